"""Which code a function runs, as digests that stay the same where it stays the same; and a point in one line."""

import ast
import dataclasses
import enum
import functools
import importlib
import json
import math
import os
import shutil
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from sweeps.reproduce import one_liner
from sweeps.sources import differing, sources

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


@pytest.fixture
def package(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    yield lambda files=FILES: Package(tmp_path, files)
    for name in [name for name in sys.modules if name.partition(".")[0] == "ident"]:
        del sys.modules[name]


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


# What makes no difference.


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("main.py", "# a remark", "# another remark, and a longer one"),
        ("main.py", '"""What it gives."""', '"""What it really gives."""'),
        ("main.py", '    """What it gives."""\n', ""),
        ("main.py", '"""The module computes."""', '"""Another text."""'),
        ("main.py", "np.sin(total) * factor", "(\n        np.sin( total )\n    ) * factor"),
        ("main.py", 'points["x"]', "points['x']"),
        (
            "main.py",
            "def compute(points, factor=DEFAULT):",
            "def compute(points: dict, factor: float = DEFAULT) -> dict:",
        ),
        ("main.py", "SCALE = 2.0", "SCALE: float = 2.0"),
        ("main.py", "total = SCALE", "total: float = SCALE"),
        ("main.py", 'color="blue"', 'color="red"'),
        ("main.py", "from ident.figures import Figure", "from ident.figures import Figure, Other"),
        ("main.py", "import numpy as np\n", "import json\nimport numpy as np\nfrom ident import figures\n"),
        ("main.py", "from ident import api, tools", "from ident import tools, api"),
        (
            "main.py",
            "    return tools.paint(figure, color)",
            "    return tools.paint(figure, color)\n\n\nEXTRA = 1",
        ),
        ("core.py", "    return x\n", "    return -x\n"),
        ("api.py", "helper as helper, other", "other, helper as helper"),
        ("tools.py", "return color", "return color, figure"),
        ("settings.py", "UNUSED = 7", "UNUSED = 8"),
        ("deep/inner.py", "return 5", "return 55"),
        ("figures.py", "size = 8", "size = 9"),
    ],
)
def test_what_is_not_run_makes_no_difference(package, name, old, new):
    files = package()
    compute = files.load("main").compute
    before = sources(compute)
    files.edit(name, old, new)
    assert sources(compute) == before


def test_order_of_imports_makes_no_difference(package):
    files = package()
    compute = files.load("main").compute
    before = sources(compute)
    files.edit("main.py", "from ident.api import helper\nfrom ident.decorators import doubled\n", "")
    files.edit(
        "main.py", "import ident.deep.inner\n", "import ident.deep.inner\nfrom ident.decorators import doubled\n"
    )
    files.edit("main.py", "import numpy as np\n", "from ident.api import helper\nimport numpy as np\n")
    assert sources(compute) == before


# What makes a difference, and where.


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("main.py", "np.sin(total)", "np.cos(total)"),
        ("main.py", "SCALE = 2.0", "SCALE = 2.5"),
        ("main.py", 'LIMITS["high"] = 9.0', 'LIMITS["low"] = 9.0'),
        ("main.py", "factor=DEFAULT", "factor=ORDER"),
        ("main.py", "@doubled\n", ""),
        ("main.py", "import numpy as np\n", "import numpy.lib as np\n"),
        ("core.py", "return x + 1", "return x + 2"),
        ("api.py", "helper as helper", "other as helper"),
        ("tools.py", "STEP = 1", "STEP = 2"),
        ("tools.py", "x + STEP", "x - STEP"),
        ("tools.py", "STEP = 1", "STEP = 1\nprint()"),
        ("decorators.py", "f(*a, **k)", "2 * f(*a, **k)"),
        ("models.py", "unit = 1.0", "unit = 2.0"),
        ("models.py", "weight: float = 3.0", "weight: float = 4.0"),
        ("models.py", "value: float", "value: int"),
        ("settings.py", "DEFAULT = 1.5", "DEFAULT = 1.6"),
        ("settings.py", "ORDER = 2", "ORDER = 3"),
        ("deep/inner.py", "return 4", "return 44"),
        ("late.py", "return 6", "return 66"),
    ],
)
def test_what_is_run_makes_a_difference(package, name, old, new):
    files = package()
    compute = files.load("main").compute
    before = sources(compute)
    files.edit(name, old, new)
    module = "ident." + name.removesuffix(".py").replace("/", ".")
    assert module in differing(before, sources(compute))


