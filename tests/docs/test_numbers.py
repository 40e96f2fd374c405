"""Numbers that the README takes from results are those of the reference."""

from functools import cache

import numpy as np
import pytest
import xarray as xr

from studies.accuracy.findings import GROUPS, right, table
from studies.tables import number
from tests import HOME

README = " ".join((HOME / "README.md").read_text().split())


@cache
def kept(name):
    with xr.open_dataset(HOME / "results" / "reference" / name / f"{name}.nc") as file:
        return file.load()


def table4():
    data = kept("table4")
    found, text = (
        100.0 * float(np.abs(data[name] / data["frequency_paper"] - 1.0).max())
        for name in ("frequency", "frequency_at_text_position")
    )
    yield f"85 mm gives all eight frequencies within {found:.2f} % of its numerical column; 80 mm misses by up to "
    yield f"misses by up to {text:.0f} %."


def fig5():
    data = kept("fig5")
    pairs = zip(data["onset_mu"].values, data["onset_frequency"].values, strict=True)
    first, second, third = (f"{mu:.4f} ({frequency:.0f} Hz)" for mu, frequency in pairs)
    yield f"the onsets are {first}, {second} and {third}"


def fig7():
    data = kept("fig7")
    yield f"{float(data['dominant_frequency'].sel(V=1e-3)):.0f} in that of `results/reference/fig7`"
    apart = 1e3 * (data["first_separation_time"] - data["first_slip_time"])
    slow, faster = (float(apart.sel(V=V)) for V in (1e-3, 2e-3))
    yield f"{slow:.1f} ms after the first slip at 1 mm/s and {faster:.1f} ms at 2 mm/s"


def table6():
    data = kept("table6").sortby("window_frequency_from", ascending=False)
    (a, b), (c, d) = zip(data["window_from"].values, data["window_to"].values, strict=True)
    yield f"2.8 kHz is unstable from {a:.2f} to {b:.2f} degrees, that near 400 Hz from {c:.2f} to {d:.2f}"


def stability():
    lowest = kept("stability")["onset_mu"].to_series().dropna()
    yield f"The lowest onset is mu = {lowest.min():.4f}, at {lowest.idxmin():.1f} degrees"


def sensitivity():
    at = kept("sensitivity").sel(theta=5.0, pair=1)
    say, again = at["elasticity_mu"], 100.0 * at["change_mu"] / at["onset_mu"]
    (p2, p1), (more, less) = (each.sel(parameter=["p2_length", "p1_length"]).values for each in (say, again))
    yield f"raises the paper's lowest onset by {p2:.1f} %, on P1's lowers it by {-p1:.1f} %; solved again"
    yield f"(`fiv run sensitivity`) by {more:.1f} % and {-less:.1f} %."
    yield f"1 % of an elastic modulus moves it by {float(say.sel(parameter='p1_young_modulus')):.1f} %"


def stick_time():
    data = kept("stick_time")
    ends = data["intermittence_end"] / (data["mu"] * data["F"]) * 1e3
    own = data.sel(mu=0.2, F=9.0)
    low, ratio, high = (float(own[f"start_up_ratio{end}"]) for end in ("_low", "", "_high"))
    yield f"they last {ratio:.3f} ({low:.3f} to {high:.3f}) times as long"
    laws = [[float(own[f"exponent{end}"][k]) for end in ("", "_low", "_high")] for k in range(3)]
    yield "an exponent of {:.2f} ({:.2f} to {:.2f})".format(*laws[0])
    yield f"over all speeds the exponent is {laws[1][0]:.2f}"
    yield "(exponent {:.3f}, {:.3f} to {:.3f})".format(*laws[2])
    yield f"They end at {1e3 * float(own['intermittence_end']):.2f} mm/s"
    (a, _), (b, c), (d, _) = ((float(row.min()), float(row.max())) for row in ends)
    yield f"ends at V / (mu F) = {a:.2f}, {b:.2f} to {c:.2f} and {d:.2f} mm/s/N"


def stress():
    yield f"tries to break each method {kept('stress').sizes['case']} times"


# Rows of the README's table of defaults, as it calls them.
DEFAULTS = {
    ("fast", "default"): "`fast` by default: the model as given",
    ("fast", "converged"): "`fast`, converged: the reference of the model",
    ("fast", "numerical damping published"): '`fast` with `numerical_damping="published"`',
    ("fast", "step 0.25"): "step 0.25 of the limit",
    ("fast", "step 0.5"): "step 0.5 of the limit",
    ("fast", "step 0.98"): "step 0.98 of the limit",
    ("fast", "cut-off 0.4"): "cut-off 0.4 of the default's",
    ("fast", "cut-off 0.64"): "cut-off 0.64 of it: 75 kHz with the paper's rig",
    ("fast", "cut-off 0.8"): "cut-off 0.8 of it",
    ("fast", "cut-off 1.4"): "cut-off 1.4 of it",
    ("fast", "cut-off 2"): "cut-off 2 of it",
    ("fast", "damping 0.333"): "a third of the element's damping",
    ("fast", "damping 3"): "three times its damping",
    ("fast", "termination elastic"): "elastic element",
    ("fast", "termination none"): "no element",
    ("fast", "truncation 2"): "no element, twice the cut-off",
    ("fast", "pseudo-modes bandwidth"): "pseudo-modes damped by their bands' widths",
    ("fast", "pseudo-modes 0.02"): "pseudo-modes with 0.02 of critical damping",
    ("fast", "cross terms off"): "no cross terms",
    ("exact", "default"): "`exact`",
    ("paper", "default"): "`paper`: the published scheme",
    ("paper", "numerical damping none"): "`paper` without its numerical damping, half its step",
    ("SciPy solve_ivp", "default"): "SciPy's `solve_ivp` with events",
}


def accuracy():
    """The README's table; ``python -c "from tests.docs.test_numbers import *; print(*accuracy(), sep='\\n')"``."""
    rows = table(kept("accuracy")).set_index(["method", "setting"])
    groups = [f"{name}, {what}" for name in GROUPS for what in ("error", "right at")]
    yield f"| setting | s per s | until known, s | `paper` / it | {' | '.join(groups)} |"
    yield "| --- " * (4 + len(groups)) + "|"
    for at, name in DEFAULTS.items():
        row = rows.loc[at]
        cells = [number(row["cost"], ".3g"), number(row["known"], ".2g"), number(row["ratio"], ".4g")]
        for group in GROUPS:
            cells += [number(row[f"mismatch {group}"], ".2f"), right(row, group)]
        yield f"| {name} | {' | '.join(cells)} |"


@pytest.mark.parametrize(
    "sentences", [table4, fig5, fig7, table6, stability, sensitivity, stick_time, accuracy, stress]
)
def test_the_readme_says_what_the_reference_holds(sentences):
    missing = [sentence for sentence in sentences() if sentence not in README]
    assert not missing
