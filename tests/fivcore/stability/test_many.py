"""Flutter onsets of many rigs: those of one rig at a time, by modes from similarity and a secular equation."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from fivcore import Rig, flutter_onsets, flutter_onsets_many, sliding_modes
from fivcore.beams.modes import contact_modes
from fivcore.beams.similar import secular_root, unit_cantilever
from fivcore.rig import P1, P2
from fivcore.stability import many
from tests.helpers import extended_onsets as extended
from tests.helpers.rigs import workshop_rig
from tests.helpers.scattered import rig_of, scattered

FIELDS = ("mu", "frequency", "recovery_mu", "recovery_frequency", "entry_mu")


def made(p1=None, p2=None, **change) -> Rig:
    return Rig(replace(P1, **(p1 or {})), replace(P2, **(p2 or {})), **change)


EXTREMES = {
    "paper": (made(), 5.0),
    "upright": (made(), 0.0),
    "leaning": (made(), 80.0),
    "leaning back": (made(), -80.0),
    "hardly leaning": (made(), 1e-3),
    "no head": (made(head_mass=0.0), 5.0),
    "no head, upright": (made(head_mass=0.0), 0.0),
    "heavy head": (made(head_mass=1e15), 5.0),
    "undamped": (made(d1=0.0, d2=0.0), 5.0),
    "heavily damped": (made(d1=2e4, d2=1e-5), 5.0),
    "one element": (made({"elements": 1}, {"elements": 1}), 7.0),
    "200 elements": (made({"elements": 200}, {"elements": 200}), 7.0),
    "stiff on soft": (made({"young_modulus": 1e20}, {"young_modulus": 1e9}), 7.0),
    "soft on stiff": (made({"young_modulus": 1e9}, {"young_modulus": 1e20}), 7.0),
    "contact at the end": (made(contact_position=0.15), 7.0),
}
WORKSHOP = {f"workshop {s}": (workshop_rig(s, s % 3 > 0), 80.0 * np.sin(s + 1.0)) for s in range(30)}
CASES = [pytest.param(*case, id=name) for name, case in (EXTREMES | WORKSHOP).items()]


def poles(rig: Rig, theta: float, limit: float) -> np.ndarray:
    """Poles and residues of a rig, ascending, those beyond 25 `limit` (rad2/s2) replaced."""
    beams = (unit_cantilever(beam.elements) for beam in (rig.p1, rig.p2))
    system = np.empty((3, 3 * (rig.p1.elements + rig.p2.elements) + 1 + many.NODES))
    size = many.contact_poles(many.rig_table({"theta": theta}, rig)[0], 1.0, limit, *beams, system)
    return system[:, np.argsort(system[0, :size], kind="stable")]


@pytest.mark.parametrize(("rig", "theta"), CASES)
def test_poles_and_residues_are_those_of_the_modes(rig, theta):
    p, normal, tangential = contact_modes(rig, theta)
    order = np.argsort(p, kind="stable")
    p, normal, tangential = (each[order][normal[order] != 0.0] for each in (p, normal, tangential))
    mine = poles(rig, theta, np.inf)
    # The larger of the two shapes carries the rounding of the eigenvectors.
    rounding = max(1e-11, 1e-15 * max(rig.p1.elements, rig.p2.elements) ** 2.2)
    assert_allclose(mine[0], p, rtol=rounding)
    assert_allclose(mine[1], normal**2, rtol=0.0, atol=30.0 * rounding * np.max(normal**2))
    scale = np.abs(normal).max() * np.abs(tangential).max()
    assert_allclose(mine[2], normal * tangential, rtol=0.0, atol=30.0 * rounding * scale)


@pytest.mark.parametrize(("rig", "theta"), CASES)
def test_onsets_are_those_of_one_rig(rig, theta):
    one, found = flutter_onsets(rig, theta), flutter_onsets_many({"theta": theta}, rig=rig)
    for name in FIELDS:
        assert_allclose(getattr(found, name)[0], getattr(one, name), rtol=1e-10, err_msg=name)


def test_onsets_where_every_number_is_scattered():
    numbers = scattered(60)
    found = flutter_onsets_many(numbers, 8e3, 0.8)
    for row in range(60):
        one = flutter_onsets(rig_of(numbers, row), numbers["theta"][row], 8e3, 0.8)
        for name in FIELDS:
            values = getattr(found, name)[row]
            assert_allclose(values[np.isfinite(values)], getattr(one, name), rtol=1e-10)


def test_onsets_in_extended_precision():
    numbers = scattered(12)
    found = flutter_onsets_many(numbers)
    for row in range(12):
        rig = rig_of(numbers, row)
        seen = np.isfinite(found.mu[row])
        mu, omega = (each[row][seen].astype(np.longdouble) for each in (found.mu, 2.0 * np.pi * found.frequency))
        given = extended.numbers(rig, float(numbers["theta"][row]))
        given = {name: np.full(len(mu), np.longdouble(value)) for name, value in given.items()}
        if len(mu):
            assert_allclose([omega, mu], extended.onset_roots(rig, given, omega, mu), rtol=1e-11)


@pytest.mark.parametrize(("rig", "theta"), [EXTREMES["paper"], EXTREMES["200 elements"], WORKSHOP["workshop 4"]])
def test_far_poles_are_replaced_without_a_difference_in_the_band(rig, theta):
    unit = (2e4 * np.pi) ** 2
    every, few = poles(rig, theta, np.inf), poles(rig, theta, unit)
    assert few.shape[1] < every.shape[1]
    far, new = (each[:, each[0] > 25.0 * unit] for each in (every, few))
    for x in unit * np.array([-4.0, -1.0, 0.0, 0.5, 1.0, 1.0 - 0.3j, -1j]):
        exact, terms = np.sum(far[1:] / (far[0] - x), axis=1), np.sum(np.abs(far[1:]) / far[0], axis=1)
        assert np.all(np.abs(np.sum(new[1:] / (new[0] - x), axis=1) - exact) <= 1e-14 * terms)


def test_a_secular_equation_with_poles_that_all_but_coincide():
    """Roots of a rank-one change against closed-form sums of them; gaps keep their relative accuracy."""
    d = np.array([1.0, 1.0 + 4e-16, 2.0, 2.0 + 1e-9, 50.0])
    w, gap = np.array([0.3, 1e-20, 1e-8, 0.2, 3.0]), np.empty(5)
    last = np.append(d, d[-1] + 10.0)
    roots, distances = [], []
    for k in range(5):
        roots.append(secular_root(k, last, w, 0.5, gap))
        distances.append(-gap.copy())
    assert all(low <= root <= high for root, (low, high) in zip(roots, pairwise(last), strict=True))
    assert sum(roots) == pytest.approx(np.sum(d) + np.sum(w) / 0.5, rel=1e-14)
    # Residues of prod (d_i - z) / prod (root_k - z) give back the weights.
    for i, weight in enumerate(w):
        others = [j for j in range(5) if j != i]
        product = np.prod([distances[k][i] for k in range(5)]) / np.prod(d[others] - d[i])
        assert 0.5 * product == pytest.approx(weight, rel=1e-12)


def test_equal_frequencies_of_the_clamped_modes():
    """An axial and a bending frequency that coincide: the limit of frequencies that nearly do."""
    along, across = unit_cantilever(30)[0][0, [0, 32]]
    thickness = P1.length * np.sqrt(along / across)
    systems = [poles(made({"thickness": thickness * (1.0 + by)}), 30.0, np.inf) for by in (0.0, 1e-13)]
    assert_allclose(systems[0][0], systems[1][0], rtol=1e-11)
    assert_allclose(systems[0][1], systems[1][1], rtol=0.0, atol=1e-9 * systems[0][1].max())


@pytest.mark.parametrize("seed", range(2))
def test_unstable_is_where_a_mode_grows(seed):
    """At random rigs like the paper's, without exception."""
    numbers, mu = scattered(25, seed), np.linspace(0.0, 1.0, 41)
    unstable = flutter_onsets_many(numbers).unstable(mu)
    for row in range(25):
        modes = sliding_modes(rig_of(numbers, row), numbers["theta"][row], mu)
        assert_array_equal(unstable[row], np.any(modes.unstable, axis=-1))


