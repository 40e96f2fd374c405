"""Packages, classes and functions to be told apart, for the tests of what code does."""

import dataclasses
import enum
import importlib
import os
import subprocess
import sys
import textwrap
from pathlib import Path

HOME = Path(__file__).parents[1]

FILES = {
    "__init__.py": "",
    "main.py": '''
        """The module computes."""

        from __future__ import annotations

        from typing import TYPE_CHECKING

        import numpy as np

        from ident import api, tools
        from ident.api import helper
        from ident.decorators import doubled
        from ident.models import Model
        from ident.settings import DEFAULT, ORDER
        import ident.deep.inner

        if TYPE_CHECKING:
            from ident.figures import Figure

        SCALE = 2.0
        LIMITS: dict[str, float] = {"low": 0.0}
        LIMITS["high"] = 9.0


        @doubled
        def compute(points, factor=DEFAULT):
            """What it gives."""
            from ident.late import arrive

            model = Model(points["x"])  # a remark
            total = SCALE * helper(model.value) + tools.shift(1.0) + ident.deep.inner.depth() + arrive()
            return {"y": np.sin(total) * factor * ORDER + LIMITS["low"]}


        def draw(figure: Figure, color="blue"):
            return tools.paint(figure, color)
        ''',
    "api.py": "from ident.core import helper as helper, other\n",
    "core.py": "def helper(x):\n    return x + 1\n\n\ndef other(x):\n    return x\n",
    "tools.py": """
        STEP = 1

        def shift(x):
            return x + STEP

        def paint(figure, color):
            return color
        """,
    "decorators.py": "def doubled(f):\n    return lambda *a, **k: f(*a, **k)\n",
    "models.py": """
        from dataclasses import dataclass

        class Base:
            unit = 1.0

        @dataclass
        class Model(Base):
            value: float
            weight: float = 3.0
        """,
    "settings.py": """
        import sys

        DEFAULT = 1.5
        if sys.platform == "nowhere":
            ORDER = 1
        else:
            ORDER = 2
        UNUSED = 7
        """,
    "deep/__init__.py": "",
    "deep/inner.py": "def depth():\n    return 4\n\n\ndef unused():\n    return 5\n",
    "late.py": "def arrive():\n    return 6\n",
    "figures.py": "class Figure:\n    size = 8\n",
}

# What names stand for that the text does not say; what running changes.
NAMED = {
    "__init__.py": "",
    "late.py": "import os\nT = float(os.environ.get('T', 1))\n",
    "settings.py": """
        import os
        from pathlib import Path

        import numpy as np

        SAID, WORDS, NUMBER = 2.0, "a", 1
        FOLDER = str(Path(__file__).parent)
        COUNT = int("1")
        TABLE = np.arange(3.0) / 7
        HELD = np.zeros(2)
        SEEN = list()
        LAST = int("0")
        UNUSED = float("5")

        def keep(held):
            global LAST
            LAST += 1
            HELD[0] = held
            return LAST, HELD
        """,
    "main.py": """
        from ident import settings

        LOCAL = float("3")
        RUNS = 0

        def f(points):
            global RUNS
            from ident.late import T
            RUNS += 1
            settings.SEEN.append(points)
            here = settings.FOLDER, settings.WORDS, settings.NUMBER
            LOCAL = settings.SAID
            return here, LOCAL, settings.COUNT * settings.TABLE * T
        """,
}


class Package:
    """Files of a package called `ident`, which may be changed."""

    def __init__(self, folder, files):
        self.folder = folder / "ident"
        for name, text in files.items():
            self.write(name, text)

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(textwrap.dedent(text))

    def edit(self, name, old, new):
        text = (self.folder / name).read_text()
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in {name}"
        (self.folder / name).write_text(text.replace(old, new))

    def load(self, name):
        importlib.invalidate_caches()
        return importlib.import_module(f"ident.{name}")


def run(code, *folders, **environment):
    """What Python prints, in another process; of some code or of a script."""
    program = [str(code)] if isinstance(code, Path) else ["-c", textwrap.dedent(code)]
    done = subprocess.run(
        [sys.executable, *program],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))} | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        cwd=folders[0],
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def maker(held):
    def inner(points):
        return held

    return inner


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


@dataclasses.dataclass(frozen=True)
class Inner:
    size: float = 1.0
    name: str = "a"


@dataclasses.dataclass(frozen=True)
class Outer:
    inner: Inner = Inner()
    values: tuple = ()
    table: dict = dataclasses.field(default_factory=dict)
    needed: float = dataclasses.field(default=0.0, kw_only=True)


class Caller:
    def __init__(self, held):
        self.held = held

    def __call__(self, points):
        return self.held

    def method(self, points):
        return self.held

    @classmethod
    def of_class(cls, points):
        return cls