def test_what_packages_do_when_they_are_imported_counts(package):
    files = package()
    compute = files.load("main").compute
    before = sources(compute)
    files.write("deep/__init__.py", "import numpy\n\nUNUSED = 1\nnumpy.seterr(all='raise')\n")
    after = sources(compute)
    assert differing(before, after) == ["ident.deep"]
    files.edit("deep/__init__.py", "UNUSED = 1", "UNUSED = 2")
    assert sources(compute) == after


def test_only_what_is_ours_is_named(package):
    found = sources(package().load("main").compute)
    assert list(found) == sorted(found)
    assert set(found) == {
        *("ident.main", "ident.api", "ident.core", "ident.tools", "ident.decorators", "ident.models"),
        *("ident.settings", "ident.deep.inner", "ident.late"),
    }
    assert all(len(digest) == 16 for digest in found.values())


def test_nothing_is_imported_for_it(package):
    files = package({"__init__.py": "", "main.py": "def f(p):\n    from ident import late\n    return late.g()\n"})
    files.write("late.py", "raise RuntimeError('imported')\ndef g():\n    return 1\n")
    assert set(sources(files.load("main").f)) == {"ident.main", "ident.late"}
    assert "ident.late" not in sys.modules


def test_a_module_used_otherwise_counts_as_a_whole(package):
    text = "from ident import tools\n\n\ndef f(p):\n    return {}\n"
    files = package({"__init__.py": "", "tools.py": "A = 1\nB = 2\n", "main.py": text.format("tools.A")})
    f = files.load("main").f
    for use, counts in {"tools.A": False, "getattr(tools, 'A')": True, "tools.C": True}.items():
        files.write("main.py", text.format(use))
        files.write("tools.py", "A = 1\nB = 2\n")
        before = sources(f)
        files.write("tools.py", "A = 1\nB = 3\n")
        assert (sources(f) != before) == counts, use


def test_stars_and_relative_imports_are_followed(package):
    files = package(
        {
            "__init__.py": "from . import tools\nfrom .core import *\n",
            "core.py": "def helper():\n    return 1\n",
            "tools.py": "def shift():\n    return 1\n",
            "sub/__init__.py": "from ..tools import shift\n",
            "main.py": """
                import ident
                from .sub import shift
                from . import helper

                def f(p):
                    return shift() + helper() + ident.tools.shift()
                """,
        }
    )
    f = files.load("main").f
    before = sources(f)
    assert {"ident", "ident.core", "ident.tools", "ident.sub", "ident.main"} == set(before)
    files.edit("core.py", "return 1", "return 2")
    files.edit("tools.py", "return 1", "return 2")
    assert differing(before, sources(f)) == ["ident.core", "ident.tools"]


def test_modules_that_import_each_other(package):
    files = package(
        {
            "__init__.py": "from ident.main import f\n",
            "main.py": "import ident\nfrom ident import other\n\n\ndef f(p):\n    return other.g(p)\n",
            "other.py": "import ident\n\n\ndef g(p):\n    return ident.f(p)\n",
        }
    )
    assert set(sources(files.load("main").f)) == {"ident", "ident.main", "ident.other"}


def test_a_global_set_elsewhere_in_the_module(package):
    text = "STATE = 0\n\n\ndef f(p):\n    global STATE\n    STATE = 1\n\n\ndef g(p):\n    return STATE\n"
    files = package({"__init__.py": "", "main.py": text})
    main = files.load("main")
    before = sources(main.f)
    files.edit("main.py", "STATE = 0", "STATE = 5")
    assert sources(main.f) != before


