"""What changes the digest of a function that is loaded, what does not, and what is refused."""

import ast
import collections
import dataclasses
import enum
import functools
import hashlib
import json
import math
import os
import re
import shutil
import subprocess
import sys
import textwrap
import threading
import tomllib
import types
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numba import njit
from scipy.interpolate import CubicSpline

from studies import registry
from studies.asking.sweep import sweep_of
from sweeps import InputError, StoreError, Sweep, load_script, pointwise
from sweeps.fingerprint import modules, provenance
from sweeps.fingerprint.code import covered, digests
from sweeps.fingerprint.modules import LIBRARIES
from tests import HOME
from tests.sweeps.fingerprint.conftest import LIVE, PROGRAM


def changed(before, after):
    return sorted(name for name in before | after if before.get(name) != after.get(name))


def run(code, *folders, **environment):
    """What Python prints in another process."""
    command = [sys.executable, *([str(code)] if isinstance(code, Path) else ["-c", code])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))} | environment
    return subprocess.run(command, env=environment, cwd=folders[0], check=True, text=True, stdout=-1).stdout


# Code that is reached by name.


def test_every_edit_of_what_is_reached_counts(files):
    files()
    before = digests([files.load().compute])
    assert list(before) == sorted(before)
    assert {"beside.inner", "ident.core", "ident.main", "ident.models"} < set(before)
    assert not {"ident.figures", "numpy", "scipy", "sys"} & set(before)
    for name, text in PROGRAM.items():
        for line in text.splitlines():
            found, _, edits = line.strip().partition("  # edit: ")
            for old, new in (edit.split(" -> ") for edit in edits.split(" | ") if edits):
                files.edit(name, found, edited := found.replace(old, new))
                assert changed(before, digests([files.load().compute])), edited
                files({name: text})
    assert digests([files.load().compute]) == before


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("main", '"""What it gives."""', '"""What it really gives."""'),
        ("main", '"""What it gives."""', ""),
        ("late", "return x + 6", '"""Late."""\n    return x + 6'),
        ("models", "    unit", '    """A base."""\n    unit'),
        ("main", '"""The module computes."""', '"""Another text."""'),
        ("main", "  # a remark", "  # another"),
        ("main", "np.sin(total) * factor", "(\n        np.sin( total )\n    ) * factor"),
        ("main", 'color="blue"', 'color="red"'),
        ("main", "import numpy as np\n", "import json\nimport numpy as np\nfrom ident import figures\n"),
        ("main", "api, lazy", "lazy, api"),
        ("main", "return color", "return 1\nif __name__ == '__main__':\n    LIMITS['low'] = 1"),
        ("main", "DEFAULT = 1.5", "UNUSED = 1\nclass Unused:\n    size = DEFAULT = 1\nDEFAULT = 1.5"),
        ("core", "return +x", "return -x"),
        ("figures", "size = 8", "size = 9"),
    ],
)
def test_what_is_not_run_makes_no_difference(files, name, old, new):
    before = digests([files().load().compute])
    files.edit(f"ident/{name}.py", old, new)
    assert digests([files.load().compute]) == before


@pytest.mark.parametrize(
    "text",
    [
        "from numba.experimental import jitclass\nimport numba\nK = 1\n@jitclass([('a', numba.int64)])\nclass C:\n"
        "    def __init__(self, a):\n        self.a = a\n    def m(self):\n        return self.a + K\n"
        "def f(p):\n    return C(1).m()\n",
        "class C:\n    __slots__ = ()\n    def __call__(self, p):\n        return K\nf = C()\nK = 1\n",
        "try:\n    from ...none import g\nexcept ImportError:\n    K = 1\ndef f(p):\n    return K\n",
        "T = []\nT.append(lambda: K)\nK = 1\ndef f(p):\n    return T[0]()\n",
        "def g():\n    return K\nK = 1\nf = lambda p: g()\n",
        "def make():\n    def f(p):\n        return K\n    return f\nK = 1\nf = make()\n",
        "K = 1\nfor k in (0, K):\n    def f(p, k=k):\n        return k\n",
        "K = 1\ndef f(p):\n    return lambda p=K: p\n",
    ],
)
def test_ways_to_reach_a_constant(files, text):
    before = digests([files({"one.py": text}).load("one").f])
    files.edit("one.py", "K = 1", "K = 2")
    assert digests([files.load("one").f]) != before


