"""Table 4 and Fig. 6: glued modes, and the pair that locks in."""

import numpy as np
import pytest

from fivcore import Rig, flutter_onsets, sliding_modes
from studies import paper, registry
from studies.answering import summary
from studies.asking.sweep import sweep_of
from studies.gallery import fig6, table4
from sweeps import InputError


def test_the_papers_column_belongs_to_85_mm(computed):
    data = computed("table4")
    np.testing.assert_allclose(data["frequency"], paper.GLUED_NUMERICAL, rtol=2.3e-3)
    away = np.abs(data["frequency_at_text_position"] / data["frequency_paper"] - 1.0)
    assert float(away.max()) == pytest.approx(0.101, abs=1e-3)
    assert float(data["frequency"][0]) == pytest.approx(paper.FIRST_GLUED)
    assert table4.tuned(0.085, 5.0, 16.0).head_mass == pytest.approx(2.9434, abs=1e-4)


def test_a_mode_that_the_paper_does_not_list_has_no_number_of_the_paper(computed):
    data = computed("table4", mode=[8, 9])
    assert float(data["frequency"][1]) == pytest.approx(8237.0, abs=1.0)
    np.testing.assert_array_equal(np.isnan(data["frequency_paper"]), [False, True])


def test_the_pair_locks_in_at_the_onset(computed):
    mu = np.append(np.linspace(0.0, 0.2, 41), [0.111, 0.1115])
    data = computed("fig6", mu=np.unique(mu))
    onset = flutter_onsets(Rig(), 5.0).mu[0]
    assert float(data["lock_in_mu"]) == onset
    np.testing.assert_array_equal(data["mode"], [5, 6])
    np.testing.assert_allclose(data["frequency"].sel(mu=0.0), [2531.0, 3087.0], atol=1.0)
    below = data["mu"].values < onset
    grows = data["growth_rate"].isel(mode=1).values > 0.0
    np.testing.assert_array_equal(grows, ~below)
    # Below the onset two frequencies approach, above they are one.
    apart = np.diff(data["frequency"].values, axis=1)[:, 0]
    assert np.all(np.diff(apart[below]) < 0.0)
    np.testing.assert_allclose(apart[~below], 0.0, atol=3.0)
    modes = sliding_modes(Rig(), 5.0, 0.0)
    np.testing.assert_array_equal(data["frequency"].sel(mu=0.0), modes.frequency[[4, 5]])


def test_the_unstable_shape_is_a_coupled_motion_of_the_tip(computed):
    data = computed("fig6", mu=[0.0, 0.1])
    shape = [data[f"shape_{x}_real"] + 1j * data[f"shape_{x}_imag"] for x in "xy"]
    assert float(np.max(np.abs(shape))) == pytest.approx(1.0)
    tip, under = (int(k) for k in np.flatnonzero(np.hypot(data["node_x"], data["node_y"]) < 1e-9))
    assert data["beam"].values[[tip, under]].tolist() == [1, 2]
    # The contact stays closed.
    assert shape[1][tip] == pytest.approx(complex(shape[1][under]), abs=1e-6)
    assert next(summary.parts(fig6.STUDY, data)).startswith("At θ = 5°")


@pytest.mark.parametrize(
    ("name", "values"),
    [("table4", {"mode": 0}), ("table4", {"mode": 360}), ("fig6", {"theta": -5.0}), ("fig6", {"mu": 5.0})],
)
def test_what_cannot_be_computed_is_refused_before_it_runs(name, values):
    ((key, value),) = values.items()
    with pytest.raises(InputError, match=f"{key} = {value:g}"):
        sweep_of(registry.load(name), values)
