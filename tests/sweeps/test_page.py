"""`python -m sweeps`, and the words of the engine's messages."""

import ast
import re
import subprocess
import sys

import sweeps
from tests import HOME


def test_the_page_has_every_name_of_a_user():
    command = [sys.executable, "-m", "sweeps"]
    page = subprocess.run(command, capture_output=True, text=True, cwd=HOME, check=True).stdout
    assert len(page.splitlines()) < 100
    assert "Plan.run(scheduler='threads', workers=None, progress=None, *, fail_fast=False)\n" in page
    readme = (HOME / "sweeps" / "README.md").read_text()
    errors = [each for each in vars(sweeps).values() if isinstance(each, type) and issubclass(each, BaseException)]
    named = {*re.findall(r"sweeps\.(\w+)\(", readme), *(each.__name__ for each in errors)}
    assert {name for name in named if not re.search(rf"^  {name}\b", page, re.MULTILINE)} == set()


def test_messages_of_the_engine_speak_python():
    """They name arguments, no options of a command."""
    for file in (HOME / "sweeps").rglob("*.py"):
        texts = [n.value for n in ast.walk(ast.parse(file.read_text())) if isinstance(n, ast.Constant)]
        assert not [each for each in texts if isinstance(each, str) and re.search(r"[\s(]--\w|\bfiv \w", each)]