def test_of_the_engine_only_what_is_given_counts(files):
    f = files({"one.py": "from sweeps import Grid\ndef f(p):\n    return Grid\n"}).load("one").f
    assert set(digests([f])) == {"one"}
    assert "sweeps.fingerprint.code" in digests([f, digests])


def test_equal_names_do_not_hide_what_is_swapped(files):
    text = "C = {'up': lambda x: x + 1, 'down': lambda x: x - 1}\ndef f(p):\n    return C['up'](p)\n"
    before = digests([files({"one.py": text}).load("one").f])
    files(
        {
            "one.py": text.replace(
                "'up': lambda x: x + 1, 'down': lambda x: x - 1", "'up': lambda x: x - 1, 'down': lambda x: x + 1"
            )
        }
    )
    assert digests([files.load("one").f]) != before


@pytest.mark.parametrize("name", ["namedtuple_own", "statistics"])
def test_modules_that_are_named_like_others_count(files, name, monkeypatch):
    """A module beside a script hides one of Python's."""
    monkeypatch.delitem(sys.modules, name, raising=False)
    modules.kind_of.cache_clear()
    f = files({f"{name}.py": "K = 1\ndef f(p):\n    return K\n"}).load(name).f
    assert set(digests([f])) == {name}
    modules.kind_of.cache_clear()


def test_a_compiled_extension_counts_by_its_file(files):
    """Its functions cannot be read."""
    files({"one.py": "import quick\ndef f(p):\n    return quick.g(p)\n", "quick.py": "g = len\n"})
    module = files.load("one")
    module.quick.__file__ = str(files({"quick.so": "1"}).folder / "quick.so")
    before = digests([module.f])
    files({"quick.so": "2"})
    modules.extension_of.cache_clear()  # as in a new process
    assert changed(before, digests([module.f])) == ["quick"]


# What is declared, and installed packages.


def test_declared_files_and_folders_count_by_their_bytes(files):
    files({"one.py": "def f(p):\n    pass\n", "config.json": "1", "data/a/b.txt": "1", "data/c.txt": "1"})
    files({"other/config.json": "1"})
    f, code = files.load("one").f, [files.folder / each for each in ("config.json", "data", "other/config.json")]
    before = digests([f], code)
    assert set(before) == {"one", "config.json", "data"}
    files({"other/config.json": "2"})
    assert changed(before, digests([f], code)) == ["config.json"]
    files({"config.json": "2", "data/a/b.txt": "2"})
    after = digests([f], code)
    assert changed(before, after) == ["config.json", "data"]
    (files.folder / "data/a/b.txt").rename(files.folder / "data/a/c.txt")
    assert changed(after, digests([f], code)) == ["data"]


@pytest.mark.parametrize("name", ["beside", "beside.inner", "further"])
def test_a_declared_package_or_module_counts_with_all_that_it_defines(files, name):
    f, path = files().load("ident.core").other, "further.py" if name == "further" else "beside/inner.py"
    before = digests([f], [name])
    assert {"ident.core", name} <= set(before)
    files({path: '"""A text."""\n' + textwrap.dedent(PROGRAM[path]).replace("K = 1", "K = (1)  # one")})
    assert digests([files.load("ident.core").other], [name]) == before
    files({path: textwrap.dedent(PROGRAM[path]) + "UNUSED = 1\n"})
    assert changed(before, digests([files.load("ident.core").other], [name])) == [path[:-3].replace("/", ".")]


INSTALLED = {
    "one.py": "import several.inner\ndef f(p):\n    return several.inner.g(p)\n",
    "lazy.py": "def f(p):\n    from several.inner import g\n    return g(p)\n",
    "site-packages/several/__init__.py": "",
    "site-packages/several/inner.py": "K = 1\ndef g(p):\n    return K\n",
}


