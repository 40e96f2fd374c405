"""Files of programs whose code is edited."""

import importlib
import re
import sys
import textwrap

import pytest

# A program of several modules. Every marked edit changes the digest of `compute`.
PROGRAM = {
    "ident/__init__.py": "from .core import exported\n",
    "ident/api.py": "from ident.core import helper as helper, other  # edit: helper as -> other as\n",
    "ident/core.py": """
        from ident.settings import *
        def exported(x):
            return x * FACTOR  # edit: FACTOR -> FACTOR + 1
        def helper(x):
            return x + 1  # edit: 1 -> 2
        def other(x):
            return +x
        """,
    "ident/settings.py": """
        import sys
        FACTOR = 2.0  # edit: 2.0 -> 2.5
        if sys.platform == "nowhere":
            ORDER = 1
        else:
            ORDER = 2  # edit: 2 -> 3
        """,
    "ident/deep/__init__.py": "",
    "ident/deep/inner.py": """
        from ..deeper import *
        def depth():
            return 4 + K  # edit: 4 -> 44
        """,
    "ident/deeper.py": "K = 1  # edit: 1 -> 2\n",
    "ident/late.py": "import ident.main\ndef arrive(x):\n    return x + 6  # edit: 6 -> 7\n",
    "ident/figures.py": "class Figure:\n    size = 8\n",
    "ident/lazy.py": "anything = 9  # edit: 9 -> 10\n",
    "ident/models.py": """
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
        """,
    "ident/main.py": '''
        """The module computes."""
        from __future__ import annotations
        import functools
        from typing import TYPE_CHECKING
        import numpy as np  # edit: numpy as -> scipy as
        from ident import api, lazy
        from ident.api import helper
        from ident.models import Model
        from ident.settings import ORDER
        import beside
        import ident
        import ident.deep.inner
        import ident.settings as chosen
        if TYPE_CHECKING:
            from ident.figures import Figure
        SCALE = 2.0  # edit: 2.0 -> 2.5
        SCALE *= 2  # edit: 2 -> 3
        LIMITS: dict[str, float] = {"low": 0.0}  # edit: 0.0 -> 0.1
        LIMITS["high"] = 9.0  # edit: 9.0 -> 8.0 | high -> low
        LIMITS.update(middle=4.0)  # edit: 4.0 -> 4.5
        for name in ("a", "b"):
            LIMITS[name] = 1.0  # edit: 1.0 -> 1.5
        chosen.FACTOR = chosen.FACTOR * 3  # edit: 3 -> 4
        DEFAULT = 1.5  # edit: 1.5 -> 1.6
        CHOICES = {"up": lambda x: x + 1, "down": lambda x: x - 1}  # edit: x - 1 -> x - 2
        def doubled(function):
            @functools.wraps(function)
            def inner(points):
                return 2 * function(points)  # edit: 2 * -> 3 *
            return inner
        def tripled(function):
            return function
        @doubled  # edit: doubled -> tripled | @doubled -> # without
        def compute(points, factor=DEFAULT):  # edit: =DEFAULT -> =ORDER
            """What it gives."""
            from ident.late import arrive
            model = Model(points["x"])  # a remark
            total = SCALE * api.helper(model.value) + ident.deep.inner.depth() + arrive(1.0) + beside.near()
            total += ident.exported(factor) + chosen.FACTOR + lazy.anything + model.scaled() + LIMITS["low"]
            return {"y": np.sin(total) * factor * ORDER + CHOICES["up"](total)}  # edit: np.sin -> np.cos
        def draw(figure: Figure, color="blue"):
            return color
        def f(points):
            return helper(points)
        ''',
    "beside/__init__.py": "from .inner import near\n",
    "beside/inner.py": """
        import scipy
        from further import K
        def near():
            return scipy.e * K  # edit: K -> K + 1
        """,
    "further.py": "K = 1  # edit: 1 -> 2\n",
}


