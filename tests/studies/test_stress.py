"""The stress battery: what it asks, that each of its checks can fail, and what it has found."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import Beam, ContactError, Rig, Scene, simulate
from fivcore.beams.modes import propagator
from fivcore.contact.reduced import full_model, reduced_model
from fivcore.contact.step_map import at_most
from fivcore.rig import P1, P2
from fivcore.transient import published
from studies import tables
from studies.plotting import figures
from studies.stress import runs, study
from studies.stress.ask import LIMITS, Question, question_of, stated
from studies.stress.cases import CASES, METHODS, POINT, TOO_EXPENSIVE
from studies.stress.checks import CHECKS, judged
from studies.stress.findings import EXPENSIVE, FAILS, NOT_ASKED, OUTCOMES
from studies.stress.starts import RINGING, STARTS
from tests import HOME

# A handful of every kind; all others are run under `slow`, and the outcomes of all are in the reference.
SOON = {
    "fast": ["step 0.9 of the largest", "step 1.001 of the largest", "1.001 of critical mu, 20°",
             "theta = 89.9999°", "in the mirror", "F = 1e+06 N, same V/F", "tangent", "preload 10000 F",
             "open, stick", "3 and 3 elements", "ramp 1e-09 s", "to P2's clamp, 1.001 of the way",
             "1.001 of the least cut-off, none"],
    "exact": ["0.999 of critical mu, 20°", "0.9999999 of critical mu, 20°", "0.999 of the least V/F",
              "1.001 of the least V/F", "thrown at 100 m/s", "head of 1e9 kg",
              "0.999 of the least cut-off, absorbing", "1.001 of the least cut-off, absorbing", "termination none",
              "every mode, no element", "3 and 3 elements", "too many samples"],
    "paper": ["step 1.001 of the largest", "theta = 90°", "no such state", "3 and 3 elements", "100 s, vibrating"],
}  # fmt: skip
QUICK = [(name, method) for method in METHODS for name in SOON[method]]
SLOW = [(name, method) for name in CASES for method in METHODS if name not in SOON[method]]
EVERY = {"record": True, "settle": 0.0}


def scene(**numbers):
    return Scene(**{**POINT, **numbers})


def computed(**axes):
    """The study's dataset in memory."""
    return study.STUDY.sweep(axes).plan().run("sync")


def wrong(answer):
    """Of what `put` gives, the checks that did not pass."""
    _, _, values, bounds = answer
    each = dict(zip(CHECKS, zip(values.tolist(), bounds.tolist(), strict=True), strict=True))
    return {name: (value, bound) for name, (value, bound) in each.items() if bound == bound and not value <= bound}


# The cases.


@pytest.mark.parametrize(
    ("name", "method"), [*QUICK, *(pytest.param(*each, marks=pytest.mark.slow) for each in SLOW)]
)
def test_a_method_does_what_is_expected(name, method):
    outcome, passed, *_ = answer = study.put(CASES[name], method)
    assert wrong(answer) == {}
    assert passed == 1
    assert outcome == expected(name, method)


def expected(name, method):
    """The outcome expected of a case."""
    if method in CASES[name].not_asked:
        return NOT_ASKED
    return EXPENSIVE if method in TOO_EXPENSIVE.get(name, ()) else OUTCOMES.index(CASES[name].expectation(method))


def test_the_reference_holds_what_is_expected_of_every_case():
    """It is of this code (tests/docs/test_project.py)."""
    with xr.open_dataset(HOME / "results" / "reference" / "stress" / "stress.nc") as file:
        outcome, passed = (file[name].load().to_series() for name in ("outcome", "passed"))
    assert [*outcome.index] == [(name, method) for name in CASES for method in METHODS]
    assert [*outcome] == [expected(*each) for each in outcome.index]
    assert (passed == 1).all()


def test_every_limit_and_start_is_asked_for_and_cases_of_a_group_stand_together():
    assert TOO_EXPENSIVE.keys() <= CASES.keys()
    assert {case.edge for case in CASES.values()} == {*LIMITS, ""}
    assert {case.start for case in CASES.values()} == {*STARTS, ""}
    groups = [case.group for case in CASES.values()]
    assert all(groups)
    assert sum(a != b for a, b in pairwise(groups)) == len(set(groups)) - 1


def test_a_method_that_does_not_refuse_or_refuses_too_much_fails():
    short = replace(CASES["theta = 0°"], run={"duration": 1e-4})
    with pytest.raises(AssertionError, match="does what it should refuse with ValueError"):
        study.put(replace(short, expected="ValueError"), "fast")
    with pytest.raises(AssertionError, match="theta = 0°, fast: ContactError: mu = 50: from"):
        study.put(replace(short, scene={"mu": 50.0}), "fast")
    with pytest.raises(ContactError):
        study.put(replace(short, scene={"mu": 50.0}, expected="ValueError"), "fast")


