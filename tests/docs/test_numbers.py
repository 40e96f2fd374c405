"""Numbers that the READMEs take from results are those of the reference."""

from functools import cache

import numpy as np
import pytest
import xarray as xr

import studies
from studies import paper
from studies.accuracy.findings import GROUPS, right, table
from studies.tables import number
from tests import HOME
from tests.benchmarks import damping
from tests.docs import readmes


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


def robust():
    at = kept("robust").sel(theta=5.0)
    low, high = np.quantile(at["onset_mu"], [0.05, 0.95])
    yield f"flutter between mu = {low:.4f} and {high:.4f}"
    yield f"the nominal rig does at {float(at['nominal_onset_mu']):.4f}"
    share, *ends = (100.0 * float(at[f"probability_{end}"].sel(mu=0.1)) for end in ("unstable", "low", "high"))
    yield f"At mu = 0.1 already {share:.1f} % are unstable ({ends[0]:.1f} to {ends[1]:.1f} %, Wilson's"
    total = at["sobol_total"].to_series().sort_values(ascending=False)
    assert set(total.index[:2]) == {"p1_young_modulus", "p2_young_modulus"}
    assert total.index[2] == "p1_thickness"
    assert total[["head_mass", "d1", "d2"]].max() < 0.005
    first, second, third = (f"{value:.2f}" for value in total[:3])
    yield f"(total Sobol indices {first} and {second}), then P1's thickness ({third})"
    data = kept("robust")
    wrong = 100.0 * float(data["probability_unstable"].values[data["nominal_unstable"].values == 0].mean())
    yield f"plane {wrong:.1f} % of the rigs are unstable where the nominal one is stable"


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


def words(data):
    """Regimes of a result, in words, in its order."""
    meanings = data["regime"].attrs["flag_meanings"].split()
    return [meanings[int(code)].replace("_", " ") for code in data["regime"].values]


def listed(values, form=".0f"):
    """Numbers in a cell of a table."""
    return ", ".join(f"{float(value):{form}}" for value in values)


def beside_the_paper():
    """Cells of the first README's table: quantity, the paper's, ours, study."""
    glued, data = paper.GLUED_NUMERICAL, kept("table4")
    worst = 100.0 * float(np.abs(data["frequency"] / data["frequency_paper"] - 1.0).max())
    theirs, ours = f"{glued[0]:.0f} to {glued[-1]:.0f} Hz", f"within {worst:.2f} %, contact at 85 mm"
    yield f"{len(glued)} natural frequencies, glued", theirs, ours, "table4"
    data = kept("fig5")
    onsets = zip(data["onset_mu"].values, data["onset_frequency"].values, strict=True)
    for (mu, frequency), (own_mu, own) in zip(paper.ONSETS, onsets, strict=True):
        theirs, ours = f"mu = {mu:g}, {frequency:.0f} Hz", f"mu = {own_mu:.4f}, {own:.0f} Hz"
        yield "onset of instability (paper: steps of 0.01)", theirs, ours, "fig5"
    at = data.sel(mu=paper.MU)
    theirs, own = paper.ANGLES_UNSTABLE[paper.THETA], at["frequency"].values[at["growth_rate"].values > 0.0]
    yield "frequencies of the unstable modes", f"{listed(theirs)} Hz", f"{listed(own)} Hz", "fig5"
    data, speeds = kept("fig7").sel(V=list(paper.SPEEDS)), listed((1e3 * V for V in paper.SPEEDS), "g")
    theirs, ours = f"{paper.SIMULATED_LINE:.0f} Hz", f"{listed(data['dominant_frequency'].values)} Hz"
    yield f"dominant frequency at V = {speeds} mm/s", theirs, ours, "fig7"
    theirs = ", ".join(paper.VIBRATION[V] for V in paper.SPEEDS)
    yield "vibration at these speeds", theirs, ", ".join(words(data)), "fig7"
    data = kept("stick_time").sel(mu=paper.MU, F=paper.LOAD)
    slow, fast = (f"{1e3 * V:g} mm/s" for V in sorted(paper.STICK_RATIO_SPEEDS))
    theirs, ours = f"{paper.STICK_RATIO:g}", f"{float(data['start_up_ratio']):.3f}"
    yield f"duration of sticks, {fast} over {slow}", theirs, ours, "stick_time"
    yield "n in duration ~ V^n", "-1", f"{float(data['exponent'][0]):.2f}", "stick_time"
    data, peaks = kept("contact"), sorted(paper.CONTACT_PEAKS.items())
    speeds = listed((1e3 * V for V, _ in peaks), "g")
    kinds = (("normal force", "normal_force_999", "N", 1.0), ("slip speed", "slip_speed_999", "mm/s", 1e3))
    for k, (what, name, unit, scale) in enumerate(kinds):
        theirs = listed(scale * values[k] for _, values in peaks)
        ours = listed(scale * data[name].sel(V=V) for V, _ in peaks)
        yield f"{what}, 99.9 % quantile, at V = {speeds} mm/s", f"{theirs} {unit}", f"{ours} {unit}", "contact"
    data = kept("fig11")
    (at, measured), (steady, none) = paper.ANGLES.items()
    assert np.isnan(none)
    vibrating, quiet = words(data.sel(theta=[at, steady]))
    ours = f"{vibrating}, {float(data['dominant_frequency'].sel(theta=at)):.0f} Hz"
    yield f"vibration at theta = {at:g} degrees, 2 mm/s", f"{measured:.0f} Hz", ours, "fig11"
    data, ((_, below), (above, _)) = kept("table6"), paper.STEADY_ANGLES
    outside = data.sel(theta=(data["theta"] < below) | (data["theta"] > above))
    (ours,) = {quiet, *words(outside)}
    what = f"the same at {steady:g}, above {above:g} and below {below:g} degrees"
    yield what, "steady sliding", ours, "table6"


