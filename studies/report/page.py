"""The report: one page of every result, which needs no network and no other file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pandas as pd
from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

import sweeps
from studies import registry, runner
from studies.answering import results, summary
from studies.asking import rigs
from studies.declaring import labels
from studies.declaring.parameters import KNOWN
from studies.report.section import Result, Tell, content, date, failure_text, packed
from sweeps import InputError, MissingFileError

HERE = Path(__file__).parent
# A result with what the page says of it; those of an earlier page by their file, with its version.
Section = tuple[Result, dict[str, Any]]
Known = dict[Path, tuple[Any, Section]]


def write(
    targets: Sequence[str], out: str | Path | None, file: str | Path | None, tell: Tell, known: Known | None = None
) -> Path:
    """Write the page of some results, or of all of the results folder, its rigs and the reference; its path.

    `targets` are studies or maps by name, or paths of netCDF files; all if there are none. The page is `file`, by
    default `report.html` in the results folder. `tell` is given a line for all results that are the reference's,
    and for each thing that cannot be shown. `known` has sections of an earlier page, taken where a file is the
    same, and gets those of this page. An `InputError` names an unknown name, or says that nothing can be shown.
    """
    sections, broken = opened(names(targets, out), out, tell, {} if known is None else known)
    if not sections:
        raise InputError(broken[0])
    if notice := of_reference(sections):
        tell(notice)
    target = results.expanded(file) if file else results.results_folder(out) / "report.html"
    whole = page(sections, broken, out)
    with runner.atomic_write(target) as temporary:
        temporary.write_text(whole, encoding="utf-8", errors="backslashreplace", newline="\n")
    return target


def names(targets: Sequence[str], out: str | Path | None) -> list[str]:
    """The results on the page, by name or path."""
    names = [registry.resolve(each).name if results.is_script(each) else each for each in dict.fromkeys(targets)]
    return names or everything(results.results_folder(out))


def version(file: Path) -> tuple[Any, ...]:
    """A value that changes when a result changes, or when a run of it begins or ends."""
    return sweeps.Store(file).is_locked(), *sweeps.Store(file).version()


def own_files(folder: Path) -> list[Path]:
    """Every result of a folder in the order of the studies, then those of each of its rigs."""
    order = registry.names()
    place = {name: number for number, name in enumerate(order)}
    folders = [folder, *(folder / name for name in rigs.names(folder))]
    return [
        file
        for each in folders
        for file in sorted(results.stored(each), key=lambda file: place.get(file.stem, len(order)))
    ]


def everything(folder: Path) -> list[str]:
    """Every result of a folder and of its rigs, and the reference of studies that the folder itself lacks."""
    own, order, reference = own_files(folder), registry.names(), results.reference_folder(folder)
    if not own:
        show = f"; show the reference with: fiv report --out {reference} --file report.html"
        lacks = "has no results" if folder.is_dir() else "does not exist"
        (first,) = registry.names_for("first")
        begin = results.command("run", first, None if folder == Path("results") else folder)
        raise InputError(f"{folder}: the folder {lacks}; begin with: {begin}{show if reference.is_dir() else ''}")
    there = {file.stem for file in results.stored(folder)}
    others = (results.file_of(name, reference) for name in order if name not in there)
    return [str(file) for file in (*own, *others) if sweeps.Store(file).exists()]


def opened(
    names: Sequence[str], out: str | Path | None, tell: Tell, known: Known
) -> tuple[list[Section], list[str]]:
    """The results with their sections, and for each file that is none a line with the reason, told as well."""
    sections, broken = list[Section](), list[str]()
    for name in names:
        file = results.results_file(name, out)
        try:
            now = version(file)
            if known.get(file, ("",))[0] != now:
                dataset = results.open_dataset(name, out)
                result = Result(runner.study_of(dataset, str(file)), dataset, file, sweeps.status(file))
                with results.damage_as_error(file):
                    known[file] = now, (result, content(result, tell))
            sections.append(known[file][1])
        except MissingFileError:
            raise
        except Exception as problem:  # noqa: BLE001 - a bad file, or a study that fails to load, is named on the page
            why = failure_text(problem)
            broken.append(why if str(file) in why else f"{file}: {why}")
            tell(broken[-1])
    return sections, broken


def of_reference(sections: Sequence[Section]) -> str:
    """A sentence that names the studies shown from the reference; "" if there are none."""
    studies = [result for result, _ in sections if result.name in registry.names()]
    theirs = [result.name for result in studies if result.is_reference]
    own, from_project = {result.name for result in studies if not result.is_reference}, "the project's reference"
    if theirs and not own:
        return f"you have run none of the studies; all are shown from {from_project}"
    rest = f"the rest is shown from {from_project}: {', '.join(name for name in theirs if name not in own)}"
    return f"you have run {len(own)} of the {len(own.union(theirs))} studies; {rest}" if theirs else ""


def grouped(sections: Sequence[Section], out: str | Path | None) -> dict[str, tuple[str, list[Section]]]:
    """The sections under their headings with a note: one's own, each rig's with its numbers, the project's."""
    folder, groups = results.results_folder(out), dict[str, tuple[str, list[Section]]]()
    named = {(folder / name).resolve(): name for name in rigs.names(out)}
    named |= {folder.resolve(): name} if (name := results.rig_in(folder)) else {}
    for section in sorted(sections, key=lambda each: each[0].is_reference):
        file = section[0].file.resolve()
        rig, place = next(((named[each], each) for each in file.parents if each in named), ("", folder))
        heading = f"Rig {rig}" if rig else "Your results"
        heading, rig = ("The project's results", "") if section[0].is_reference else (heading, rig)
        note = rigs.title(rig, place.parent) if rig else ""
        groups.setdefault(heading, (note, []))[1].append(section)
    return groups


