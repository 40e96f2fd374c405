"""Figure of a structure's receptances at its contact, and of its largest growth rate over friction."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from fivcore import followed_modes
from studies.plotting import figures
from studies.plotting.modes import mark_divergence, mark_recoveries

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from fivcore import FlutterOnsets, Structure

POINTS, FRICTIONS = 4000, 101


def draw(
    structure: Structure, fmax: float, mu_max: float, onsets: FlutterOnsets | None, load: float = 1.0
) -> Figure:
    """|h_NN|, |h_NT|, |h_TT| over frequency up to `fmax`, Hz, and the largest growth rate over friction.

    With several contacts the receptances are those of the contact with the largest force under the load, N.
    """
    figure, (left, right) = figures.panels(1, 2, 7.5)
    elastic = structure.frequency[(structure.frequency > 0.0) & (structure.frequency < fmax)]
    low = 0.3 * min(elastic.min(initial=fmax), 0.1 * fmax)
    # Peaks are narrower than any even spacing.
    frequency = np.union1d(np.geomspace(low, fmax, POINTS), elastic)
    contact = int(np.argmax(structure.equilibrium(load)[0])) if structure.several else 0
    normal, cross = structure.receptances(frequency, contact=contact)
    tangential = structure.receptances(frequency, 1.0, contact)[1] - cross
    curves = {"h_NN": normal, "h_NT": cross, "h_TT": tangential}
    for (name, values), colour, style in zip(
        curves.items(), (figures.BLUE, figures.ORANGE, figures.BLACK), ("-", "-", "--"), strict=True
    ):
        if np.any(values):
            left.loglog(frequency, np.abs(values), style, color=colour, linewidth=0.9, label=f"|{name}|")
    left.set(xlabel="frequency / Hz", ylabel="receptance / (m/N)", xlim=(low, fmax))
    figures.one_two_five(left.xaxis)
    mu = np.linspace(0.0, mu_max, FRICTIONS)
    growth = followed_modes(structure, 0.0, mu, fmax, F=load).growth_rate
    right.plot(mu, growth, color=figures.BLACK)
    right.plot(mu, np.where(growth > 0.0, growth, np.nan), color=figures.RED, linewidth=2.0)
    right.axhline(0.0, color=figures.GREY, linewidth=0.8)
    if onsets is not None:
        if len(onsets.mu):
            right.plot(onsets.mu, 0.0 * onsets.mu, "o", color=figures.BLUE, label="flutter onset")
        mark_recoveries(right, onsets.recovery_mu, 0.0 * onsets.recovery_mu)
        mark_divergence([right], onsets.divergence_mu)
    right.set(xlabel="coefficient of friction μ", ylabel="growth rate / (1/s)")
    where = f"receptances at contact {contact}" if structure.several else "receptances at the contact"
    figures.entitle((left, right), (where, "modes of steady sliding"))
    figures.legend_below(figure, (left, right), 3)
    figure.suptitle(repr(structure))
    return figures.finish(figure)
