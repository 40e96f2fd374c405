"""The report: one page of every result that is kept, which needs nothing but itself."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Sequence
from hashlib import sha256
from importlib.resources import files
from pathlib import Path

import sweeps
from studies import registry, runner
from studies.maps import maps
from studies.report.markup import Markup, code, tag
from studies.report.parts import command, table
from studies.report.section import Result, section
from sweeps import duration

SCRIPTS = ("page.js", "filter.js", "table.js", "map.js")
HEADS = ("study", "points", "failed", "time of computing", "computed")
TITLE = "Friction-induced vibration: results"


def write(
    names: Sequence[str], out: str | Path | None, file: str | Path | None, told: Callable[[str], None]
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
    told : callable
        Given a line for each file that cannot be shown.

    Raises
    ------
    ValueError
        For an unknown study, or where there is nothing to show.
    StoreError
        If the page cannot be written.
    """
    results, missing, problems = gather(names, out)
    folder = runner.results_folder(out)
    if problems and not results:
        raise ValueError(problems[0])
    for problem in problems:
        told(problem)
    if not results:
        first = missing[0]
        raise ValueError(f"{folder}: nothing of this has been computed there yet; begin with: fiv run {first}")
    target = Path(file).expanduser() if file else folder / "report.html"
    whole = page(results, missing)
    with runner.written(target) as temporary:
        temporary.write_text(whole, encoding="utf-8", newline="\n")
    return target


def gather(names: Sequence[str], out: str | Path | None) -> tuple[list[Result], list[str], list[str]]:
    """The results there are, in the order of the studies; the studies there are none of; what cannot be shown."""
    targets = list(dict.fromkeys(names)) or [*registry.NAMES, *_maps(out)]
    results, missing, problems = [], [], []
    for target in targets:
        file = runner.results_file(target, out)
        try:
            dataset = runner.open_dataset(target, out)
            study = runner.study_of(dataset, str(file))
            state = sweeps.status(file).state
        except FileNotFoundError:
            if target not in registry.NAMES:
                raise
            missing.append(target)
        except (KeyError, ValueError) as problem:
            clear = isinstance(problem, ValueError)
            problems.append(str(problem) if clear else f"{file}: it is not the result of a study")
        else:
            results.append(Result(study, dataset, file, state, target))
    return results, missing, problems


def _maps(out: str | Path | None) -> list[str]:
    return sorted(map(str, (runner.results_folder(out) / maps.NAME).glob("*.nc")))


def page(results: Sequence[Result], missing: Sequence[str]) -> str:
    """The whole page; the same results give the same bytes."""
    style, script = code("style", _own("page.css")), code("script", "\n".join(map(_own, SCRIPTS)))
    newest = max((result.made for result in results), default="")
    rows = [
        [
            tag("a", result.title, href=f"#{result.anchor}"),
            f"{result.dataset['status'].size}",
            f"{result.counts.get('failed', 0)}",
            duration(result.seconds),
            result.made or result.state,
        ]
        for result in results
    ]
    head = tag(
        "head",
        tag("meta", charset="utf-8"),
        tag("meta", name="viewport", content="width=device-width, initial-scale=1"),
        tag("meta", name="color-scheme", content="light dark"),
        tag("meta", http_equiv="Content-Security-Policy", content=_policy(style, script)),
        tag("title", TITLE),
        tag("link", rel="icon", href="data:,"),
        style,
    )
    body = tag(
        "body",
        tag("a", "To the results", href="#results", class_="skip"),
        tag(
            "header",
            tag("h1", TITLE),
            tag(
                "p",
                "Two beams in frictional point contact: what was computed, beside what the paper says.",
                class_="lead",
            ),
            tag("p", f"Newest result: {newest}" if newest else "", class_="note"),
        ),
        tag(
            "main",
            tag("h2", "Overview", id="overview"),
            tag("nav", table(HEADS, rows, "What is in this page"), aria_labelledby="overview", class_="overview"),
            [section(result) for result in results],
            _missing(missing),
            id="results",
        ),
        script,
    )
    return f"<!doctype html>\n{tag('html', head, body, lang='en')}\n"


def _missing(missing: Sequence[str]) -> Markup:
    if not missing:
        return Markup("")
    told = [
        [tag("dt", registry.load(name).title), tag("dd", registry.load(name).question, command(f"fiv run {name}"))]
        for name in missing
    ]
    return tag(
        "section",
        tag("h2", "Not run yet", id="missing-title"),
        tag("dl", told, class_="missing"),
        aria_labelledby="missing-title",
    )


def _own(name: str) -> str:
    """A file of this package."""
    return files("studies.report").joinpath(name).read_text(encoding="utf-8")


def _policy(style: Markup, script: Markup) -> str:
    """What the page may do: nothing is fetched, and only the project's own style and script count."""
    digests = [
        b64encode(sha256(each.partition(">")[2].rpartition("</")[0].encode()).digest()).decode()
        for each in (style, script)
    ]
    return f"default-src 'none'; img-src data:; style-src 'sha256-{digests[0]}'; script-src 'sha256-{digests[1]}'"
