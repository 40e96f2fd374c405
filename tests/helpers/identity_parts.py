"""Packages, classes and functions to be told apart, for the tests of what code does."""

import contextlib
import dataclasses
import enum
import importlib
import io
import os
import re
import runpy
import subprocess
import sys
import textwrap
from pathlib import Path

# A program of several modules. Every marked line is reached by what `compute` of `main.py` runs, or it stands in
# another module, which counts as a whole.
PROGRAM = {
    "__init__.py": "from .core import exported\n",
    "api.py": "from ident.core import helper as helper, other  # edit: helper as -> other as\n",
    "core.py": """
        from ident.settings import *

        def exported(x):
            return x * FACTOR  # edit: FACTOR -> FACTOR + 1

        def helper(x):
            return x + 1  # edit: 1 -> 2

        def other(x):
            return +x  # edit: + -> -
        """,
    "settings.py": """
        import sys

        FACTOR = 2.0  # edit: 2.0 -> 2.5
        if sys.platform == "nowhere":
            ORDER = 1
        else:
            ORDER = 2  # edit: 2 -> 3
        UNUSED = 7  # edit: 7 -> 8
        """,
    "tools.py": """
        STEP = 1  # edit: 1 -> 2 | 1 -> 1; print()

        def shift(x):
            return x + STEP  # edit: + -> -

        def paint(figure, color):
            return color  # edit: color -> color, figure
        """,
    "deep/__init__.py": "",
    "deep/inner.py": """
        from ..deeper import *

        def depth():
            return 4 + K  # edit: 4 -> 44

        def unused():
            return 5  # edit: 5 -> 55
        """,
    "deeper.py": "K = 1  # edit: 1 -> 2\n",
    "late.py": "import ident.main\n\ndef arrive(x):\n    return x + 6  # edit: 6 -> 7\n",
    "figures.py": "class Figure:\n    size = 8\n",
    "plugins.py": """
        from .registry import TABLE, register

        @register("square")  # edit: square -> cube
        def square(x):
            return x**2  # edit: **2 -> **3
        """,
    "registry.py": """
        TABLE = {"plain": 1.0}  # edit: 1.0 -> 1.5

        def register(name):
            def keep(function):
                TABLE[name] = function  # edit: = function -> = (function, 1)
                return function
            return keep
        """,
    "models.py": """
        import dataclasses

        class Base:
            unit = 1.0  # edit: 1.0 -> 3.0

            def scaled(self):
                return self.unit * 2  # edit: * 2 -> * 4

        class Other(Base):
            pass

        @dataclasses.dataclass(frozen=True)  # edit: frozen=True -> frozen=False
        class Model(Base):  # edit: (Base) -> (Other)
            value: float  # edit: float -> int
            weight: float = 3.0  # edit: 3.0 -> 4.0

            @property
            def heavy(self):
                return self.weight > 2  # edit: > 2 -> > 5

            def __getattr__(self, name):
                return 5  # edit: 5 -> 8
        """,
    "lazy.py": "def __getattr__(name):\n    return 9  # edit: 9 -> 10\n",
    "main.py": '''
        """The module computes."""

        from __future__ import annotations

        import functools
        from typing import TYPE_CHECKING

        import numpy as np  # edit: numpy as -> numpy.lib as

        from ident import api, lazy, registry, tools
        from ident.api import helper
        from ident.models import Model
        from ident.settings import ORDER
        import ident
        import ident.deep.inner
        import ident.plugins
        import ident.settings as chosen

        if TYPE_CHECKING:
            from ident.figures import Figure

        SCALE = 2.0  # edit: 2.0 -> 2.5
        LIMITS: dict[str, float] = {"low": 0.0}  # edit: 0.0 -> 0.1
        LIMITS["high"] = 9.0  # edit: 9.0 -> 8.0 | high -> low
        LIMITS.update(middle=4.0)  # edit: 4.0 -> 4.5
        DEFAULT = 1.5  # edit: 1.5 -> 1.6
        SHAPE = (1, 2) if DEFAULT else (2, 1)  # edit: (2, 1) -> (3, 1)
        CHOICES = {"up": lambda x: x + 1, "down": lambda x: x - 1}  # edit: x - 1 -> x - 2

        def doubled(function):
            @functools.wraps(function)
            def inner(points):
                return 2 * function(points)  # edit: 2 * -> 3 *
            return inner

        def tripled(function):
            return function

        def maker(step=0.5):  # edit: 0.5 -> 0.6
            def inner(x):
                return x / step  # edit: x / -> x *
            return inner

        HELD = maker()  # edit: maker() -> maker(2.0)
        GIVEN = functools.partial(pow, 2)  # edit: (pow, 2) -> (pow, 3)

        @doubled  # edit: doubled -> tripled | @doubled -> # without
        def compute(points, factor=DEFAULT):  # edit: =DEFAULT -> =ORDER
            """What it gives."""
            from ident.late import arrive

            model = Model(points["x"])  # a remark
            total = SCALE * helper(model.value) + tools.shift(1.0) + ident.deep.inner.depth() + arrive(1.0)
            total += ident.exported(factor) + chosen.FACTOR + lazy.anything + model.scaled() + model.other
            total += model.heavy + LIMITS["low"] + SHAPE[0] + HELD(1.0) + GIVEN(2) + registry.TABLE["plain"]
            return {"y": np.sin(total) * factor * ORDER + CHOICES["up"](total)}  # edit: np.sin -> np.cos

        def draw(figure: Figure, color="blue"):
            return tools.paint(figure, color)
        ''',
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

# What may stand anywhere between two statements at the top of a module and changes nothing.
HARMLESS = (
    "# a remark\n",
    '"""A text."""\n',
    "\n\n\n",
    "UNUSED = 1\n",
    "def unused():\n    return DEFAULT\n",
    "class Unused:\n    size = 1\n",
    "import json\n",
    "unused: int\n",
)


def edits():
    """Every edit marked in the program: file, line, the line as edited."""
    for name, text in PROGRAM.items():
        for line in text.splitlines():
            before, _, marked = line.strip().partition("  # edit: ")
            for edit in marked.split(" | ") if marked else ():
                old, _, new = edit.partition(" -> ")
                assert before.count(old) == 1, line
                yield name, before, before.replace(old, new)


class Package:
    """Files of a package called `ident`, which may be changed."""

    def __init__(self, folder, files):
        self.folder = folder / "ident"
        for name, text in files.items():
            self.write(name, text)

    def write(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(re.sub("  # edit: .*", "", textwrap.dedent(text)))

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


def printed(script):
    """What a script prints, started in this process as Python starts it."""
    with contextlib.redirect_stdout(io.StringIO()) as text:
        runpy.run_path(str(script), run_name="__main__")
    return text.getvalue()


def maker(held):
    def inner(points):
        return held

    return inner


def echo(points, *places, **constants):
    return points, places, constants


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
