"""Results of another declaration are refused, saying what differs; of another environment they are a warning."""

import dataclasses
import importlib
import json
import re
import subprocess
import sys
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from studies import registry
from studies.asking.sweep import sweep_of
from sweeps import Axis, Grid, InputError, MixedWarning, Sample, StoreError, Sweep, Variable, json_equal
from sweeps.fingerprint import provenance
from sweeps.fingerprint.identity import coverage, differences, fingerprint
from sweeps.fingerprint.provenance import environment, mixed
from tests import HOME
from tests.helpers import waves
from tests.helpers.backends import INSIDE, visible
from tests.helpers.waves import VARIABLES, interrupted, product, sweep


@dataclasses.dataclass
class Rig:
    mass: float = 1.0
    parts: tuple = (1, 2)


def wide(points, factor=1.0, rig=None):
    return waves.wave(points)


XY = {"x": Axis([1.0, 2.0], "m"), "y": Axis([3.0], "m")}
SAMPLE = {"x": stats.uniform(1.0, 2.0)}
BEFORE = {"constants": {"factor": 2.0, "rig": Rig()}, "grid": Grid(XY)}
ZIPPED = Grid({"x": Axis([1.0], "m"), "y": Axis([3.0], "m")}, zipped=("x", "y"))
CHANGES = [
    ({"constants": {"factor": 2.0 * (1.0 + 2e-16), "rig": Rig()}}, "factor = 2.0 there, 2.0000000000000004 here"),
    ({"constants": {"factor": 2.0, "rig": Rig(1.5)}}, "rig.mass = 1.0 there, 1.5 here"),
    ({"constants": {"factor": 2.0, "rig": Rig(1.0, (1, 3))}}, "rig.parts = [1, 2] there, [1, 3] here"),
    ({"constants": {"factor": 2.0}}, 'rig = {"mass": 1.0, "parts": [1, 2]} there, nothing here'),
    ({"variables": VARIABLES | {"root": Variable("s")}}, 'variables root.units = "m" there, "s" here'),
    ({"variables": VARIABLES | {"root": Variable("m", digits=4)}}, "variables root.digits = null there, 4 here"),
    ({"variables": {"root": Variable("m")}}, "variables count = {"),
    ({"grid": Grid(XY | {"x": Axis([1.0], "km")})}, 'axes x.units = "m" there, "km" here'),
    ({"grid": Grid(XY | {"z": Axis([1.0])})}, "axes z = nothing there"),
    ({"grid": Grid(XY | {"x": Axis(["1.0"], "m")})}, "axes x.text = false there, true here"),
    ({"grid": ZIPPED}, 'groups = [["x"], ["y"]] there, [["x", "y"]] here'),
    ({"coords": {"power": Axis([1, 2, 4])}}, "coords power = "),
    ({"function": wide}, "the code of tests.helpers.waves, tests.sweeps.fingerprint.test_identity has changed"),
    ({"key": product}, "the code of tests.helpers.waves"),
    ({"grid": Sample(SAMPLE, 4)}, "sample = nothing there"),
]


@pytest.mark.usefixtures("small_pieces")
@pytest.mark.parametrize("unfinished", [True, False])
def test_results_of_another_declaration_are_refused_naming_what_differs(path, unfinished):
    if unfinished:
        interrupted(sweep(**BEFORE).plan(path), 1)
    else:
        sweep(**BEFORE).plan(path).run("sync")
    before = {each: each.read_bytes() for each in path.parent.rglob("*") if each.is_file()}
    start_over = r"other results: [^\n]*, or start over \(fresh=True\)[^\n]*$"
    for changes, message in CHANGES:
        with pytest.raises(StoreError, match=start_over) as caught:
            sweep(**(BEFORE | changes)).plan(path)
        assert message in str(caught.value)
        assert {each: each.read_bytes() for each in before} == before
        assert sweep(**(BEFORE | changes)).plan(path, fresh=True).todo


PAIRS = [
    (pd.DataFrame({"a": [1.0]}), pd.DataFrame({"a": [2.0]})),
    (pd.Series([1.0]), pd.Series([2.0])),
    (np.arange(3), np.arange(4)),
    (1 + 2j, 1 - 2j),
    ({"a": [None, True]}, {"a": [None, False]}),
    (float("nan"), 0.0),
]


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_constants_are_compared_by_value(path, one, other):
    sweep(function=wide, constants={"rig": one}).plan(path).run("sync")
    assert sweep(function=wide, constants={"rig": one}).plan(path).todo == 0
    with pytest.raises(StoreError, match=r"rig\S* = .* there, .* here"):
        sweep(function=wide, constants={"rig": other}).plan(path)


TABLES = [
    (pd.DataFrame({"a": [1.0]}, index=[0.0]), pd.DataFrame({"a": [1.0]}, index=[10.0])),
    (pd.Series([9.0, 5.0], index=[0, 0]), pd.Series([1.0, 5.0], index=[0, 0])),
    ({1: 2.0}, {"1": 2.0}),
    (np.float32([1.0]), np.float64([1.0])),
    (np.zeros(5000), np.ones(5000)),
]


@pytest.mark.parametrize(("one", "other"), TABLES)
def test_tables_are_compared_with_their_index_and_keys_with_their_type(path, one, other):
    sweep(function=wide, constants={"rig": one}).plan(path).run("sync")
    assert sweep(function=wide, constants={"rig": one}).plan(path).todo == 0
    with pytest.raises(StoreError, match=r"the content of rig|rig\S* = .* there"):
        sweep(function=wide, constants={"rig": other}).plan(path)


def test_a_long_array_takes_little_room(path):
    rig = np.random.default_rng(0).random(300_000)
    sweep(function=wide, constants={"rig": rig}).plan(path).run("sync")
    assert path.stat().st_size < 100_000


def test_a_changed_output_of_a_study_names_the_study():
    study = registry.load("fig5")
    more = dataclasses.replace(study, outputs=study.outputs | {"more": Variable(dims=("mode",))})
    one, other = (fingerprint(each, coverage(each)) for each in (sweep_of(study), sweep_of(more)))
    assert differences(one, other).endswith("the code of studies.gallery.fig5 has changed")


def test_differences_are_short_and_nan_equals_nan():
    one, other = ({"compiler": "py", "code": code} for code in ({"a": "1"}, {"a": "2", "b": "1"}))
    assert differences(one, other) == "the code of a, b has changed"
    assert differences(one, other, code=False) == ""
    many = {"constants": {str(k): "long" * 50 for k in range(9)}}
    assert len(differences(many, {"constants": {}})) < 400
    assert json_equal({"a": float("nan")}, {"a": float("nan")})


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


def test_workers_are_compared_when_a_run_starts(path, tmp_path):
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
        process.stdin.close()
