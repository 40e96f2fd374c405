"""Own structures have a cut-off of motion beside the band of stability."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from scipy import sparse

from fivcore import (
    InputError,
    Rig,
    Scene,
    State,
    Structure,
    flutter_onsets,
    growing_frequencies,
    simulate,
    sliding_modes,
)
from fivcore.contact.reduced import CONTACT_STEP, reduced_model
from fivcore.modal.cutoffs import FURTHER_MODES, GROWTH_REACH, MOTION_MODES, SLENDER
from fivcore.transient.published import PERIOD_SHARE, paper_step
from tests.benchmarks.constants import by_modes, vibrating
from tests.helpers import meshes
from tests.helpers.structures import beams

GIVEN = [{}, {"fmax": 10e3}, {"fmax": 20e3}, {"fmax": 100e3}]


def sparsely(monkeypatch):
    for module in ("structure", "finite_elements"):
        monkeypatch.setattr(f"fivcore.{module}.DENSE_SIZE", 10)
    return sparse.csc_array


def means(scene, duration=1.0, members=4):
    """Means of shares and RMS over members that differ by the ramp, and their standard errors."""
    runs = [simulate(scene, duration, ramp=1e-3 * (1.0 + 0.37 * k)).summary for k in range(members)]
    names = ("stick_fraction", "slip_fraction", "separation_fraction", "velocity_rms")
    values = np.array([[run[name] for name in names] for run in runs])
    return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(members)


@pytest.fixture(scope="module")
def rig_means():
    return means(Scene(2e-3, 5.0, 0.2, 9.0))


@pytest.mark.parametrize("sparsity", [False, True])
@pytest.mark.parametrize("given", GIVEN)
def test_the_beams_from_matrices_move_as_the_rig(given, sparsity, rig_means, monkeypatch):
    """Whatever the band of stability: shares within 0.01, RMS within 3 %, steps at most 1.5 times as many."""
    structure = beams(sparsely(monkeypatch) if sparsity else np.asarray, **given)
    (mine, scatter), (theirs, other) = means(Scene(2e-3, 0.0, 0.2, 9.0, structure)), rig_means
    error = 2.0 * np.hypot(scatter, other)
    assert np.all(np.abs(mine - theirs)[:3] < 0.01 + error[:3])
    assert abs(mine[3] - theirs[3]) < 0.03 * theirs[3] + error[3]
    work = [
        len(model.stiffness) / model.default_step
        for model in (reduced_model(structure, 0.0), reduced_model(Rig(), 5.0))
    ]
    assert work[0] < 1.5 * work[1]


@pytest.mark.parametrize("given", GIVEN)
def test_stability_does_not_see_the_modes_of_motion(given):
    structure = beams(**given)
    alone = replace(structure, wider=None, cutoff=None)
    one, other = flutter_onsets(structure, 0.0), flutter_onsets(alone, 0.0)
    np.testing.assert_array_equal(one.mu, other.mu)
    np.testing.assert_array_equal(one.frequency, other.frequency)
    pair = [sliding_modes(each, 0.0, 0.2).eigenvalue for each in (structure, alone)]
    np.testing.assert_array_equal(*pair)
    assert structure.frequency.max() < given.get("fmax", np.inf)


def test_modes_of_motion_are_the_same_whoever_asks():
    found = [beams(fmax=fmax) for fmax in (5e3, 10e3, 20e3, 100e3)]
    assert all(each.wider == found[0].wider for each in found)
    assert len({each.cutoff for each in found}) == 1
    assert np.count_nonzero(found[0].wider.frequency < found[0].cutoff) == MOTION_MODES
    assert len(found[0].wider.frequency) >= FURTHER_MODES


def test_a_structure_with_modes_of_motion_is_light_and_whole():
    structure = beams(fmax=10e3)
    assert len(pickle.dumps(structure)) < 20_000
    assert Structure.from_dict(structure.to_dict()) == structure
    assert pickle.loads(pickle.dumps(structure)) == structure  # noqa: S301
    assert structure != replace(structure, wider=None)
    assert structure.mirrored().wider == structure.wider.mirrored()
    assert structure.truncated().wider.static == 0
    assert np.all(structure.with_stiffness_damping(1e-8).wider.damping[1:-2] > structure.wider.damping[1:-2])
    damped = structure.damped([0.01] * (len(structure.frequency) - 1) + [0.02], of="free")
    own = 2.0 * np.sqrt(damped.wider.stiffness[: len(damped.wider.frequency)])
    assert damped.wider.damping[1:-2] / own[1:] == pytest.approx(
        np.r_[[0.01] * (len(structure.frequency) - 2), [0.02] * (len(own) - len(structure.frequency) + 1)]
    )


def test_states_have_the_modes_of_motion_or_those_of_stability():
    structure = beams(fmax=10e3)
    scene, few = Scene(2e-3, 0.0, 0.2, 9.0, structure), np.zeros(len(structure.frequency))
    end = simulate(scene, 1e-3).final_state
    modes = len(structure.wider.frequency)
    assert len(end.displacement) == modes + 2
    simulate(scene, 1e-3, initial=end)
    simulate(scene, 1e-3, initial=State(few, few, 2, True))
    with pytest.raises(InputError, match=f"they must be {modes} finite numbers"):
        simulate(scene, 1e-3, initial=State(few[1:], few[1:], 2, True))


def test_ratios_of_a_band_are_continued_to_the_modes_of_motion():
    """Given for the modes of the band, as before."""
    kept = beams(fmax=10e3)
    n = len(kept.frequency)
    M = np.diag(np.ones(60))
    K = np.diag((2.0 * np.pi * np.linspace(100.0, 60e3, 60)) ** 2)
    rows = {"normal": np.ones(60), "tangential": np.linspace(1.0, -1.0, 60), "load": -np.ones(60)}
    own = Structure.from_matrices(M, K, **rows, fmax=10e3, damping_ratio=np.linspace(0.01, 0.02, 10))
    assert n > 5
    assert len(own.frequency) == 10
    wider = own.wider.damping[: len(own.wider.frequency)] / (2.0 * np.sqrt(own.wider.stiffness[:-2]))
    assert wider == pytest.approx(np.r_[np.linspace(0.01, 0.02, 10), [0.02] * (len(wider) - 10)])


def test_the_expected_error_is_a_number_or_its_origin_says_why_not():
    structure, scene = beams(fmax=10e3), Scene(2e-3, 0.0, 0.2, 9.0)
    run = simulate(replace(scene, rig=structure), 1.5).summary
    assert "cutoff_origin" not in run
    assert run["cutoff"] == structure.cutoff < structure.wider.frequency[-1]
    assert 0.005 < run["cutoff_error"] < 0.05
    run = simulate(replace(scene, rig=structure), 0.01, cutoff=50e3).summary
    assert run["cutoff"] == 50e3
    assert np.isnan(run["cutoff_error"])
    modes = Structure.from_modes([0.0, 500.0], [1.0, 0.2], [0.0, 1.0], load=[-1.0, 0.0])
    run = simulate(replace(scene, rig=modes), 0.01).summary
    assert (run["cutoff_origin"], round(run["cutoff"], 6)) == ("highest mode", 500.0)
    assert np.isnan(run["cutoff_error"])


@pytest.mark.parametrize("fmax", [5e3, 20e3])
def test_the_published_scheme_steps_for_the_modes_of_motion(fmax):
    """Its step, and the damping that goes with it, follow the highest mode that moves."""
    structure = beams(fmax=fmax)
    assert paper_step(structure) == PERIOD_SHARE / (2.0 * np.pi * structure.wider.frequency[-1])
    run = simulate(Scene(2e-3, 0.0, 0.2, 9.0, structure), 1e-3, "paper").summary
    assert run["cutoff"] == pytest.approx(structure.wider.frequency[-1])


def test_a_cutoff_above_all_modes_leaves_their_residual():
    """Static modes are no modes of motion: the step does not follow them."""
    structure = beams(fmax=10e3)
    top = 1.0001 * structure.wider.frequency[-1]
    high, usual = (reduced_model(structure, 0.0, cutoff) for cutoff in (1e9, top))
    assert high.default_step == usual.default_step
    assert high.K.any()


def test_a_small_model_is_what_it_is():
    """Without a band no mode is left out; of a mesh the upper third of its modes."""
    M, K = np.eye(12), np.diag((2.0 * np.pi * np.linspace(100.0, 9e3, 12)) ** 2)
    rows = {"normal": np.ones(12), "tangential": np.linspace(1.0, -1.0, 12), "load": -np.ones(12)}
    assert reduced_model(Structure.from_matrices(M, K, **rows), 0.0).kept.all()
    mesh = meshes.structure(4, 1e3)
    assert len(mesh.motion.frequency) <= FURTHER_MODES
    assert reduced_model(mesh, 0.0).K.any()


def assert_converged(scenes, most):
    """All but `most` are within 0.02 and two standard errors of four times the cut-off, and all within 0.05."""
    found = [by_modes(seed, scene, (None,)) for seed, scene in scenes]
    beyond = np.array([each[None][1] for each in found if each])
    assert np.count_nonzero(beyond > 0.02) <= most, beyond
    assert beyond.max() < 0.05, beyond


def test_the_cutoff_of_a_structure_has_converged():
    assert_converged([(22, meshes.vibrating(22))], 0)


@pytest.mark.slow
def test_the_cutoff_of_random_structures_has_converged():
    """Of 21 pins under arms and bars on beams, and 9 strips, whose modes are dense."""
    assert_converged([*vibrating(21), *vibrating(9, (2,))], 2)


@pytest.mark.parametrize("seed", [50, 89])
def test_a_step_of_a_solid_follows_its_highest_mode(seed):
    """Most of its contact's compliance is above the cut-off, whose own oscillation is slower than the modes."""
    model = reduced_model(meshes.structure(seed, 10e3), 0.0)
    highest = float(np.sqrt(model.stiffness.max()))
    assert model.contact_frequency < highest
    assert model.default_step * highest <= CONTACT_STEP / SLENDER
    assert len(model.stiffness) == 2 * MOTION_MODES


