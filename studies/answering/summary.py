"""Summaries as data: sentences and captioned tables, as text for a terminal and as HTML for the page."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from studies.answering import claims
from studies.answering.results import configuration, is_usual, settings, structure_in
from studies.declaring import labels
from studies.declaring.parameters import RIG, SCENE
from studies.motion import above, mixed
from sweeps import DONE, FAILED, PENDING

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from studies.study import Study

# Failed points that a summary lists.
LISTED = 5
# Columns of a table where the output is no terminal.
WIDTH = 100


def presented(study: Study, dataset: xr.Dataset) -> xr.Dataset | None:
    """The result for summary and figure; None if they do not apply, or if no point is done.

    They apply to a result with the study's own dimensions. An unfinished result gets the study's derived
    variables; pending points have no values.
    """
    status = dataset["status"]
    if not (is_usual(dataset, study.dims) and (status == DONE).any()):
        return None
    return study.derive(dataset) if study.derive is not None and (status == PENDING).any() else dataset


def parts(study: Study, dataset: xr.Dataset) -> Iterator[Any]:
    """The whole summary of a result: what is fixed, the study's own parts, the paper's claims, failed points."""
    yield fixed_text(study, dataset)
    yield from (f"Of the structure: {remark}." for remark in structure_in(dataset).get("remarks", ()))
    if pending := int((dataset["status"] == PENDING).sum()):
        yield f"{pending} of {dataset['status'].size} points are not computed yet; this is of the others."
    shown = presented(study, dataset) if study.summary is not None else None
    yield from general(dataset) if shown is None or study.summary is None else study.summary(shown)
    beside = claims.beside(dataset if shown is None else shown, study.claims)
    if len(beside):
        yield "Beside the paper", beside
    yield from above.told(dataset)
    yield from mixed.told(dataset)
    yield from failures(dataset)


def fixed_text(study: Study, dataset: xr.Dataset) -> str:
    """The operating point, and other fixed parameters that differ from the study's defaults."""
    text = fixed_parts(study, dataset)
    if set(RIG) <= set(settings(dataset)) and claims.is_papers_rig(dataset):
        if not text:
            return "On the paper's rig."
        text.append("the paper's rig")
    # A number is a place, a rig is none.
    return f"{'At' if ' = ' in text[0] else 'For'} {', '.join(text)}." if text else f"{study.title}."


def fixed_parts(study: Study, dataset: xr.Dataset, *, figure: bool = False) -> list[str]:
    """Fixed numbers: those of the scene, and others that differ from their default; a figure counts draws."""
    values = {name: value for name, value in settings(dataset).items() if name in dataset.coords}
    defaults = {name: parameter.default for name, parameter in study.parameters.items()}
    drawn = configuration(dataset).get("constants", {}).get("distributions", {}) if figure else {}
    named = [name for name, value in values.items() if name in SCENE or value != defaults.get(name, value)]
    text = [labels.named(n, values[n], str(dataset[n].attrs.get("units", "1"))) for n in named if n not in drawn]
    text += [structure["name"]] if (structure := structure_in(dataset)) else []
    return text + [f"{len(drawn)} uncertain parameter" + "s" * (len(drawn) > 1)] * bool(drawn)


def was_set(study: Study, dataset: xr.Dataset) -> str:
    """The parameters that were set, for the small print of a figure."""
    parts = [
        labels.named(str(d), dataset[d][0]) for d in dataset["status"].dims if dataset.sizes[d] == 1 and d in SCENE
    ]
    parts += fixed_parts(study, dataset, figure=True)
    if "numerical_damping" in dataset.coords and not dataset["numerical_damping"].ndim:
        published = str(dataset["numerical_damping"].values) == "published"
        parts = [part for part in parts if not part.startswith("numerical damping")]
        parts += [f"{'with' if published else 'without'} the published scheme's numerical damping"]
    return "set: " + ", ".join(parts) if parts else ""


def missing(dataset: xr.Dataset) -> str:
    """The numbers of failed points and of points not computed yet; "" if there are none."""
    status = dataset["status"].values
    counts = {"failed": int((status == FAILED).sum()), "not computed yet": int((status == PENDING).sum())}
    return "; ".join(f"{n} of {status.size} points {what}" for what, n in counts.items() if n)


