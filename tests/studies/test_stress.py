"""The stress battery: its cases, that each of its checks can fail, and what it reports."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from fivcore import Rig
from studies.asking.sweep import sweep_of
from studies.plotting import figures
from studies.stress import study
from studies.stress.cases import CASES, METHODS, POINT, TOO_EXPENSIVE
from studies.stress.checks import CHECKS, LIMITS, RunSpec, collect, evaluate, spec_of, stated
from studies.stress.study import EXPENSIVE, FAILS, NOT_APPLICABLE, OUTCOMES, run_case
from tests import HOME

# One that runs and one that is refused of each; all others run under `slow`, and the reference has all outcomes.
SOON = {
    "fast": ["step 0.9 of the largest", "step 1.001 of the largest", "in the mirror"],
    "exact": ["0.999 of Painleve's mu, 20°", "too many samples"],
    "paper": ["3 and 3 elements", "theta = 90°", "100 s, vibrating"],
}
SLOW = [(name, method) for name in CASES for method in METHODS if name not in SOON[method]]
QUICK = [(name, method) for method in METHODS for name in SOON[method]]


def expected(name, method):
    if method in CASES[name].excluded:
        return NOT_APPLICABLE
    return EXPENSIVE if method in TOO_EXPENSIVE.get(name, ()) else OUTCOMES.index(CASES[name].expectation(method))


@pytest.mark.parametrize(("name", "method"), [*QUICK, *(pytest.param(*x, marks=pytest.mark.slow) for x in SLOW)])
def test_a_method_does_what_is_expected(name, method):
    outcome, passed, values, bounds = run_case(CASES[name], method)
    wrong = ~(values <= bounds) & ~np.isnan(bounds)
    assert not [(*row, name) for *row, name, bad in zip(values, bounds, CHECKS, wrong, strict=True) if bad]
    assert (outcome, passed) == (expected(name, method), 1)


# Their balance scatters where runs are longer.
BALANCED = ["step 0.999 of the largest", "0.999 of Painleve's mu, 5°", "0.9999999 of Painleve's mu, 5°"]


@pytest.mark.parametrize("name", BALANCED)
def test_the_balance_of_fast_at_a_limit_is_no_matter_of_last_bits(name):
    spec, _ = spec_of(CASES[name], "fast")
    for change in 1e-7 * np.random.default_rng(0).standard_normal(8):
        data = collect(spec.changed(V=spec.arguments["V"] * (1.0 + change)))
        value, bound = evaluate(data)["energy"]
        assert set(np.unique(data.run.state)) == {0, 1, 2}
        assert value < 0.5 * bound


def test_the_reference_holds_what_is_expected_and_the_set_of_cases_is_closed():
    with xr.open_dataset(HOME / "results" / "reference" / "stress" / "stress.nc") as file:
        outcome, passed = (file[name].load().to_series() for name in ("outcome", "passed"))
    assert [*outcome.index] == [(name, method) for name in CASES for method in METHODS]
    assert [*outcome] == [expected(*pair) for pair in outcome.index]
    assert (passed == 1).all()
    assert len(CASES) == 127
    assert TOO_EXPENSIVE.keys() <= CASES.keys()
    assert {case.edge for case in CASES.values()} == {*LIMITS, ""}


def test_a_method_that_does_not_refuse_refuses_too_much_or_does_not_say_why_fails():
    short = replace(CASES["theta = 0°"], run={"duration": 1e-4})
    with pytest.raises(AssertionError, match="does what it should refuse with ValueError"):
        run_case(replace(short, expected="ValueError"), "fast")
    for outcome in ("passes", "ValueError"):
        with pytest.raises(AssertionError, match="theta = 0°, fast: ContactError: mu = 50: from"):
            run_case(replace(short, scene={"mu": 50.0}, expected=outcome), "fast")
    outcome, passed, values, _ = run_case(replace(CASES["step 1.001 of the largest"], names="duration"), "fast")
    assert (outcome, passed, values[-1]) == (FAILS, 0, 1.0)
    assert stated("it must be at most 2.09e-06 s, or so", "at most") == 2.09e-6
    assert np.isnan(stated("it must be less", "at most"))


@pytest.fixture(scope="module", params=[("fast", 20e-3), ("exact", 12e-3), ("paper", 11.5e-3)])
def good(request):
    """The operating point by each method, for so long that it has burst."""
    method, duration = request.param
    return collect(RunSpec(method, Rig(), None, {**POINT, "duration": duration, "ramp": 1e-3}))


def failing(data, **series):
    """Names of the checks that fail once series of the record are replaced."""
    checks = evaluate(data._replace(run=replace(data.run, **series)))
    return {name for name, (value, bound) in checks.items() if not value <= bound}


def test_the_operating_point_passes_every_check(good):
    assert failing(good) == set()
    assert set(np.unique(good.run.state)) == {0, 1, 2}
    never = {"paper": {"cone", "gap", "energy"}, "fast": {"relaxation", "gap"}, "exact": {"relaxation"}}
    assert set(evaluate(good)) == set(CHECKS) - {"mean", "copy", "message"} - never[good.spec.method]


def test_each_check_of_the_record_can_fail(good):
    run, N, method = good.run, good.run.normal_force, good.spec.method
    assert "finite" in failing(good, normal_force=np.where(N > 9.0, np.nan, N))
    assert "normal" in failing(good, normal_force=N - 1e-6)
    assert "separation" in failing(good, normal_force=N + 1e-9)
    assert "normal" in failing(good, normal_force=np.full_like(N, np.nan))  # NaN passes nothing
    law = "relaxation" if method == "paper" else "cone"
    assert law in failing(good, tangential_force=1.001 * run.tangential_force)
    assert "direction" in failing(good, slip_velocity=-run.slip_velocity)
    assert "stick" in failing(good, slip_velocity=np.where(run.state == 1, 1e-6, run.slip_velocity))
    if method == "exact":
        assert "gap" in failing(good, normal_force=1.01 * N) & failing(good, normal_force=np.roll(N, 5))
    if method != "paper":
        assert "energy" in failing(good, summary={**run.summary, "energy_residual": 0.3})


def test_a_copy_that_differs_and_a_mean_that_is_not_the_load_fail(good):
    other = {**good.summary, "mean_normal_force": good.summary["mean_normal_force"] * (1.0 + 1e-9)}
    assert "copy" not in failing(good._replace(original=good.summary))
    assert "copy" in failing(good._replace(original=other))
    assert "copy" in failing(good._replace(original={**good.summary, "regime": "stuck"}))
    assert "record" in failing(good._replace(summary=other))
    if good.spec.method == "fast":
        long = collect(spec_of(replace(CASES["100 s, sliding"], run={"duration": 1.0}), "fast")[0])
        assert failing(long) == set()
        wrong = replace(long.long, summary={**long.long.summary, "mean_normal_force": 1.001 * POINT["F"]})
        assert failing(long._replace(long=wrong)) == {"mean"}


def test_a_summary_and_a_figure_say_what_failed():
    names = ["step 1.001 of the largest", "mu = nan", "theta = 90°"]
    data = sweep_of(study.STUDY, {"case": names}).plan().run("sync")
    data["outcome"] = data["outcome"].astype(float)
    data["outcome"][0, 0], data["margin"][0, 0, 7], data["value"][0, 0, 7] = FAILS, 2.0, 1.0
    data["status"][2, 1], data["status"][2, 2] = 2, 0  # one broke down, one is not computed yet
    finding, (_, counts), (_, nearest), *_ = study.summary(data)
    assert finding.startswith("2 of 7 ")
    assert counts.set_index("outcome").loc[["fails", "pending"]].to_numpy().sum() == 3
    assert nearest.iloc[0][["case", "method", "check", "margin"]].tolist() == [names[0], "fast", "gap", 2.0]
    with figures.style():
        assert study.STUDY.figure(data).get_suptitle().endswith(": 2 failed")
