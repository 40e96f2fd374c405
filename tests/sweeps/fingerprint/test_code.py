"""What changes the digest of a function, what does not, and what is refused."""

import dataclasses
import enum
import functools
import importlib
import json
import math
import os
import re
import subprocess
import sys
import textwrap
import threading
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from studies import registry
from sweeps import InputError, load_script
from sweeps.fingerprint.code import check_loaded, digests, libraries
from tests import HOME

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
        chosen.SHIFT = 3  # edit: 3 -> 4
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
    # Another package beside it counts as a whole.
    "beside/__init__.py": "from .inner import near\nUNUSED = 1  # edit: 1 -> 2\n",
    "beside/inner.py": "import scipy\nfrom further import K\ndef near():\n    return K  # edit: K -> K + 1\n",
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


def changed(before, after):
    return sorted(name for name in before | after if before.get(name) != after.get(name))


def run(code, *folders, **environment):
    """What Python prints in another process."""
    command = [sys.executable, *([str(code)] if isinstance(code, Path) else ["-c", code])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))} | environment
    return subprocess.run(command, env=environment, cwd=folders[0], check=True, text=True, stdout=-1).stdout


# Code that is reached by name, and packages that count as a whole.


def test_every_edit_of_what_is_reached_counts(files):
    files()
    before = digests([files.load().compute])
    assert list(before) == sorted(before)
    assert {"beside", "further", "ident", "ident.main"} < set(before)
    assert not {"ident.figures", "numpy", "sys"} & set(before)
    for name, text in PROGRAM.items():
        module = name.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        module = "beside" if module == "beside.inner" else module
        for line in text.splitlines():
            found, _, edits = line.strip().partition("  # edit: ")
            for old, new in (edit.split(" -> ") for edit in edits.split(" | ") if edits):
                files.edit(name, found, edited := found.replace(old, new))
                assert module in changed(before, digests([files.load().compute])), edited
                files({name: text})
    assert digests([files.load().compute]) == before


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("main", '"""What it gives."""', '"""What it really gives."""'),
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


# What is declared.


def test_declared_files_and_folders_count_by_their_bytes(files):
    files({"one.py": "def f(p):\n    pass\n", "config.json": "1", "data/a/b.txt": "1", "data/c.txt": "1"})
    f, code = files.load("one").f, [files.folder / "config.json", files.folder / "data"]
    before = digests([f], code)
    assert set(before) == {"one", "config.json", "data"}
    files({"config.json": "2", "data/a/b.txt": "2"})
    after = digests([f], code)
    assert changed(before, after) == ["config.json", "data"]
    (files.folder / "data/a/b.txt").rename(files.folder / "data/a/c.txt")
    assert changed(after, digests([f], code)) == ["data"]


@pytest.mark.parametrize("name", ["beside", "beside.inner", "further"])
def test_a_declared_package_or_module_counts_as_a_whole(files, name):
    f, path = files().load("ident.core").other, "further.py" if name == "further" else "beside/inner.py"
    before = digests([f], [name])
    assert {"ident.core", name} <= set(before)
    files({path: '"""A text."""\n' + PROGRAM[path].replace("K = 1", "K = (1)  # one")})
    assert digests([f], [name]) == before
    files({path: PROGRAM[path] + "UNUSED = 1\n"})
    assert changed(before, digests([f], [name])) == [name]


def test_an_installed_package_counts_by_its_version(files):
    about = "site-packages/several-1.0.dist-info"
    metadata = "Metadata-Version: 2.1\nName: several\nVersion: {}\n"
    files({"one.py": "def f(p):\n    from several.inner import g\n", "site-packages/several/inner.py": "g = 1\n"})
    files({f"{about}/METADATA": metadata.format("1.0"), f"{about}/top_level.txt": "several\n"})
    sys.path.insert(0, str(files.folder / "site-packages"))
    f = files.load("one").f
    assert set(digests([f])) == {"one"}
    assert libraries([f]) == ["several"]
    assert digests([f], ["several"])["several"] == "version 1.0"
    files({f"{about}/METADATA": metadata.format("1.1"), "site-packages/several/inner.py": "g = 2\n"})
    assert digests([f], ["several"])["several"] == "version 1.1"