def installed(files, version, **edits):
    """Install a package with its RECORD, as pip does."""
    texts = INSTALLED | edits
    about = "site-packages/several-1.0.dist-info"
    inner = texts["site-packages/several/inner.py"]
    record = (
        f"several/inner.py,sha256={hashlib.sha256(inner.encode()).hexdigest()},{len(inner)}\nseveral/x.txt,,\n"
    )
    texts |= {f"{about}/METADATA": f"Metadata-Version: 2.1\nName: several\nVersion: {version}\n"}
    files(texts | {f"{about}/top_level.txt": "several\n", f"{about}/RECORD": record})
    for each in (modules.record, modules.is_installed, provenance.distributions):
        each.cache_clear()  # as in a new process


@pytest.mark.parametrize("module", ["one", "lazy"])
def test_an_installed_package_counts_by_its_files(files, module):
    installed(files, "1.0")
    sys.path.insert(0, str(files.folder / "site-packages"))
    f = files.load(module).f
    before = digests([f])
    assert set(before) == {module, "several"}
    assert covered([f]).libraries == ("several",)
    # Another version of the same code is the same code; other code of the same version is not.
    installed(files, "1.1")
    assert digests([files.load(module).f]) == before
    installed(files, "1.1", **{"site-packages/several/inner.py": "K = 2\ndef g(p):\n    return K\n"})
    assert changed(before, digests([files.load(module).f])) == ["several"]


def test_an_upgrade_under_a_live_session_does_not_pass_for_what_is_loaded(files):
    installed(files, "1.0")
    sys.path.insert(0, str(files.folder / "site-packages"))
    f, text = files.load("one").f, "K = 1\ndef g(p):\n    return K + 1\n"
    before = digests([f])
    installed(files, "1.1", **{"site-packages/several/inner.py": text})
    assert digests([f]) != digests([files.load("one").f])
    assert digests([files.load("one").f]) != before


def test_this_project_counts_by_content_wherever_it_lies(monkeypatch):
    function = sweep_of(registry.load("table4")).function
    before = covered([function])
    assert {"fivcore.rig", "studies.gallery.table4"} < set(before.code)
    modules.is_installed.cache_clear()
    monkeypatch.setattr(modules, "INSTALLED", {HOME.name})
    try:
        assert covered([function]) == before
    finally:
        modules.is_installed.cache_clear()


@pytest.mark.parametrize("name", ["mylib", "ident.none", Path("none.json")])
def test_what_cannot_be_found_is_refused(files, name):
    with pytest.raises(InputError, match=rf"^code = '{name}': there is no such package, module or file$"):
        digests([files().load("ident.core").helper], [name])


def test_libraries_are_those_that_covered_code_names(files):
    main = files().load()
    assert {"numpy", "scipy"} <= {*covered([main.compute]).libraries}
    assert covered([main.f]).libraries == ()
    assert covered([main.f], ["beside"]).libraries == ("scipy",)


def test_every_dependency_of_this_project_is_a_library():
    """Else a new version of it would outdate results, or its absence."""
    project = tomllib.loads((HOME / "pyproject.toml").read_text())["project"]
    names = {re.split(r"[<>=\[]", each)[0].lower() for each in project["dependencies"]} | {"pyuff"}
    roots = {
        root for root, every in provenance.distributions().items() if names & {each.lower() for each in every}
    }
    assert {"numpy", "distributed", "PIL"} & roots
    others = {"pylab", "mpl_toolkits", "itables_for_dash"}
    assert {each for each in roots if each[0] != "_"} - others <= LIBRARIES


# Values that functions carry along.


class Colour(enum.Enum):
    RED = 1
    BLUE = 2


@dataclasses.dataclass(frozen=True)
class Inner:
    size: float = 1.0


class Caller:
    def __init__(self, held):
        self.held = held

    def __call__(self, points):
        return self.held


def nothing():
    pass


def maker(held):
    def inner(points):
        return held

    return inner


