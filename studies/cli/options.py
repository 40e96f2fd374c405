"""Arguments and options that commands share. No heavy package is imported, so that `fiv --help` is fast."""

from __future__ import annotations

import json
import os
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import click
from click import option

CATALOGUE = Path(__file__).parents[1] / "catalogue.json"


def catalogue() -> dict[str, dict[str, Any]]:
    """Title, question, points and seconds of each predefined study; of installed ones only the name."""
    known: dict[str, dict[str, Any]] = json.loads(CATALOGUE.read_text(encoding="utf-8"))
    installed = sorted(point.name for point in entry_points(group="fiv.studies"))
    return known | {name: {} for name in installed if name not in known}


def _studies(context: click.Context, argument: click.Parameter, incomplete: str) -> list[str]:
    return [name for name in {**catalogue(), **dict.fromkeys(result_names())} if name.startswith(incomplete)]


def result_names(out: str | None = None) -> list[str]:
    """Names of results in the results folder, by file names only."""
    return sorted({path.name.partition(".nc")[0] for path in _folder(out).glob("*/[!.]*.nc*")})


def rig_names(out: str | None = None) -> list[str]:
    """Names of the rigs with a folder there: those with a rig file, and the paper's."""
    folder = _folder(out)
    return sorted({path.parent.name for path in (*folder.glob("*/rig.toml"), *folder.glob("paper/*/[!.]*.nc"))})


def _folder(out: str | None) -> Path:
    return Path(out or os.environ.get("FIV_RESULTS") or "results").expanduser()


def _rigs(context: click.Context, argument: click.Parameter, incomplete: str) -> list[str]:
    return [name for name in rig_names(context.params.get("out")) if name.startswith(incomplete)]


def target(name: str, metavar: str, **options: Any) -> Any:
    """An argument that shells complete with the names of studies."""
    return click.argument(name, metavar=metavar, shell_complete=_studies, **options)


STUDY, TARGET = target("study", "STUDY"), target("target", "STUDY|PATH")
OUT = option("--out", type=click.Path(), help="Results folder; default: FIV_RESULTS, else ./results.")
ERROR = option("--standard-error", type=float, metavar="X", help="The same as --set standard_error=X.")
DISTRIBUTIONS = "mu=normal:0.2:0.02, uniform:LOW:HIGH, lognormal:MEDIAN:SIGMA, "
DISTRIBUTIONS += "triangular:LOW:MODE:HIGH, loguniform:LOW:HIGH"
DRAWS = (
    option("--scatter", multiple=True, metavar="NAME=DIST", help=f"Draw a parameter: {DISTRIBUTIONS}."),
    option("--samples", type=int, metavar="N", help="Number of draws; default: 1024. More are added to those."),
    option("--seed", type=int, metavar="N", help="Seed of the draws; default: 0."),
)
ADOPT = "After a change of code, keep stored results if N of their points, computed again, agree."
STORED = (
    OUT,
    option("--fresh", is_flag=True, help="Start over, whatever the results folder holds of it."),
    option("--adopt", type=click.IntRange(min=1), metavar="N", help=ADOPT),
    option("--retry-failed", is_flag=True, help="Compute failed points again."),
    option("--strict", is_flag=True, help="Refuse unusual values, and points of other versions and processors."),
)
SPECS = "mu=0.2, V=1,2mm/s, mu=0:0.5:101 (start:stop:count), mu=log:1e-3:1:30, V=auto, a word, a distribution"
KEYS = "set and scatter (tables), study, points, record, sample_rate, samples, seed, scheduler, workers"
RIG_HELP = "A rig by name (fiv rig), in whose folder results lie; or a TOML file: a table [set], or a structure."
RIG = option("--rig", metavar="NAME|FILE", shell_complete=_rigs, help=RIG_HELP)
RIGS = option("--rig", metavar="NAME", shell_complete=_rigs, help="Read the results of this rig (fiv rig).")
# Options of `plan` and `run`: the points.
POINTS = (
    option("--set", "assignments", multiple=True, metavar="NAME=SPEC", help=f"Values of a parameter: {SPECS}."),
    option("--config", metavar="FILE.toml", help=f"Keys {KEYS}. Options win."),
    RIG,
    *DRAWS,
    option("--points", metavar="FILE.csv", help="Rows to compute; heads are parameters, like p1_thickness [mm]."),
    option("--record", metavar="NAME,...", help="Record time series, for example velocity_B,normal_force."),
    option("--sample-rate", metavar="HZ", help="Sampling rate of recorded series: 20e3 or 20kHz."),
    ERROR,
    *STORED,
)
BACKEND = "Back end, or tcp://host:port of a Dask scheduler; default: DASK_SCHEDULER_ADDRESS, else threads."
HOW = (
    option("--scheduler", metavar="ADDRESS|threads|sync", help=BACKEND),
    option("--workers", type=click.IntRange(min=1), help="Processes on this machine, or threads."),
    option("--share", metavar="K/N", help="Compute every N-th computation from the K-th on; then: fiv merge."),
    option("--fail-fast", is_flag=True, help="Stop at the first point that fails."),
    option("--yes", is_flag=True, help="Never ask."),
)
HALVED = "Halve the intervals of the SPECs N times where the quantity changes, and interpolate elsewhere."
DRAWN = "What is drawn; see the list below."
MAP = (
    option("--x", required=True, metavar="NAME=SPEC", help="Axis across: theta=-10:20:61 or V=log:2e-4:1e-2:30."),
    option("--y", metavar="NAME=SPEC", help="Axis up; without it the map is a curve over x."),
    option("--fix", "fixed", multiple=True, metavar="NAME=VALUE", help="Another parameter: theta=8."),
    RIG,
    option("--quantity", "quantities", multiple=True, required=True, metavar="NAME,...", help=DRAWN),
    option("--refine", type=click.IntRange(0, 12), default=0, metavar="N", help=HALVED),
    option("--tolerance", type=float, metavar="T", help="Largest error of interpolation, of the range: 0.02."),
    *DRAWS,
    ERROR,
    *STORED,
)
SHOWN = "Columns, also calculated: 'V*1000, theta'; with --by: count, mean:X, share:X and more."
FORMS = click.Choice(["table", "csv", "json"])
QUERY = (
    option("--where", metavar="EXPR", help="Condition on the rows; default: all."),
    option("--show", metavar="A,B,...", help=SHOWN),
    option("--by", metavar="A,B,...", help="Merge the rows with equal values in these columns."),
    option("--sort", metavar="A,...", help="Columns to sort by; descending with a minus: --sort -velocity_rms."),
    option("--limit", type=click.IntRange(min=0), metavar="N", help="Largest number of rows."),
    option("--format", "form", type=FORMS, default="table", show_default=True, help="csv, json: all digits."),
    option("--units", is_flag=True, help="Heads with units: V [m s-1]; in json an object beside the rows."),
    RIGS,
    OUT,
)
FILM: Any = {"is_flag": False, "flag_value": "gif", "type": click.Choice(["gif", "mp4"]), "metavar": "[gif|mp4]"}
# Options of `plot` and `structure`: what moves.
MOVING = (
    option("--animate", "film", **FILM, help="A film of the motion; mp4 needs ffmpeg; default: gif."),
    option("--vtu", is_flag=True, help="What moves as a series that ParaView plays: FILE.pvd."),
)
