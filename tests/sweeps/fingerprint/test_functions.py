"""What functions carry along, and functions without a source: what of them makes a difference."""

import functools
import json
import math
import shutil
import textwrap
import threading

import numpy as np
import pytest

from sweeps.fingerprint.code import differing, digests
from tests import HOME
from tests.helpers import waves
from tests.helpers.identity_parts import NAMED, PROGRAM, Caller, Colour, Inner, Outer, maker, printed, run


def same_everywhere():
    pass


VALUES = [None, True, 1, 1.0, -0.0, 0.0, math.nan, 1j, "1", b"1", range(3), Colour.RED, Colour.BLUE]
VALUES += [np.float64(1.0), np.float32(1.0), np.arange(3), np.arange(3.0), np.arange(3)[:, None]]
VALUES += [np.array(["a", None]), [1, 2], (1, 2), {1, 2}, {"a": 1}, {"a": 2}, Inner(), Inner(2.0), Outer()]
VALUES += [Outer(Inner(2.0)), math.sin, math.cos, np.sin, np.cos, np.mean, math, np, Inner, Outer]
VALUES += [same_everywhere, maker(1)]


def test_a_closure_counts_with_its_values():
    found = [tuple(digests(maker(value)).items()) for value in VALUES]
    assert len(set(found)) == len(VALUES)
    assert found == [tuple(digests(maker(value)).items()) for value in VALUES]
    copies = [digests(maker(value)) for value in ([1, 2], {"a": 1}, Inner(2.0), np.arange(3), {2, 1})]
    assert copies == [digests(maker(value)) for value in ([1, 2], {"a": 1}, Inner(2.0), np.arange(3), {1, 2})]


@pytest.mark.parametrize("value", [threading.Lock(), object(), [object()], iter([1]), Outer(values=(object(),))])
def test_what_cannot_be_compared_is_refused(value):
    said = "held = .*, which cannot be compared with a stored one; pass it as a constant"
    with pytest.raises(ValueError, match=rf"^function maker.<locals>.inner closes over {said}"):
        digests(maker(value))
    with pytest.raises(ValueError, match=rf"^function maker is given {said}"):
        digests(functools.partial(maker, held=value))
    with pytest.raises(ValueError, match=r"has the default held = .*, which cannot"):
        digests(lambda points, held=value: held)


def test_a_function_that_calls_itself_within_another():
    def outer():
        def again(points):
            return again(points)

        return again

    assert digests(outer()) == digests(outer())


def test_lambdas_of_one_line_are_told_apart():
    one, two, three = lambda p: p + 1, lambda p: p + 2, lambda p, k=3: p + k
    assert len({digests(f)[__name__] for f in (one, two, three, lambda p: p - 1)}) == 4
    assert digests(one) == digests(lambda p: p + 1)
    assert len({digests(lambda p, k=k: p + k)[__name__] for k in (1, 2, 1)}) == 2


def test_a_partial_is_its_function_with_what_is_given():
    def of(*places, **named):
        return digests(functools.partial(same_everywhere, *places, **named))

    assert of(a=1, b=2) == of(b=2, a=1)
    assert of(a=1) != of(a=2)
    assert of(1) != of(2)
    assert of(Inner()) == of(Inner())
    assert of(a=1) == digests(functools.partial(functools.partial(same_everywhere), a=1))


def test_wrapped_and_closed_over_functions_lead_to_both(package):
    text = """
        import functools
        from ident.core import helper

        def wrapped(f):
            @functools.wraps(f)
            def inner(p):
                return 3 * f(p)
            return inner
        """
    files = package(PROGRAM | {"wrap.py": text})
    helper = files.load("core").helper
    function, cached, closed = files.load("wrap").wrapped(helper), functools.lru_cache(helper), maker(helper)
    before, inside = digests(function), digests(closed)
    assert set(before) == {"ident.core", "ident.wrap"}
    assert digests(cached) == digests(helper)
    files.edit("core.py", "x + 1", "x + 2")
    files.edit("wrap.py", "3 * f(p)", "4 * f(p)")
    assert differing(before, digests(function)) == ["ident.core", "ident.wrap"]
    assert differing(inside, digests(closed)) == ["ident.core"]


def test_compiled_functions_are_their_python_with_the_compilers_options(package):
    from numba import njit

    files = package()
    helper = files.load("core").helper
    before = digests(njit(helper))
    assert set(before) == {"ident.core"}
    assert before == digests(njit(helper)) != digests(njit(fastmath={"nsz", "contract"})(helper))
    files.edit("core.py", "x + 1", "x + 2")
    assert digests(njit(helper)) != before


