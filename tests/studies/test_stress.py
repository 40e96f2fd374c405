"""The stress battery: what it asks, that each of its checks can fail, and what it has found."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from fivcore import Beam, ContactError, DivergenceError, Rig, Scene, critical_mu, simulate
from fivcore.beams.free_motion import propagator
from fivcore.contact.reduced import full_model, reduced_model
from fivcore.contact.step_map import at_most
from fivcore.rig import P1, P2
from fivcore.transient import published
from studies import registry, tables
from studies.plotting import figures
from studies.stress import checks as stress_checks
from studies.stress import findings as stress_report
from studies.stress import runs as stress_runs
from studies.stress import study as stress
from studies.stress.case import APART, CAME, DEAR, FAILS, METHODS, PASSES, POINT
from studies.stress.cases import CASES, GROUPS
from studies.stress.limits import LIMITS, stated
from studies.stress.questions import Question, question_of, too_dear
from studies.stress.replay import replayed
from studies.stress.starts import RINGING, STARTS, first_state

NUMBERS = {case.name: number for number, case in enumerate(CASES, 1)}
CHECKS = list(stress_checks.CHECKS)
EVERY = {"record": True, "settle": 0.0}

# A handful of every kind, for each run; all of them are run under `slow`.
QUICK = [
    ("step 0.9 of the largest", "fast"),
    ("step 1.001 of the largest", "fast"),
    ("step 1.001 of the largest", "paper"),
    ("mu = 0", "exact"),
    ("0.999 of critical mu, 20°", "exact"),
    ("0.999 of critical mu, 20°", "paper"),
    ("0.9999999 of critical mu, 20°", "exact"),
    ("1.001 of critical mu, 20°", "fast"),
    ("theta = 89.9999°", "fast"),
    ("theta = 90°", "paper"),
    ("in the mirror", "fast"),
    ("F = 1e+06 N, same V/F", "fast"),
    ("0.999 of the least V/F", "exact"),
    ("1.001 of the least V/F", "exact"),
    ("tangent", "fast"),
    ("tangent", "exact"),
    ("preload 10000 F", "fast"),
    ("thrown at 100 m/s", "exact"),
    ("open, stick", "fast"),
    ("no such state", "paper"),
    ("3 and 3 elements", "fast"),
    ("3 and 3 elements", "paper"),
    ("head of 1e9 kg", "exact"),
    ("ramp 1e-09 s", "fast"),
    ("100 s, vibrating", "paper"),
    ("to P2's clamp, 1.001 of the way", "fast"),
    ("1.001 of the least cut-off, none", "fast"),
    ("0.999 of the least cut-off, absorbing", "exact"),
    ("1.001 of the least cut-off, absorbing", "exact"),
    ("termination none", "exact"),
    ("every mode, no element", "exact"),
    ("3 and 3 elements", "exact"),
    ("too many samples", "exact"),
]


def scene(**given_numbers):
    return Scene(**{**POINT, **given_numbers})


def computed(**given_values):
    """The study's dataset in memory."""
    return stress.STUDY.sweep(given_values).plan().run("sync")


def told(case, method):
    """What came, and every check that did not pass."""
    came, passed, values, bounds = stress.put(case, method)
    each = {name: (float(v), float(b)) for name, v, b in zip(CHECKS, values, bounds, strict=True)}
    wrong = {name: found for name, found in each.items() if not (found[0] <= found[1] or np.isnan(found[1]))}
    return CAME[came], bool(passed), wrong


# The cases.


@pytest.mark.parametrize(("name", "method"), QUICK)
def test_a_method_does_what_is_expected(name, method):
    case = CASES[NUMBERS[name] - 1]
    came, passed, wrong = told(case, method)
    assert wrong == {}
    assert passed
    assert came in (case.expectation(method), "too dear")


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("number", range(1, len(CASES) + 1))
def test_every_method_does_what_is_expected(number, method):
    came, passed, wrong = told(CASES[number - 1], method)
    assert wrong == {}
    assert passed
    assert came in (CASES[number - 1].expectation(method), "not asked", "too dear")


