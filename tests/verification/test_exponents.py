"""All exponents are found: counted by the argument principle on all modes, which the solver does not know."""

from dataclasses import replace

import numpy as np
import pytest

from fivcore import Friction, Rig, Structure, sliding_modes
from fivcore.contact.compression import compressed, lanczos
from fivcore.errors import InputError
from fivcore.stability.exponents import (
    band_modes,
    damped_inverse,
    damped_starts,
    eigenvalues,
    exponents,
    undamped_inverse,
)
from fivcore.stability.falling import sliding_point
from fivcore.structure import modal_structure
from tests.helpers.scattered import rig_of, scattered
from tests.helpers.structures import assert_same_set, drawn

SETS = {
    "Coulomb, Rayleigh": (True, None),
    "Coulomb, by mode": (False, None),
    "falling, Rayleigh": (True, Friction(0.6, 1.0)),
    "falling, by mode": (False, Friction(0.2, 1.0, "rational")),
}


def beams(seed, rayleigh):
    """A rig of 361 modes as a structure, and a band."""
    rng = np.random.default_rng(abs(seed))
    numbers = scattered(1, abs(seed))
    own = modal_structure(rig_of(numbers, 0), float(numbers["theta"][0]))
    ratio = rng.uniform(0.0, 0.05, len(own.stiffness))
    damped = own if rayleigh else replace(own, rayleigh=None, damping=2.0 * ratio * np.sqrt(own.stiffness))
    return damped, 10.0 ** rng.uniform(3.3, 4.3)


def modes_of(own, omega):
    """p, c, n, t of all modes in units of omega; static ones far beyond, and damped by d2 alone."""
    p, c, g = own.stiffness / omega**2, own.damping / omega, np.stack([own.normal, own.tangential]) / omega
    static = np.arange(len(p)) >= len(own.frequency)
    far = np.where(static, np.maximum(1e15 / np.where(static, p, 1.0), 1.0), 1.0)
    p, g = p * far, g * np.sqrt(far)
    return p, np.where(static, own.d2 * omega * p, c), *g


def characteristic(z, p, c, n, t, m, k):
    """f over all modes at z, (points,); a function of lambda where c is None."""
    distance = p - z[:, None] if c is None else p + z[:, None] * (c + z[:, None])
    A, B, C = ((each / distance).sum(axis=1) for each in (n * n, n * t, t * t))
    return A + m * B - (0.0 if c is None else k * z * (A * C - B * B))


def clear_radius(p, c, largest):
    """Size of poles, and of a circle in the band that is as far as possible from them: roots are close to some."""
    poles = p if c is None else np.concatenate([np.roots([1.0, *each]) for each in zip(c, p, strict=True)])
    size = np.abs(poles)
    inside = np.sort(size[(size > 0.6 * largest) & (size < 0.99 * largest)])
    ends = np.concatenate([[0.6 * largest], inside, [0.99 * largest]])
    widest = np.diff(ends).argmax()
    return size, 0.5 * (ends[widest] + ends[widest + 1])


def number_within(radius, size, p, c, n, t, m, k):
    """Roots within a circle: turns of f on its upper half, twice, and poles in it; None if a root is too near."""
    angle = np.linspace(0.0, np.pi, 257)
    value = characteristic(radius * np.exp(1j * angle), p, c, n, t, m, k)
    for _ in range(40):
        turn = np.angle(value[1:] / value[:-1])
        coarse = np.flatnonzero((np.abs(turn) > 0.4) | (np.abs(np.diff(value)) > 0.5 * np.abs(value[:-1])))
        if not len(coarse):
            break
        middle = 0.5 * (angle[coarse] + angle[coarse + 1])
        if len(angle) > 20_000 or np.diff(angle).min() < 1e-12:
            return None
        more = characteristic(radius * np.exp(1j * middle), p, c, n, t, m, k)
        angle, value = np.insert(angle, coarse + 1, middle), np.insert(value, coarse + 1, more)
    return int(np.rint(turn.sum() / np.pi)) + np.sum(size < radius)


