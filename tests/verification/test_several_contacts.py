"""Several contacts: statics, stability and motion against other ways to the same."""

import itertools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import linalg

from fivcore import (
    Friction,
    InputError,
    Rig,
    Scene,
    State,
    Structure,
    assembled_modes,
    flutter_onsets,
    on_foot,
    onset_sensitivity,
    simulate,
    sliding_modes,
)
from fivcore.contact.several import _least_friction
from fivcore.stability.several import exponents_at, onsets_of_several, steady_forces
from fivcore.statics import resting
from fivcore.transient.fast.several_kernel import gauss_seidel, observe
from fivcore.transient.statistics import SLIP
from tests.helpers.blocks import chain, stick_times
from tests.helpers.moreau_jean import run as moreau_jean
from tests.helpers.several import drawn, paper_rig, repeated, two_beams


def by_enumeration(p, normal, load, gap, push=None):
    """Forces of the contacts that may be closed together, of all sets of them; `push`: with their friction."""
    push = normal if push is None else push
    c, n, found = len(normal), len(p), []
    for size in range(c + 1):
        for closed in map(list, itertools.combinations(range(c), size)):
            system = np.block([
                [np.diag(p), -push[closed].T],
                [normal[closed], np.zeros((size, size))],
            ])  # fmt: skip
            scale = np.append(1.0 / np.sqrt(np.maximum(p, 1e2)), np.full(size, np.sqrt(np.maximum(p, 1e2)).mean()))
            system = scale[:, None] * system * scale
            if np.linalg.cond(system) > 1e12:
                continue
            q, force = np.split(scale * np.linalg.solve(system, scale * np.append(load, -gap[closed])), [n])
            opened = [i for i in range(c) if i not in closed]
            if np.all(force >= -1e-12 * np.abs(force).max(initial=0.0)) and np.all(
                (gap + normal @ q)[opened] > -1e-13
            ):
                found.append(np.zeros(c))
                found[-1][closed] = force
    return found


def test_statics_against_all_sets_of_closed_contacts():
    rng, refused = np.random.default_rng(0), 0
    for _ in range(300):
        c, n = int(rng.integers(1, 6)), int(rng.integers(5, 12))
        p, gap = 10.0 ** rng.uniform(2.0, 9.0, n), np.abs(rng.normal(size=c)) * 1e-6 * rng.choice([0.0, 1.0], c)
        p[: rng.integers(0, min(3, c) + 1)] = 0.0
        normal, load = rng.normal(size=(c, n)), rng.normal(size=n)
        known = by_enumeration(p, normal, load, gap)
        if not known:
            refused += 1
            with pytest.raises(InputError, match="load"):
                resting(p, normal, load, gap)
            continue
        forces, gaps = resting(p, normal, load, gap)
        assert forces == pytest.approx(known[0], abs=1e-7 * max(known[0].max(), 1e-12))
        assert forces.min() >= 0.0
        assert gaps.min() >= -1e-15
    assert 20 < refused < 150


def eliminated(own, mu, fmax, fallen=0.0):
    """Exponents by bases of motions that leave the gaps closed, and of those in which the forces do no work.

    `fallen`, (n, n), by which friction that falls takes from the damping.
    """
    push = own.normal + mu * own.friction[:, None] * own.tangential
    right, left = linalg.null_space(own.normal), linalg.null_space(push)
    M, C, K = np.eye(len(own.damping)), np.diag(own.damping) - fallen, np.diag(own.stiffness)
    M, C, K = (left.T @ each @ right for each in (M, C, K))
    n = len(M)
    whole = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    phi, omega = np.linalg.eigvals(whole), 2.0 * np.pi * fmax
    return phi[(phi.imag >= 0.0) & (phi.imag <= omega) & (np.abs(phi) <= 2.0 * omega)]


def apart(one, other):
    """Largest relative distance of an entry of one set from the nearest of the other."""
    return max(np.abs(b - each).min() / abs(each) for a, b in ((one, other), (other, one)) for each in a)


def exponents(own, mu, fmax, **given):
    found = sliding_modes(own, 0.0, mu, fmax, **given)
    return found.growth_rate + 2j * np.pi * found.frequency