def test_methods_and_instances_count_with_their_state():
    assert digests(Caller(1)) == digests(Caller(1)) != digests(Caller(2))
    assert digests(Caller(1).method) == digests(Caller(1).method) != digests(Caller(2).method)
    assert digests(Caller.of_class) == digests(Caller.of_class) != digests(Caller.method)
    with pytest.raises(ValueError, match=r"the Caller that is called holds held = .*cannot be compared"):
        digests(Caller(threading.Lock()))
    with pytest.raises(ValueError, match="cannot be compared"):
        digests([].append)


def test_a_librarys_function_is_known_by_its_name():
    assert digests(np.sin) != digests(np.cos)
    assert set(digests(np.sin)) == {"numpy"}
    assert set(digests(functools.partial(math.pow, 2.0))) == {"math"}


# What names of modules stand for.


@pytest.mark.parametrize(
    ("module", "name", "value", "counts"),
    [
        *(("settings", "COUNT", value, True) for value in (2, True, 1.0, None)),
        *(
            ("settings", "TABLE", value, True)
            for value in (np.arange(3.0), np.arange(3.0, dtype="f4"), np.int8(1))
        ),
        *(("settings", "SAID", value, True) for value in (2.5, 2)),
        *(("settings", "WORDS", "b", True), ("settings", "NUMBER", True, True), ("settings", "SAID", 2.0, False)),
        *(("settings", "FOLDER", "/elsewhere", False), ("settings", "UNUSED", 6.0, False)),
        *(("settings", "SEEN", [1], False), ("main", "LOCAL", 4.0, False), ("main", "RUNS", 7, False)),
    ],
)
def test_numbers_and_arrays_of_modules_count(package, module, name, value, counts):
    files = package(NAMED)
    f = files.load("main").f
    before = digests(f)
    setattr(files.load(module), name, value)
    assert differing(before, digests(f)) == [f"ident.{module}"] * counts


def test_what_running_changes_does_not_count(package, monkeypatch):
    files = package(NAMED)
    files.edit("main.py", "settings.SAID", "settings.keep(points)")
    f = files.load("main").f
    before, logged = digests(f), digests(waves.wave)
    f(1.0)
    monkeypatch.setattr(waves, "LOG", [*waves.LOG, (1.0,)])
    assert (digests(f), digests(waves.wave)) == (before, logged)
    assert files.load("settings").LAST == 1


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
    names = {"__name__": "nowhere"}
    exec(text, names)
    return digests(names["f"])


def test_code_without_a_source_counts_as_it_was_compiled():
    found = bare(BARE)
    assert set(found) == {"nowhere"}
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
        from sweeps.fingerprint.code import digests
        def maker(held):
            return lambda points: held
        print(json.dumps([digests(f), digests(ident.main.compute), digests(maker({"x", "y", "z"}))]))
        """)
    printed = {run(code, files.folder.parent, HOME, PYTHONHASHSEED=seed) for seed in ("1", "2")}
    assert len(printed) == 1
    first, second, third = json.loads(printed.pop())
    assert set(first) == set(third) == {"__main__"}
    assert second == digests(files.load("main").compute)


def test_a_script_counts_with_what_its_functions_use(tmp_path, monkeypatch):
    """Text, what is changed in place, and what names stand for: also of an environment and a file."""
    text = textwrap.dedent("""
        import json, os, time
        import numpy as np
        from sweeps.fingerprint.code import digests
        start = time.time()
        K = float(os.environ["K"])
        T = np.loadtxt("coef.txt")
        FACTOR, TABLE = 2, {}
        OTHER = {}
        TABLE["a"] = 1
        TABLE.update(b=2)
        OTHER["a"] = 3
        def f(p):
            start = p["x"]
            return {"y": start * K + T, "z": FACTOR, "t": TABLE}
        g = lambda points: 1
        if __name__ == "__main__":
            print(json.dumps(digests(f, g)))
        """)
    script, table = tmp_path / "script.py", tmp_path / "coef.txt"
    monkeypatch.chdir(tmp_path)

    def found(edit="", factor="1", coefficients="1 2\n"):
        old, _, new = edit.partition(" -> ")
        assert not edit or text.count(old) == 1
        script.write_text(text.replace(old, new) if edit else text)
        table.write_text(coefficients)
        monkeypatch.setenv("K", factor)
        return printed(script)

    first = found()
    assert set(json.loads(first)) == {"script"}
    assert {found('FACTOR, "t" -> FACTOR,  "t"'), found("= 3 -> = 5"), found(factor="1.0")} == {first}
    others = [found(edit) for edit in ("= 2, -> = 3,", "= 1\n -> = 5\n", "b=2 -> b=5", ": 1\n -> : 2\n")]
    assert len({first, *others, found(factor="2"), found(coefficients="1 3\n")}) == 7


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
        from sweeps.fingerprint.code import digests
        print(json.dumps([sweeps.__file__, sorted(digests(lambda points: one.f(points))), sorted(digests(one.f))]))
        """
    file, _, found = json.loads(run(code, place))
    assert "site-packages" in file
    assert found == ["one", "two"]
