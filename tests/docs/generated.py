"""Tables of the READMEs that the project computes: `python -m tests.docs.generated` writes them.

A table stands between `<!-- benchmarks: PART.TABLE -->`, `<!-- questions -->` or `<!-- claims: STUDY, ... -->` and
`<!-- end -->`.
"""

import re
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from studies import registry
from studies.answering import claims
from studies.cli.options import catalogue
from studies.cli.output import rough_duration
from studies.declaring import labels
from studies.gallery import stribeck
from studies.motion import following
from tests import HOME, make_reference
from tests.benchmarks import tables
from tests.docs import readmes

COMPUTED = re.compile(r"(<!-- (questions|claims)(?:: ([\w, ]+))? -->\n).*?(<!-- end -->)", re.DOTALL)
REFERENCE = HOME / "results" / "reference"
# Columns of the claims, first with the printed damping, then with the identified one, and their heads.
ANSWERS = {"computed": "printed damping", "deviation": "deviation"}
ANSWERS |= {"computed ": "identified damping", "deviation ": "deviation"}


class Question(NamedTuple):
    """A question of a user, the command that answers it, and the answer: a text, or from a study's reference.

    `reference` is the study whose reference answers, if the command runs none; `time` and `figure` are what the
    catalogue does not have.
    """

    text: str
    command: str
    answer: str | Callable[[xr.Dataset], str]
    time: str = ""
    figure: str = ""
    reference: str = ""

    @property
    def study(self) -> str:
        """The study that the command runs, if it is a run."""
        return self.command.split()[2] if self.command.startswith("fiv run") else ""


def onset(data: xr.Dataset) -> str:
    """The lowest onset of flutter."""
    return f"mu = {float(data['onset_mu'][0]):.4g}, at {float(data['onset_frequency'][0]):.4g} Hz"


def tolerances(data: xr.Dataset) -> str:
    """Where 90 % of the rigs begin to flutter."""
    low, high = data["onset_mu"].sel(theta=5.0).quantile([0.05, 0.95]).values
    return f"squeal starts between mu = {low:.3f} and {high:.3f} in 90 % of rigs built to workshop tolerances"


def falling(data: xr.Dataset) -> str:
    """Up to which speed most of the growth rate is due to falling friction."""
    speeds = data["V"].where(stribeck.mostly_falling(data)).max("V")
    low, high = (1e3 * float(speeds.sel(kinetic_ratio=ratio)) for ratio in (0.9, 0.5))
    return (
        f"falling friction, not mode coupling, drives the squeal below {low:.3g} mm/s if friction drops by a"
        f" tenth, and below {high:.3g} mm/s if it drops by half"
    )


def both_stable(data: xr.Dataset) -> str:
    """The interval in which sliding and vibration are both stable."""
    ends = " to ".join(f"{value:.3f} ± {error:.3f}" for value, error, _ in following.interval(data))
    count, loops = int(data["bistable_low"].notnull().sum()), data["bistable_low"].size
    return f"sliding and vibration are both stable from mu = {ends}, in {labels.counted(count, loops, 'loop')}"


def vibrating(data: xr.Dataset) -> str:
    """The share of random knocks that start vibration, far below and just below the onset."""
    shares = (data["vibration_share"].squeeze().sel(mu=mu, method="nearest") for mu in (0.095, 0.101, 0.109))
    found = [f"{100.0 * float(share):.0f} % at mu = {float(share['mu']):.3f}" for share in shares]
    largest = 1e3 * float(np.nanmax(np.abs(data["start_knock"])))
    return f"of knocks up to {largest:.1f} mN s: {', '.join(found)}"


def least_knock(data: xr.Dataset) -> str:
    """The smallest knock that starts vibration, far below and just below the onset."""
    least = (data["knock_threshold"].squeeze().sel(mu=mu, method="nearest") for mu in (0.093, 0.101, 0.109))
    return ", ".join(f"{1e3 * float(each):.2g} mN s at mu = {float(each['mu']):.3f}" for each in least)


