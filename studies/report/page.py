"""The report: one page of every result that is kept, which needs nothing but itself."""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

import sweeps
from studies import registry, results
from studies.cli.output import harmless
from studies.maps import maps
from studies.report.answers import answers
from studies.report.battery import battery
from studies.report.context import OVERVIEW, Broken, Result, overview, shown, table, why
from studies.report.explained import explained
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
    contents, missing, broken = gather(names, out)
    folder = results.results_folder(out)
    if not contents:
        begin = results.command("run", [*missing, ""][0], out)
        nothing = f"{folder}: nothing of this has been computed there yet; begin with: {begin}"
        raise InputError(broken[0].line if broken else nothing)
    target = registry.expanded(file) if file else folder / "report.html"
    whole = page(contents, missing, out, broken)
    for each in broken:
        warn(each.line)
    with written(target) as temporary:
        temporary.write_text(whole, encoding="utf-8", newline="\n")
    return target


def gather(names: Sequence[str], out: str | Path | None) -> tuple[list[Result], list[str], list[Broken]]:
    """The results there are, in the order of the studies; the studies there are none of; what cannot be shown."""
    kept_maps = sorted(map(str, (results.results_folder(out) / maps.NAME).glob("*.nc")))
    contents, missing, broken = list[Result](), list[str](), list[Broken]()
    at_points = [f"{name}{suffix}" for name in registry.names() for suffix in registry.SUFFIXES]
    at_points = [name for name in at_points if results.is_there(results.file_of(name, out))]
    for target in dict.fromkeys(names or [*registry.names(), *at_points, *kept_maps]):
        file = results.results_file(target, out)
        try:
            dataset = results.open_dataset(target, out)
            study = results.study_of(dataset, str(file))
            own = None if results.is_path(target) else out
            contents.append(Result(study, dataset, file, sweeps.status(file).state, target, own))
        except FileNotFoundError:
            if target not in registry.names():
                raise
            missing.append(target)
        except KeyError:
            broken.append(Broken(target, f"{file}: it is not the result of a study"))
        except Exception as problem:  # noqa: BLE001 - a file that is no result takes no other with it
            broken.append(Broken(target, why(problem)))
    return contents, missing, broken


def page(
    contents: Sequence[Result],
    missing: Sequence[str],
    out: str | Path | None = None,
    broken: list[Broken] | None = None,
) -> str:
    """The whole page; the same results give the same bytes. What turns out to be `broken` is added there."""
    broken = [] if broken is None else broken
    whole = []
    for result in contents:
        try:
            whole.append((result, overview(result), shown(result), answers(result.study.name, result.dataset)))
        except Exception as problem:  # noqa: BLE001 - a file or a study of one's own takes no other section with it
            broken.append(Broken(result.target, f"{result.file}: {why(problem)}"))
    titles = {result.study.name: (result.anchor, result.title) for result, *_ in reversed(whole)}
    findings = {result.study.name: each for result, _, _, each in reversed(whole)}
    names = dict(
        [("found", "What we found")] * any(findings.values())
        + [("rig", "Rig, symbols, regimes"), ("overview", "Overview")]
        + [(result.anchor, result.short) for result, *_ in whole]
        + [(each.anchor, each.title) for each in broken]
        + [("missing", "Not run yet")] * bool(missing)
    )
    environment = Environment(
        autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined, finalize=_harmless
    )
    environment.policies["json.dumps_function"] = lambda data, **options: json.dumps(_harmless(data), **options)
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    style, script = _own("page.css"), "\n".join(map(_own, SCRIPTS))
    return environment.from_string(_own("page.html.j2")).render(
        results=[(result, parts) for result, _, parts, _ in whole],
        overview=table(OVERVIEW, [row for _, row, _, _ in whole], "What is in this page"),
        newest=max((result.made for result, *_ in whole), default=""),
        battery=battery(out),
        index=names.items(),
        answers=[(*titles[name], each) for name in registry.MODULES for each in findings.get(name, ())],
        explained=(words := explained()),
        symbols=table(("symbol or name", "meaning", "the paper's value"), words["symbols"], "Symbols and names"),
        rig=_own("rig.svg"),
        broken=broken,
        missing=[(registry.load(name), results.command("run", name, out)) for name in missing],
        style=style,
        style_digest=_digest(style),
        script=script,
        script_digest=_digest(script),
    )


def _harmless(value: Any) -> Any:
    """A value for the page, without what turns the direction of texts round; the page's own stays."""
    if isinstance(value, str) and not isinstance(value, Markup):
        return harmless(value)
    if isinstance(value, dict):
        return {_harmless(key): _harmless(each) for key, each in value.items()}
    return [_harmless(each) for each in value] if isinstance(value, (list, tuple)) else value


def _own(name: str) -> str:
    """A file of this package."""
    return files("studies.report").joinpath(name).read_text(encoding="utf-8")


def _digest(text: str) -> str:
    """How the page's policy names a style or script: those with another digest count for nothing."""
    return "sha256-" + b64encode(sha256(text.encode()).digest()).decode()
