"""Tables of the READMEs that the project computes: `python -m tests.docs.generated` writes them.

A table stands between `<!-- benchmarks: PART.TABLE -->`, `<!-- claims -->` or `<!-- accuracy -->` and
`<!-- end -->`.
"""

import re

import pandas as pd
import xarray as xr

from studies import claims, registry
from studies.accuracy import presentation
from tests import HOME
from tests.benchmarks import tables
from tests.docs import readmes

COMPUTED = re.compile(r"(<!-- (claims|accuracy) -->\n).*?(<!-- end -->)", re.DOTALL)


def claims_table() -> str:
    """Every claim of the paper beside the reference, as Markdown."""
    parts = []
    for name in registry.NAMES:
        with xr.open_dataset(HOME / "results" / "reference" / name / f"{name}.nc") as data:
            parts.append(claims.beside(data, registry.load(name).claims).assign(study=f"`{name}`"))
    table = pd.concat([part for part in parts if len(part)])
    heads = list(table.columns)
    return tables.lines(heads, table.astype(str).values.tolist())


def accuracy_table() -> str:
    """Cost and errors of every method and setting in the reference, as Markdown."""
    with xr.open_dataset(HOME / "results" / "reference" / "accuracy" / "accuracy.nc") as data:
        table = presentation.table(data)
    frame = table[["method", "setting", "cost", "time", "speed_up"]].copy()
    for group in presentation.GROUPS:
        frame[f"{group}: error"] = table[f"mismatch {group}"]
        frame[f"{group}: right at"] = [
            f"{r}/{c}" for r, c in table[[f"right {group}", f"compared {group}"]].values
        ]
    heads = {"cost": "CPU s per s", "time": "CPU s to a standard error of 0.005", "speed_up": "speed-up"}
    cells = frame.rename(columns=heads).map(lambda cell: f"{cell:.3g}" if isinstance(cell, float) else cell)
    return tables.lines(list(cells.columns), cells.replace({"nan": "-", "0/0": "-"}).astype(str).values.tolist())


def rendered(text: str) -> str:
    """A README with the tables of today."""
    made = {"claims": claims_table, "accuracy": accuracy_table}
    text = COMPUTED.sub(lambda found: found[1] + made[found[2]]() + found[3], text)
    return tables.rendered(text, tables.load())


if __name__ == "__main__":
    for name in readmes.NAMES:
        (HOME / name).write_text(rendered((HOME / name).read_text(encoding="utf-8")), encoding="utf-8")
