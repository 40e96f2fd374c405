"""Compiled kernels are kept for the state of all sources, wherever there is a place, and not for ever."""

import os
import shutil
import time
from pathlib import Path
from runpy import run_path

import pytest

from fivcore import jit
from fivcore.transient.fast_kernel import advance


def test_compiled_code_is_kept_for_this_state_of_all_sources():
    assert jit.SOURCES in advance.stats.cache_path
    assert len(jit.SOURCES) == 16


def test_every_source_of_every_room_counts(tmp_path):
    """Numba itself looks only at the file of a kernel, not at what is inlined into it."""
    home = Path(jit.__file__).parent
    shutil.copytree(home, tmp_path / "fivcore", ignore=shutil.ignore_patterns("__pycache__"))

    def sources():
        return run_path(str(tmp_path / "fivcore" / "jit.py"))["SOURCES"]

    assert sources() == jit.SOURCES
    inlined = tmp_path / "fivcore" / "transient" / "statistics.py"
    inlined.write_text(inlined.read_text() + "\n# changed\n")
    assert sources() != jit.SOURCES


def test_where_nothing_can_be_written_the_next_place_is_taken(tmp_path):
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    folder = jit.cache_folder([blocked, tmp_path / "user"])
    assert folder == tmp_path / "user" / f"{jit.PREFIX}{jit.SOURCES}"
    assert folder.is_dir()
    assert jit.cache_folder([blocked]) is None


@pytest.mark.parametrize(("age", "kept"), [(0.5 * jit.OLD, True), (2.0 * jit.OLD, False)])
def test_folders_of_other_sources_go_once_they_are_old(tmp_path, age, kept):
    other, foreign = tmp_path / f"{jit.PREFIX}0123456789abcdef", tmp_path / "something-else"
    for folder in (other, foreign):
        folder.mkdir()
        (folder / "index").write_text("")
        os.utime(folder, (time.time() - age, time.time() - age))
    jit.cache_folder([tmp_path])
    assert other.exists() == kept
    assert foreign.exists()