def test_divergence_is_a_real_eigenvalue_at_the_edge():
    numbers = scattered(40)
    found, seen = flutter_onsets_many(numbers), 0
    for row in np.flatnonzero(np.isfinite(found.divergence_mu)):
        at = found.divergence_mu[row] * np.array([1.0 - 1e-9, 1.0 + 1e-9])
        modes = sliding_modes(rig_of(numbers, row), numbers["theta"][row], at)
        assert_array_equal(np.sum(modes.unstable & (modes.frequency == 0.0), axis=-1) % 2, [0, 1])
        seen += 1
    assert seen > 5


def test_neither_threads_nor_neighbours_change_a_bit(monkeypatch):
    numbers = scattered(40)
    whole = flutter_onsets_many(numbers)
    monkeypatch.setattr(many, "BATCH", 7)
    parts = flutter_onsets_many(numbers, threads=2)
    alone = flutter_onsets_many({name: value[17] for name, value in numbers.items()})
    for name in (*FIELDS, "divergence_mu"):
        assert_array_equal(getattr(whole, name), getattr(parts, name))
        values = getattr(alone, name)[0]
        assert_array_equal(np.atleast_1d(getattr(whole, name)[17])[: np.size(values)], np.atleast_1d(values))


def test_what_is_not_named_is_the_rigs():
    rig = made({"elements": 6, "width": 0.02}, {"elements": 9}, head_mass=1.0)
    found = flutter_onsets_many({"theta": [5.0, 12.0], "p2_density": 7000.0}, rig=rig)
    for row, theta in enumerate((5.0, 12.0)):
        one = flutter_onsets(replace(rig, p2=replace(rig.p2, density=7000.0)), theta)
        assert_allclose(found.mu[row][np.isfinite(found.mu[row])], one.mu, rtol=1e-10)
    assert not found.mu.flags.writeable