VALUES = [None, True, 1, 1.0, -0.0, 0.0, 1j, "1", Colour.RED, Colour.BLUE, np.float64(2.0), np.arange(3)]
VALUES += [[1, 2], {"a": 1}, {"a": 2}, Inner(), Inner(2.0), math.sin, np.sin, Inner, nothing, Caller(1), Caller(2)]
VALUES += [maker(1), maker(2), Caller(1).__call__, functools.partial(nothing, 1), functools.partial(nothing, a=1)]
VALUES += [lambda p: p + 1, lambda p: p + 2, lambda p, k=1: k, lambda p, k=2: k, functools.lru_cache(nothing)]
VALUES += [
    {1: 1},
    {"1": 1},
    (1, 2),
    {1, 2},
    np.arange(3.0),
    np.arange(3, dtype=np.int32),
    np.ma.array([1, 2], mask=[0, 1]),
]
VALUES += [
    np.ma.array([1, 2]),
    np.array([1, "a"], dtype=object),
    "a" * 2000,
    "a" * 2000 + "b",
    b"1",
    re.compile("a"),
]
VALUES += [pd.Series([1.0, 2.0], index=index) for index in ([0, 1], [0, 2], [0.0, 1.0], ["0", "1"], [0, 0])]
VALUES += [
    pd.DataFrame({"a": [1.0], "b": [2.0]}),
    pd.DataFrame({"b": [2.0], "a": [1.0]}),
    pd.Index([1]),
    pd.Index([2]),
]
VALUES += [CubicSpline([0, 1, 2], [0, 1, y]) for y in (2, 3)] + [np.vectorize(nothing), np.vectorize(maker)]
VALUES += [
    collections.Counter("ab"),
    collections.OrderedDict(a=1, b=1),
    collections.deque([1]),
    Path("a"),
    np.random,
]


def test_a_closure_counts_with_its_values():
    found = [tuple(digests([maker(value)]).items()) for value in VALUES]
    assert len(set(found)) == len(VALUES)
    assert found == [tuple(digests([maker(value)]).items()) for value in VALUES]


@pytest.mark.parametrize("value", [threading.Lock(), [threading.Lock()], (n for n in "a")])
def test_what_cannot_be_compared_is_refused(value):
    functions = maker(value), functools.partial(maker, held=value), lambda points, held=value: held, Caller(value)
    for each in functions:
        with pytest.raises(
            InputError, match=r": it carries .*, which cannot be compared with a stored value; pass it"
        ):
            digests([each])


def test_carried_functions_are_followed_and_compiled_ones_have_their_options(files):
    def carriers(helper):
        return [maker(helper), functools.partial(nothing, helper), functools.lru_cache(helper), njit(helper)]

    helper = files().load("ident.core").helper
    before = [digests([each]) for each in carriers(helper)]
    assert before[3] == digests([njit(helper)]) != digests([njit(fastmath={"nsz", "contract"})(helper)])
    files.edit("ident/core.py", "x + 1", "x + 2")
    for old, each in zip(before, carriers(files.load("ident.core").helper), strict=True):
        assert changed(old, digests([each])) in (["ident"], ["ident.core"])


# Functions without a source, other processes, scripts.

BARE = """
import numpy as np
from dataclasses import dataclass
FACTOR, TABLE, UNUSED = 2.0, np.arange(3), 1
@dataclass
class Model:
    size: float = 1.0
    def grown(self): return self.size + 1
def helper(x): return x * 3
def f(points):
    'A text.'
    return FACTOR * TABLE, Model().grown(), "a" in {"a", "b", "c"}, [helper(x) for x in points]
"""


@pytest.mark.parametrize(
    ("old", "new", "counts"),
    [
        ("'A text.'", "'Another.'", False),
        *(("(3), 1", "(3), 2", False), ("x * 3", "x * 4", True), ("= 2.0,", "= 3.0,", True)),
        *(("arange(3)", "arange(4)", True), ("= 1.0", "= 2.0", True), ("size + 1", "size + 2", True)),
    ],
)
def test_code_without_a_source_counts_as_it_was_compiled(old, new, counts):
    found = []
    for text in (BARE, BARE.replace(old, new)):
        names = {"__name__": "nowhere"}
        exec(text, names)
        found.append(digests([names["f"]]))
    assert BARE.count(old) == 1
    assert changed(*found) == ["nowhere"] * counts