def test_what_a_script_does_when_it_is_started_is_not_its_import(package):
    text = "def f(p):\n    return p\n\n\nif __name__ == '__main__':\n    print({})\n"
    files = package({"__init__.py": "", "main.py": text.format(1)})
    f = files.load("main").f
    before = sources(f)
    files.write("main.py", text.format(2))
    assert sources(f) == before


def test_differing_names_what_differs():
    assert differing({"a": "1", "b": "2", "c": "3"}, {"b": "2", "c": "4", "d": "5"}) == ["a", "c", "d"]
    assert differing({"a": "1"}, {"a": "1"}) == []


# What functions carry along.


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


VALUES = [
    *(None, True, 1, 1.0, -0.0, 0.0, math.nan, 1j, "1", b"1", range(3), Colour.RED, Colour.BLUE),
    *(
        np.float64(1.0),
        np.float32(1.0),
        np.arange(3),
        np.arange(3.0),
        np.arange(3)[:, None],
        np.array(["a", None]),
    ),
    *([1, 2], (1, 2), {1, 2}, {"a": 1}, {"a": 2}, Inner(), Inner(2.0), Outer(), Outer(Inner(2.0))),
    *(
        math.sin,
        math.cos,
        np.sin,
        np.cos,
        np.mean,
        math,
        np,
        Inner,
        Outer,
        test_differing_names_what_differs,
        maker(1),
    ),
]


def test_a_closure_counts_with_its_values():
    digests = [tuple(sources(maker(value)).items()) for value in VALUES]
    assert len(set(digests)) == len(VALUES)
    assert digests == [tuple(sources(maker(value)).items()) for value in VALUES]
    copies = [sources(maker(value)) for value in ([1, 2], {"a": 1}, Inner(2.0), np.arange(3), {2, 1})]
    assert copies == [sources(maker(value)) for value in ([1, 2], {"a": 1}, Inner(2.0), np.arange(3), {1, 2})]


@pytest.mark.parametrize("value", [threading.Lock(), object(), [object()], iter([1]), Outer(values=(object(),))])
def test_what_cannot_be_compared_is_refused(value):
    said = "held = .*, which cannot be compared with a stored one; pass it as a constant"
    with pytest.raises(ValueError, match=rf"^function maker.<locals>.inner closes over {said}"):
        sources(maker(value))
    with pytest.raises(ValueError, match=rf"^function maker is given {said}"):
        sources(functools.partial(maker, held=value))
    with pytest.raises(ValueError, match=r"has the default held = .*, which cannot"):
        sources(lambda points, held=value: held)


def test_a_closure_leads_to_its_function(package):
    files = package({"__init__.py": "", "main.py": "def f(p):\n    return 1\n"})
    f = files.load("main").f
    before = sources(maker(f))
    assert "ident.main" in before
    files.edit("main.py", "return 1", "return 2")
    assert "ident.main" in differing(before, sources(maker(f)))


def test_a_function_that_calls_itself_within_another():
    def outer():
        def again(points):
            return again(points)

        return again

    assert sources(outer()) == sources(outer())


def test_lambdas_of_one_line_are_told_apart():
    one, two, three = lambda p: p + 1, lambda p: p + 2, lambda p, k=3: p + k
    assert len({sources(f)[__name__] for f in (one, two, three, lambda p: p - 1)}) == 4
    assert sources(one) == sources(lambda p: p + 1)
    assert len({sources(lambda p, k=k: p + k)[__name__] for k in (1, 2, 1)}) == 2


def test_a_partial_is_its_function_with_what_is_given():
    def of(*places, **named):
        return sources(functools.partial(test_differing_names_what_differs, *places, **named))

    assert of(a=1, b=2) == of(b=2, a=1)
    assert of(a=1) != of(a=2)
    assert of(1) != of(2)
    assert of(Inner()) == of(Inner())
    assert of(a=1) == sources(functools.partial(functools.partial(test_differing_names_what_differs), a=1))


