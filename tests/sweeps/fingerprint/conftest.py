"""Packages that a test may write and change."""

import sys

import pytest

from tests.helpers.identity_parts import PROGRAM, Package


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Makes a package called `ident` of some files."""
    monkeypatch.syspath_prepend(tmp_path)
    yield lambda files=PROGRAM: Package(tmp_path, files)
    for name in [name for name in sys.modules if name.partition(".")[0] == "ident"]:
        del sys.modules[name]
