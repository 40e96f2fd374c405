"""Ablations of the contact: the relaxation time and the cross terms of its element, and beta2."""

from functools import partial

import numpy as np
import pytest

from fivcore import Rig, Scene, critical_mu, simulate
from fivcore.contact.ablation import modified, with_relaxation_time, without_cross_terms
from fivcore.contact.reduced import DAMPING, full_model, reduced_model
from fivcore.contact.step_map import at_most
from fivcore.transient.published import BETA2, TAU, contact_closing, largest_step
from tests.helpers.runs import assert_same_run

SCENE = Scene(0.02, 5.0, 0.2, 9.0)
CUTOFF = 75e3
# Past the first separation at 20 mm/s.
BURST = 0.0125


def own_tau():
    """Relaxation time of the paper's rig, s."""
    return 2.0 * DAMPING / reduced_model(Rig(), 5.0, CUTOFF).contact_frequency


def relaxing(tau):
    return partial(with_relaxation_time, tau=tau)


def first_contact(method="fast", **asked):
    return simulate(SCENE, BURST, method, record=True, sample_rate=1e6, **asked)


def test_tau_scales_the_dashpot_and_nothing_else():
    own = reduced_model(Rig(), 5.0, CUTOFF)
    tau = own_tau()
    for factor in (0.0, 0.5, 2.0):
        model = with_relaxation_time(own, factor * tau)
        np.testing.assert_allclose(model.C, factor * own.C, rtol=1e-14)
        assert np.array_equal(model.K, own.K)
        assert np.array_equal(model.rest, own.rest)
    # At least the material's.
    damped = reduced_model(Rig(d2=1e-2), 5.0, CUTOFF)
    np.testing.assert_allclose(damped.C, 1e-2 * own.K, rtol=1e-14)


def test_without_cross_terms_normal_and_tangential_flexibility_stay():
    own = reduced_model(Rig(), 20.0, CUTOFF)
    model = without_cross_terms(own)
    assert own.K[0, 1] != 0.0
    assert np.count_nonzero(model.K) == np.count_nonzero(model.C) == 2
    np.testing.assert_allclose(1.0 / np.diag(model.K), np.diag(np.linalg.inv(own.K)), rtol=1e-12)
    np.testing.assert_allclose(model.C, own.C[0, 0] / own.K[0, 0] * model.K, rtol=1e-14)


def test_scenes_share_a_modified_model():
    own, modify = reduced_model(Rig(), 5.0, CUTOFF), relaxing(1e-7)
    assert modified(own, None) is own
    assert modified(own, modify) is modified(own, modify) is not own


@pytest.mark.parametrize("method", ["fast", "exact", "paper"])
def test_the_usual_tau_or_beta2_asked_for_by_its_value_changes_no_bit(method):
    usual = {} if method == "paper" else {"cutoff": CUTOFF}
    value = {"beta2": BETA2} if method == "paper" else {"modify": relaxing(own_tau())}
    assert_same_run(first_contact(method, **usual), first_contact(method, **usual, **value))


@pytest.mark.parametrize("modify", [relaxing(1e-7), without_cross_terms])
def test_fast_and_exact_solve_the_same_changed_law(modify):
    """Until the surfaces part they agree better with each other than with the law as it is."""
    step = 1e-7
    runs = [
        simulate(SCENE, BURST, method, cutoff=CUTOFF, step=step, record=True, sample_rate=1.0 / step, **given)
        for method, given in (("fast", {"modify": modify}), ("exact", {"modify": modify}), ("exact", {}))
    ]
    until = int(min(run.summary["first_separation_time"] for run in runs) / step) - 1
    fast, exact, plain = (run.velocity_B[:until] for run in runs)
    assert np.abs(fast - exact).max() < 0.05 * np.abs(plain - exact).max()


def test_tau_zero_is_the_elastic_termination():
    zero = first_contact(cutoff=CUTOFF, modify=relaxing(0.0))
    assert_same_run(zero, first_contact(cutoff=CUTOFF, termination="elastic"))
    modify = relaxing(1e-7)
    elastic = first_contact(cutoff=CUTOFF, termination="elastic", modify=modify)
    assert_same_run(elastic, first_contact(cutoff=CUTOFF, modify=modify))


@pytest.mark.parametrize("modify", [relaxing(1e-7), without_cross_terms])
def test_the_onset_obeys_the_changed_law_too(modify):
    """Unless a cut-off is given the first burst is reached by a finer model."""
    changed = []

    def noted(model):
        changed.append(len(model.rest))
        return modify(model)

    times = [simulate(SCENE, BURST, modify=each).summary["first_separation_time"] for each in (None, noted)]
    assert np.isfinite(times).all()
    assert times[0] != times[1]
    assert len(changed) == 2
    assert changed[1] > changed[0]


@pytest.mark.parametrize("beta2", [0.5, 0.65, 1.0])
def test_the_stable_step_follows_beta2(beta2):
    model = full_model(Rig(), 5.0)
    limit = largest_step(model.stiffness, model.damping, beta2)
    simulate(SCENE, 1e-6, "paper", beta2=beta2, step=0.999 * limit)
    with pytest.raises(ValueError, match=f"needs at most {at_most(limit)} s"):
        simulate(SCENE, 1e-6, "paper", beta2=beta2, step=1.001 * limit)


def test_critical_friction_follows_ablations():
    theta = 20.0
    assert critical_mu(Rig(), theta, "exact", modify=without_cross_terms) == np.inf
    elastic = critical_mu(Rig(), theta, "fast", termination="elastic")
    assert critical_mu(Rig(), theta, "fast", modify=relaxing(0.0)) == elastic
    W = contact_closing(full_model(Rig(), theta), 2e-8, 0.5)
    by_hand = abs(W[0] / W[1]) * (1.0 + TAU / 2e-8)
    assert critical_mu(Rig(), theta, "paper", beta2=0.5) == pytest.approx(by_hand, rel=1e-12)
    assert by_hand != critical_mu(Rig(), theta, "paper")
