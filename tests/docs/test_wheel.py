"""The wheel: all that a user needs is in it."""

import os
import re
import shutil
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

from tests import HOME


@pytest.mark.slow
def test_a_wheel_runs_a_study_from_an_empty_folder(tmp_path):
    copy = tmp_path / "copy"
    for name in ("fivcore", "sweeps", "studies"):
        shutil.copytree(HOME / name, copy / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md"):
        shutil.copy(HOME / name, copy)
    build = [sys.executable, "-m", "pip", "wheel", "--no-deps", "-q", "-w", str(tmp_path), str(copy)]
    subprocess.run(build, check=True)
    (wheel,) = tmp_path.glob("*.whl")
    packed = set(zipfile.ZipFile(wheel).namelist())
    for package in ("fivcore", "sweeps", "studies"):
        files = {path for path in (copy / package).rglob("*") if path.is_file()}
        assert {str(path.relative_to(copy)) for path in files} <= packed
    # A fresh environment that borrows the libraries of this one, but not the project.
    place, libraries = tmp_path / "fresh", Path(pytest.__file__).parents[1]
    venv.create(place, with_pip=False)
    target = next(place.glob("lib/python*/site-packages"))
    install = [sys.executable, "-m", "pip", "install", "--no-deps", "-q", "--target", str(target), str(wheel)]
    subprocess.run(install, check=True)
    empty = tmp_path / "empty"
    empty.mkdir()
    environment = {key: value for key, value in os.environ.items() if key not in ("FIV_RESULTS", "PYTHONPATH")}

    def fiv(*arguments):
        return subprocess.run(
            [place / "bin" / "python", "-m", "studies", *arguments],
            cwd=empty,
            env=environment | {"PYTHONPATH": os.pathsep.join([str(target), str(libraries)])},
            capture_output=True,
            text=True,
        )

    done = fiv("run", "fig5", "--set", "mu=0:0.5:51")
    assert done.returncode == 0, done.stderr
    assert re.search(r"0\.1112 +2802", done.stdout)
    assert sorted(path.name for path in empty.rglob("*.*")) == ["fig5.nc", "fig5.png"]
    done = fiv("check")
    assert done.returncode == 0, done.stdout
    assert done.stdout.endswith("all is well\n")
