"""A study of one's own in the folder of each test: quick, with one point that fails."""

from pathlib import Path

import pytest

OWN = """
import os
import numpy as np
from studies.study import Parameter, Study

def squares(x, kind, gain):
    if np.any(x == 2.0) and not os.path.exists("mended"):
        raise ValueError("two is too much")
    return {"y": gain * x**2}

def summarise(data):
    yield f"The largest square is {float(data['y'].max()):g}."

STUDY = Study(
    "squares", "Squares", "How large are squares?",
    {"x": Parameter([1.0, 3.0, 4.0], "m", "side"), "kind": Parameter(["plain", "odd, even"], text="kind"),
     "gain": Parameter(2.0, "1", "gain")},
    {"y": ("m", "square")}, squares, summary=summarise,
)
"""


@pytest.fixture
def own(tmp_path, forgetful):
    """The file of the study."""
    path = tmp_path / "own.py"
    path.write_text(OWN)
    return path


@pytest.fixture
def folder(tmp_path):
    """Names of the files in the test's folder, without locks."""

    def names() -> list[str]:
        files = (
            path for path in Path(tmp_path).rglob("*") if path.is_file() and path.suffix not in (".lock", ".py")
        )
        return sorted(str(path.relative_to(tmp_path)) for path in files if "__pycache__" not in path.parts)

    return names