def test_wrapped_functions_lead_to_both(package):
    text = """
        import functools
        from ident.core import helper

        def wrapped(f):
            @functools.wraps(f)
            def inner(p):
                return 3 * f(p)
            return inner
        """
    files = package(FILES | {"wrap.py": text})
    helper = files.load("core").helper
    function, cached = files.load("wrap").wrapped(helper), functools.lru_cache(helper)
    before = sources(function), sources(cached), sources(helper)
    assert set(before[0]) == {"ident.core", "ident.wrap"}
    assert before[1] == before[2]
    files.edit("core.py", "x + 1", "x + 2")
    files.edit("wrap.py", "3 * f(p)", "4 * f(p)")
    assert differing(before[0], sources(function)) == ["ident.core", "ident.wrap"]


def test_compiled_functions_are_their_python_with_the_compilers_options(package):
    from numba import njit

    files = package()
    helper = files.load("core").helper
    before = sources(njit(helper))
    assert set(before) == {"ident.core"}
    assert before == sources(njit(helper)) != sources(njit(fastmath={"nsz", "contract"})(helper))
    files.edit("core.py", "x + 1", "x + 2")
    assert sources(njit(helper)) != before


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


def test_methods_and_instances_count_with_their_state():
    assert sources(Caller(1)) == sources(Caller(1)) != sources(Caller(2))
    assert sources(Caller(1).method) == sources(Caller(1).method) != sources(Caller(2).method)
    assert sources(Caller.of_class) == sources(Caller.of_class) != sources(Caller.method)
    with pytest.raises(ValueError, match=r"the Caller that is called holds held = .*cannot be compared"):
        sources(Caller(threading.Lock()))
    with pytest.raises(ValueError, match="cannot be compared"):
        sources([].append)


def test_a_librarys_function_is_known_by_its_name():
    assert sources(np.sin) != sources(np.cos)
    assert set(sources(np.sin)) == {"numpy"}
    assert set(sources(functools.partial(math.pow, 2.0))) == {"math"}


# Functions without a source, and other processes.

BARE = """
import numpy as np
from dataclasses import dataclass, field
FACTOR, TABLE, UNUSED = 2.0, np.arange(3), 1
@dataclass
class Model:
    size: float = 1.0
    parts: list = field(default_factory=list)
    def grown(self): return self.size + 1
def helper(x): return x * 3
def f(points):
    'A text.'
    inside = [helper(x) for x in points]
    return FACTOR * TABLE, Model().grown(), "a" in {"a", "b", "c"}, inside
"""


def bare(text):
    names = {"__name__": "__main__"}
    exec(text, names)
    return sources(names["f"])


def test_code_without_a_source_counts_as_it_was_compiled():
    found = bare(BARE)
    assert set(found) == {"__main__"}
    for old, new in {"A text": "Another", "UNUSED = 2.0": "UNUSED = 2.0 "}.items():
        assert bare(BARE.replace(old, new)) == found, old
    assert bare("# a remark\n" + BARE.replace("(x):", "(x: float):")) == found
    assert bare(BARE.replace("np.arange(3), 1", "np.arange(3), 2")) == found
    for old, new in {
        "x * 3": "x * 4",
        "FACTOR, TABLE, UNUSED = 2.0": "FACTOR, TABLE, UNUSED = 3.0",
        "np.arange(3)": "np.arange(4)",
        "FACTOR * TABLE": "FACTOR + TABLE",
        "size: float = 1.0": "size: float = 2.0",
        "default_factory=list": "default_factory=dict",
        "self.size + 1": "self.size + 2",
        '"c"}': '"d"}',
    }.items():
        assert BARE.count(old) == 1
        assert bare(BARE.replace(old, new)) != found, old


