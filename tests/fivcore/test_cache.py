"""The folder of compiled kernels."""

import os
import subprocess
import sys

from numba import njit

from fivcore import jit


def test_folders_of_others_beside_the_kernels_stay(tmp_path):
    """However old they are and whatever their name; old kernels of our own sources go."""
    others, old = tmp_path / "kernels-of-someone-else", tmp_path / "fiv" / "kernels-of-old-sources"
    for folder in (others, old):
        folder.mkdir(parents=True)
        os.utime(folder, (0, 0))
    code = "from fivcore.jit import FOLDER; print(FOLDER)"
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    said = subprocess.check_output([sys.executable, "-c", code], text=True, env=environment)
    assert said.startswith(str(tmp_path / "fiv" / "kernels-"))
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