def test_the_cases_have_names_of_their_own_and_every_group_has_its_place():
    assert len(NUMBERS) == len(CASES)
    groups = [case.group for case in CASES]
    assert [group for k, group in enumerate(groups) if group not in groups[:k]] == list(GROUPS)
    # Cases of a group stand together, for the table and for those who ask for some by number.
    assert sum(a != b for a, b in pairwise(groups)) == len(GROUPS) - 1


def test_every_limit_and_start_is_asked_for():
    assert {case.edge for case in CASES if case.edge} == set(LIMITS)
    assert {case.start for case in CASES if case.start} == set(STARTS)


def test_what_is_too_dear_is_not_asked_and_what_is_asked_can_be_paid():
    for case in CASES:
        for method in METHODS:
            if case.expectation(method) == PASSES and method not in case.apart and "elements" not in case.name:
                question, _ = question_of(case, method)
                assert too_dear(question) == (question.seconds() > 10.0)
    long = CASES[NUMBERS["100 s, vibrating"] - 1]
    assert [too_dear(question_of(long, method)[0]) for method in METHODS] == [False, True, True]


def test_a_method_that_does_not_refuse_or_refuses_too_much_fails():
    fine = CASES[NUMBERS["theta = 0°"] - 1]
    short = replace(fine, run={"duration": 1e-4})
    with pytest.raises(AssertionError, match="does what it should refuse with ValueError"):
        stress.put(replace(short, expected="ValueError"), "fast")
    with pytest.raises(stress.UnexpectedError, match="ContactError: mu = 50: from"):
        stress.put(replace(short, scene={"mu": 50.0}), "fast")
    with pytest.raises(ContactError):
        stress.put(replace(short, scene={"mu": 50.0}, expected="ValueError"), "fast")


def test_a_refusal_must_name_its_argument_and_its_limit():
    case = CASES[NUMBERS["step 1.001 of the largest"] - 1]
    assert told(replace(case, names="duration"), "fast")[2] == {"message": (1.0, 0.0)}
    friction = CASES[NUMBERS["mu = -0.1"] - 1]
    assert told(friction, "exact") == ("ValueError", True, {})
    assert stated("it must be at most 2.09e-06 s, or so", "at most") == 2.09e-6
    assert np.isnan(stated("it must be less", "at most"))


# Each check can fail.


@pytest.fixture(scope="module")
def evidence():
    """The operating point by each method, for so long that it has burst."""
    found = {}
    for method, duration in (("fast", 20e-3), ("exact", 12e-3), ("paper", 11.5e-3)):
        found[method] = stress_runs.gathered(Question(method, POINT, Rig(), duration, {}), None)
    return found


@pytest.mark.parametrize("method", METHODS)
def test_the_operating_point_passes_every_check(evidence, method):
    found = stress_checks.judged(evidence[method])
    assert all(stress_checks.passes(*each) for each in found.values())
    assert set(np.unique(evidence[method].run.state)) == {0, 1, 2}


def spoilt(evidence, **changes):
    """The evidence with other series in its record, and what they do."""
    run = replace(evidence.run, **changes)
    question = evidence.question
    plain = replace(evidence.plain, **changes) if len(evidence.plain.time) == len(run.time) else evidence.plain
    replay = evidence.replay
    if replay is not None:
        load = question.numbers["F"]
        replay = replayed(question, plain.time, plain.normal_force / load, plain.tangential_force / load)
    return replace(evidence, run=run, plain=plain, replay=replay)


def fails(name, evidence):
    check, _ = stress_checks.CHECKS[name]
    found = check(evidence)
    return found is not None and not stress_checks.passes(*found)