def check(seeds, kind):
    """Number of points at which exponents and their count were compared."""
    rayleigh, law = SETS[kind]
    compared = 0
    for seed in seeds:
        rng = np.random.default_rng(abs(seed))
        own, fmax = beams(seed, rayleigh) if seed < 0 else drawn(seed, rayleigh)
        fmax *= 10.0 ** rng.uniform(-0.7, 0.5) if seed >= 0 else 1.0
        m, k = rng.uniform(0.0, 3.0), 0.0
        if law:
            V, F = 10.0 ** rng.uniform(-3.0, 0.5), 10.0 ** rng.uniform(-3.0, 2.0)
            try:
                m, k = sliding_point(own, law, rng.uniform(0.0, 1.5), V, F)
                modes = band_modes(own, fmax, True)
            except InputError:
                continue
        else:
            modes = band_modes(own, fmax)
        p, c, n, t = modes_of(own, modes.omega)
        undamped = modes.rayleigh is not None
        size, radius = clear_radius(p, None if undamped else c, modes.largest)
        count = number_within(radius, size, p, None if undamped else c, n, t, m, k * modes.omega)
        if count is None:
            continue
        roots = exponents(modes, np.array([m]), np.array([k]))[0]
        roots = roots[np.abs(roots) < radius]
        # Of a conjugate pair of exponents one is listed, of lambda both.
        found = len(roots) if undamped else np.where(roots.imag > 0.0, 2, 1).sum()
        assert found == count, (seed, kind, k * modes.omega)
        assert len(np.unique(roots)) == len(roots)
        compared += 1
    return compared


@pytest.mark.parametrize("kind", SETS)
def test_their_number_is_that_of_the_argument_principle(kind):
    assert check(range(100), kind) > 80
    assert check(range(-10, 0), kind) > 7


@pytest.mark.slow
@pytest.mark.parametrize("kind", SETS)
def test_the_number_of_twenty_thousand(kind):
    assert check(range(1000, 6000), kind) > 4000
    assert check(range(-300, -10), kind) > 200


def sums(residues, p, c, z):
    """Three receptances at z, and the size of their terms, each (3, points)."""
    terms = residues[:, None] / (p + z[:, None] * (c + z[:, None]))
    return terms.sum(axis=-1), np.abs(terms).sum(axis=-1)


@pytest.mark.parametrize("rayleigh", [True, False])
def test_compressed_modes_have_the_receptances_of_all(rayleigh):
    """Of 100 rigs with each kind of damping: in the band to rounding, and with fewer modes than a sixth."""
    for seed in range(1, 101):
        own, fmax = beams(-seed, rayleigh)
        modes = band_modes(own, fmax, True)
        p, c, n, t = modes_of(own, modes.omega)
        angle, size = np.linspace(0.25, 0.5, 9)[:, None] * np.pi, np.array([0.03, 0.3, 0.7, 1.0, 2.0])
        z = (size * np.exp(1j * angle)).ravel()
        whole, terms = sums(np.stack([n * n, n * t, t * t]), p, c, z)
        error = np.abs(sums(modes.residues, modes.p, modes.c, z)[0] - whole) / np.sqrt(terms[0] * terms[2])
        assert error[:, np.abs(z) < 1.5].max() < 1e-14
        assert error.max() < 2e-13
        assert len(modes.p) < len(p) / 6


def test_a_rig_has_few_modes_in_its_band():
    """361 modes become 38, 34 of which friction feels, or 23 for the eigenproblem."""
    own = modal_structure(Rig(), 5.0)
    assert len(own.stiffness) == 361
    falling, modes = band_modes(own, 10e3, True), band_modes(own, 10e3)
    assert [len(each) for each in (falling.p, modes.p, falling.few[0], modes.few[0])] == [38, 34, 23, 21]


def test_modes_that_are_few_or_move_one_gap_alone_are_compressed():
    """Lanczos ends early: the second row is a part of the first, is zero, or the modes are fewer than nodes."""
    s, x = np.geomspace(1e-6, 1.0, 40), np.linspace(-1.0, 0.6, 9)[:, None]
    n = np.cos(np.arange(40.0))
    for w in (
        np.stack([n, 0.3 * n]),
        np.stack([n, 0.0 * n]),
        np.stack([0.0 * n, n]),
        np.eye(2, 40, 30) + np.eye(2, 40, 5),
    ):
        nodes, _, weights = lanczos(s, 0.0 * s, w, 6)
        for a, b in ((0, 0), (0, 1), (1, 1)):
            exact = (w[a] * w[b] / (1.0 - x * s)).sum(axis=1)
            np.testing.assert_allclose(
                (weights[a] * weights[b] / (1.0 - x * nodes)).sum(axis=1), exact, rtol=1e-11, atol=1e-15
            )