def in_sliding(own, mu, F=1.0):
    """Forces, (c,), of all sets of contacts that may be closed in steady sliding."""
    push = own.normal + mu * own.friction[:, None] * own.tangential
    return by_enumeration(own.stiffness, own.normal, F * own.load, own.gap, push)


def with_contacts(own, closed):
    """A structure with some of its contacts alone."""
    rows = {name: getattr(own, name)[closed] for name in ("normal", "tangential", "struck", "gap", "friction")}
    return replace(own, **rows)


def test_exponents_of_fifty_structures_against_dense_elimination():
    opened, refused = 0, 0
    for seed in range(50):
        own = drawn(seed)
        for mu in (0.2, 0.7):
            known = in_sliding(own, mu)
            if len(known) != 1 or not known[0].any():
                refused += 1
                with pytest.raises(InputError, match="no unique steady sliding from mu = "):
                    sliding_modes(own, 0.0, mu, 2e3)
                continue
            assert steady_forces(own, mu) == pytest.approx(known[0], abs=1e-9 * known[0].max())
            opened += not known[0].all()
            mine = exponents(own, mu, 2e3)
            theirs = eliminated(with_contacts(own, known[0] > 0.0), mu, 2e3)
            assert len(mine) == len(theirs)
            assert len(mine) == 0 or apart(mine, theirs) < 1e-8
    assert opened >= 20
    assert 5 <= refused < 15


@pytest.mark.parametrize("gap", [0.0, 1e-7])
def test_onsets_are_counted_in_each_set_of_contacts(gap):
    """Between onsets and recoveries as many modes grow as with the contacts that are closed there."""
    own, F = drawn(4), 10.0
    own = own.with_gap(gap * np.arange(4.0))
    found = flutter_onsets(own, 0.0, 2e3, 2.0, F=F)
    changes = sorted([(mu, 1) for mu in found.mu] + [(mu, -1) for mu in found.recovery_mu])
    places, count, sets = [0.0, *(mu for mu, _ in changes), 2.0], 0, set()
    for low, high, change in zip(places, places[1:], [*(each for _, each in changes), 0], strict=False):
        if high - low > 1e-6:
            middle = 0.5 * (low + high)
            (forces,) = in_sliding(own, middle, F)
            sets.add(tuple(np.flatnonzero(forces)))
            phi = eliminated(with_contacts(own, forces > 0.0), middle, 2e3)
            assert np.sum((phi.real > 0.0) & (phi.imag > 0.0)) == count
        count += change
    assert len(sets) > 2
    # Some of these are changes of closed contacts, and there a growth rate jumps.
    sides = [[in_sliding(own, mu * side, F)[0] > 0.0 for side in (1.0 - 1e-6, 1.0 + 1e-6)] for mu in found.mu]
    assert any(np.any(before != beyond) for before, beyond in sides)


def test_a_foot_that_friction_has_tilted_vibrates_from_its_onset_on():
    """Two contacts are closed at rest, from mu = .213 on one; the onset is that of runs."""
    own, F, V = on_foot(Rig(), 5.0, 3, 15e-3), 9.0, 1.0
    onset = flutter_onsets(own, 0.0)
    assert onset.mu == pytest.approx([0.358], abs=1e-3)
    assert onset.frequency == pytest.approx([339.4], abs=0.1)
    assert (own.equilibrium(F)[0] > 0.0).sum() == 2
    # Growing, it separates after some periods, as the model that moves has fewer modes.
    for mu, periods in ((0.3, 8.0), (0.4, 2.0)):
        assert (steady_forces(own, mu) > 0.0).tolist() == [True, False, False]
        modes = sliding_modes(own, 0.0, mu)
        k = int(np.nanargmax(modes.growth_rate)) if mu > onset.mu[0] else 1
        assert (modes.growth_rate[k] > 0.0) == (mu > onset.mu[0])
        found = growth_in_a_run(own, mu, V, F, modes, k, periods, 4)
        assert found == pytest.approx(modes.growth_rate[k], rel=0.01)


