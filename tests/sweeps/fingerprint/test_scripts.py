"""A script and the module of its file are one: what one has computed the other takes up."""

import importlib
import json
import sys

import pytest

from sweeps import InputError, load_script
from sweeps.fingerprint.code import digests
from tests import HOME
from tests.helpers.identity_parts import printed, run

SCRIPT = """
import dataclasses
import json
from sweeps import *
from sweeps.fingerprint.code import digests
TABLE = {"a": 1}
TABLE["b"] = 2
@dataclasses.dataclass
class Kind:
    size: float = 1.0
def inner(points):
    return Kind(), TABLE
def f(points):
    return inner(points)
print(json.dumps(digests(f, lambda points: Kind)))
"""


@pytest.fixture
def script(tmp_path, monkeypatch):
    """Write a script; what it imports is forgotten afterwards."""
    monkeypatch.setattr(sys, "path", [*sys.path])
    before = set(sys.modules)

    def write(text=SCRIPT, name="one_script.py"):
        (tmp_path / name).write_text(text)
        return tmp_path / name

    yield write
    for name in set(sys.modules) - before:
        if getattr(sys.modules[name], "__file__", "").startswith(str(tmp_path)):
            del sys.modules[name]


def test_a_script_is_the_module_of_its_file(script, capsys):
    file = script()
    started = json.loads(run(file, HOME))
    module = load_script(file)
    assert json.loads(capsys.readouterr().out) == started
    assert set(started) == {"one_script"}
    assert load_script(file) is module
    # Of what it does besides, as a script's, nothing counts that the functions do not use.
    file.write_text(SCRIPT + "print('more')\n")
    assert printed(file).startswith(json.dumps(started))
    file.write_text(SCRIPT.replace("= 2", "= 3"))
    assert json.loads(printed(file)) != started


def test_an_import_of_a_script_that_does_nothing_besides_is_the_script(script):
    file = script(SCRIPT.replace("print(", "x = lambda: ("))
    sys.path.insert(0, str(file.parent))
    imported = digests(importlib.import_module("one_script").f)
    del sys.modules["one_script"]
    assert imported == digests(load_script(file).f)


def test_what_lies_beside_a_script_is_found(script):
    script("FACTOR = 2\n", "beside_it.py")
    assert load_script(script("from beside_it import FACTOR\n")).FACTOR == 2


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.py", None, r"none\.py: there is no such file"),
        ("json.py", "", "Python has a module called json already; rename the file"),
        ("wrong.py", "1 +", "wrong.py: it cannot be loaded: SyntaxError: invalid syntax"),
        ("wrong.py", "nothing", "wrong.py: it cannot be loaded: NameError: name 'nothing' is not defined"),
    ],
)
def test_a_file_that_cannot_be_loaded_is_one_line(script, name, text, message):
    file, path = script(text or "", name), [*sys.path]
    if text is None:
        file.unlink()
    with pytest.raises(InputError, match=message) as told:
        load_script(file)
    assert "\n" not in str(told.value)
    assert sys.path == path