def test_no_rigs():
    found = flutter_onsets_many({"theta": []})
    assert found.mu.shape == (0, 0)
    assert found.unstable([0.1, 0.2]).shape == (0, 2)


NOT_ROWS = "it must be a number or a row of numbers"
BAD = [
    ({}, {}, "numbers: theta is missing"),
    (
        {"theta": [1.0, 90.0]},
        {},
        "rig of row 1: theta = 90.0: it must be a single angle between -90 and 90 degrees",
    ),
    ({"theta": [1.0, np.inf]}, {}, "rig of row 1: theta = inf: it must be"),
    ({"theta": 1.0, "p1_lenght": 1.0}, {}, "a name in numbers = 'p1_lenght': it must be one of theta, "),
    (
        {"theta": 1.0, "p1_length": [1, 0]},
        {},
        "p1 of row 1: Beam: length = 0.0: it must be a number from 1e-09 to ",
    ),
    (
        {"theta": 1.0, "p2_density": [1e3, 1e10]},
        {},
        "p2 of row 1: Beam: density = 10000000000.0: it must be a num",
    ),
    (
        {"theta": 1.0, "d1": [1.0, 2.0, np.nan, 0.0]},
        {},
        "rig of row 2: Rig: d1 = nan: it must be a number from 0 to",
    ),
    ({"theta": 1.0, "head_mass": "heavy"}, {}, f"head_mass = 'heavy': {NOT_ROWS}"),
    (
        {"theta": 1.0, "head_mass": ["heavy"]},
        {},
        "head_mass = ['heavy']: it must be a number or an array of numbers",
    ),
    ({"theta": 1.0, "head_mass": True}, {}, f"head_mass = True: {NOT_ROWS}"),
    ({"theta": [[1.0]]}, {}, f"theta = [[1.0]]: {NOT_ROWS}"),
    (
        {"theta": [1.0, 2.0], "d1": [1.0, 2.0, 3.0]},
        {},
        "numbers: rows of [2, 3] numbers: they must have one length",
    ),
    (
        {"theta": 1.0, "contact_position": [0.3, 0.1, 0.29], "p2_length": [0.4, 0.05, 0.3]},
        {},
        "rig of row 1: Rig: contact_position = 0.1: it must be above 0 and at most P2's length, 0.05 m",
    ),
    (5.0, {}, "numbers = 5.0: it must be a Mapping"),
    ({"theta": 1.0}, {"threads": 0}, "threads = 0: it must be a whole number from 1 to 1024"),
    ({"theta": 1.0}, {"rig": None}, "rig = None: it must be a Rig"),
    ({"theta": 1.0}, {"fmax": -1.0}, "fmax = -1.0: it must be a number from 0.001 to 1e+09 (Hz)"),
]


@pytest.mark.parametrize(("numbers", "options", "message"), BAD)
def test_what_cannot_be_asked_for_is_refused(numbers, options, message):
    with pytest.raises(ValueError, match=r".") as caught:
        flutter_onsets_many(numbers, **options)
    assert str(caught.value).startswith(message)
    with pytest.raises(ValueError, match=r"mu = 1.5: it must be a number from 0 to 1 \(a coefficient of friction"):
        flutter_onsets_many({"theta": 5.0}).unstable(1.5)


def test_a_search_without_end_names_its_row(monkeypatch):
    search = many._isolate_rows
    monkeypatch.setattr(many, "BATCH", 2)
    monkeypatch.setattr(
        many, "_isolate_rows", lambda *args: (*search(*args)[:4], 1 if args[0][1, 0] == 8.0 else -1)
    )
    message = (
        "no friction up to mu_max = 1 can be told apart in row 3 below fmax = 10000 Hz; choose a smaller band"
    )
    with pytest.raises(ArithmeticError, match=message):
        flutter_onsets_many({"theta": [5.0, 6.0, 7.0, 8.0]})