@pytest.mark.parametrize("method", METHODS)
def test_a_force_that_is_not_finite_or_pulls_fails(evidence, method):
    good = evidence[method]
    N = good.run.normal_force
    assert fails("finite", replace(good, run=replace(good.run, normal_force=np.where(N > 9.0, np.nan, N))))
    assert fails("normal", replace(good, run=replace(good.run, normal_force=N - 1e-6)))
    assert fails("separation", replace(good, run=replace(good.run, normal_force=N + 1e-9)))
    # A number that is none passes nothing.
    assert fails("normal", replace(good, run=replace(good.run, normal_force=np.full_like(N, np.nan))))


@pytest.mark.parametrize("method", METHODS)
def test_friction_beyond_its_law_fails(evidence, method):
    good = evidence[method]
    T = good.run.tangential_force
    check = "relaxation" if method == "paper" else "cone"
    assert fails(check, replace(good, run=replace(good.run, tangential_force=1.001 * T)))
    assert fails("direction", replace(good, run=replace(good.run, slip_velocity=-good.run.slip_velocity)))
    drifting = np.where(good.run.state == 1, 1e-6, good.run.slip_velocity)
    assert fails("stick", replace(good, run=replace(good.run, slip_velocity=drifting)))


@pytest.mark.parametrize("method", METHODS)
def test_forces_a_thousandth_too_large_or_too_late_leave_a_gap(evidence, method):
    good = evidence[method]
    N, T = good.run.normal_force, good.run.tangential_force
    assert fails("gap", spoilt(good, normal_force=1.01 * N, tangential_force=1.01 * T))
    late = {"normal_force": np.roll(N, 5), "tangential_force": np.roll(T, 5), "state": np.roll(good.run.state, 5)}
    assert fails("gap", spoilt(good, **late))


@pytest.mark.parametrize("method", METHODS)
def test_energy_from_nowhere_a_copy_that_differs_and_a_run_too_dear_fail(evidence, method):
    good = evidence[method]
    lost = {**good.run.summary, "energy_residual": 0.3}
    assert fails("energy", replace(good, run=replace(good.run, summary=lost)))
    assert not fails("copy", replace(good, copied=good.summary))
    other = {**good.summary, "mean_normal_force": good.summary["mean_normal_force"] * (1.0 + 1e-9)}
    assert fails("copy", replace(good, copied=other))
    assert fails("copy", replace(good, copied={**good.summary, "regime": "stuck"}))
    assert fails("record", replace(good, summary=other))
    assert fails("cost", replace(good, cost=11.0))


def test_the_mean_of_the_normal_force_is_the_load():
    case = CASES[NUMBERS["100 s, sliding"] - 1]
    question, _ = question_of(replace(case, run={"duration": 3.0}), "fast")
    good = stress_runs.gathered(question, None)
    assert not fails("mean", good)
    wrong = {**good.settled.summary, "mean_normal_force": 1.001 * POINT["F"]}
    assert fails("mean", replace(good, settled=replace(good.settled, summary=wrong)))


# The replay: the motion from the forces alone.


@pytest.mark.parametrize("V", [20e-3, 1.0])
def test_an_elastic_contact_gives_way_exactly_as_its_forces_say(V):
    """The kicks of `fast` are the replay's own and u = K^-1 (N, T): rounding is left, and what leaps leave."""
    question = Question("fast", {**POINT, "V": V}, Rig(), 20e-3, {"termination": "elastic", "cutoff": 75e3})
    run = question.ask(sample_rate=1.0 / question.step, **EVERY)
    replay = replayed(question, run.time, run.normal_force / 9.0, run.tangential_force / 9.0)
    unit = np.linalg.inv(question.model.K)[0, 0] * run.normal_force.max() / 9.0
    touching = run.state > 0
    assert np.abs(replay.gap[touching]).max() < 1e-6 * unit
    assert replay.gap[~touching].min() > -1e-6 * unit
    assert replay.gap.max() > unit