def test_falling_friction_has_the_contacts_of_its_speed():
    own, friction, V, F = drawn(6), Friction(0.5, 0.05), 0.05, 10.0
    ratio = friction.ratio(V)
    for mu, count in ((0.2 / ratio, 3), (0.4 / ratio, 2)):
        (forces,) = in_sliding(own, mu * ratio, F)
        assert (forces > 0.0).sum() == count
        part = with_contacts(own, forces > 0.0)
        k = -mu * friction.slope(V) * part.friction * forces[forces > 0.0]
        fallen = part.tangential.T @ (k[:, None] * part.tangential)
        mine = exponents(own, mu, 2e3, friction=friction, V=V, F=F)
        theirs = eliminated(part, mu * ratio, 2e3, fallen)
        assert apart(mine[mine.imag > 0.0], theirs[theirs.imag > 0.0]) < 1e-8


@pytest.mark.parametrize("seed", range(6))
def test_exponents_against_stiff_springs_in_the_contacts(seed):
    own, mu = drawn(seed), 0.4
    n = len(own.stiffness)
    stiff = 1e7 * own.stiffness.max() / np.square(own.normal).sum(axis=1).mean()
    springs = stiff * own.normal.T @ own.normal
    friction = stiff * own.tangential.T @ (own.friction[:, None] * own.normal)
    K = np.diag(own.stiffness) + springs
    found = assembled_modes(np.eye(n), np.diag(own.damping), K, friction_stiffness=friction, mu=mu, fmax=2e3)
    theirs = (found.growth_rate + 2j * np.pi * found.frequency).ravel()
    mine = exponents(own, mu, 2e3)
    inside = np.abs(mine.real) < 0.4 * 2.0 * np.pi * 2e3
    assert inside.any()
    assert all(np.abs(theirs - each).min() < 1e-6 * abs(each) for each in mine[inside])


@pytest.mark.parametrize("friction", [Friction(), Friction(0.6, 0.01), Friction(0.6, 0.01, "rational")])
def test_one_contact_among_several_has_its_exponents_and_onsets(friction):
    own = paper_rig()
    again, point = repeated(own, 1), {"friction": friction, "V": 2e-3, "F": 9.0}
    mine = exponents_at(again, 10e3, friction)(0.2, 2e-3, 9.0) * 2e4 * np.pi
    theirs = exponents(own, 0.2, 10e3, **point)
    theirs = theirs[np.isfinite(theirs)]
    assert apart(mine[mine.imag > 0.0], theirs[theirs.imag > 0.0]) < 1e-8
    one, (mu, frequency, *_) = (
        flutter_onsets(own, 0.0, **point),
        onsets_of_several(again, 10e3, 1.0, friction, 2e-3, 9.0),
    )
    if friction.constant:
        assert mu == pytest.approx(one.mu, rel=1e-8)
        assert frequency == pytest.approx(one.frequency, rel=1e-7)
        assert onsets_of_several(again, 10e3, 1.0, friction, None, None)[5] == pytest.approx(
            one.divergence_mu, rel=1e-6
        )


def test_shapes_solve_the_equations():
    own, mu = drawn(3), 0.5
    found = sliding_modes(own, 0.0, mu, 2e3)
    for phi, q in zip(exponents(own, mu, 2e3), found.shape, strict=True):
        force = (own.stiffness + phi * (own.damping + phi)) * q
        push = own.normal + mu * own.friction[:, None] * own.tangential
        rest = force - push.T @ np.linalg.lstsq(push.T, force)[0]
        assert np.abs(own.normal @ q).max() < 1e-8 * np.abs(own.normal).max()
        assert np.abs(rest).max() < 1e-7 * np.abs(force).max()


@pytest.mark.parametrize(
    ("friction", "mu", "error"),
    [(Friction(), 0.1, 1e-9), (Friction(0.8, 0.0), 0.1, 1e-9), (Friction(0.8, 0.05), 0.1, 1e-4)],
)
def test_two_contacts_in_one_place_are_one(friction, mu, error):
    """With friction that falls with the speed the first step in slip differs, by 1e-5 m/s.

    There the rate at which slip begins is that of the forces of slip, with one contact those of stick.
    """
    own = paper_rig()
    given = {"cutoff": 94e3, "record": True, "sample_rate": None}
    one, two = (
        simulate(Scene(0.02, 0.0, mu, 9.0, each, friction), 6e-3, **given) for each in (own, repeated(own))
    )
    assert one.summary["first_slip_time"] == two.summary["first_slip_time"]
    for name in ("velocity_B", "normal_force", "tangential_force"):
        known = getattr(one, name)
        assert getattr(two, name) == pytest.approx(known, abs=error * np.abs(known).max())
    assert np.array_equal(one.state, two.state)