def test_every_process_finds_the_same(package):
    files = package()
    code = BARE + textwrap.dedent("""
        import json, sys
        import ident.main
        from sweeps.sources import sources
        def maker(held):
            return lambda points: held
        print(json.dumps([sources(f), sources(ident.main.compute), sources(maker({"x", "y", "z"}))]))
        """)
    printed = {run(code, files.folder.parent, HOME, PYTHONHASHSEED=seed) for seed in ("1", "2")}
    assert len(printed) == 1
    first, second, third = json.loads(printed.pop())
    assert set(first) == set(third) == {"__main__"}
    assert second == sources(files.load("main").compute)


def test_a_script_is_read_from_its_file(tmp_path):
    text = """
        import json
        from sweeps.sources import sources
        FACTOR = 2
        def f(points):
            return FACTOR
        g = lambda points: 1
        if __name__ == "__main__":
            print(json.dumps(sources(f, g)))
        """
    script = tmp_path / "script.py"
    found = []
    for old, new in (("", ""), ("return FACTOR", "return FACTOR  # twice"), ("FACTOR = 2", "FACTOR = 3")):
        script.write_text(textwrap.dedent(text).replace(old, new))
        found.append(run(script, HOME))
    assert set(json.loads(found[0])) == {"__main__"}
    assert found[0] == found[1] != found[2]


def test_an_installed_project_is_known_by_its_distribution(tmp_path):
    place = tmp_path / "site-packages"
    shutil.copytree(HOME / "sweeps", place / "sweeps", ignore=shutil.ignore_patterns("__pycache__"))
    for name, text in {
        "one/__init__.py": "from two import g\nimport three\ndef f(points): return g() + three.h()\n",
        "two/__init__.py": "def g(): return 1\n",
        "three/__init__.py": "def h(): return 1\n",
        "whole-1.0.dist-info/METADATA": "Metadata-Version: 2.1\nName: whole\nVersion: 1.0\n",
        "whole-1.0.dist-info/top_level.txt": "sweeps\none\ntwo\n",
    }.items():
        (place / name).parent.mkdir(exist_ok=True, parents=True)
        (place / name).write_text(text)
    code = """
        import json, three, one, sweeps
        from sweeps.sources import sources
        print(json.dumps([sweeps.__file__, sorted(sources(lambda points: one.f(points))), sorted(sources(one.f))]))
        """
    file, _, found = json.loads(run(code, place))
    assert "site-packages" in file
    assert found == ["one", "two"]


def test_the_project_itself(tmp_path):
    for name in ("fivcore", "sweeps", "studies"):
        shutil.copytree(HOME / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    printed = run(
        """
        import ast, json, pathlib, time
        from studies import fig7
        from sweeps.sources import differing, sources

        def changed(name, function):
            path = pathlib.Path(name)
            lines = path.read_text().splitlines()
            body = next(n for n in ast.parse("\\n".join(lines)).body if getattr(n, "name", "") == function).body
            first = body[1]  # after the docstring
            lines.insert(first.lineno - 1, " " * first.col_offset + "unused = 1")
            path.write_text("\\n".join(lines))
            return differing(before, sources(fig7.histories))

        start = time.perf_counter()
        before = sources(fig7.histories)
        seconds = time.perf_counter() - start
        print(json.dumps([fig7.__file__, seconds, before,
            changed("studies/fig7.py", "draw"), changed("studies/fig7.py", "report"),
            changed("fivcore/fast_kernel.py", "advance"), changed("studies/fig7.py", "histories")]))
        """,
        tmp_path,
    )
    file, seconds, before, *changed = json.loads(printed)
    assert Path(file).is_relative_to(tmp_path)
    assert {"fivcore.fast", "fivcore.fast_kernel", "studies.transients", "studies.fig7"} <= set(before)
    assert not {"studies.figures", "studies.registry", "matplotlib", "sweeps.plan"} & set(before)
    assert changed == [[], [], ["fivcore.fast_kernel"], ["fivcore.fast_kernel", "studies.fig7"]]
    assert seconds < 3.0  # usually a tenth of it


# One line.


def echo(points, *places, **constants):
    return points, places, constants


def failing(points, rig=None, limit=1.0):
    raise ValueError(f"{points['V'].tolist()} with {rig} is above {limit}")


def evaluated(line, **names):
    """The value of a line's last expression, after the rest of it."""
    assert len(line.splitlines()) == 1
    tree = ast.parse(line)
    tree.body[-1] = ast.Assign([ast.Name("result", ast.Store())], tree.body[-1].value)
    exec(compile(ast.fix_missing_locations(tree), "line", "exec"), names)
    return names["result"]


def same(one, other):
    """Equality to the type and the sign of zero; one NaN is as good as another."""
    if type(one) is not type(other):
        return False
    if isinstance(one, (np.ndarray, np.generic)):
        return one.dtype == other.dtype and one.shape == other.shape and same(one.tolist(), other.tolist())
    if isinstance(one, dict):
        return same(list(one.items()), list(other.items()))
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(same, one, other))
    if dataclasses.is_dataclass(one) and not isinstance(one, type):
        return same([*vars(one).items()], [*vars(other).items()])
    return repr(one) == repr(other)


