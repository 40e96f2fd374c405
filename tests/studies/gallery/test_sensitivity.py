"""Sensitivity of the flutter onsets: real changes, pairs over theta, what units demand, and the words."""

import re
from functools import partial

import numpy as np
import pytest

from fivcore import Rig, flutter_onsets, onset_curves
from studies import paper
from studies.gallery.sensitivity import findings
from studies.gallery.sensitivity.study import PARAMETERS, STUDY, larger
from studies.plotting import figures
from studies.rig import rig_of
from tests.helpers.rigs import workshop_rig

ANGLES = [-5.0, 0.0, 0.5, 1.0, 3.0, 5.0, 8.0, 15.0]


@pytest.fixture(scope="module")
def computed(computed):
    return partial(computed, "sensitivity")


@pytest.fixture(scope="module")
def whole(computed):
    return computed(theta=ANGLES)


@pytest.mark.parametrize("parameter", PARAMETERS)
def test_derivatives_and_changes_are_those_of_rigs_set_number_by_number(whole, parameter):
    theta, step = 8.0, 1e-5
    settings = {name: each.value for name, each in STUDY.settings.items()} | {"theta": theta}
    start, low, high, one = (
        flutter_onsets(*rig_of(settings | {parameter: settings[parameter] * (1.0 + each)}))
        for each in (0.0, -step, step, 0.01)
    )
    at = whole.sel(theta=theta, parameter=parameter)
    for name in ("mu", "frequency"):
        first, less, more, new = (getattr(each, name)[:3] for each in (start, low, high, one))
        np.testing.assert_array_equal(at[f"onset_{name}"], first)
        slope = (more - less) / (2.0 * step * first)
        np.testing.assert_allclose(at[f"elasticity_{name}"], slope, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(at[f"change_{name}"] / first, new / first - 1.0, rtol=1e-7, atol=1e-9)


def test_pairs_are_branches_of_onsets_and_never_change_places(whole):
    """Without tan(theta) > 0 there is none; at half a degree the third has its onset above mu_max."""
    curves = onset_curves(Rig(), ANGLES)
    at = ANGLES.index(paper.THETA)
    own = [int(np.flatnonzero(curves.mu[at] == mu)[0]) for mu in np.sort(curves.mu[at])[:3]]
    for name in ("mu", "frequency"):
        held = whole[f"onset_{name}"].transpose("parameter", "theta", "pair").values
        np.testing.assert_array_equal(held, np.broadcast_to(getattr(curves, name)[:, own], held.shape))
    np.testing.assert_allclose(whole["onset_frequency"].max(["theta", "parameter"]), [2802, 398, 7705], atol=0.5)
    known = np.isfinite(whole["elasticity_mu"].values).all(axis=1)
    np.testing.assert_array_equal(known.sum(axis=1), [0, 0, 2, 3, 3, 3, 3, 3])
    assert not whole["fold"].any()


def test_pairs_are_numbered_where_one_says_up_to_mu_max(computed, whole):
    """At 1.5 degrees their order is still that at 5; at 15 all are above mu_max."""
    data = computed(theta=[5.0], parameter=["p2_length"], pairs_theta=1.5)
    np.testing.assert_array_equal(data["onset_mu"].squeeze(), whole["onset_mu"].sel(theta=5.0)[0])
    assert computed(theta=[5.0], parameter=["theta"], pairs_theta=15.0, mu_max=0.2)["onset_mu"].isnull().all()


def test_onsets_obey_units_on_any_rig_and_a_wrong_elasticity_shows(whole, computed):
    rig = workshop_rig(3)
    numbers = {f"{p}_{n}": getattr(beam, n) for p, beam in (("p1", rig.p1), ("p2", rig.p2)) for n in vars(beam)}
    numbers |= {name: getattr(rig, name) for name in ("contact_position", "head_mass", "d1", "d2")}
    other = computed(theta=[6.0, 9.0], pairs_theta=9.0, **numbers)
    assert np.isfinite(other["elasticity_mu"]).any()
    assert max(map(findings.residual, (whole, other))) < 1e-10
    wrong = whole.copy(deep=True)
    wrong["elasticity_mu"].loc[{"theta": 5.0, "pair": 2, "parameter": "head_mass"}] *= 1.001
    assert findings.residual(wrong) > 1e-8


def test_numbers_move_what_an_onset_has_above_tan_theta(whole, computed):
    """Under a heavy head by one share at every inclination; theta where mu is not least."""
    heavy = computed(theta=[2.0, 5.0, 20.0], head_mass=1e9)
    excess = findings.excess_elasticity(heavy)
    assert float(abs(excess.sel(theta=2.0)).max()) > 60.0
    np.testing.assert_allclose(excess.sel(theta=[2.0, 20.0]), excess.sel(theta=[5.0, 5.0]), rtol=1e-5, atol=1e-5)
    curve = onset_curves(Rig(), [2.0, 4.0]).onsets
    (lowest,) = (each.lowest for each in curve if abs(each.lowest[2] - 2802.0) < 1.0)
    at = computed(theta=[lowest[0]], parameter=["theta"])["elasticity_mu"].squeeze()
    assert abs(float(at[0])) < 1e-6


def test_the_words_name_the_numbers_that_matter(whole):
    text = STUDY.report(whole)
    for pair, frequency in ((1, 2802), (2, 398), (3, 7705)):
        size = np.abs(whole["elasticity_mu"].sel(theta=5.0, pair=pair).values)
        said = re.search(rf"^{frequency} Hz, onset at .*\n((?:  .*\n){{3}})", text, re.MULTILINE)[1].splitlines()
        for k, line in zip(np.argsort(-size), said, strict=False):
            assert line.startswith(f"  {findings.named(PARAMETERS[k])}: mu ")
            new = flutter_onsets(*larger(Rig(), 5.0, PARAMETERS[k])).mu
            assert any(f" to {mu:.4f} (" in line for mu in new)
    for words in (
        "with the sizes of their elasticities of mu: length of P2 (8.57 to 41.6), length of P1 (",
        "\nHardly matter (elasticities of mu below 0.1): head mass, d1, d2.\n",
        "\n1 % of a number changes mu by 0.85 to 1.24 times what its derivative says (",
        "\n2802 Hz: over theta mu is least between 1 and 3 degrees.\n",
        "that of mu - tan(theta) 20 to 20.2.\n",
    ):
        assert words in text


@pytest.mark.parametrize(
    ("given", "said", "drawn"),
    [
        ({"theta": [-5.0]}, "No onset has derivatives at theta = -5 degrees.", "pair 1: no onset"),
        ({"theta": [5.0], "parameter": ["theta"]}, "theta: mu rises to", "2802 Hz, onset at μ = 0.1112"),
        ({"theta": [3.0, 9.0], "head_mass": 0.0, "d1": 0.0}, "head mass", "Hz, onset at μ = "),
        (
            {"theta": [5.0], "contact_position": 0.15, "parameter": ["contact_position"]},
            "no onset",
            "Hz, onset at",
        ),
    ],
)
def test_any_range_has_words_and_a_figure(computed, given, said, drawn):
    data = computed(**given)
    assert np.all(data["status"] == 1)
    assert said in STUDY.report(data)
    with figures.style():
        figure = STUDY.draw(data)
        assert any(drawn in axes.get_title() for axes in figure.axes)
        figure.canvas.draw()
