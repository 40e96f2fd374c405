"""The paper, the published scheme and the model in one table: `python -m tests.benchmarks.damping`.

Each study that reproduces a transient of the paper is run with either numerical damping. It prints a table of the
README.
"""

from __future__ import annotations

import tempfile

import studies
from studies.registry import resolve
from studies.tables import Table

STUDIES = ("fig7", "contact", "fig11", "table6", "stick_time")


def beside_the_paper(name: str, numerical_damping: str, folder: str) -> dict[tuple[str, str], list[str]]:
    """Rows of a study's table beside the paper: by figure and place the paper's value, that found, the section."""
    found = studies.run(name, out=f"{folder}/{numerical_damping}", numerical_damping=numerical_damping)
    parts = resolve(name).findings(found)
    tables = [part for part in parts if isinstance(part, Table) and part.heads[0] == "beside the paper"]
    return {(row[0], row[1]): [row[2], row[3], row[5]] for table in tables for row in table.rows}


def main() -> None:
    """Print the table."""
    print("| Figure | at | paper | published scheme | model | section |")
    print("| --- | --- | --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for name in STUDIES:
            published, model = (beside_the_paper(name, damping, folder) for damping in ("published", "none"))
            for (figure, place), (value, found, section) in published.items():
                given = model.get((figure, place), ["", "-", ""])[1]
                print(f"| `{name}`: {figure} | {place} | {value} | {found} | {given} | {section} |", flush=True)


if __name__ == "__main__":
    main()
