"""The figure of who sticks, slips and is open: no switch is lost, and few or many contacts have their rows."""

import numpy as np
import pytest
import xarray as xr

from studies.plotting import contacts, figures

NAMES = "separation", "stick", "slip"


def recorded(state):
    """A result with one point and this state, (contacts, samples)."""
    data = xr.Dataset(
        {"status": ("mu", [1]), "contact_state": (("mu", "elapsed", "contact"), state.T[None].astype(np.int8))},
        coords={"mu": ("mu", [0.2], {"units": "1"}), "elapsed": np.arange(state.shape[1]) / 50e3},
    )
    shares = {f"contact_{name}_fraction": (state == k).mean(axis=1)[None] for k, name in enumerate(NAMES)}
    return data.assign({name: (("mu", "contact"), share) for name, share in shares.items()})


@pytest.mark.parametrize(("count", "samples"), [(2, 1), (5, 7), (20, 60_001)])
def test_the_mean_colour_of_a_contact_is_that_of_its_shares_of_time(count, samples):
    state = np.random.default_rng(0).integers(0, 3, (count, samples))
    with figures.style():
        figure = contacts.draw(recorded(state))
        figure.draw_without_rendering()
    mesh = figure.axes[0].collections[0]
    colours = mesh.get_array().reshape(count, -1, 3)
    widths = np.diff(mesh.get_coordinates()[0, :, 0])
    assert len(widths) <= contacts.WIDE
    from matplotlib.colors import to_rgb

    expected = np.array([to_rgb(colour) for colour in contacts.COLOURS])[state].mean(axis=1)
    np.testing.assert_allclose((colours * widths[:, None]).sum(axis=1) / widths.sum(), expected, rtol=1e-6)
