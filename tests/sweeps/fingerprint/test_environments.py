"""A file lists the environments of its runs; a run that adds another one warns, or is refused by `strict`."""

import importlib
import json
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest

from sweeps import InputError, MixedWarning, Sweep
from sweeps.fingerprint import provenance
from sweeps.fingerprint.provenance import environment, mixed
from tests import HOME
from tests.helpers.backends import INSIDE, visible
from tests.helpers.waves import interrupted, sweep

OTHER = "numpy .* -> 9.9"
FIRST, MORE = {"x": [1.0, 3.0]}, {"x": [1.0, 2.0, 3.0, 4.0]}


def listed(data):
    return json.loads(data.attrs["environments"])


@pytest.fixture
def elsewhere(monkeypatch):
    """From the call on, another version of a library."""

    def change(library="numpy", version="9.9"):
        before = provenance._version
        monkeypatch.setattr(provenance, "_version", lambda name: version if name == library else before(name))

    return change


def test_an_environment_names_versions_and_the_processor_but_no_paths():
    here = environment(["pandas"])
    assert list(here) == ["python", "numpy", "scipy", "numba", "llvmlite", "pandas", "blas", "processor"]
    assert here["numpy"] == np.__version__
    assert "/" not in json.dumps(here)


def test_differences_are_of_what_both_environments_name():
    one = environment()
    assert mixed([]) == mixed([one, dict(one)]) == ""
    assert mixed([one, one | {"numba": "1"}, one | {"numba": "1"}]) == f"numba {one['numba']} -> 1"
    assert mixed([{"numpy": "1"}, {"numpy": "1", "scipy": "2"}]) == ""


def test_a_run_in_another_environment_warns_and_is_listed(path, elsewhere):
    (only,) = listed(sweep(FIRST).plan(path, strict=True).run("sync"))
    assert only.items() >= environment().items()
    elsewhere()
    plan = sweep(MORE).plan(path)
    assert re.search(f"\nenvironment +{OTHER}; stored points stay$", repr(plan))
    expected = f"^{path}: not all points are computed in one environment: {OTHER}"
    with pytest.warns(MixedWarning, match=expected) as seen:
        data = plan.run("sync")
    assert [each.filename for each in seen] == [__file__]
    assert [each["numpy"] for each in listed(data)] == [np.__version__, "9.9"]
    assert "numpy 9.9" in data.attrs["history"]
    assert "computed_by" not in data
    # Nothing is computed, so nothing is mixed.
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(listed(sweep({"x": [4.0, 1.0]}).plan(path).run("sync"))) == 2


def test_strict_refuses_a_mixture_when_planning_and_changes_nothing(path, elsewhere):
    sweep(FIRST).plan(path).run("sync")
    before = path.read_bytes()
    elsewhere()
    with pytest.raises(
        InputError, match=f"{OTHER}; choose another folder, start over with fresh, or leave strict"
    ):
        sweep(MORE).plan(path, strict=True)
    assert path.read_bytes() == before
    assert visible(path.parent) == [path.name]
    data = sweep(MORE).plan(path, strict=True, fresh=True).run("sync")
    assert [each["numpy"] for each in listed(data)] == ["9.9"]


@pytest.mark.usefixtures("small_pieces")
def test_the_parts_of_an_interrupted_run_have_their_environments(path, elsewhere):
    interrupted(sweep(MORE).plan(path), 2)
    elsewhere()
    with pytest.warns(MixedWarning, match=OTHER):
        assert len(listed(sweep(MORE).plan(path).run("sync"))) == 2


def test_a_library_that_the_code_imports_belongs_to_its_environment(path, tmp_path, monkeypatch, elsewhere):
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "uses_mpmath.py").write_text("import mpmath\n\ndef f(points):\n    return points['x']\n")
    function = importlib.import_module("uses_mpmath").f
    (here,) = listed(Sweep("one", function, {"x": [1.0]}, ["y"], code="uses_mpmath").plan(path).run("sync"))
    assert here["mpmath"]
    elsewhere("mpmath", "0.1")
    with pytest.warns(MixedWarning, match=r"mpmath .* -> 0\.1"):
        Sweep("one", function, {"x": [1.0, 2.0]}, ["y"], code="uses_mpmath").plan(path).run("sync")


WORKER = f"""
import sys, distributed
from sweeps.fingerprint import provenance

before = provenance._version
provenance._version = lambda name: "9.9" if name == "numpy" else before(name)
with distributed.LocalCluster(n_workers=1, threads_per_worker=1, **{INSIDE}) as cluster:
    print(cluster.scheduler_address, flush=True)
    sys.stdin.read()
"""


def test_workers_are_compared_when_a_run_starts_and_late_ones_at_its_end(path, tmp_path, monkeypatch):
    sweep(FIRST).plan(path).run("sync")
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", WORKER], cwd=HOME, text=True, **pipes) as process:
        address = process.stdout.readline().strip()
        with pytest.raises(InputError, match=OTHER):
            sweep(MORE).plan(path, strict=True).run(address)
        assert visible(path.parent) == [path.name]
        with pytest.warns(MixedWarning, match=OTHER):
            assert len(listed(sweep(MORE).plan(path).run(address))) == 2
        # The process that submits computes nothing: this is one environment.
        alone = sweep(MORE).plan(tmp_path / "alone.nc", strict=True).run(address)
        assert [each["numpy"] for each in listed(alone)] == ["9.9"]
        here = environment()
        monkeypatch.setattr("sweeps.compute.cluster.Cluster.environments", lambda self, libraries: [here])
        with pytest.warns(MixedWarning, match=OTHER) as seen:
            sweep(MORE).plan(tmp_path / "late.nc").run(address)
        assert len(seen) == 1
        process.stdin.close()