def test_two_contacts_in_one_place_vibrate_as_one():
    own, given = paper_rig(), {"cutoff": 94e3}
    one, two = (simulate(Scene(2e-3, 0.0, 0.2, 9.0, each), 1.0, **given).summary for each in (own, repeated(own)))
    # Over 1 s shares scatter by .01.
    for name in ("stick_fraction", "separation_fraction"):
        assert two[name] == pytest.approx(one[name], abs=0.03)
    assert two["velocity_rms"] == pytest.approx(one["velocity_rms"], rel=0.15)
    assert two["energy_residual"] < 0.01
    assert two["contact_mean_normal_force"] == pytest.approx([4.5, 4.5], abs=0.1)


def growth_in_a_run(own, mu, V, F, modes, k, periods=8.0, pairs=1):
    """Growth rate, 1/s, of the difference of two runs, one from steady sliding and one from a mode beside it."""
    forces, gap = steady_forces(own, mu, F), own.normal[steady_forces(own, mu, F) > 0.0]
    q, elastic = (
        F * own.load + forces @ (own.normal + mu * own.friction[:, None] * own.tangential),
        own.stiffness > 0,
    )
    q = np.where(elastic, q, 0.0) / np.where(elastic, own.stiffness, 1.0)
    # Rigid motions close the contacts.
    q[~elastic] = np.linalg.lstsq(gap[:, ~elastic], -gap @ q)[0]
    phi, shape = modes.growth_rate[k] + 2j * np.pi * modes.frequency[k], modes.shape[k]
    shape = shape * 1e-6 * np.abs(q).max()
    statuses = np.where(forces > 0.0, 2, 0)
    states = (
        State(q + shape.real, (phi * shape).real, 2, True, statuses),
        State(q, np.zeros(len(q)), 2, True, statuses),
    )
    given = {"record": True, "sample_rate": None}
    runs = [
        simulate(Scene(V, 0.0, mu, F, own), periods / modes.frequency[k], initial=state, **given)
        for state in states
    ]
    # Exponents in pairs, by linear prediction.
    every, n = max(round(0.1 / modes.frequency[k] / runs[0].time[1]), 1), 2 * pairs
    y = (runs[0].velocity_B - runs[1].velocity_B)[::every]
    ahead = np.linalg.lstsq(np.stack([y[n - 1 - i : len(y) - 1 - i] for i in range(n)], axis=1), y[n:])[0]
    found = np.log(np.roots([1.0, *-ahead]).astype(complex)) / (runs[0].time[every] - runs[0].time[0])
    found = found[np.argmin(np.abs(found - phi))]
    assert found.imag == pytest.approx(phi.imag, rel=1e-3 if pairs == 1 else 1e-2)
    return found.real


def test_a_perturbation_grows_by_its_exponent():
    for seed, mu in ((0, 0.3), (2, 0.6), (3, 0.3), (5, 0.3), (9, 1.0)):
        own, F, V = drawn(seed), 10.0, 1.0
        modes = sliding_modes(own, 0.0, mu, 2e3)
        k = int(np.nanargmax(modes.growth_rate))
        assert growth_in_a_run(own, mu, V, F, modes, k) == pytest.approx(modes.growth_rate[k], rel=1e-3)


def test_blocks_on_a_belt_stick_and_slip_as_from_event_to_event():
    """Three blocks in a chain, from the start with the belt: periods to 1e-6, each stick within four steps."""
    K, own = chain()
    mu, kappa, V, step, duration = 0.5, 0.6, 0.01, 2.5e-7, 1.0
    known = stick_times(K, V, mu * own.friction, kappa * mu * own.friction, duration)
    # The springs are unloaded, and all move with the belt.
    v = np.append(np.zeros(3), own.tangential[:, 3:].T @ np.full(3, V))
    given = {"step": step, "record": "state", "sample_rate": None, "initial": State(np.zeros(6), v, 1, True)}
    found = simulate(Scene(V, 0.0, mu, 3.0, own, Friction(kappa, 0.0)), duration, **given)
    for i, times in enumerate(known):
        state = found.contact_state[:, i]
        mine = found.time[1:][(state[1:] == 1) & (state[:-1] != 1)]
        times = np.array([each for each in times if each < duration - 10.0 * step])
        assert len(mine) == len(times) > 30
        assert np.abs(mine - times).max() < 4.0 * step
        periods = (mine[-1] - mine[5]) / (times[-1] - times[5])
        assert periods == pytest.approx(1.0, abs=1e-6)