SCRIPT = """
import dataclasses, json
from further import K
from sweeps import *
from sweeps.fingerprint.code import digests
TABLE = {"a": 1}
TABLE["b"] = 2
@dataclasses.dataclass
class Kind:
    size: float = 1.0
def f(points):
    return Kind(), TABLE, K
found = digests([f, lambda points: Kind])
print(json.dumps(found))
"""


def test_a_script_is_the_module_of_its_file(files, capsys):
    file = files({"further.py": "K = 1\n", "one_script.py": SCRIPT}).folder / "one_script.py"
    started = json.loads(run(file, HOME))
    assert set(started) == {"one_script"}
    module = load_script(file)
    assert json.loads(capsys.readouterr().out) == started
    assert load_script(file) is module
    # Of what a script does besides, nothing counts that its functions do not use.
    file.write_text(SCRIPT.replace("= 2", "= 3") + "print()\n")
    assert changed(json.loads(run(file, HOME)), started) == ["one_script"]


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.py", None, r"none\.py: there is no such file"),
        ("json.py", "", "Python has a module called json already; rename the file"),
        ("wrong.py", "1 +", r"wrong\.py: it cannot be loaded: SyntaxError: invalid syntax"),
        ("wrong.py", "nothing", r"wrong\.py: it cannot be loaded: NameError: name 'nothing' is not defined"),
    ],
)
def test_a_file_that_cannot_be_loaded_is_one_line(files, name, text, message):
    files({} if text is None else {name: text})
    path = [*sys.path]
    with pytest.raises(InputError, match=message) as caught:
        load_script(files.folder / name)
    assert "\n" not in str(caught.value)
    assert sys.path == path


# A live session: numbers bear the fingerprint of the code that computed them.


def live_sweep(f, file):
    return Sweep("live", pointwise(lambda a: f(a)), {"a": [1.0, 2.0]}, ["y"]).plan(file)


@pytest.mark.parametrize("text", LIVE.values(), ids=LIVE)
def test_an_edit_under_a_live_session_is_noticed(files, text, path):
    f = files({"live.py": text}).load("live").f
    files({"live.py": text.replace("2.0", "3.0")})
    assert live_sweep(f, path).run("sync")["y"].values.tolist() == [2.0, 4.0]
    assert live_sweep(f, path).todo == 0
    with pytest.raises(StoreError, match=r"the code of .* has changed"):
        live_sweep(files.load("live").f, path)
    # The other way round, of another session with the old file.
    files({"live.py": text})
    assert live_sweep(files.load("live").f, path).todo == 0


@pytest.mark.parametrize("text", LIVE.values(), ids=LIVE)
def test_an_edit_in_a_notebook_is_noticed(text, path, monkeypatch):
    monkeypatch.setitem(sys.modules, "__main__", types.ModuleType("__main__"))  # as IPython does
    cells = vars(sys.modules["__main__"])
    exec(text, cells)
    live_sweep(cells["f"], path).run("sync")
    plan = live_sweep(cells["f"], path)
    assert plan.todo == 0
    exec(text.replace("2.0", "3.0"), cells)
    with pytest.raises(StoreError, match=r"the code of .* has changed"):
        live_sweep(cells["f"], path)


def test_a_change_between_plan_and_run_is_noticed(files, path):
    module = files({"live.py": LIVE["a dict"]}).load("live")
    plan = live_sweep(module.f, path)
    module.T["k"] = 3.0
    with pytest.raises(
        StoreError, match=r"live has changed since this was planned \(the code of .* has changed\); plan again"
    ):
        plan.run("sync")
    assert not path.exists()


