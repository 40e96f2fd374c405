"""The paper, the published scheme and the model in one table: `python -m tests.benchmarks.damping`.

The reference of each study that reproduces a transient of the paper has the published scheme's numerical damping;
here it is run without. It prints a table of results/README.md.
"""

from __future__ import annotations

import tempfile

import xarray as xr

import studies
from studies.registry import resolve
from studies.results import FOLDER
from studies.tables import Table

STUDIES = ("fig7", "contact", "fig11", "table6", "stick_time")


def beside_the_paper(name: str, found: xr.Dataset) -> dict[tuple[str, str], list[str]]:
    """Rows of a study's table beside the paper: by figure and place the paper's value, that found, the section."""
    tables = [part for part in resolve(name).findings(found) if isinstance(part, Table)]
    rows = [row for table in tables if table.heads[0] == "beside the paper" for row in table.rows]
    return {(row[0], row[1]): [row[2], row[3], row[5]] for row in rows}


def main() -> None:
    """Print the table."""
    print("| Figure | at | paper | published scheme | model | section |")
    print("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for name in STUDIES:
            published = beside_the_paper(name, studies.open(f"results/{FOLDER}/{name}/{name}.nc"))
            model = beside_the_paper(name, studies.run(name, out=folder, numerical_damping="none"))
            for (figure, place), (value, found, section) in published.items():
                given = model.get((figure, place), ["", "-", ""])[1]
                print(f"| `{name}`: {figure} | {place} | {value} | {found} | {given} | {section} |", flush=True)


if __name__ == "__main__":
    main()
