"""Figures: what is drawn of the kept results is the picture that is kept beside them."""

import numpy as np
import pytest
from matplotlib.testing.compare import compare_images

import sweeps
from studies import registry, runner
from tests import HOME

# Root mean square over the pixels, of 255: another Matplotlib may draw letters otherwise; a line that is missing
# makes more (`test_a_line_that_is_missing_shows`).
TOLERANCE = 1.0
KEPT = HOME / "results" / "reference"


def drawn(name, folder, alter=lambda dataset: dataset):
    dataset = alter(sweeps.open_results(KEPT / name / f"{name}.nc"))
    return runner.plot(registry.load(name), dataset, folder / f"{name}.nc")


@pytest.mark.parametrize("name", registry.NAMES)
def test_every_kept_figure_is_drawn_again(name, tmp_path):
    kept = KEPT / name / f"{name}.png"
    assert compare_images(str(kept), str(drawn(name, tmp_path)), TOLERANCE) is None


def test_a_line_that_is_missing_shows(tmp_path):
    def without_a_mode(dataset):
        return dataset.assign(frequency=dataset["frequency"].where(dataset["mode"] != 4, np.nan))

    figure = drawn("fig5", tmp_path, without_a_mode)
    assert compare_images(str(KEPT / "fig5" / "fig5.png"), str(figure), TOLERANCE) is not None