@pytest.mark.parametrize("name", ["mylib", "ident.none", Path("none.json")])
def test_what_cannot_be_found_is_refused(files, name):
    with pytest.raises(InputError, match=rf"^code = '{name}': there is no such package, module or file$"):
        digests([files().load("ident.core").helper], [name])


def test_libraries_are_those_that_covered_code_imports(files):
    main = files().load()
    assert {"numpy", "scipy"} <= {*libraries([main.compute])}
    assert libraries([main.f]) == []
    assert libraries([main.f], ["beside"]) == ["scipy"]


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


def test_a_closure_counts_with_its_values():
    found = [tuple(digests([maker(value)]).items()) for value in VALUES]
    assert len(set(found)) == len(VALUES)
    assert found == [tuple(digests([maker(value)]).items()) for value in VALUES]


@pytest.mark.parametrize("value", [threading.Lock(), [threading.Lock()], (n for n in "a")])
def test_what_cannot_be_compared_is_refused(value):
    functions = maker(value), functools.partial(maker, held=value), lambda points, held=value: held, Caller(value)
    for each in functions:
        with pytest.raises(InputError, match=r" has held = .*, which cannot be compared with a stored value"):
            digests([each])


def test_carried_functions_are_followed_and_compiled_ones_have_their_options(files):
    helper = files().load("ident.core").helper
    given = [maker(helper), functools.partial(nothing, helper), functools.lru_cache(helper), njit(helper)]
    before = [digests([each]) for each in given]
    assert before[3] == digests([njit(helper)]) != digests([njit(fastmath={"nsz", "contract"})(helper)])
    files.edit("ident/core.py", "x + 1", "x + 2")
    for old, each in zip(before, given, strict=True):
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
from sweeps.fingerprint.code import check_loaded, digests
TABLE = {"a": 1}
TABLE["b"] = 2
@dataclasses.dataclass
class Kind:
    size: float = 1.0
def f(points):
    return Kind(), TABLE, K
check_loaded([f])
found = digests([f, lambda points: Kind])
print(json.dumps(found))
"""


def test_a_script_is_the_module_of_its_file(files, capsys):
    file = files({"further.py": "K = 1\n", "one_script.py": SCRIPT}).folder / "one_script.py"
    started = json.loads(run(file, HOME))
    assert set(started) == {"one_script", "further"}
    module = load_script(file)
    assert json.loads(capsys.readouterr().out) == started
    assert load_script(file) is module
    # Of what a script does besides, nothing counts that its functions do not use.
    file.write_text(SCRIPT + "print()\n")
    assert json.loads(run(file, HOME)) == started
    file.write_text(SCRIPT.replace("= 2", "= 3"))
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


# Code that is loaded and is not what its file contains now.


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("ident/core.py", "return x + 1", "return x + 2"),
        ("ident/main.py", "np.sin(total)", "np.cos(total)"),
        ("ident/main.py", "def compute(", "def another("),
        ("ident/models.py", "self.weight > 2", "self.weight > 1"),
        ("beside/inner.py", "return K", "return -K"),
        ("further.py", "K = 1", "K = 2"),
    ],
)
def test_loaded_code_that_is_not_in_its_file_is_refused(files, name, old, new):
    compute = files().load().compute
    check_loaded([compute])
    files.edit(name, old, new)
    message = rf"^{Path(name).name} has changed since Python loaded it \(.*\); restart Python, or reload"
    with pytest.raises(InputError, match=message):
        check_loaded([compute])


def test_the_projects_own_studies():
    for name in registry.NAMES:
        sweep = registry.load(name).sweep({})
        functions = [each for each in (sweep.function, sweep.key, sweep.scale) if each is not None]
        check_loaded(functions, ["fivcore"])
        found = digests(functions, ["fivcore"])
        assert "fivcore" in found
        assert not [each for each in found if re.match(r"studies\.(plotting|registry|report)", each)]
        assert not {"matplotlib", "sweeps"} & {*libraries(functions, ["fivcore"])}