@pytest.mark.parametrize(("p", "t", "k"), [([1.0, 2.0], [0.5, -0.3], 1e-9), ([0.3, 1.7], [1.0, 2.0], 1e9)])
def test_slow_exponents_of_steep_friction(p, t, k):
    """f of two modes as a polynomial, with friction that hardly falls or so steeply that it holds the contact."""
    own = Structure.from_modes(np.sqrt(p) / (2.0 * np.pi), [1.0, 1.0], t, load=[-1.0, -1.0], d1=0.02)
    quadratic = [np.poly1d([1.0, 0.02, each]) for each in p]
    x, y = quadratic
    cross = (t[1] - t[0]) ** 2
    polynomial = y * (1.0 + 0.4 * t[0]) + x * (1.0 + 0.4 * t[1]) - k * cross * np.poly1d([1.0, 0.0])
    expected = polynomial.roots[polynomial.roots.imag >= 0.0]
    modes = band_modes(own, 1.0 / np.pi, True)
    found = exponents(modes, np.array([0.4]), np.array([k]))[0] * modes.omega
    near = expected[(np.abs(expected) < 2.0 * modes.omega) & (expected.imag < modes.omega)]
    assert_same_set(found[np.isfinite(found)], near, 1e-12)


@pytest.mark.parametrize("law", [Friction(), Friction(0.3, 1.0)])
def test_shapes_of_gaps_that_no_mode_couples(law):
    """Modes of one gap or of the other: what moves is what contact forces move, and the normal gap is closed."""
    given = {"load": [-1.0, -1.0, 0.0, 0.0], "d1": 0.1}
    own = Structure.from_modes([1.0, 2.0, 1.5, 2.5], [1.0, 0.5, 0.0, 0.0], [0.0, 0.0, 1.0, 0.7], **given)
    found = sliding_modes(own, 0.0, 0.4, 4.0, friction=law, V=0.2, F=3.0)
    assert found.frequency.size == 3
    for rate, frequency, q in zip(found.growth_rate, found.frequency, found.shape, strict=True):
        phi = complex(rate, 2.0 * np.pi * frequency)
        moved = (own.stiffness + phi * (own.damping + phi)) * q
        forces = np.linalg.lstsq(np.stack([own.normal, own.tangential], axis=1), moved, rcond=None)[0]
        left = moved - forces[0] * own.normal - forces[1] * own.tangential
        assert np.abs(left).max() < 1e-12 * own.stiffness.max()
        assert abs(own.normal @ q) < 1e-12
        assert np.abs(q).max() == pytest.approx(1.0)


def test_undamped_eigenvalues_lead_to_all_exponents():
    """With damping and friction that falls, by Newton steps, where a general eigenproblem is not needed."""
    rng, m, k = np.random.default_rng(0), np.array([0.4]), np.array([0.3])
    for _ in range(5):
        p, c, (n, t) = np.sort(rng.uniform(0.2, 3.0, 5)), 0.02 + 0.02 * rng.random(5), rng.normal(size=(2, 5))
        starts = eigenvalues(*undamped_inverse(m, p, n, t, 1.0))
        (found,), whole = damped_starts(starts, m, k, p, c, n, t)
        (expected,) = eigenvalues(*damped_inverse(m, k, p, c, n, t))
        assert whole
        # Constraints take two exponents to infinity.
        expected = expected[(expected.imag >= 0.0) & (np.abs(expected) < 1e3)]
        assert_same_set(found[np.isfinite(found)], expected, 1e-10)


def test_far_modes_become_ten_with_the_receptances_of_all_and_ten_stay_as_they_are():
    p, c = np.geomspace(50.0, 5e4, 40), np.zeros(40)
    g = np.stack([np.cos(np.arange(40.0)), np.sin(2.0 * np.arange(40.0))])
    few, _, gaps = compressed(p, c, g, p > 0.0, 5)
    assert len(few) == 10
    for x in (-1.0, 0.0, 1.0):
        expected = (g[:, None] * g / (p - x)).sum(axis=-1)
        np.testing.assert_allclose((gaps[:, None] * gaps / (few - x)).sum(axis=-1), expected, rtol=1e-12)
    for mine, given in zip(compressed(p[:10], c[:10], g[:, :10], p[:10] > 0.0, 5), (p, c, g), strict=True):
        np.testing.assert_array_equal(mine, given[..., :10])


def test_a_rig_with_modal_damping_has_few_modes_in_its_band():
    """361 modes become some 39, of which friction feels 36."""
    own = modal_structure(Rig(), 5.0)
    ratio = np.linspace(0.01, 0.02, len(own.stiffness))
    damped = replace(own, rayleigh=None, damping=2.0 * ratio * np.sqrt(own.stiffness))
    assert len(band_modes(damped, 10e3, True).p) <= 40
