"""Shares on the command line, and the array job of the README with a queue that starts processes."""

import os
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
import xarray as xr

import sweeps
from tests.docs import readmes

ARRAY = re.search(r"^ {4}#!/bin/bash\n(?: {4}.*\n)+", readmes.TEXTS["sweeps/README.md"], re.MULTILINE)
JOB = textwrap.dedent(ARRAY[0]).replace("regimes", "own.py")
# The last job begins when the others have ended: the test does so.
SBATCH = """#!/bin/sh
echo "$@" >> waiting
"""


@pytest.mark.posix
def test_the_array_job_of_the_readme(tmp_path, own, here):
    (tmp_path / "sbatch").write_text(SBATCH)
    (tmp_path / "sbatch").chmod(0o755)
    (tmp_path / "job.sh").write_text(JOB)
    own.write_text(own.read_text().replace("np.any(x == 2.0)", "np.any(x == 9.0)"))
    path = os.pathsep.join([str(tmp_path), str(Path(sys.executable).parent), os.environ["PATH"]])
    queue = os.environ | {"PATH": path, "SLURM_ARRAY_TASK_COUNT": "2", "SLURM_ARRAY_JOB_ID": "17"}
    tasks = [queue | {"SLURM_ARRAY_TASK_ID": str(number)} for number in (1, 2)]
    jobs = [
        subprocess.Popen(["bash", "-eu", "job.sh"], cwd=tmp_path, env=task, stderr=subprocess.PIPE, text=True)
        for task in tasks
    ]
    said = [job.communicate(timeout=300)[1] for job in jobs]
    assert [job.returncode for job in jobs] == [0, 0], said
    assert "share           2 of 2\n" in said[1]
    assert said[1].endswith("share 2 of 2 is computed, 0 failed\n")
    (wrapped,) = re.findall(r"^--dependency=afterany:17 --wrap fiv (.*)$", (tmp_path / "waiting").read_text())
    assert "interrupted" in here("status", "squares", "--out", "on-slurm").stdout
    assert here(*wrapped.split()).returncode == 0
    whole = sweeps.open_results("on-slurm/squares/squares.nc")
    assert here("run", "own.py", "--out", "whole").returncode == 0
    other = sweeps.open_results("whole/squares/squares.nc")
    xr.testing.assert_equal(*(each.drop_vars("wall_time") for each in (whole, other)))


def test_missing_shares_are_named_and_failed_points_are_exit_1(own, here, folder):
    assert here("run", "own.py", "--share", "1/3", "-q").returncode == 0
    assert here("run", "own.py", "--share", "3/3", "--out", "other", "-q").returncode == 0
    done = here("merge", "own.py", "other", "-q")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "fiv: squares: missing shares: 2 of 3; 2 of 6 computations are pending\n"
    assert any("on-slurm" not in name and name.endswith("3-of-3.parts/manifest") for name in folder())
    assert "squares" in here("list").stdout
    assert here("run", "own.py", "--share", "2/3", "-q").returncode == 0
    assert here("merge", "own.py").returncode == 0
    for number in (1, 2):
        done = here("run", "own.py", "--set", "x=2,3", "--share", f"{number}/2", "--out", "failing")
    assert here("merge", "own.py", "--out", "failing").returncode == 1


@pytest.mark.parametrize("share", ["0/3", "4/3", "3", "a/b", "1/0", "-1/3", "1/3/5", ""])
def test_a_malformed_share_is_one_line(own, here, share):
    done = here("run", "own.py", "--share", share)
    assert done.returncode == 2
    assert done.stderr == f"fiv: --share {share!r}: it must be K/N with K from 1 to N, for example 3/16\n"


def test_a_refined_map_and_a_folder_without_shares_are_refused(own, here):
    refined = ("map", "--x", "theta=0:8:5", "--y", "mu=0:0.4:5", "--quantity", "growth_rate", "--refine", "1")
    done = here(*refined, "--share", "1/2")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "a refined sweep has no shares" in done.stderr
    done = here("merge", "own.py", "nowhere")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "own.py: no share of it in" in done.stderr