def test_a_symmetric_pad_moves_symmetrically():
    """Two contacts side by side: what is antisymmetric stays at rest, and together they are one contact."""
    rng = np.random.default_rng(3)
    frequency, (n, t) = np.array([40.0, 90.0, 150.0, 210.0, 330.0]), rng.normal(size=(2, 5))
    turned, frequencies = np.array([1.0, 1.0, -1.0, 1.0, -1.0]), {"frequency": frequency, "damping_ratio": 0.02}
    pad = Structure.from_modes(
        normal=[n, n * turned], tangential=[t, t * turned], load=-n * (turned > 0), **frequencies
    )
    given = {"record": True, "sample_rate": None, "ramp": 0.0, "step": 1e-5}
    found = simulate(Scene(0.02, 0.0, 0.15, 5.0, pad), 0.2, **given)
    assert found.summary["first_slip_time"] < 0.1
    size = np.abs(found.contact_normal_force).max()
    assert np.ptp(found.contact_normal_force, axis=1).max() < 1e-9 * size
    assert np.array_equal(found.contact_state[:, 0], found.contact_state[:, 1])


def test_second_order_in_the_step_until_slip():
    own, runs = two_beams(3), []
    scene, times = Scene(2e-4, 0.0, 0.8, 9.0, own), np.linspace(1e-4, 1e-3, 200)
    for share in (1, 2, 4, 16):
        step = 1e-6 / share
        runs.append(simulate(scene, 1.5e-3, cutoff=94e3, step=step, record="velocity_B", sample_times=times))
    assert np.isnan(runs[-1].summary["first_slip_time"])
    errors = [np.abs(run.velocity_B - runs[-1].velocity_B).max() for run in runs[:-1]]
    assert errors[0] > 3.0 * errors[1] > 9.0 * errors[2]


def test_sensitivities_are_those_of_changed_structures():
    own = drawn(9)
    found = onset_sensitivity(own, 0.0, 2e3)
    assert len(found.mu)
    for name, gradient in found.mu_gradient.items():
        kind, _, number = name.partition("_")
        if kind != "frequency" or int(number) % 3:
            continue
        k, mu = int(number) - 1, []
        for change in (1e-5, -1e-5):
            p = own.stiffness.copy()
            p[k] *= (1.0 + change) ** 2
            mu.append(flutter_onsets(replace(own, stiffness=p), 0.0, 2e3).mu)
        known = (mu[0] - mu[1]) / (2e-5 * own.frequency[k])
        assert gradient == pytest.approx(known, rel=1e-3, abs=1e-6 * np.abs(known).max())


def compared(seed, duration, settle, share):
    """Shares of time and mean forces of `fast`, less those of a Moreau-Jean scheme with coordinates of its own."""
    own, F, mu, V = drawn(seed), 10.0, 0.6, 0.02
    found = simulate(Scene(V, 0.0, mu, F, own), duration, settle=settle, ramp=0.0)
    assert found.summary["energy_residual"] < 1e-3
    assert found.summary["unsolved_steps"] == 0
    n, c = len(own.stiffness), own.contacts
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(n, n)))[0]
    matrices = np.eye(n), turn * own.damping @ turn.T, turn * own.stiffness @ turn.T
    rows = own.normal @ turn.T, own.tangential @ turn.T
    rest = turn @ ((F * own.load + own.equilibrium(F)[0] @ own.normal) / own.stiffness)
    step = share * found.final_state.origin[1].step
    shares, mean = moreau_jean(
        *matrices, *rows, np.zeros(c), F * turn @ own.load, mu * own.friction, V, rest, np.zeros(n),
        step, int(duration / step), settle, 200,
    )  # fmt: skip
    mine = [found.summary[f"contact_{name}_fraction"] for name in ("separation", "stick", "slip")]
    return np.array(mine).T - shares, (found.summary["contact_mean_normal_force"] - mean) / F


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2, 4, 7])
def test_shares_of_time_are_those_of_a_moreau_jean_scheme(seed):
    shares, forces = compared(seed, 4.0, 0.5, 0.1)
    assert np.abs(shares).max() < 0.025
    assert np.abs(forces).max() < 0.01


