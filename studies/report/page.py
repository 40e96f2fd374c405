"""The report: one page of every result that is kept, which needs nothing but itself."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

from jinja2 import Environment, StrictUndefined

import sweeps
from studies import registry, results
from studies.maps import maps
from studies.report.context import Result, overview, shown
from studies.runner import written
from sweeps import InputError

SCRIPTS = ("page.js", "filter.js", "table.js", "map.js")


def write(
    names: Sequence[str], out: str | Path | None, file: str | Path | None, warn: Callable[[str], None]
) -> Path:
    """Write the page of the studies called `names`, or of all, and of all maps if none is named.

    Parameters
    ----------
    names : sequence of str
        Studies, or paths of netCDF files.
    out : str or Path, optional
        The results folder.
    file : str or Path, optional
        The page; by default `report.html` in the results folder.
    warn : callable
        Given a line for each file that cannot be shown.

    Raises
    ------
    ValueError
        For an unknown study, or where there is nothing to show.
    StoreError
        If the page cannot be written.
    """
    found, missing, problems = gather(names, out)
    folder = results.results_folder(out)
    if not found:
        begin = results.command("run", [*missing, ""][0], out)
        nothing = f"{folder}: nothing of this has been computed there yet; begin with: {begin}"
        raise InputError(problems[0] if problems else nothing)
    for problem in problems:
        warn(problem)
    target = Path(file).expanduser() if file else folder / "report.html"
    whole = page(found, missing, out)
    with written(target) as temporary:
        temporary.write_text(whole, encoding="utf-8", newline="\n")
    return target


def gather(names: Sequence[str], out: str | Path | None) -> tuple[list[Result], list[str], list[str]]:
    """The results there are, in the order of the studies; the studies there are none of; what cannot be shown."""
    kept_maps = sorted(map(str, (results.results_folder(out) / maps.NAME).glob("*.nc")))
    found, missing, problems = [], [], []
    at_points = [f"{name}{suffix}" for name in registry.names() for suffix in registry.SUFFIXES]
    at_points = [name for name in at_points if results.is_there(results.file_of(name, out))]
    for target in dict.fromkeys(names or [*registry.names(), *at_points, *kept_maps]):
        file = results.results_file(target, out)
        try:
            dataset = results.open_dataset(target, out)
            study = results.study_of(dataset, str(file))
            own = None if results.is_path(target) else out
            found.append(Result(study, dataset, file, sweeps.status(file).state, target, own))
        except FileNotFoundError:
            if target not in registry.names():
                raise
            missing.append(target)
        except KeyError:
            problems.append(f"{file}: it is not the result of a study")
        except ValueError as problem:
            problems.append(str(problem))
    return found, missing, problems


def page(found: Sequence[Result], missing: Sequence[str], out: str | Path | None = None) -> str:
    """The whole page; the same results give the same bytes."""
    environment = Environment(autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined)
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    style, script = _own("page.css"), "\n".join(map(_own, SCRIPTS))
    return environment.from_string(_own("page.html.j2")).render(
        results=[(result, shown(result)) for result in found],
        overview=overview(found),
        newest=max((result.made for result in found), default=""),
        missing=[(registry.load(name), results.command("run", name, out)) for name in missing],
        style=style,
        style_digest=_digest(style),
        script=script,
        script_digest=_digest(script),
    )


def _own(name: str) -> str:
    """A file of this package."""
    return files("studies.report").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    """How the page's policy names a style or script: those with another digest count for nothing."""
    return "sha256-" + b64encode(sha256(text.encode()).digest()).decode()
