"""The paper, the published scheme and the model in one table.

The reference of each study that reproduces a transient of the paper has the published scheme's numerical damping;
here it is run without.
"""

from __future__ import annotations

import tempfile

import studies
from studies import registry
from studies.answering import claims
from tests import HOME
from tests.benchmarks.tables import Column, Table

STUDIES = ("fig7", "contact", "fig11", "table6", "stick_time")


def transients() -> Table:
    """Every claim on the paper's transients by both answers."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name in STUDIES:
            listed = registry.load(name).claims
            published, model = (
                claims.beside(data, listed).set_index(["quantity", "at"])
                for data in (
                    studies.open(HOME / "results" / "reference" / name / f"{name}.nc"),
                    studies.run(name, out=folder, numerical_damping="none"),
                )
            )
            for (quantity, place), row in published.iterrows():
                other = model["computed"].get((quantity, place), "-")
                rows.append([f"`{name}`: {quantity}", place, row["paper"], row["computed"], other, row["section"]])
    heads = ("Figure", "at", "paper", "published scheme", "model", "section")
    return Table([Column(head) for head in heads], rows)


TABLES = {"transients": transients}