def test_a_refusal_must_name_its_argument_and_its_limit():
    step = CASES["step 1.001 of the largest"]
    assert wrong(study.put(replace(step, names="duration"), "fast")) == {"message": (1.0, 0.0)}
    assert wrong(study.put(CASES["mu = -0.1"], "exact")) == {}
    assert stated("it must be at most 2.09e-06 s, or so", "at most") == 2.09e-6
    assert np.isnan(stated("it must be less", "at most"))


# Each check can fail.


@pytest.fixture(scope="module")
def evidence():
    """The operating point by each method, for so long that it has burst."""
    durations = {"fast": 20e-3, "exact": 12e-3, "paper": 11.5e-3}
    return {
        method: runs.gathered(Question(method, POINT, Rig(), duration, {}))
        for method, duration in durations.items()
    }


@pytest.fixture(params=METHODS)
def good(evidence, request):
    """That of one method."""
    return evidence[request.param]


def failing(evidence, **changes):
    """Names of the checks that fail once series of the record are replaced; the replay is as it was."""
    found = judged(replace(evidence, run=replace(evidence.run, **changes)))
    return {name for name, (value, bound) in found.items() if not value <= bound}


def replayed(evidence, **changes):
    """The evidence as if the record that is replayed had other series."""
    plain, load = replace(evidence.plain, **changes), evidence.question.numbers["F"]
    replay = evidence.replay and runs.replayed(
        evidence.question, plain.time, plain.normal_force / load, plain.tangential_force / load
    )
    return replace(evidence, plain=plain, replay=replay)


def test_the_operating_point_passes_every_check(good):
    assert failing(good) == set()
    assert set(np.unique(good.run.state)) == {0, 1, 2}
    never = {"mean", "copy", "message", "cone" if good.question.method == "paper" else "relaxation"}
    assert set(judged(good)) == set(CHECKS) - never


def test_a_force_that_is_not_finite_or_pulls_fails(good):
    N = good.run.normal_force
    assert "finite" in failing(good, normal_force=np.where(N > 9.0, np.nan, N))
    assert "normal" in failing(good, normal_force=N - 1e-6)
    assert "separation" in failing(good, normal_force=N + 1e-9)
    # A number that is none passes nothing.
    assert "normal" in failing(good, normal_force=np.full_like(N, np.nan))


def test_friction_beyond_its_law_fails(good):
    run, law = good.run, "relaxation" if good.question.method == "paper" else "cone"
    assert law in failing(good, tangential_force=1.001 * run.tangential_force)
    assert "direction" in failing(good, slip_velocity=-run.slip_velocity)
    assert "stick" in failing(good, slip_velocity=np.where(run.state == 1, 1e-6, run.slip_velocity))


def test_forces_a_hundredth_too_large_or_late_leave_a_gap(good):
    run, plain = good.run, good.plain
    larger = [{"normal_force": 1.01 * each.normal_force, "tangential_force": 1.01 * each.tangential_force}
              for each in (run, plain)]  # fmt: skip
    late = [{name: np.roll(getattr(each, name), 5) for name in ("normal_force", "tangential_force", "state")}
            for each in (run, plain)]  # fmt: skip
    for own, of_plain in (larger, late):
        assert "gap" in failing(replayed(good, **of_plain), **own)


def test_energy_from_nowhere_a_copy_that_differs_and_a_run_too_expensive_fail(good):
    assert "energy" in failing(good, summary={**good.run.summary, "energy_residual": 0.3})
    assert "copy" not in failing(replace(good, original=good.summary))
    other = {**good.summary, "mean_normal_force": good.summary["mean_normal_force"] * (1.0 + 1e-9)}
    assert "copy" in failing(replace(good, original=other))
    assert "copy" in failing(replace(good, original={**good.summary, "regime": "stuck"}))
    assert "record" in failing(replace(good, summary=other))
    assert "cost" in failing(replace(good, cost=11.0))


def test_the_mean_of_the_normal_force_is_the_load():
    case = replace(CASES["100 s, sliding"], run={"duration": 1.0})
    good = runs.gathered(question_of(case, "fast")[0])
    assert failing(good) == set()
    other = {**good.long.summary, "mean_normal_force": 1.001 * POINT["F"]}
    assert failing(replace(good, long=replace(good.long, summary=other))) == {"mean"}