def test_what_the_published_scheme_takes_is_its_own_damping_and_its_impacts():
    """The balance of `paper` misses them; the replay, which knows no contact law, finds them again."""
    good = stress_runs.gathered(Question("paper", {**POINT, "V": 1.0, "mu": 1.0}, Rig(), 6e-3, {}), None)
    value, bound = stress_checks.energy(good)
    assert value < bound
    assert value < 0.05 * good.run.summary["energy_residual"]
    assert good.run.summary["energy_residual"] > 0.01
    assert 0.0 < good.replay.struck < good.replay.added


@settings(max_examples=15, deadline=None)
@given(st.floats(-60.0, 60.0), st.floats(0.05, 0.5), st.floats(1e-3, 1.0), st.sampled_from(["fast", "paper"]))
def test_no_forces_leave_a_gap_in_contact(theta, mu, V, method):
    numbers = {"V": V, "theta": theta, "mu": mu, "F": 9.0}
    question = Question(method, numbers, Rig(), 2e-3, {"cutoff": 75e3} if method == "fast" else {})
    run = question.ask(sample_rate=min(1.0 / question.step, 1e9), **EVERY)
    replay = replayed(question, run.time, run.normal_force / 9.0, run.tangential_force / 9.0)
    unit = np.linalg.inv(reduced_model(Rig(), theta).K)[0, 0] * run.normal_force.max() / 9.0
    unit += question.step * replay.closing
    assert np.abs(replay.gap[run.state > 0]).max(initial=0.0) < 0.25 * unit


# Starts.


@pytest.mark.parametrize(
    ("name", "above"), [("tangent", 0.0), ("tangent, missed", 1e-12), ("tangent, met", -1e-12)]
)
def test_a_tangent_path_just_touches(name, above):
    """Free flight of all modes, by the propagator: its first least gap."""
    full = full_model(Rig(), POINT["theta"])
    q, v, _ = first_state(name, scene(), full.kept)
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
def test_what_begins_apart_is_apart(name):
    full = full_model(Rig(), POINT["theta"])
    q, _, _ = first_state(name, scene(), full.kept)
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


@pytest.mark.parametrize("share", [0.99, 0.999, 0.99999])
def test_exact_goes_on_until_just_before_the_critical_friction(share):
    """There slip grows within nanoseconds, but no two eigenvalues coincide."""
    critical = critical_mu(Rig(), 20.0, "exact")
    run = simulate(scene(theta=20.0, V=1.0, mu=share * critical), 2e-3, "exact", record=True, sample_rate=1e6)
    assert run.summary["energy_residual"] < 1e-12
    assert np.all(np.abs(run.tangential_force) <= share * critical * run.normal_force + 1e-9)


def test_exact_says_where_slip_is_too_close_to_critical_to_be_resolved():
    with pytest.raises(ContactError, match=r"from 1\.91087 on .* so close to it slip grows"):
        simulate(scene(theta=20.0, mu=critical_mu(Rig(), 20.0, "exact") * (1.0 - 1e-7)), 1e-4, "exact")


@pytest.mark.parametrize("rig", [Rig(head_mass=1e7), Rig(d1=1e7)])
def test_exact_does_not_go_on_where_its_digits_are_lost(rig):
    with pytest.raises(DivergenceError, match="lost in the rounding of a mode far slower"):
        simulate(replace(scene(), rig=rig), 2e-3, "exact")
    assert simulate(replace(scene(), rig=rig), 2e-3).summary["energy_residual"] < 0.05


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


def test_a_step_as_large_as_the_message_says_is_taken():
    with pytest.raises(ValueError, match="at most") as refusal:
        simulate(scene(), 1e-6, "paper", step=3e-8)
    simulate(scene(), 1e-6, "paper", step=stated(str(refusal.value), "at most"))


# The study.


@pytest.fixture(scope="module")
def small():
    """A few cases by all methods."""
    names = ("step 0.9 of the largest", "mu = nan", "theta = 90°", "3 and 3 elements", "100 s, vibrating")
    return computed(case=[NUMBERS[name] for name in names if name != "100 s, vibrating"])