def test_shares_of_time_are_those_of_a_moreau_jean_scheme_in_short():
    shares, forces = compared(2, 0.6, 0.1, 0.25)
    assert np.abs(shares).max() < 0.08
    assert np.abs(forces).max() < 0.03


def test_the_critical_friction_of_contacts_that_do_not_feel_each_other_is_the_least_of_theirs():
    """N of one contact is positive up to the ratio of direct to cross flexibility."""
    direct, cross, matrix = np.array([2.0, 3.0]), np.array([0.5, -0.6]), np.eye(4)
    matrix[range(2), range(2)] = direct
    matrix[[0, 1, 2, 3], [2, 3, 0, 1]] = [*cross, *cross]
    for factors in ([1.0, 0.2], [1.0, 3.0], [0.3, 0.3]):
        expected = np.min(direct / np.abs(cross) / factors)
        assert _least_friction(matrix, np.array(factors)) == pytest.approx(expected, rel=1e-12)


def test_contacts_in_one_place_slip_with_the_friction_of_their_speed():
    """Forces are solved to rounding, though three contacts share one."""
    own, law, mu = repeated(paper_rig(), 3), Friction(0.4, 0.3), 0.3
    given = {"cutoff": 60e3, "ramp": 0.0, "settle": 0.0, "record": True, "sample_rate": None}
    found = simulate(Scene(1.0, 0.0, mu, 9.0, own, law), 1.2e-4, **given)
    slips = found.contact_state == SLIP
    ratio = np.array([law.ratio(v) for v in found.contact_slip_velocity[slips]])
    expected = mu * ratio * found.contact_normal_force[slips]
    assert slips.mean() > 0.5
    np.testing.assert_allclose(np.abs(found.contact_tangential_force[slips]), expected, atol=1e-9)


def test_where_stick_and_slip_are_both_possible_slip_continues():
    law = {"mu": np.array([0.3]), "kinetic": np.array([0.3]), "falls": True, "law": (0.0, 0.05, 0.0)}
    motion = {"matrix": np.eye(2), "force": np.zeros(2), "was": [SLIP], "status": [SLIP], "slip": [-0.25]}
    gauss_seidel(
        SimpleNamespace(**law, unit=1.0, late=1.0, rigid=False),
        SimpleNamespace(**motion),
        np.array([1.0, 0.25]),
        5,
    )
    (N, T), speed = motion["force"], 0.25 - motion["force"][1]
    assert motion["status"] == [SLIP]
    assert N == 1.0
    np.testing.assert_allclose(T, 0.3 * Friction(0.0, 0.05).ratio(speed), rtol=1e-9)


def test_power_is_lost_at_the_velocity_in_the_middle_of_an_impulse():
    v, push, output, damping = np.random.default_rng(0).random((4, 5))
    mean = v + 0.5 * push
    assert observe(output, damping, v, push) == pytest.approx((output @ mean, damping @ mean**2), rel=1e-12)


def test_a_rigid_contact_among_several_slips_with_the_friction_of_its_speed():
    law, mu = Friction(0.0, 0.05), 0.3
    own = Structure.from_modes([0.0, 1.59], [[1.0, 0.0]], [[0.0, 1.0]], load=[-1.0, 0.0], gap=1e-9)
    given = {"initial": State(np.zeros(2), np.array([0.0, -0.1]), SLIP, True), "step": 1e-3, "settle": 0.0}
    found = simulate(Scene(1e-9, 0.0, mu, 1.0, own, law), 0.05, **given, record=True, sample_rate=None)
    assert np.all(found.contact_state == SLIP)
    ratio = np.array([law.ratio(v) for v in found.contact_slip_velocity[:, 0]])
    np.testing.assert_allclose(found.tangential_force, mu * ratio * found.normal_force, rtol=1e-6)


def test_where_no_friction_is_given_there_are_no_modes():
    assert sliding_modes(drawn(2), 0.0, []).frequency.shape == (0, 0)
