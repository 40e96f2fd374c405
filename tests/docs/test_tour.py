"""The notebook studies/tour.ipynb: small, of no machine, and it runs."""

import ast
import json
import re

import pytest

from tests import HOME

TOUR = HOME / "studies" / "tour.ipynb"


def test_the_tour_is_small_whole_and_of_no_machine():
    text = TOUR.read_text()
    assert len(text) <= 300_000
    assert not re.search(r"/(home|root|tmp|work|Users)/|[A-Z]:\\\\", text)
    cells = json.loads(text)["cells"]
    assert [c["source"][0].strip() for c in cells if "".join(c["source"]).startswith("## ")] == [
        "## 1. Fig. 5 of the paper",
        "## 2. A rig of your own",
        "## 3. A structure of your own",
        "## 4. A sweep",
        "## 5. A fit",
    ]
    for cell in (c for c in cells if c["cell_type"] == "code"):
        lines = [line for line in "".join(cell["source"]).splitlines() if not line.startswith("%")]
        # Names that an import takes exist; each cell has its outputs.
        exec(
            "\n".join(
                ast.unparse(n) for n in ast.walk(ast.parse("\n".join(lines))) if isinstance(n, ast.ImportFrom)
            )
        )
        assert cell["outputs"]
        assert not [each for each in cell["outputs"] if each["output_type"] == "error"]


@pytest.mark.slow
def test_the_tour_runs(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    notebook = nbformat.read(TOUR, 4)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": tmp_path}}).execute()
    shown = [out for cell in notebook.cells for out in cell.get("outputs", ())]
    assert sum("image/png" in each.get("data", {}) for each in shown) == 5
    assert "0.111233" in str(shown)
