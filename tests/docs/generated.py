"""Tables of the READMEs that the project computes: `python -m tests.docs.generated` writes them.

A table stands between `<!-- benchmarks: PART.TABLE -->` or `<!-- claims -->` and `<!-- end -->`.
"""

import re

import pandas as pd
import xarray as xr

from studies import claims, registry
from tests import HOME
from tests.benchmarks import tables
from tests.docs import readmes

CLAIMS = re.compile(r"(<!-- claims -->\n).*?(<!-- end -->)", re.DOTALL)


def claims_table() -> str:
    """Every claim of the paper beside the reference, as Markdown."""
    parts = []
    for name in registry.NAMES:
        with xr.open_dataset(HOME / "results" / "reference" / name / f"{name}.nc") as data:
            parts.append(claims.beside(data, registry.load(name).claims).assign(study=f"`{name}`"))
    table = pd.concat([part for part in parts if len(part)])
    heads = list(table.columns)
    return tables.lines(heads, table.astype(str).values.tolist())


def rendered(text: str) -> str:
    """A README with the tables of today."""
    text = CLAIMS.sub(lambda found: found[1] + claims_table() + found[2], text)
    return tables.rendered(text, tables.load())


if __name__ == "__main__":
    for name in readmes.NAMES:
        (HOME / name).write_text(rendered((HOME / name).read_text(encoding="utf-8")), encoding="utf-8")