def test_a_line_reads_as_promised():
    line = one_liner(failing, {"V": np.float64(0.002)}, {"rig": Outer(Inner(2.5)), "limit": 0.5})
    assert line == (
        "from numpy import array; from tests.test_identity import Inner; from tests.test_identity import Outer; "
        "from tests.test_identity import failing; "
        "failing({'V': array([0.002])}, rig=Outer(inner=Inner(size=2.5)), limit=0.5)"
    )
    assert "rig=Outer(), limit=float('nan')" in one_liner(failing, {}, {"rig": Outer(), "limit": math.nan})


def test_a_line_does_the_same_in_another_process(tmp_path):
    module = """
        from dataclasses import dataclass
        import numpy as np

        @dataclass(frozen=True)
        class Beam:
            length: float
            shape: np.ndarray = None

        @dataclass(frozen=True)
        class Rig:
            beam: Beam = Beam(1.0)
            mass: float = 2.0

        def compute(points, rig=Rig(), **rest):
            if points["V"][0] < 0:
                raise ValueError(f"V = {points['V']}: it must be positive; {rig}, {rest}")
            return {k: (v, v.dtype) for k, v in points.items()}, rig, rest
        """
    (tmp_path / "oneline.py").write_text(textwrap.dedent(module))
    sys.path.insert(0, str(tmp_path))
    try:
        import oneline

        cases = []
        for speed in (0.1, -0.1):
            point = {"V": np.float64(speed), "n": np.int32(3), "kind": np.str_("a\nb"), "on": np.bool_(True)}
            beam = oneline.Beam(0.1 + 0.2, np.array([1.0, np.nan, -np.inf], dtype=np.float32))
            cases.append((point, {"rig": oneline.Rig(beam), "text": "it's\n", "none": None}))
        lines = [one_liner(oneline.compute, *case) for case in cases]
        arrays = [{name: np.asarray([value]) for name, value in point.items()} for point, _ in cases]
        expected = [repr(oneline.compute(arrays[0], **cases[0][1]))]
        with pytest.raises(ValueError, match="it must be positive") as raised:
            oneline.compute(arrays[1], **cases[1][1])
        expected.append(repr(raised.value))
    finally:
        sys.path.remove(str(tmp_path))
        sys.modules.pop("oneline", None)
    code = f"""
        import ast
        for line in {lines!r}:
            *before, last = ast.parse(line).body
            names = {{}}
            exec(compile(ast.Module(before, []), "line", "exec"), names)
            try:
                print(repr(repr(eval(compile(ast.Expression(last.value), "line", "eval"), names))))
            except ValueError as problem:
                print(repr(repr(problem)))
        """
    assert [ast.literal_eval(line) for line in run(code, tmp_path).splitlines()] == expected