def quantities(dataset: xr.Dataset) -> list[str]:
    """Outputs with one number at each point, without standard errors."""
    kinds = {str(name): (array.dims, array.dtype.kind) for name, array in dataset.data_vars.items()}
    names = [name for name, kind in kinds.items() if kind == (dataset["status"].dims, "f")]
    return [name for name in names if name != "wall_time" and not name.endswith("_se")]


def general(dataset: xr.Dataset) -> Iterator[Any]:
    """Quantiles of each variable with one number at each point, and its rank correlations with the parameters."""
    import pandas as pd

    dims = dataset["status"].dims
    done = dataset["status"] == DONE
    yield f"{int(done.sum())} of {done.size} points computed, along {', '.join(map(str, dims))}."
    names, rows = quantities(dataset), []
    for name in names:
        values = labels.readable(dataset[name].where(done)).values
        finite = values[np.isfinite(values)]
        low, middle, high = np.quantile(finite, (0.05, 0.5, 0.95)) if len(finite) else (np.nan,) * 3
        rows.append((f"{name} {labels.unit_of(dataset[name])[0]}".strip(), len(finite), low, middle, high))
    if done.any() and (empty := [name for name, row in zip(names, rows, strict=True) if not row[1]]):
        yield f"No point has a value of {', '.join(empty)}: every computation returned NaN or infinity."
    if rows and done.any():
        yield "Quantiles", pd.DataFrame(rows, columns=["quantity", "points", "5 %", "median", "95 %"])
    elif not rows:
        yield "No output has one number a point; fiv query prints them."
    varied = [
        str(n) for n, c in dataset.coords.items() if c.ndim and set(c.dims) <= set(dims) and c.dtype.kind == "f"
    ]
    points = dataset[names].where(done).to_dataframe().reset_index()
    if varied and names and len(points) >= 8:
        ranks = points[[*varied, *names]].rank()
        table = ranks.corr().loc[names, varied].dropna(how="all").round(3)
        if len(table):
            yield "Rank correlations (Spearman)", table.rename_axis("quantity").reset_index()


def failures(dataset: xr.Dataset) -> Iterator[str]:
    """Failed points with their reasons: one line if all have the same reason, else the first points."""
    failed = np.argwhere((dataset["status"] == FAILED).values)
    if not len(failed):
        return
    status = dataset["status"]
    points = [dataset.isel(dict(zip(status.dims, place, strict=True))) for place in failed[:LISTED]]
    if "error" in dataset:
        reasons = set(dataset["error"].values[(status == FAILED).values])
        if len(failed) > 1 and len(reasons) == 1:
            yield f"{len(failed)} of {status.size} points failed: {reasons.pop()}"
            return
    for point in points:
        where = ", ".join(labels.named(str(dim), point[dim]) for dim in status.dims)
        yield f"failed: {where}: {point['error'].item() if 'error' in point else 'the file has no reason'}"
    if len(failed) > LISTED:
        yield f"and {len(failed) - LISTED} more failed"


def text(parts: Iterable[Any], width: int | None = None) -> str:
    """A summary as text no wider than the terminal."""
    width = width or shutil.get_terminal_size((WIDTH, 24)).columns
    blocks = list[str]()
    for part in parts:
        if isinstance(part, str):
            blocks.append(textwrap.fill(part, width))
        else:
            caption, table = part
            blocks.append(f"\n{textwrap.fill(caption, width - 1)}:\n{table_text(table, width)}\n")
    return "\n".join(blocks).replace("\n\n\n", "\n\n").strip("\n")


def table_text(table: pd.DataFrame, width: int) -> str:
    """A table as aligned columns, in blocks that fit the width."""
    if not len(table):
        return "(none)"
    shown = table.map(labels.number)
    return str(shown.to_string(index=False, line_width=width, na_rep="-"))


def html(table: pd.DataFrame) -> str:
    """A table as HTML; texts are escaped."""
    return str(
        table.map(labels.number)
        .rename_axis(columns=None)
        .to_html(index=False, border=0, classes="data", na_rep="-")
    )