@pytest.mark.parametrize(("seed", "more"), [(10, True), (18, False)])
def test_where_sliding_grows_near_the_cutoff_more_modes_move(seed, more):
    """The dashpot that stands for the modes above decides whether such a mode grows."""
    scene = meshes.vibrating(seed)
    own, moved = scene.rig, simulate(scene, 1e-3).summary["cutoff"]
    below = growing_frequencies(scene, cutoff=own.cutoff)
    assert (below[-1] > GROWTH_REACH * own.cutoff) == more
    assert (moved > own.cutoff) == more
    assert np.count_nonzero(own.motion.frequency < moved) >= (FURTHER_MODES if more else MOTION_MODES)


@pytest.mark.parametrize("static", [1, 2])
def test_static_modes_alone_are_a_residual_or_none(static):
    """They never move: with one of them, of which no contact law can be made, the known modes are all there is."""
    frequency, rows = np.linspace(100.0, 9e3, 12), np.stack([np.ones(12), np.linspace(1.0, -1.0, 12)])
    own = Structure.from_modes(frequency, *rows, load=-np.ones(12))
    far = {"stiffness": [1e25] * static, "normal": [1e8, 0.0][:static], "tangential": [0.0, 1e8][:static]}
    zero = dict.fromkeys(("damping", "inertia", "output", "load", "struck"), [0.0] * static)
    added = {name: np.append(getattr(own, name), row) for name, row in (far | zero).items()}
    model = reduced_model(replace(own, **added, static=static), 0.0, 1e9)
    assert len(model.stiffness) == 12
    assert model.K.any() == (static == 2)
    assert model.default_step > 1e-8