NUMBERS = st.one_of(st.booleans(), st.integers(), st.floats(), st.complex_numbers())
DTYPES = st.sampled_from(
    ["f8", "f4", "f2", "i8", "i4", "i1", "u8", "u2", "c16", "c8", "?", "U5", "U1", "S3", ">f8"]
)
ARRAYS = hnp.arrays(DTYPES, hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3))
SCALARS = hnp.arrays(DTYPES.filter(lambda d: d[0] != ">"), 1).map(lambda a: a[0])
CONSTANTS = st.recursive(
    st.one_of(st.none(), NUMBERS, st.text(), st.binary(), ARRAYS, SCALARS, st.sampled_from(Colour)),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.lists(inner, max_size=3).map(tuple),
        st.dictionaries(st.text(max_size=3), inner, max_size=3),
        st.builds(Outer, st.builds(Inner, st.floats(), st.text()), inner, needed=inner),
    ),
    max_leaves=6,
)


@given(
    st.dictionaries(st.text(max_size=3), SCALARS, min_size=1, max_size=3),
    st.dictionaries(st.sampled_from(["a", "b", "c d", "class", "array", "echo"]), CONSTANTS, max_size=3),
)
@settings(max_examples=60, deadline=None)
def test_a_line_gives_back_every_value(point, constants):
    given, places, named = evaluated(one_liner(echo, point, constants))
    assert same(given, {name: np.asarray([value]) for name, value in point.items()})
    assert places == ()
    assert same(dict(sorted(named.items())), dict(sorted(constants.items())))


def test_what_a_partial_gives_stands_in_the_line():
    function = functools.partial(functools.partial(echo, b=1, c=2), b=3)
    line = one_liner(function, {"x": np.float64(1.0)}, {"c": 4, "d": 5})
    assert evaluated(line)[2] == {"b": 3, "c": 4, "d": 5}
    given, (points,), _ = evaluated(one_liner(functools.partial(echo, "first"), {"x": np.int64(1)}, {}))
    assert (given, points["x"].dtype) == ("first", np.int64)


@functools.lru_cache
def cached(points):
    return points


def array(points, held):
    return points, held


def test_wrapped_functions_methods_and_taken_names():
    assert one_liner(cached, {}, {}) == "from tests.test_identity import cached; cached({})"
    assert one_liner(functools.wraps(echo)(lambda points: 1), {}, {}).endswith("; echo({})")
    assert evaluated(one_liner(Caller.of_class, {"x": np.float64(1.0)}, {})) is Caller
    points, held = evaluated(one_liner(array, {"x": np.float64(1.0)}, {"held": np.arange(2)}))
    np.testing.assert_array_equal(points["x"], [1.0])
    np.testing.assert_array_equal(held, [0, 1])


def test_a_function_that_cannot_be_imported_is_named_in_a_remark():
    line = one_liner(lambda points, factor: factor * points["x"], {"x": np.float64(1.0)}, {"factor": 2.0})
    assert line.startswith("from numpy import array; function({'x': array([1.0])}, factor=2.0)  # function: ")
    assert line.endswith(".<locals>.<lambda> of tests.test_identity")
    assert evaluated(line, function=echo)[2] == {"factor": 2.0}
    for other in (maker(1), Caller(1), Caller(1).method, functools.partial(maker(1), k=2)):
        assert one_liner(other, {}, {}).startswith("function(")


def test_what_cannot_be_written_is_told_and_does_not_raise():
    class Odd:
        def __repr__(self):
            return "odd\nin two lines " + 100 * "-"

    class Worse:
        def __repr__(self):
            raise RuntimeError

    line = one_liner(echo, {"x": np.float64(1.0)}, {"odd": Odd(), "worse": [Worse()], "fine": 1})
    assert len(line.splitlines()) == 1
    assert "odd=odd, worse=[worse], fine=1)  # odd: odd in two lines ---" in line
    assert evaluated(line, odd=1, worse=2)[2] == {"odd": 1, "worse": [2], "fine": 1}
