"""Compiled kernels: the folder that keeps them, what may happen to it, and what decides their bits."""

import ast
import errno
import os
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit

from fivcore import jit, kernel_store
from tests.helpers import processors


def in_a_new_process(code, **variables):
    """What a process prints; a variable that is None is not set in it."""
    environment = {name: value for name, value in (os.environ | variables).items() if value is not None}
    return subprocess.check_output([sys.executable, "-c", code], text=True, env=environment)


def doubled(x):
    return 2.0 * x


@pytest.fixture
def compiled(tmp_path, monkeypatch):
    """Make a dispatcher as another process would, over one folder."""
    monkeypatch.setattr(kernel_store, "FOLDER", tmp_path / "kernels")
    return lambda: kernel_store.attach(njit(doubled))


def is_loaded(dispatcher):
    """Call a kernel, and tell whether it came from the disk."""
    assert dispatcher(1.5) == 3.0
    return sum(dispatcher.stats.cache_hits.values()) == 1


def cut(file):
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])


def empty(file):
    file.write_bytes(b"")


def garbage(file):
    file.write_bytes(bytes(range(256)) * 8)


def one_bit(file):
    found = bytearray(file.read_bytes())
    found[len(found) // 2] ^= 1
    file.write_bytes(found)


def removed(file):
    file.unlink()


ONCE = [("*.nbi", cut), ("*.nbi", garbage), ("*.nbc", one_bit), ("*.nbc", removed), ("checksum", empty)]


@pytest.mark.parametrize(("pattern", "damage"), ONCE)
def test_a_damaged_file_costs_a_compilation(compiled, tmp_path, pattern, damage):
    assert not is_loaded(compiled())
    assert is_loaded(compiled())
    (file,) = tmp_path.rglob(pattern)
    damage(file)
    assert not is_loaded(compiled())
    assert is_loaded(compiled())


def test_a_file_that_numba_cannot_read_costs_a_compilation(compiled, tmp_path):
    """Whatever it raises: here the checksum is right, as after a fault before it was taken."""
    compiled()(1.5)
    (file,) = tmp_path.rglob("*.nbi")
    garbage(file)
    (place,) = kernel_store.FOLDER.iterdir()
    (place / "checksum").write_text(kernel_store._checksum(place))
    assert not is_loaded(compiled())
    assert is_loaded(compiled())


def test_a_full_disk_is_said_and_leaves_nothing(compiled, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", full)  # the end of writing a file, in Numba
        with pytest.warns(
            UserWarning, match=r"compiled kernels are not kept in .*kernels: No space left on device"
        ):
            assert not is_loaded(compiled())
    assert list(kernel_store.FOLDER.iterdir()) == []
    assert not is_loaded(compiled())
    assert is_loaded(compiled())


def test_a_folder_that_vanishes_is_made_again(compiled):
    compiled()(1.5)
    again = compiled()
    shutil.rmtree(kernel_store.FOLDER)
    assert not is_loaded(again)
    assert is_loaded(compiled())


def test_two_processes_that_compile_at_once_keep_one_variant(compiled, monkeypatch):
    """The second one has found nothing, and when it has compiled the first one has stored."""
    first, second = compiled(), compiled()
    with monkeypatch.context() as patched:
        patched.setattr(second._cache, "load_overload", lambda *_: first(1.5) and None)
        assert not is_loaded(second)
    assert len(list(kernel_store.FOLDER.iterdir())) == 1
    assert is_loaded(compiled())


def test_every_variant_has_a_folder_of_its_own(compiled):
    """In one list of Numba's two processes might give two variants one file."""
    one = compiled()
    assert (one(1.5), one(1)) == (3.0, 2.0)
    assert len(list(kernel_store.FOLDER.iterdir())) == 2
    assert is_loaded(compiled())


def test_without_a_folder_kernels_are_compiled(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    found = kernel_store.cache_folder([tmp_path / "file" / "within"])
    monkeypatch.setattr(kernel_store, "FOLDER", found)
    assert found is None
    assert not is_loaded(kernel_store.attach(njit(doubled)))


def test_a_user_without_a_home_may_import():
    """As in a container: no HOME, no entry for the user, and an installation that may only be read."""
    code = """
import os, pathlib
def no_home():
    raise RuntimeError("Could not determine home directory.")
pathlib.Path.home, os.access = no_home, lambda *_: False
from fivcore import glued_frequencies, kernel_store, Rig
print(kernel_store.FOLDER, len(glued_frequencies(Rig(), 5.0)))
"""
    said = in_a_new_process(code, HOME=None, XDG_CACHE_HOME=None, NUMBA_CACHE_DIR=None)
    assert said == "None 8\n"


def test_folders_of_others_beside_the_kernels_stay(tmp_path):
    """However old they are and whatever their name; old kernels of our own sources go."""
    others, old = tmp_path / "kernels-of-someone-else", tmp_path / "fiv" / "kernels-of-old-sources"
    for folder in (others, old):
        folder.mkdir(parents=True)
        os.utime(folder, (0, 0))
    code = "from fivcore.kernel_store import FOLDER; print(FOLDER)"
    assert in_a_new_process(code, NUMBA_CACHE_DIR=str(tmp_path)).startswith(str(tmp_path / "fiv" / "kernels-"))
    assert others.exists()
    assert not old.exists()


def test_who_needs_a_part_first_changes_no_bit():
    """Numba would pass the freedom to fuse products and sums on to what a kernel calls."""

    @jit.inlined
    def part(a, b, c):
        return a * b + c

    @jit.contracted
    def whole(a, b, c):
        return part(a, b, c)

    assert njit(lambda a, b, c: whole(a, b, c))(0.1, 3.0, -0.3) == 0.1 * 3.0 - 0.3


def test_fast_math_code_has_no_powers():
    """Numba compiles `x ** n` once a process, with the freedom of the kernel that first needs it.

    Then the bits of a result would depend on what was computed before.
    """
    free, found = {"contracted", "reordered", "reordered_call"}, 0
    for path in Path(jit.__file__).parent.rglob("*.py"):
        for part in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(part, ast.FunctionDef) and free & {ast.unparse(each) for each in part.decorator_list}:
                found += 1
                assert not any(isinstance(each, ast.Pow) for each in ast.walk(part)), (path.name, part.name)
    assert found > 10


def test_functions_bear_the_options_that_decide_their_bits():
    """As texts and sorted lists, so that they are the same in every process."""
    assert jit.reordered(lambda x: x).compiled_with["fastmath"] == ["contract", "nsz", "reassoc"]
    parts = [part(lambda x: x) for part in (jit.called, jit.inlined, jit.contracted, jit.reordered)]
    assert len({repr(part.compiled_with) for part in parts}) == 4
    assert jit.kernel(doubled).compiled_with == {"nogil": "True", "error_model": "numpy", "fastmath": "False"}


@pytest.mark.skipif(platform.machine().lower() not in ("x86_64", "amd64"), reason="registers of x86")
@pytest.mark.parametrize(
    ("target", "none", "some"),
    [pytest.param("haswell", "z", "y", marks=pytest.mark.slow), ("generic", "[yz]", "x")],
)
def test_other_processors_are_imitated(tmp_path, target, none, some):
    """The widest registers: 256 bits (ymm) with AVX2, 128 (xmm) with SSE2; 512 (zmm) would be AVX-512's."""
    code = """
import numpy as np
from fivcore.beams.similar import lower_deflections
lower_deflections(0.3, np.ones(22))
print(*lower_deflections.inspect_asm().values())
"""
    variables = processors.VARIABLES[target] | {"NUMBA_CACHE_DIR": str(tmp_path)}
    assembly = in_a_new_process(code, **variables)
    assert not re.search(rf"%{none}mm\d", assembly)
    assert re.search(rf"%{some}mm\d", assembly)
