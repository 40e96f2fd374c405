"""The paper, the published scheme and the model in one table.

The reference of each study that reproduces a transient of the paper has the published scheme's numerical damping;
here it is run without.
"""

from __future__ import annotations

import tempfile

import xarray as xr

import studies
from studies.registry import resolve
from studies.results import FOLDER
from studies.tables import Table as Findings
from tests.benchmarks.tables import Column, Table

STUDIES = ("fig7", "contact", "fig11", "table6", "stick_time")


def beside_the_paper(name: str, found: xr.Dataset) -> dict[tuple[str, str], list[str]]:
    """Rows of a study's table beside the paper: by figure and place the paper's value, that found, the section."""
    tables = [part for part in resolve(name).findings(found) if isinstance(part, Findings)]
    rows = [row for table in tables if table.heads[0] == "beside the paper" for row in table.rows]
    return {(row[0], row[1]): [row[2], row[3], row[5]] for row in rows}


def transients() -> Table:
    """Every figure of the paper's transients by both answers."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in STUDIES:
            published = beside_the_paper(name, studies.open(f"results/{FOLDER}/{name}/{name}.nc"))
            model = beside_the_paper(name, studies.run(name, out=folder, numerical_damping="none"))
            for (figure, place), (value, found, section) in published.items():
                given = model.get((figure, place), ["", "-", ""])[1]
                rows.append([f"`{name}`: {figure}", place, value, found, given, section])
    heads = ("Figure", "at", "paper", "published scheme", "model", "section")
    return Table([Column(each) for each in heads], rows)


TABLES = {"transients": transients}