@pytest.mark.parametrize(
    "text",
    [
        "CACHE = {}\ndef f(a): return CACHE.setdefault(a, 2.0 * a)",
        "import numpy as np\nROOM = np.zeros(3)\ndef f(a):\n    ROOM[:] += a\n    return 2.0 * a",
        "import functools\n@functools.cache\ndef g(a): return 2.0 * a\ndef f(a): return g(a)",
        "COUNT = 0\ndef f(a):\n    global COUNT\n    COUNT += 1\n    return 2.0 * a",
        "class C:\n    n = 0\n    def __call__(self, a):\n        self.n += 1\n        return 2 * a\nf = C()",
    ],
)
def test_what_the_code_itself_changes_while_it_runs_counts_as_it_was(files, path, text):
    module = files({"live.py": text}).load("live")
    live_sweep(module.f, path).run("sync")
    assert live_sweep(module.f, path).todo == 0
    longer = Sweep("live", live_sweep(module.f, path).sweep.function, {"a": [1.0, 2.0, 3.0]}, ["y"])
    assert longer.plan(path).run("sync")["y"].values.tolist() == [2.0, 4.0, 6.0]
    assert longer.plan(path).todo == 0
    assert live_sweep(files.load("live").f, path).todo == 0


SETS = """
import numpy as np, pandas as pd, xarray as xr
from random import uniform
from scipy import stats
from scipy.interpolate import CubicSpline
from sweeps.fingerprint.code import digests
def f(p):
    def g(x): return x in {"up", "down", "left"}
    return g(p)
f.sides = {"up", "down", "left"}
f.drawn = stats.norm(2.0), uniform, np.random.normal, np.random.default_rng(1), lambda p: stats.norm(2.0)
f.tables = pd.DataFrame({"a": [1.0], "b": ["x"]}), xr.DataArray([1.0], dims="x"), CubicSpline([0, 1], [0, 1])
print(digests([f, lambda p: p in {"one", "two", "three"}]))
"""


def test_neither_the_order_of_sets_nor_the_state_of_a_process_counts():
    assert len({run(SETS, HOME, PYTHONHASHSEED=seed) for seed in "12"}) == 1


def test_the_projects_own_studies():
    for name in registry.NAMES:
        sweep = sweep_of(registry.load(name))
        found = covered([each for each in (sweep.function, sweep.key, sweep.scale) if each is not None])
        own = {each for each in found.code if each.startswith(("fivcore.", "studies."))}
        assert own == set(found.code), name
        assert not [each for each in own if re.match(r"studies\.(plotting|registry|report|query|cli)", each)]
        assert not {"matplotlib", "sweeps", "pandas"} & {*found.libraries}


def numbers(file):
    """Places of the numbers in a file's code."""
    found = [node for node in ast.walk(ast.parse(file.read_bytes())) if isinstance(node, ast.Constant)]
    return [(file, node) for node in found if type(node.value) in (int, float)]


STUDY = """
import json
from studies import registry
from studies.asking.sweep import sweep_of
from sweeps.fingerprint.code import digests
sweep = sweep_of(registry.load("scenes"))
print(json.dumps(digests([sweep.function, sweep.key, sweep.scale])))
"""


@pytest.mark.slow
def test_random_changes_of_numbers_in_the_core_are_noticed(tmp_path):
    """36 numbers in files of fivcore that the study `scenes` reaches, each in a process of its own."""
    for name in ("fivcore", "sweeps", "studies"):
        shutil.copytree(HOME / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    before = json.loads(run(STUDY, tmp_path, PYTHONDONTWRITEBYTECODE="1"))
    files = [tmp_path / f"{name.replace('.', '/')}.py" for name in before if name.startswith("fivcore.")]
    places = [place for file in files for place in numbers(file)]
    for file, node in np.random.default_rng(0).permutation(np.array(places, dtype=object))[:36]:
        lines = file.read_bytes().splitlines(keepends=True)
        line = lines[node.lineno - 1]
        edited = line[: node.col_offset] + f"({node.value!r} + 1)".encode() + line[node.end_col_offset :]
        file.write_bytes(b"".join([*lines[: node.lineno - 1], edited, *lines[node.lineno :]]))
        try:
            after = json.loads(run(STUDY, tmp_path, PYTHONDONTWRITEBYTECODE="1"))
        except subprocess.CalledProcessError:  # the number may be a shape
            after = {}
        assert changed(before, after), f"{file.name}, line {node.lineno}: {line.decode()}"
        file.write_bytes(b"".join(lines))
