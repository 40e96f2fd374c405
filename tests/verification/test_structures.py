"""Stability of structures: that of the beams they may be, dense eigenvalues, differences, null spaces."""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest
from scipy import linalg

from fivcore import Rig, flutter_onsets, glued_frequencies, onset_sensitivity, sliding_modes, tune_head_mass
from fivcore.stability.many import FlutterOnsets
from fivcore.structure import Structure
from tests.helpers.rigs import workshop_rig
from tests.helpers.structures import assert_same_set, drawn, within

BEAMS = [(Rig(), 5.0), (workshop_rig(1), 9.0), (workshop_rig(5), 12.0), (workshop_rig(14), 20.0)]


@cache
def dense_exponents(own, mu):
    """Exponents with Im >= 0, of the modes with g_N = 0 and T = mu N as a matrix; static modes are a spring."""
    m = len(own.frequency)
    unit = np.sqrt(own.stiffness[:m].max())
    p, c, n, t = own.stiffness[:m] / unit**2, own.damping[:m] / unit, own.normal[:m], own.tangential[:m]
    force, mass, damping, stiffness = n + mu * t, np.eye(m), np.diag(c), np.diag(p)
    if own.static:
        compliance = own.normal[m:] * (own.normal + mu * own.tangential)[m:] / own.stiffness[m:]
        spring = np.outer(force, n) / (compliance.sum() * unit**2)
        stiffness, damping = stiffness + spring, damping + own.d2 * unit * spring
    else:
        right, left = linalg.null_space(n[None]), linalg.null_space(force[None]).T
        mass, damping, stiffness = (left @ each @ right for each in (mass, damping, stiffness))
    lower = -np.linalg.solve(mass, np.hstack([stiffness, damping]))
    values = np.linalg.eigvals(np.vstack([np.eye(len(mass), 2 * len(mass), len(mass)), lower]))
    return unit * values[values.imag >= 0.0]


def exponents(own, mu, fmax):
    found = sliding_modes(own, 0.0, mu, fmax)
    values = found.growth_rate + 2j * np.pi * found.frequency
    return values[np.isfinite(values)]