def test_a_file_says_in_words_what_its_numbers_are(small):
    assert small["came"].dims == ("case", "method")
    assert small["value"].dims == ("case", "method", "check")
    assert list(small["method_name"].values) == list(METHODS)
    assert list(small["check"].values) == CHECKS
    names = [CASES[int(number) - 1].name for number in small["case"].values]
    assert list(small["case_name"].values) == names
    assert np.all(small["passed"] == 1)
    assert small["came"].attrs["flag_meanings"].split()[0] == "passes"
    margin = small["margin"].values
    assert np.nanmax(margin) < 1.0
    np.testing.assert_array_equal(np.isnan(margin), np.isnan(small["bound"].values))


def test_the_report_tells_every_case_and_the_nearest_check(small):
    text = registry.load("stress").report(small)
    for name in small["case_name"].values:
        assert name in text
    assert "Nothing failed." in text
    assert "ValueError" in text
    assert "Not asked of 'exact': it has no step to be stable" in text
    assert "too dear" not in text


def broken(small):
    """The dataset as if one case failed a check, one broke down and one was not computed yet."""
    data = small.copy(deep=True)
    data["came"] = data["came"].astype(float)
    data["came"][0, 0], data["passed"][0, 0] = FAILS, 0
    data["value"][0, 0, CHECKS.index("gap")] = 0.5
    data["margin"][0, 0, CHECKS.index("gap")] = 2.0
    data["error"] = data["error"].astype(object)
    data["error"][3, 1] = "ZeroDivisionError: division by zero"
    data["status"][3, 1], data["status"][3, 2] = 2, 0
    for name in ("came", "value", "bound", "margin"):
        data[name][3, 1:] = np.nan
    return data


def test_what_failed_is_listed_with_its_reason(small):
    text = tables.text(stress_report.findings(broken(small)))
    assert "2 failed:" in text
    assert "step 0.9 of the largest, fast: gap: 0.5, at most 0.25" in text
    assert "3 and 3 elements, exact: ZeroDivisionError: division by zero" in text
    assert "pending" in text


@pytest.mark.parametrize("pick", [{}, {"case": [0]}, {"method": [2]}, {"case": [1], "method": [1]}])
def test_figures_of_few_cases_and_of_failures(small, pick):
    for data in (small, broken(small)):
        with figures.style():
            figure = stress.STUDY.draw(data.isel(pick))
            figure.canvas.draw()


def test_a_case_is_run_by_its_number():
    number = NUMBERS["theta = 90°"]
    data = computed(case=number, method=[0, 2])
    assert data["case_name"].item() == "theta = 90°"
    assert [CAME[int(code)] for code in data["came"].values[0]] == ["ValueError", "ValueError"]
    # What is not asked of a method is told apart from what would be too dear.
    assert computed(case=1, method=1)["came"].item() == APART
    assert computed(case=NUMBERS["100 s, vibrating"], method=2)["came"].item() == DEAR


@pytest.mark.parametrize(
    ("axis", "value"), [("case", 0), ("case", len(CASES) + 1), ("method", -1), ("method", len(METHODS))]
)
def test_a_number_that_no_case_or_method_has_is_refused(axis, value):
    with pytest.raises(ValueError, match=f"{axis} = {value}: it must be from"):
        stress.STUDY.sweep({axis: value})


def test_a_case_that_breaks_down_does_not_take_the_others_with_it(monkeypatch):
    def put(case, method):
        if method == "exact":
            raise ZeroDivisionError("division by zero")
        return 0, 1, np.zeros(len(CHECKS)), np.ones(len(CHECKS))

    monkeypatch.setattr(stress, "put", put)
    found = stress.battery({"case": np.array([1, 1, 2]), "method": np.array([0, 1, 2])})
    assert [type(error) for error in found["error"]] == [type(None), ZeroDivisionError, type(None)]
    assert found["passed"].tolist() == [1, 0, 1]
    with pytest.raises(ZeroDivisionError):
        stress.battery({"case": np.array([1]), "method": np.array([1])})
