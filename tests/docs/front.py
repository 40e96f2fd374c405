"""The picture at the head of the README: the rig, where its sliding is unstable, and the knock that starts squeal.

``python -m tests.docs.front`` draws it from the reference of `stability` and a map of the knock threshold,
which it computes.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

import studies
from studies.answering.results import REFERENCE
from studies.plotting import figures, planes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

THETA, V = 5.0, 2e-3


def front(stability: xr.Dataset, knocks: xr.Dataset) -> Figure:
    """The figure from results of `stability` over (theta, mu) and of a map of `knock_threshold` along mu."""
    figure, panels = figures.panels(1, 3, 6.0, width_ratios=(1.25, 1.15, 1.0))
    draw_rig(panels[0])
    plane = panels[1]
    growth = stability["growth_rate"].where(stability["growth_rate"] > 0.0)
    mesh = planes.cells(plane, growth, "theta", "mu")
    figure.colorbar(mesh, ax=plane, label="growth rate / (1/s)")
    mu = knocks["mu"].values
    plane.plot([THETA, THETA], [mu[0], mu[-1]], color=figures.RED, linewidth=4.0, label="(c)")
    plane.legend(loc="lower right")
    axes = panels[2]
    threshold, error = (1e3 * knocks[f"knock_threshold{end}"].values for end in ("", "_se"))
    axes.errorbar(mu, threshold, error, color=figures.RED, marker="o", markersize=3.0)
    low = mu[np.isfinite(threshold)].min()
    onset = float(stability["onset_mu"].sel(theta=THETA, method="nearest").min())
    axes.axvline(onset, color=figures.BLACK, linestyle="--")
    axes.set(yscale="log", xlim=(mu[0], onset + 0.004), xlabel="μ", ylabel="knock on P1 / (mN s)")
    bottom, top = axes.get_ylim()
    for x, text in ((0.5 * (mu[0] + low), "sliding"), (onset + 0.002, "squeal")):
        axes.text(x, np.sqrt(bottom * top), text, rotation=90.0, ha="center", va="center")
    axes.text(0.5 * (low + onset), 0.7 * top, "a stronger knock\nstarts squeal", ha="center", va="top")
    figures.entitle(panels, ("the rig", "unstable sliding", f"θ = {THETA:g}°, V = {1e3 * V:g} mm/s"))
    return figures.finish(figure)


def draw_rig(axes: Any) -> None:
    """Beam P1 on beam P2, in mm, with more inclination than it has."""
    angle, length = np.radians(12.0), 50.0
    up = length * np.array([np.sin(angle), np.cos(angle)])
    axes.add_patch(_box((-75.0, -4.0), 150.0, 4.0, "#9db7d5"))
    axes.add_patch(_box((-87.0, -10.0), 12.0, 16.0, "#bbbbbb"))
    axes.plot([0.0, up[0]], [0.0, up[1]], color="black", linewidth=6.0, solid_capstyle="butt")
    axes.plot([0.0, up[0]], [0.0, up[1]], color="#e3b878", linewidth=4.0, solid_capstyle="butt")
    axes.plot([0.0, 0.0], [0.0, length], color=figures.GREY, linestyle=":")
    axes.add_patch(_box((up[0] - 9.0, up[1]), 18.0, 12.0, "#dddddd"))
    arrow = {"arrowstyle": "-|>", "color": figures.RED, "linewidth": 1.6}
    axes.annotate("", (up[0], up[1] + 13.0), (up[0], up[1] + 32.0), arrowprops=arrow)
    axes.annotate("", (-50.0, 14.0), (-85.0, 14.0), arrowprops=arrow)
    axes.annotate("", (16.0, 2.0), (16.0, 30.0), arrowprops=arrow)
    notes = ((up[0] + 4.0, up[1] + 20.0, "F"), (-85.0, 18.0, "V"), (1.6, 38.0, "θ"), (up[0] + 5.0, 36.0, "P1"))
    for x, y, text in (*notes, (60.0, 2.0, "P2"), (19.0, 14.0, "knock on P1"), (-2.0, -14.0, "C")):
        axes.text(x, y, text)
    axes.set(xlim=(-90.0, 80.0), ylim=(-25.0, 85.0), aspect="equal")
    axes.axis("off")


def _box(corner: tuple[float, float], width: float, height: float, colour: str) -> Any:
    from matplotlib.patches import Rectangle

    return Rectangle(corner, width, height, facecolor=colour, edgecolor="black", linewidth=0.8)


def main() -> None:
    """Draw the picture into the folder of the reference."""
    with TemporaryDirectory() as folder, figures.style(width="220mm"):
        knocks = studies.map(
            x="mu=0.088:0.11:23", quantity="knock_threshold", fix={"V": V, "theta": THETA}, out=folder
        )
        figure = front(studies.open(Path("results") / REFERENCE / "stability" / "stability.nc"), knocks)
        image = figures.saved(figure, "png", figures.data_digest(knocks))
        (Path("results") / REFERENCE / "front.png").write_bytes(image)


if __name__ == "__main__":
    main()
