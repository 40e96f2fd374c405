"""What may be asked of a contact law beyond its defaults: its relaxation time, its cross terms, and beta2."""

import re

import numpy as np
import pytest

from fivcore import Rig, Scene, critical_mu, simulate
from fivcore.contact.reduced import full_model, reduced_model, relaxation_time
from fivcore.contact.step_map import at_most
from fivcore.transient.published import BETA2, TAU, contact_closing, largest_step

SCENE = Scene(5e-3, 5.0, 0.2, 9.0)
CUTOFF = 75e3
# Past the first separation at 5 mm/s.
BURST = 0.04


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in ("velocity_B", "normal_force"))


def first_contact(method="fast", **asked):
    return simulate(SCENE, BURST, method, record=True, sample_rate=1e6, **asked)


def test_tau_scales_the_dashpot_and_nothing_else():
    own = reduced_model(Rig(), 5.0, CUTOFF)
    tau = relaxation_time(Rig(), CUTOFF)
    for factor in (0.0, 0.5, 2.0):
        model = reduced_model(Rig(), 5.0, CUTOFF, relaxation_time=factor * tau)
        np.testing.assert_allclose(model.C, factor * own.C, rtol=1e-14)
        assert np.array_equal(model.K, own.K)
        assert np.array_equal(model.rest, own.rest)


def test_without_cross_terms_normal_and_tangential_flexibility_stay():
    own = reduced_model(Rig(), 20.0, CUTOFF)
    model = reduced_model(Rig(), 20.0, CUTOFF, cross_terms=False)
    assert own.K[0, 1] != 0.0
    assert np.count_nonzero(model.K) == np.count_nonzero(model.C) == 2
    np.testing.assert_allclose(1.0 / np.diag(model.K), np.diag(np.linalg.inv(own.K)), rtol=1e-12)


@pytest.mark.parametrize("method", ["fast", "exact"])
def test_the_derived_tau_asked_for_by_its_value_changes_no_bit(method):
    asked = {"cutoff": CUTOFF, "relaxation_time": relaxation_time(Rig(), CUTOFF)}
    assert same(first_contact(method, cutoff=CUTOFF), first_contact(method, **asked))


def test_the_papers_beta2_asked_for_by_its_value_changes_no_bit():
    assert same(first_contact("paper"), first_contact("paper", beta2=BETA2))


@pytest.mark.parametrize("asked", [{"relaxation_time": 1e-7}, {"cross_terms": False}])
def test_fast_and_exact_solve_the_same_changed_law(asked):
    """Until the surfaces part they agree better with each other than with the law as it is."""
    step = 1e-7
    runs = [
        simulate(SCENE, BURST, method, cutoff=CUTOFF, step=step, record=True, sample_rate=1.0 / step, **given)
        for method, given in (("fast", asked), ("exact", asked), ("exact", {}))
    ]
    until = int(min(run.summary["first_separation_time"] for run in runs) / step) - 1
    fast, exact, plain = (run.velocity_B[:until] for run in runs)
    assert np.abs(fast - exact).max() < 0.05 * np.abs(plain - exact).max()


def test_tau_zero_is_the_elastic_termination():
    zero = first_contact(cutoff=CUTOFF, relaxation_time=0.0)
    assert same(zero, first_contact(cutoff=CUTOFF, termination="elastic"))


def test_the_onset_follows_the_cross_terms():
    """Unless a cut-off is given the first burst is reached by a finer model, which must obey the same law."""
    times = [simulate(SCENE, BURST, cross_terms=kept).summary["first_separation_time"] for kept in (True, False)]
    assert np.isfinite(times).all()
    assert times[0] != times[1]


@pytest.mark.parametrize("beta2", [0.5, 0.65, 1.0])
def test_the_stable_step_follows_beta2(beta2):
    model = full_model(Rig(), 5.0)
    limit = largest_step(model.stiffness, model.damping, beta2)
    simulate(SCENE, 1e-6, "paper", beta2=beta2, step=0.999 * limit)
    with pytest.raises(ValueError, match=f"needs at most {at_most(limit)} s"):
        simulate(SCENE, 1e-6, "paper", beta2=beta2, step=1.001 * limit)


def test_critical_friction_follows_the_switches():
    theta = 20.0
    assert critical_mu(Rig(), theta, "exact", cross_terms=False) == np.inf
    elastic = critical_mu(Rig(), theta, "fast", termination="elastic")
    assert critical_mu(Rig(), theta, "fast", relaxation_time=0.0) == elastic
    W = contact_closing(full_model(Rig(), theta), 2e-8, 0.5)
    by_hand = abs(W[0] / W[1]) * (1.0 + TAU / 2e-8)
    assert critical_mu(Rig(), theta, "paper", beta2=0.5) == pytest.approx(by_hand, rel=1e-12)
    assert by_hand != critical_mu(Rig(), theta, "paper")


@pytest.mark.parametrize(
    ("method", "given", "text"),
    [
        ("fast", {"relaxation_time": -1e-9}, "relaxation_time = -1e-09: it must be a number from 0 to 1 (s)"),
        ("fast", {"relaxation_time": 1e-7, "termination": "elastic"}, "relaxation_time = 1e-07: termination"),
        ("fast", {"relaxation_time": 1e-7, "termination": "none"}, "termination 'none' has none; leave it out"),
        ("exact", {"relaxation_time": 1e-7, "termination": "none"}, "termination = 'none': method 'exact' needs"),
        (
            "exact",
            {"termination": "elastic"},
            "termination = 'elastic': method 'exact' needs the absorbing",
        ),
        (
            "exact",
            {"relaxation_time": 0.0},
            "relaxation_time = 0: method 'exact' needs a time above 0; use",
        ),
        ("paper", {"relaxation_time": 1e-7}, "relaxation_time = 1e-07: method 'paper' keeps all modes"),
        ("fast", {"cross_terms": 0}, "cross_terms = 0: it must be a bool"),
        ("paper", {"cross_terms": False}, "cross_terms = False: method 'paper' keeps all modes"),
        ("fast", {"cross_terms": False, "termination": "none"}, "cross_terms = False: termination 'none'"),
        ("fast", {"beta2": 0.8}, "beta2 = 0.8: method 'fast' has none, only 'paper'; leave it out"),
        ("exact", {"beta2": 0.5}, "beta2 = 0.5: method 'exact' has none"),
        ("paper", {"beta2": 0.49}, "beta2 = 0.49: it must be a number from 0.5 to 1"),
        ("paper", {"beta2": "half"}, "beta2 = 'half': it must be a number from 0.5 to 1"),
    ],
)
def test_a_switch_out_of_place_is_named(method, given, text):
    for call in (lambda: simulate(SCENE, 1e-3, method, **given), lambda: critical_mu(Rig(), 5.0, method, **given)):
        with pytest.raises(ValueError, match=re.escape(text)) as caught:
            call()
        assert "\n" not in str(caught.value)