def rows_of(head):
    """Rows of a table of the first README, without its head."""
    _, found, rest = readmes.TEXTS["README.md"].partition(f"\n{head}\n")
    assert found
    rows = rest.partition("\n\n")[0].splitlines()[1:]
    return [tuple(cell.strip() for cell in row.strip("|").split("|")) for row in rows]


def transients():
    """The published scheme's column of the paper's transients."""
    for name in damping.STUDIES:
        file = studies.open(HOME / "results" / "reference" / name / f"{name}.nc")
        for (figure, place), (value, found, _) in damping.beside_the_paper(name, file).items():
            yield f"| `{name}`: {figure} | {place} | {value} | {found} |".replace("|  |", "| |")


# Rows of the table of defaults, as it calls them.
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
    """Its rows; ``python -c "from tests.docs.test_numbers import *; print(*accuracy(), sep='\\n')"``."""
    rows = table(kept("accuracy")).set_index(["method", "setting"])
    groups = [f"{name}, {what}" for name in GROUPS for what in ("error", "right at")]
    yield f"| setting | s per s | until known, s | `paper` / it | {' | '.join(groups)} |"
    yield "| --- " * (4 + len(groups)) + "|"
    for at, name in DEFAULTS.items():
        row = rows.loc[at]
        cells = [number(row["cost"], ".3g"), number(row["time"], ".2g"), number(row["ratio"], ".4g")]
        for group in GROUPS:
            cells += [number(row[f"mismatch {group}"], ".2f"), right(row, group)]
        yield f"| {name} | {' | '.join(cells)} |"


SENTENCES = [table4, fig5, fig7, table6, stability, sensitivity, robust, stick_time, accuracy, stress, transients]


@pytest.mark.parametrize("sentences", SENTENCES)
def test_the_readmes_say_what_the_reference_holds(sentences):
    missing = [sentence for sentence in sentences() if sentence not in readmes.LINE]
    assert not missing


def test_the_first_readme_puts_the_papers_numbers_beside_ours():
    rows = rows_of("| quantity | the paper | fiv | study |")
    assert rows == [(*cells, f"`{study}`") for *cells, study in beside_the_paper()]