def between(data: xr.Dataset) -> str:
    """The unstable cycles of the least damping: from where to where, and their frequency."""
    point = data.isel(d2=0)
    chosen = (point["cycle_multiplier"] >= 1.0).values
    value, hertz = (point[f"cycle_{name}"].values[chosen] for name in ("value", "frequency"))
    fold = f"{point['place_text'][0].item()} at {float(point['place_value'][0]):.4f}"
    ends = " to ".join(f"{end:.0f}" for end in (hertz.min(), hertz.max()))
    return f"an unstable period of {ends} Hz, found from mu = {value.max():.3f} down to a {fold}"


QUESTIONS = (
    Question("1. Where does my rig begin to squeal?", "fiv run fig5 --set p1_length=50mm", onset),
    Question(
        "2. Which load is the loudest, with error bars?",
        "fiv map --x F=2:30:8 --quantity velocity_rms --fix V=2mm/s --fix mu=0.2 --fix members=4",
        "18 to 22 N: velocity of B 9.5 ± 0.2 mm/s RMS",
        time="about 13 s",
        figure="`results/map/`",
    ),
    Question("3. What if my numbers are uncertain?", "fiv run robust", tolerances),
    Question(
        "4. What do my own matrices or modes do?",
        "fiv structure pin.toml",
        "[own structures](studies/README.md#own-structures): modes, preload, damping, onsets",
        time="about 1 s",
        figure="`results/structure/`",
    ),
    Question("5. What if friction falls with the speed?", "fiv run stribeck", falling),
    Question(
        "6. Where are sliding and vibration both stable (hysteresis)?",
        "fiv run hysteresis",
        both_stable,
    ),
    Question("6. Which limit cycle is between the two?", "fiv run cycles", between),
    Question("6. Which fraction of all starts vibrates there?", "fiv run basins", vibrating),
    Question(
        "6. How strong a knock starts the vibration?",
        "fiv map --x mu=0.088:0.11:23 --quantity knock_threshold --fix V=2mm/s",
        least_knock,
        time="about 35 s",
        figure="[figure](results/reference/front.png)",
        reference="basins",
    ),
)


def questions_table(_: str) -> str:
    """What a user asks, with the command, its time, its answer and its figure, as Markdown."""
    rows = []
    for each in QUESTIONS:
        name = each.reference or each.study
        known = catalogue().get(each.study)
        answer, figure = each.answer, each.figure or f"[figure](results/reference/{name}/{name}.png)"
        if callable(answer):
            with xr.open_dataset(REFERENCE / name / f"{name}.nc") as data:
                answer = answer(data)
        time = rough_duration(known["seconds"]) if known else each.time
        rows.append([each.text, f"`{each.command}`", time, answer, figure])
    return tables.lines(["question", "command", "time", "answer", "figure"], rows)


def claims_table(names: str) -> str:
    """Claims of the paper beside the reference with the printed and with the identified damping, as Markdown."""
    parts = []
    for name in names.split(", "):
        keys, found = ["quantity", "at", "paper", "section"], list[pd.DataFrame]()
        for folder in (REFERENCE, REFERENCE / make_reference.IDENTIFIED):
            with xr.open_dataset(folder / name / f"{name}.nc") as data:
                found.append(claims.beside(data, registry.load(name).claims))
        parts.append(found[0].merge(found[1], on=keys, how="left", suffixes=("", " ")).assign(study=f"`{name}`"))
    table = pd.concat(parts)[["quantity", "at", "paper", *ANSWERS, "section", "study"]]
    return tables.lines(list(table.rename(columns=ANSWERS).columns), table.astype(str).values.tolist())


def rendered(text: str) -> str:
    """A README with the tables of today."""
    made = {"claims": claims_table, "questions": questions_table}
    text = COMPUTED.sub(lambda found: found[1] + made[found[2]](found[3]) + found[4], text)
    return tables.rendered(text, tables.load())


if __name__ == "__main__":
    for name in readmes.NAMES:
        (HOME / name).write_text(rendered((HOME / name).read_text(encoding="utf-8")), encoding="utf-8")