class Files:
    """Files in a folder on the search path."""

    def __init__(self, folder):
        self.folder = folder

    def __call__(self, texts=PROGRAM):
        for name, text in texts.items():
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(re.sub("  # edit: .*", "", textwrap.dedent(text)))
        return self

    def edit(self, name, old, new):
        text = (self.folder / name).read_text()
        assert text.count(old) == 1, f"{old!r} is {text.count(old)} times in {name}"
        (self.folder / name).write_text(text.replace(old, new))

    def load(self, name="ident.main"):
        """The module as its file is now."""
        self.forget()
        importlib.invalidate_caches()
        return importlib.import_module(name)

    def forget(self):
        for name in [n for n, m in sys.modules.items() if str(self.folder) in str(getattr(m, "__file__", None))]:
            del sys.modules[name]


@pytest.fixture
def files(tmp_path, monkeypatch):
    """Writes files on the search path; their modules are forgotten afterwards."""
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    # Edits within one second would load what was compiled before.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    yield (made := Files(tmp_path))
    made.forget()


# Programs of which one number is edited.
LIVE = {
    "a literal": "K = 2.0\ndef f(a): return a * K",
    "annotated": "K: float = 2.0\ndef f(a): return a * K",
    "computed": "K = 2.0 * 1\ndef f(a): return a * K",
    "a dict": "T = {'k': 2.0}\ndef f(a): return a * T['k']",
    "a list": "L = [2.0]\ndef f(a): return a * L[0]",
    "a default": "def f(a, k=2.0): return a * k",
    "a class attribute": "class C:\n    k = 2.0\ndef f(a): return a * C.k",
    "a field": "from dataclasses import *\n@dataclass\nclass C:\n    k: float = 2.0\ndef f(a): return a * C().k",
    "an array": "import numpy as np\nK = np.array([2.0])\ndef f(a): return a * float(K[0])",
    "unpacking": "J, K = 1.0, 2.0\ndef f(a): return a * K",
    "code": "def f(a): return a * 2.0",
    "a table": "import pandas as pd\nT = pd.Series([1.0], index=[2.0])\ndef f(a): return a * T.index[0]",
    "a keyword default": "def f(a, *, k=2.0): return a * k",
    "an enclosed value": "def make(k):\n    def f(a): return a * k\n    return f\nf = make(2.0)",
    "a partial": "import functools\ndef g(a, k): return a * k\nf = functools.partial(g, k=2.0)",
    "an instance": "class C:\n    def __call__(self, a): return a * self.k\nf = C()\nf.k = 2.0",
    "an attribute": "def f(a): return a * f.k\nf.k = 2.0",
    "an enumeration": "import enum\nclass E(enum.Enum):\n    K = 2.0\ndef f(a): return a * E.K.value",
    "a named tuple": "from typing import *\nclass P(NamedTuple):\n    k: float = 2.0\ndef f(a): return a * P().k",
    "a property": "class C:\n    @property\n    def k(self): return 2.0\ndef f(a): return a * C().k",
    "a static method": "class C:\n    @staticmethod\n    def k(): return 2.0\ndef f(a): return a * C.k()",
    "a nested function": "def f(a):\n    def g(): return 2.0\n    return a * g()",
    "a method of another": "class C:\n    def k(self): return 2.0\nc = C()\ndef f(a): return a * c.k()",
    "a cached function": "import functools\n@functools.cache\ndef k(): return 2.0\ndef f(a): return a * k()",
    "a private name": "__k = 2.0\ndef f(a): return a * __k",
    "a dunder attribute": "class C:\n    __k__ = 2.0\ndef f(a): return a * C.__k__",
    "dispatched": "from functools import *\n@singledispatch\ndef g(a): return a * 2.0\ndef f(a): return g(a)",
    "a ufunc": "from numba import vectorize\n@vectorize\ndef g(a): return a * 2.0\ndef f(a): return float(g(a))",
    "an object of SciPy": "from scipy.stats import norm\nN = norm(2.0)\ndef f(a): return a * float(N.mean())",
    "an enclosed module": "import sys\nK = 2.0\nf = (lambda m: lambda a: a * m.K)(sys.modules[__name__])",
    "a kernel": "from numba import njit\nK = 2.0\n@njit\ndef f(a): return a * K",
}