@pytest.mark.parametrize(("rig", "theta"), BEAMS)
def test_the_beams_as_a_structure_are_the_rig(rig, theta):
    """Bit for bit, but for onsets, where a rig's modes come from tables; and with the same damping by mode."""
    own = Structure.of(rig, theta)
    by_mode = replace(own, rayleigh=None)
    for mu in (0.0, 0.2, 0.6, 1.5):
        one, other = sliding_modes(rig, theta, mu), sliding_modes(own, 0.0, mu)
        for name in ("frequency", "growth_rate", "eigenvalue", "uncoupled"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
        # Of two real exponents, Rayleigh damping has the larger alone.
        mine, theirs = exponents(by_mode, mu, 10e3), exponents(own, mu, 10e3)
        assert_same_set(mine[mine.imag > 0.0], theirs[theirs.imag > 0.0], 1e-10)
        assert all(np.abs(mine - each).min() < 1e-9 * np.abs(each) for each in theirs)
    np.testing.assert_array_equal(glued_frequencies(rig, theta), glued_frequencies(own, 0.0))
    found, tables = flutter_onsets(own, 0.0, mu_max=2.0), flutter_onsets(rig, theta, mu_max=2.0)
    also = flutter_onsets(by_mode, 0.0, mu_max=2.0)
    for name in (each.name for each in fields(FlutterOnsets)):
        np.testing.assert_allclose(getattr(found, name), getattr(tables, name), rtol=2e-12)
        np.testing.assert_allclose(getattr(also, name), getattr(found, name), rtol=1e-11)


@pytest.mark.parametrize("kind", ["by mode", "Rayleigh", "some undamped", "critical", "overdamped"])
def test_modes_are_dense_eigenvalues(kind):
    for seed in range({"by mode": 100, "Rayleigh": 100}.get(kind, 24)):
        own, scale = drawn(seed, kind == "Rayleigh")
        rng, m = np.random.default_rng(1000 + seed), len(own.frequency)
        fmax, mus = scale * 10.0 ** rng.uniform(-0.5, 0.7), (0.0, rng.uniform(0.0, 4.0))
        some = rng.random(m) < 0.5
        ratios = {"some undamped": 0.02 * some, "critical": some + 0.01 * ~some, "overdamped": 3.0 * rng.random(m)}
        own = own.damped(ratios[kind], of="free") if kind in ratios else own
        for mu in mus:
            mine, theirs = (within(each, fmax) for each in (exponents(own, mu, fmax), dense_exponents(own, mu)))
            theirs = theirs[np.abs(theirs) > 1e-12 * scale]
            if kind == "Rayleigh":
                mine, theirs = mine[mine.imag > 0.0], theirs[theirs.imag > 0.0]
            assert_same_set(mine, theirs, 1e-8)
        flutter_onsets(own, 0.0, scale)


@pytest.mark.parametrize(("rayleigh", "share"), [(True, 1.0), (False, 1.0), (False, 1e-8)])
def test_onsets_explain_all_growing_pairs(rayleigh, share):
    """Each is a dense eigenvalue on the imaginary axis, and between them there are no more growing pairs."""
    count = 0
    for seed in range(40):
        own, scale = drawn(seed, rayleigh)
        own = own if rayleigh else replace(own, damping=share * own.damping)
        found, omega = flutter_onsets(own, 0.0, scale), 2.0 * np.pi * scale
        count += len(found.mu)
        for mu, frequency in ((found.mu, found.frequency), (found.recovery_mu, found.recovery_frequency)):
            for each, phi in zip(mu, 2j * np.pi * frequency, strict=True):
                assert np.abs(dense_exponents(own, each) - phi).min() < 1e-7 * np.abs(phi)
        for mu in np.linspace(0.013, 0.983, 20):
            values = within(dense_exponents(own, mu), scale)
            pairs = np.sum((values.real > 1e-11 * omega) & (values.imag > 1e-9 * omega))
            assert pairs <= np.sum(found.mu < mu) - np.sum(found.recovery_mu < mu) + np.sum(found.entry_mu < mu)
    assert count > 15


def changed(own, name, step):
    """A structure with one parameter of `onset_sensitivity` changed."""
    damping, stiffness, (kind, _, k) = own.damping.copy(), own.stiffness.copy(), name.partition("_")
    if kind == "direction":
        turned = np.exp(1j * step) * (own.normal + 1j * own.tangential)
        return replace(own, normal=turned.real, tangential=turned.imag)
    damping[int(k) - 1] += step * (kind == "damping")
    stiffness[int(k) - 1] = (2.0 * np.pi * (own.frequency[int(k) - 1] + step * (kind == "frequency"))) ** 2
    return replace(own, stiffness=stiffness, damping=damping, rayleigh=None)


@pytest.mark.parametrize("kind", ["by mode", "Rayleigh", "undamped", "Rayleigh, static"])
def test_sensitivities_are_differences(kind):
    """Static modes have Rayleigh damping or none, so that with it only the direction can be changed alone."""
    count, static = 0, kind == "Rayleigh, static"
    for seed in range(40):
        own, scale = drawn(seed, kind.startswith("Rayleigh"))
        if kind.startswith("Rayleigh") and static is not (own.static > 0):
            continue
        own = own if kind != "undamped" else replace(own, damping=0.0 * own.damping)
        found, last = onset_sensitivity(own, 0.0, scale), len(own.frequency)
        sizes = dict.fromkeys(("damping_2", f"damping_{last}"), own.damping[:last].max())
        sizes |= dict.fromkeys(("frequency_2", f"frequency_{last}"), own.frequency[-1])
        sizes = {name: size for name, size in sizes.items() if size > 0.0 and not static} | {"direction": 1.0}
        assert kind != "undamped" or "damping_2" not in found.mu_gradient
        roots = np.stack([found.mu, found.frequency])[:, ~found.fold]
        for name, size in sizes.items() if roots.size else ():
            moved = (changed(own, name, way * size) for way in (-1e-6, 1e-6))
            ends = [flutter_onsets(each, 0.0, 1.02 * scale, 1.2) for each in moved]
            nearest = [np.abs(end.frequency - roots[1][:, None]).argmin(axis=1) for end in ends]
            low, high = [np.stack([e.mu, e.frequency])[:, k] for e, k in zip(ends, nearest, strict=True)]
            gradients = np.stack([found.mu_gradient[name], found.frequency_gradient[name]])[:, ~found.fold]
            share, expected = (high - low) / 2e-6 / roots, gradients * size / roots
            assert np.all(np.abs(share - expected) < 1e-5 * (1.0 + np.abs(expected))), (seed, name)
            count += roots.size
    assert count > 3


def test_tied_frequencies_are_dense_eigenvalues():
    """In the null space of both gaps, or with the static modes as springs."""
    for own in (Structure.of(Rig(), 5.0), *(drawn(seed)[0] for seed in range(30))):
        m, gaps = len(own.frequency), np.stack([own.normal, own.tangential])
        if m < 9:
            continue
        matrix = np.diag(own.stiffness[:m])
        if own.static:
            compliance = (gaps[:, m:] / own.stiffness[m:]) @ gaps[:, m:].T
            matrix += gaps[:, :m].T @ np.linalg.solve(compliance, gaps[:, :m])
        held = np.eye(m) if own.static else linalg.null_space(gaps)
        values = np.linalg.eigvalsh(held.T @ matrix @ held)
        found = (2.0 * np.pi * glued_frequencies(own, 0.0, 7)) ** 2
        assert np.all(np.abs(values[:7] - found) < 1e-10 * found + 1e-13 * values[-1])


@pytest.mark.parametrize("seed", [5, 6, 14])
def test_shapes_solve_the_sliding_problem(seed):
    """In modal coordinates the largest is 1; forces of all modes agree, and the gap is closed."""
    own, scale = drawn(seed)
    found, m = sliding_modes(own, 0.0, [0.3], scale), len(own.frequency)
    phi = (found.growth_rate + 2j * np.pi * found.frequency)[0]
    assert found.shape.shape == (1, len(phi), m)
    for value, q in zip(phi, found.shape[0], strict=True):
        assert abs(q[np.abs(q).argmax()] - 1.0) < 1e-15
        force = q * (own.stiffness + own.damping * value + value**2)[:m] / (own.normal + 0.3 * own.tangential)[:m]
        np.testing.assert_allclose(force, force[np.abs(force).argmax()], rtol=1e-6)
        static = (own.normal * (own.normal + 0.3 * own.tangential))[m:] / own.stiffness[m:] * force.mean()
        assert abs(own.normal[:m] @ q + static.sum()) < 1e-8 * np.abs(own.normal[:m]) @ np.abs(q)


OWN, TWO = drawn(5)[0], Structure.from_modes([1.0, 2.0], [1.0, 1.0], [0.0, 1.0], load=[-1.0, -1.0])
WRONG = {
    r"^theta = 5: the modes of a Structure have its inclination": (sliding_modes, OWN, 5.0, 0.2),
    r"^theta = 1: ": (flutter_onsets, OWN, 1.0),
    r"^fmax = -1.0: it must be a number from": (flutter_onsets, OWN, 0.0, -1.0),
    r"^mu_max = 0.0: it must be a number from": (flutter_onsets, OWN, 0.0, 1.0, 0.0),
    r"^rig = 'pin': it must be a Rig or a Structure$": (onset_sensitivity, "pin", 0.0),
    r"^count = 500: it must be a whole number from 1 to": (glued_frequencies, OWN, 0.0, 500),
    r"^rig = .*: with its contact tied it has no mode$": (glued_frequencies, TWO, 0.0),
    r"^rig = Structure\(.*: it must be a Rig$": (tune_head_mass, OWN, 0.0),
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_input_is_named(text):
    function, *arguments = WRONG[text]
    with pytest.raises(ValueError, match=text):
        function(*arguments)


def test_a_mode_with_a_node_at_the_contact_keeps_its_frequency_when_tied():
    own = Structure.from_modes(
        [1.0, 2.0, 3.0, 4.0], [0.0, 1.0, 0.5, 0.3], [0.0, 0.2, 1.0, 0.7], load=[0.0, -1.0, 0.0, 0.0]
    )
    assert glued_frequencies(own, 0.0, 1)[0] == pytest.approx(1.0, rel=1e-13)
