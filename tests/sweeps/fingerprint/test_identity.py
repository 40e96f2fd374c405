"""Which code a function reaches, as digests that stay the same where it stays the same."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fivcore import Scene, simulate
from studies.gallery import fig7
from studies.gallery.scenes import study as scenes
from sweeps import Axis, Grid, Sweep, Variable
from sweeps.fingerprint.code import differing, digests
from sweeps.fingerprint.identity import differences, fingerprint
from tests import HOME
from tests.helpers.identity_parts import HARMLESS, PROGRAM, edits, run


def module_of(file):
    return "ident." + file.removesuffix(".py").replace("/", ".")


# What makes no difference.


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("main.py", '"""What it gives."""', '"""What it really gives."""'),
        ("main.py", '"""The module computes."""', '"""Another text."""'),
        ("main.py", "np.sin(total) * factor", "(\n        np.sin( total )\n    ) * factor"),
        ("main.py", "(points, factor=DEFAULT):", "(points: dict, factor: float = DEFAULT) -> dict:"),
        ("main.py", "SCALE = 2.0", "SCALE: float = 2.0"),
        ("main.py", "total = SCALE", "total: float = SCALE"),
        ("main.py", 'color="blue"', 'color="red"'),
        ("main.py", "from ident.figures import Figure", "from ident.figures import Figure, Other"),
        ("main.py", "import numpy as np\n", "import json\nimport numpy as np\nfrom ident import figures\n"),
        ("main.py", "api, lazy, registry, tools", "tools, registry, lazy, api"),
        (
            "main.py",
            "import functools\nfrom typing import TYPE_CHECKING",
            "from typing import TYPE_CHECKING\nimport functools",
        ),
        ("main.py", "tools.paint(figure, color)", "tools.paint(figure, color)\nif __name__ == '__main__':\n    1"),
        ("api.py", "helper as helper, other", "other, helper as helper"),
        ("figures.py", "size = 8", "size = 9"),
    ],
)
def test_what_is_not_run_makes_no_difference(package, name, old, new):
    files = package()
    compute = files.load("main").compute
    before = digests(compute)
    files.edit(name, old, new)
    assert digests(compute) == before


def test_what_packages_do_when_they_are_imported_counts(package):
    files = package()
    compute = files.load("main").compute
    before = digests(compute)
    files.write("deep/__init__.py", "import numpy\n\nUNUSED = 1\nnumpy.seterr(all='raise')\n")
    after = digests(compute)
    assert differing(before, after) == ["ident.deep"]
    files.edit("deep/__init__.py", "UNUSED = 1", "UNUSED = 2")
    assert digests(compute) == after


def test_only_what_is_ours_is_named(package):
    found = digests(package().load("main").compute)
    assert list(found) == sorted(found)
    unnamed = {"__init__.py", "deep/__init__.py", "figures.py"}
    assert set(found) == {"ident"} | {module_of(name) for name in PROGRAM if name not in unnamed}
    assert all(len(digest) == 16 for digest in found.values())


def test_nothing_is_imported_for_it(package):
    files = package({"__init__.py": "", "main.py": "def f(p):\n    from ident import late\n    return late.g()\n"})
    files.write("late.py", "raise RuntimeError('imported')\ndef g():\n    return 1\n")
    assert set(digests(files.load("main").f)) == {"ident.main", "ident.late"}
    assert "ident.late" not in sys.modules


def test_a_star_brings_whole_modules(package):
    files = package(
        {
            "__init__.py": "from ident.first import *\nfrom ident.second import K\n__all__ = ['g', 'K']\n",
            "first.py": "def g():\n    return 1\n\n\ndef unused():\n    return 1\n",
            "second.py": "K = 1\n",
            "third.py": "import ident.second\n\n\ndef h():\n    return ident.second.K\n",
            "main.py": """
                from math import *
                from ident import *
                from ident.third import *

                def f(points):
                    K = len(points)
                    return g() + sin(K)

                def whole(points):
                    return h() + K
                """,
        }
    )
    main = files.load("main")
    before, whole = digests(main.f), digests(main.whole)
    assert set(before) >= {"ident", "ident.first", "ident.main"}
    assert set(whole) >= {"ident", "ident.second", "ident.third", "ident.main"}
    files.edit("second.py", "K = 1", "K = 2")
    assert differing(whole, digests(main.whole)) == ["ident.second"]
    files.edit("first.py", "g():\n    return 1", "g():\n    return 3")
    assert "ident.first" in differing(before, digests(main.f))


def test_names_of_a_functions_own_lead_nowhere(package):
    text = """
        import time

        a = b = c = d = e = g = time.time()
        k = 1

        def f(points, a=k):
            (b, c), d = points, 1
            for e in points:
                g = lambda e: e
            return [d for d in b] + [a, c, e, g, lambda g: g]
        """
    files = package({"__init__.py": "", "main.py": text})
    f = files.load("main").f
    before = digests(f)
    files.edit("main.py", "= g = time.time()", "= time.time() + 1")
    assert digests(f) == before
    files.edit("main.py", "[d for d in b]", "[b for b in b]")
    files.edit("main.py", "k = 1", "k = 2")
    assert digests(f) != before


def test_differing_names_what_differs():
    assert differing({"a": "1", "b": "2", "c": "3"}, {"b": "2", "c": "4", "d": "5"}) == ["a", "c", "d"]
    assert differing({"a": "1"}, {"a": "1"}) == []


def test_the_project_itself(tmp_path):
    """Neither its place, a process, a run nor figures change its identity; an edit of what is computed does."""
    for name in ("fivcore", "sweeps", "studies"):
        shutil.copytree(HOME / name, tmp_path / name)  # with what is compiled
    found = run(
        """
        import ast, json, pathlib
        from studies.gallery import fig7
        from studies.gallery.scenes import study as scenes
        from sweeps.fingerprint.code import differing, digests

        def changed(name, function):
            path = pathlib.Path(name)
            lines = path.read_text().splitlines()
            body = next(n for n in ast.parse("\\n".join(lines)).body if getattr(n, "name", "") == function).body
            first = body[1]  # after the docstring
            lines.insert(first.lineno - 1, " " * first.col_offset + "unused = 1")
            path.write_text("\\n".join(lines))
            return differing(before, digests(fig7.histories))

        before = digests(fig7.histories)
        print(json.dumps([fig7.__file__, digests(fig7.histories, scenes.motions), before,
            changed("studies/gallery/fig7.py", "draw"), changed("studies/gallery/fig7.py", "findings"),
            changed("fivcore/transient/fast_kernel.py", "advance"),
            changed("studies/gallery/fig7.py", "histories")]))
        """,
        tmp_path,
        PYTHONHASHSEED="2",
    )
    file, both, before, *changed = json.loads(found)
    assert Path(file).is_relative_to(tmp_path)
    kernel, figure = "fivcore.transient.fast_kernel", "studies.gallery.fig7"
    assert {"fivcore.transient.fast", kernel, "studies.motion.transients", figure} <= set(before)
    assert not {"studies.plotting.figures", "studies.registry", "matplotlib"} & set(before)
    assert not [name for name in before if name.startswith("sweeps")]
    assert changed == [[], [], [kernel], [kernel, figure]]
    assert digests(fig7.histories, scenes.motions) == both
    simulate(Scene(1e-3, 10.0, 0.3, 20.0), 1e-3)
    assert digests(fig7.histories, scenes.motions) == both


# Every edit of a program of several modules.


@pytest.fixture
def program(package, monkeypatch):
    """A program's files, and its function's digests as a new process would find them."""
    # Edits within one tick of the clock would load what was compiled before.
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    files = package()

    def found():
        for name in [name for name in sys.modules if name.partition(".")[0] == "ident"]:
            del sys.modules[name]
        return digests(files.load("main").compute)

    return files, found


def test_each_edit_of_what_is_reached_counts(program):
    files, found = program
    before = found()
    for name, line, edited in edits():
        files.edit(name, line, edited)
        assert module_of(name) in differing(before, found()), edited
        files.write(name, PROGRAM[name])
    assert found() == before


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.sampled_from([*edits()]), st.data())
def test_one_edit_counts_whatever_else_is_edited_that_does_not(program, edit, data):
    files, found = program
    files.write("main.py", PROGRAM["main.py"])
    before = found()
    blocks = (files.folder / "main.py").read_text().strip("\n").split("\n\n")
    # Behind the import that must be the first.
    ends = [k for k in range(2, len(blocks) + 1) if k == len(blocks) or not blocks[k].startswith(" ")]
    for place in sorted(data.draw(st.lists(st.sampled_from(ends), max_size=3, unique=True)), reverse=True):
        blocks.insert(place, data.draw(st.sampled_from(HARMLESS)))
    files.write("main.py", "\n\n".join(blocks) + "\n")
    assert found() == before
    name, line, edited = edit
    text = (files.folder / name).read_text()
    files.edit(name, line, edited)
    assert found() != before
    files.write(name, text)


@pytest.mark.parametrize(
    "main",
    [
        "from contextlib import contextmanager\nf = contextmanager(lambda: K)\nK = 1\n",
        "class C:\n    __slots__ = ()\n    def __call__(self, p):\n        return K\nf = C()\nK = 1\n",
        "class C:\n    def __getattr__(self, name):\n        return K\n    __call__ = print\nf = C()\nK = 1\n",
        "import numpy as np\ndef g(x):\n    return K\nf = np.vectorize(g)\nK = 1\n",
        "from typing import TYPE_CHECKING\nif not TYPE_CHECKING:\n    K = 1\ndef f(p):\n    return K\n",
        "from ident.star import *\ndef f(p):\n    return sum(p)\n",
        "def f(p, K=None):\n    import ident.star as other\n    return other.sum(p)\n",
        "try:\n    from ident.star import sum as s\nfinally:\n    pass\ndef f(p):\n    return s\n",
        "try:\n    from ident.star import *\nfinally:\n    pass\ndef f(p):\n    return sum(p)\n",
        "T = []\n@T.append\ndef g(p):\n    return K\nK = 1\ndef f(p):\n    return T[0](p)\n",
        (
            "T = []\nif T is not None:\n    @T.append\n    def g():\n        return K\nK = 1\ndef f(p):\n"
            "    return T[0]()\n"
        ),
        (
            "import contextlib\nT = []\ndef fill():\n    T.append(lambda: K)\n"
            "    return contextlib.nullcontext()\nwith fill():\n    K = 1\ndef f(p):\n    return T[0]()\n"
        ),
        "T = []\ndef fill(name):\n    T.append(lambda: K)\nfill(__name__)\nK = 1\ndef f(p):\n    return T[0]()\n",
        "T = U = []\nU += [lambda: K]\nK = 1\ndef f(p):\n    return T[0]()\n",
        "class C:\n    global g\n    def g():\n        return K\nK = 1\ndef f(p):\n    return g()\n",
        (
            "def sum(p):\n    return 0\ntry:\n    from ident.star import *\nfinally:\n    pass\ndef f(p):\n"
            "    return sum(p)\n"
        ),
        (
            "import functools\nclass C:\n    def __init__(self, g):\n"
            "        functools.update_wrapper(self, g)\n        self.k = K\n    def __call__(self, p):\n"
            "        return self.k\nK = 1\nf = C(print)\n"
        ),
        "T = []\nK = 1\nfor k in (K, 0):\n    def f(p, k=k):\n        return k\n    T.append(f)\nf = T[0]\n",
        "K = 1\nf = eval(f'lambda p{K}: 0')\n",
        "exec('def f(p):\\n    from ident.star import sum\\n    return sum(p)\\n')\n",
        (
            "class C:\n    def __init__(self):\n        self.me, self.k = self, K\n"
            "    def __call__(self, p):\n        return self.k\nK = 1\nf = C()\n"
        ),
        "try:\n    from ...none import g\nexcept ImportError:\n    K = 1\ndef f(p):\n    return K\n",
        # A module that is used counts as a whole.
        *(f"from ident import star\ndef f(p):\n    return {use}\n" for use in ("star.A", "getattr(star, 'A')")),
        # From any depth.
        *(
            f"K = 1\ndef f(p):\n    {body}\n"
            for body in (
                "return K",
                "return [K for K in p] + [K]",
                "return [1 for K in K]",
                "def g():\n        K = 0\n    return K",
                "K = 0\n    def g():\n        global K\n        return K\n    return g()",
                "return lambda p=K: p",
                "class C:\n        K = K\n    return C",
                "global K\n    K = 0",
            )
        ),
    ],
)
def test_ways_to_reach_a_constant(package, main):
    files = package({"__init__.py": "", "star.py": "K = 1\n\n\ndef sum(p):\n    return K\n", "main.py": main})
    before = digests(files.load("main").f)
    name = "main.py" if "K = 1" in main else "star.py"
    files.edit(name, "K = 1", "K = 2")
    for loaded in ("ident.main", "ident.star", "ident"):
        sys.modules.pop(loaded, None)
    assert digests(files.load("main").f) != before


# What is recorded of a sweep.


def test_the_code_of_a_constants_class_counts(package):
    files = package(
        {
            "__init__.py": "",
            "models.py": "from dataclasses import dataclass\n\n@dataclass\nclass Model:\n    size: float\n\n"
            "    def area(self):\n        return self.size**2\n",
            "main.py": "def f(points, **constants):\n    return {'y': constants['models'][0].area()}\n",
        }
    )
    grid, variables, model = Grid({"x": Axis([1.0])}), {"y": Variable()}, files.load("models").Model(2.0)
    sweep = Sweep("areas", files.load("main").f, grid, variables, {"models": [model], "table": np.arange(3.0)})
    before = fingerprint(sweep, ())
    # The class of an array does not make its library the project's.
    assert set(before["sources"]) == {"ident.main", "ident.models", "numpy"}
    files.edit("models.py", "self.size**2", "self.size**3")
    assert differences(before, fingerprint(sweep, ())) == "the code of ident.models has changed"