# The replay: the motion from the forces alone.


@pytest.mark.parametrize("V", [20e-3, 1.0])
def test_an_elastic_contact_gives_way_exactly_as_its_forces_say(V):
    """The impulses of `fast` are the replay's own and u = K^-1 (N, T): rounding is left, and what skips leave."""
    question = Question(
        "fast", {**POINT, "V": V}, Rig(), 20e-3, {"termination": "elastic", "cutoff": 75e3, "step": 3.3e-7}
    )
    run = question.ask(sample_rate=1.0 / question.step, **EVERY)
    replay = runs.replayed(question, run.time, run.normal_force / 9.0, run.tangential_force / 9.0)
    unit = np.linalg.inv(question.model.K)[0, 0] * run.normal_force.max() / 9.0
    touching = run.state > 0
    assert np.abs(replay.gap[touching]).max() < 1e-6 * unit
    assert replay.gap[~touching].min() > -1e-6 * unit
    assert replay.gap.max() > unit


def test_what_the_published_scheme_takes_is_its_own_damping_and_its_impacts():
    """The balance of `paper` misses them; the replay, which knows no contact law, finds them again."""
    good = runs.gathered(Question("paper", {**POINT, "V": 1.0, "mu": 1.0}, Rig(), 6e-3, {}))
    value, bound = judged(good)["energy"]
    assert value < bound
    assert value < 0.05 * good.run.summary["energy_residual"]
    assert good.run.summary["energy_residual"] > 0.01
    assert 0.0 < good.replay.struck < good.replay.added


# Starts.


@pytest.mark.parametrize(
    ("name", "above"), [("tangent", 0.0), ("tangent, missed", 1e-12), ("tangent, met", -1e-12)]
)
def test_a_tangent_path_just_touches(name, above):
    """Free flight of all modes, by the propagator: its first least gap."""
    full = full_model(Rig(), POINT["theta"])
    q, v, _ = STARTS[name].build(scene(), full.kept, *STARTS[name].arguments)
    elastic = full.stiffness > 0.0
    load = np.where(elastic, full.stiffness * full.rest - full.normal, -full.normal) * POINT["F"]
    steady = np.where(elastic, load / np.where(elastic, full.stiffness, 1.0), 0.0)
    gaps = []
    for t in np.linspace(0.0, 30e-6, 3001):
        a, b, _, _ = propagator(full.stiffness, full.damping, t)
        drag = full.damping[0] * t
        fallen = load[0] * 0.5 * t * t * (1.0 - drag / 3.0 + drag * drag / 12.0)
        gaps.append(full.normal @ (steady + a * (q - steady) + b * v) + full.normal[0] * fallen)
    least = int(np.argmin(gaps))
    assert 0 < least < len(gaps) - 1
    assert 1.5 * RINGING < gaps[0] < 2.0 * RINGING
    # Between samples the path is a parabola; the rest is rounding beside the size of the head's displacement.
    before, at, after = gaps[least - 1 : least + 2]
    bottom = at - (after - before) ** 2 / (8.0 * (before - 2.0 * at + after))
    assert bottom == pytest.approx(above * RINGING, abs=1e-9 * RINGING)


@pytest.mark.parametrize("name", [name for name in STARTS if "open" in name or "thrown" in name])
def test_what_begins_open_is_open(name):
    full = full_model(Rig(), POINT["theta"])
    q, _, _ = STARTS[name].build(scene(), full.kept, *STARTS[name].arguments)
    assert full.normal @ q == pytest.approx(1e-6, rel=1e-6)


# What the battery has found.


def test_the_work_of_the_accelerating_clamp_is_in_the_balance_of_the_published_scheme():
    """On soft beams it is most of what the drive does."""
    rig = Rig(
        Beam(P1.length, P1.width, P1.thickness, P1.young_modulus / 100.0, P1.density, P1.elements),
        Beam(P2.length, P2.width, P2.thickness, P2.young_modulus / 100.0, P2.density, P2.elements),
    )
    summary = simulate(Scene(10.0, 5.0, 0.2, 9.0, rig), 3e-3, "paper").summary
    assert summary["energy_residual"] < 0.01
    # Without friction nothing else works on P2, and what is left over is the scheme's own damping.
    quiet = simulate(scene(mu=0.0), 3e-3, "paper").summary["energy_residual"]
    own = published.ADDED_DAMPING / (published.ADDED_DAMPING + Rig().d2)
    assert 0.0 < quiet < own