def page(sections: Sequence[Section], broken: Sequence[str], out: str | Path | None) -> str:
    """The whole page; equal results give equal pages."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, loader=FileSystemLoader(HERE))
    style, player, script = ((HERE / name).read_text("utf-8") for name in ("page.css", "player.js", "page.js"))
    script = player + script
    return environment.get_template("page.html.j2").render(
        groups=grouped(sections, out),
        notice=of_reference(sections),
        newest=date(max(result.stamp for result, _ in sections)),
        broken=broken,
        rig=Markup((HERE / "rig.svg").read_text("utf-8")),
        friction=friction(sections),
        symbols=Markup(summary.html(symbols())),
        library=packed(datatables("js")),
        styles=[Markup(datatables("css")), Markup(style)],
        script=Markup(script),
        digest=b64encode(sha256(script.encode()).digest()).decode(),
    )


def friction(sections: Sequence[Section]) -> str:
    """Describe the law of friction of the results on the page."""
    falls = [
        result.name
        for result, _ in sections
        if "kinetic_ratio" in result.dataset and bool((result.dataset["kinetic_ratio"] < 1.0).any())
    ]
    law = "Friction is Coulomb's with one constant coefficient μ, the same in stick and in slip and at every speed"
    return f"{law}; but it falls with the speed in {', '.join(falls)}." if falls else f"{law}."


def datatables(kind: str) -> str:
    """Script or style of DataTables, from the bundle that itables brings for pages without a network."""
    found: Any = find_spec("itables")  # its import would read the user's configuration of notebooks
    return (Path(found.origin).parent / "html" / f"dt_bundle.{kind}").read_text("utf-8")


def symbols() -> pd.DataFrame:
    """The parameters of a scene and its rig, with the paper's values."""
    rows = [
        (labels.SYMBOLS.get(name, name), p.text, labels.named(name, p.default, p.units).partition(" = ")[2])
        for name, p in KNOWN.items()
    ]
    return pd.DataFrame(rows, columns=["parameter", "meaning", "the paper's value"])