@pytest.mark.parametrize("rig", [Rig(d2=1e-5), Rig(d2=1e-4)])
def test_a_default_step_resolves_what_strong_damping_takes(rig):
    model = reduced_model(rig, 5.0)
    assert model.damping.max() * model.default_step <= 2.0
    assert model.default_step < reduced_model(Rig(), 5.0).default_step
    hit = replace(scene(V=0.2), rig=rig)
    fast, exact = (simulate(hit, 4e-3, method, settle=0.0).summary for method in ("fast", "exact"))
    assert fast["energy_residual"] < 0.01
    assert fast["first_slip_time"] == pytest.approx(exact["first_slip_time"], rel=0.02)
    for name in ("stick_fraction", "slip_fraction", "separation_fraction"):
        assert fast[name] == pytest.approx(exact[name], abs=0.02)


@settings(max_examples=200, deadline=None)
@given(st.floats(1e-12, 1e12), st.integers(2, 6))
def test_a_limit_that_is_told_is_within_the_limit(limit, digits):
    number = float(at_most(limit, digits))
    assert limit * (1.0 - 10.0 ** (1 - digits)) * (1.0 - 1e-12) <= number <= limit


# The study.


@pytest.fixture(scope="module")
def small():
    """A few cases by all methods."""
    return computed(case=["step 1.001 of the largest", "mu = nan", "theta = 90°", "3 and 3 elements"])


@pytest.fixture
def broken(small):
    """The same as if one case failed a check, one broke down and one was not computed yet."""
    data = small.copy(deep=True)
    data["outcome"] = data["outcome"].astype(float)
    data["outcome"][0, 0], data["passed"][0, 0] = FAILS, 0
    gap = list(CHECKS).index("gap")
    data["value"][0, 0, gap], data["bound"][0, 0, gap], data["margin"][0, 0, gap] = 0.5, 0.25, 2.0
    data["error"] = data["error"].astype(object)
    data["error"][3, 1] = "ZeroDivisionError: division by zero"
    data["status"][3, 1], data["status"][3, 2] = 2, 0
    for name in ("outcome", "value", "bound", "margin"):
        data[name][3, 1:] = np.nan
    return data


def test_a_file_says_in_words_what_was_asked_and_came(small):
    assert small["outcome"].dims == ("case", "method")
    assert small["value"].dims == ("case", "method", "check")
    assert small["method"].values.tolist() == list(METHODS)
    assert small["check"].values.tolist() == list(CHECKS)
    assert small["task"].sel(case="theta = 90°").item() == "P1 at 90 degrees"
    assert np.all(small["passed"] == 1)
    words = small["outcome"].attrs["flag_meanings"].split()
    code = small["outcome"].sel({"case": "theta = 90°", "method": "paper"}).item()
    assert (words[0], words[int(code)]) == ("passes", "ValueError")
    margin = small["margin"].values
    assert np.nanmax(margin) < 1.0
    np.testing.assert_array_equal(np.isnan(margin), np.isnan(small["bound"].values))


def test_what_failed_is_listed_with_its_reason(small, broken):
    text = study.STUDY.report(small)
    assert "Nothing failed." in text
    assert "Not asked of 'exact': it has no step to be stable" in text
    lines = tables.text(study.STUDY.findings(broken)).splitlines()
    assert lines[-3:] == [
        "2 failed so far:",
        "step 1.001 of the largest, fast: gap: 0.5, at most 0.25",
        "3 and 3 elements, exact: ZeroDivisionError: division by zero",
    ]
    assert "1 fails" in next(line for line in lines if line.startswith("step"))
    assert "1 pending" in next(line for line in lines if line.startswith("rig"))


@pytest.mark.parametrize("pick", [{}, {"case": [1], "method": [1]}])
def test_figures_of_few_cases_and_of_failures(small, broken, pick):
    for data in (small, broken):
        chosen = data.isel(pick)
        with figures.style():
            figure = study.STUDY.draw(chosen)
            figure.canvas.draw()
        failed = figure.get_suptitle().endswith(": none failed")
        assert failed == (data is small or bool(pick))


def test_a_case_is_run_by_its_name():
    data = computed(case="theta = 90°", method=["paper", "fast"])
    assert data["method"].values.tolist() == ["fast", "paper"]
    assert [OUTCOMES[int(code)] for code in data["outcome"].values[0]] == ["ValueError", "ValueError"]
    # A case that is not asked of a method is not one that is skipped as too expensive.
    assert computed(case="step 0.5 of the largest", method="exact")["outcome"].item() == NOT_ASKED
    assert computed(case="100 s, vibrating", method="paper")["outcome"].item() == EXPENSIVE
