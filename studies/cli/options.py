"""Arguments and options that commands share.

The module imports nothing heavy, so that `fiv --help` answers at once.
"""

from __future__ import annotations

import click

from studies.cli import completion

STUDY = click.argument("study", shell_complete=completion.study)
TARGET = click.argument("target", metavar="STUDY|PATH", shell_complete=completion.study)
OUT = click.option("--out", type=click.Path(), help="Folder for results; default: FIV_RESULTS, else ./results.")
RETRY = click.option("--retry-failed", is_flag=True, help="Compute again the points that failed.")
FRESH = click.option("--fresh", is_flag=True, help="Start over, whatever the results folder holds of it.")
STRICT = click.option(
    "--strict", is_flag=True, help="Refuse unusual values, and points computed by other versions."
)
ERROR = click.option(
    "--standard-error",
    type=float,
    metavar="X",
    help="Largest standard error of a share of time at which a run ends.",
)
SCATTER = click.option(
    "--scatter",
    multiple=True,
    metavar="NAME=DIST",
    shell_complete=completion.SCATTERED,
    help="Draw an axis or a setting from a distribution: mu=normal:0.2:0.02, uniform:LOW:HIGH, "
    "lognormal:MEDIAN:SIGMA, triangular:LOW:MODE:HIGH; cut to what is physical. Makes STUDY-scatter.",
)
DRAWS = (
    click.option(
        "--samples", type=int, metavar="N", help="Number of draws; default: 1024. More are added to those."
    ),
    click.option("--seed", type=int, metavar="N", help="Seed of the draws; default: 0."),
)
# Options of `plan` and `run`: the points and their settings.
WHAT = (
    ERROR,
    click.option(
        "--set",
        "assignments",
        multiple=True,
        metavar="AXIS=SPEC",
        shell_complete=completion.SETTABLE,
        help="Other values for an axis or a setting: mu=0.2, mu=0.1,0.2, mu=0:0.5:101, mu=log:1e-3:1:30.",
    ),
    click.option(
        "--config",
        "config_file",
        type=click.Path(dir_okay=False),
        metavar="FILE.toml",
        help="Axes, settings and whatever else the options say, from a file; options win. fiv status --toml "
        "prints a result's.",
    ),
    SCATTER,
    *DRAWS,
    click.option("--sampling", metavar="METHOD", help="sobol (the default), latin or random."),
    click.option(
        "--points",
        type=click.Path(dir_okay=False),
        metavar="FILE.csv",
        help="Compute the rows of a table; its heads are axes or settings, also with a unit: p1_thickness [mm]. "
        "Makes STUDY-points.",
    ),
    OUT,
    click.option(
        "--record",
        metavar="NAME,...",
        shell_complete=completion.SERIES_LIST,
        help="Record time series, for example velocity_B,normal_force.",
    ),
    click.option("--sample-rate", type=float, metavar="HZ", help="Sampling rate of recorded series."),
    FRESH,
    RETRY,
    STRICT,
)
# Options of `run` and `map`: the execution.
HOW = (
    click.option(
        "--scheduler",
        metavar="ADDRESS|threads|sync",
        help="Back end; the tcp://host:port is a Dask scheduler's. Default: DASK_SCHEDULER_ADDRESS, else threads.",
    ),
    click.option(
        "--workers",
        type=click.IntRange(min=1),
        help="Number of processes on this machine; with threads, of threads.",
    ),
    click.option("--fail-fast", is_flag=True, help="Stop at the first point that fails."),
    click.option("--yes", is_flag=True, help="Never ask, however long it takes."),
)
MAP = (
    click.option(
        "--x",
        required=True,
        metavar="AXIS=SPEC",
        shell_complete=completion.MAP_AXIS,
        help="Axis across: theta=-10:20:61 or V=log:2e-4:1e-2:30.",
    ),
    click.option(
        "--y",
        metavar="AXIS=SPEC",
        shell_complete=completion.MAP_AXIS,
        help="Axis up, likewise; without it the map is a curve over x.",
    ),
    click.option(
        "--fix",
        "fixed",
        multiple=True,
        metavar="AXIS=VALUE",
        shell_complete=completion.MAP_SETTING,
        help="Another axis or a setting: theta=8.",
    ),
    click.option(
        "--quantity",
        required=True,
        metavar="NAME",
        shell_complete=completion.QUANTITY,
        help="Quantity of the map; see the list below.",
    ),
    click.option(
        "--refine",
        "halvings",
        type=click.IntRange(0, 12),
        default=0,
        metavar="N",
        help="Halve the SPECs' intervals so often where the quantity changes, and interpolate elsewhere.",
    ),
    click.option(
        "--tolerance",
        type=float,
        metavar="T",
        help="With --refine: largest estimated error of interpolation, as a share of the range of the values; "
        "default: 0.02.",
    ),
    click.option(
        "--scatter",
        multiple=True,
        metavar="NAME=DIST",
        shell_complete=completion.SCATTERED,
        help="With --quantity probability_unstable: distribution of a number of the rig, as for fiv run; "
        "default: a usual scatter of all.",
    ),
    *DRAWS,
    ERROR,
    OUT,
    FRESH,
    RETRY,
    STRICT,
)
QUERY = (
    click.option("--where", metavar="EXPR", help="Condition on the rows; default: all."),
    click.option(
        "--show",
        "columns",
        metavar="A,B,...",
        shell_complete=completion.COLUMNS,
        help="Columns, also calculated: 'V*1000, theta'; with --by: count, mean:X, share:X and more.",
    ),
    click.option(
        "--by",
        metavar="A,B,...",
        shell_complete=completion.COLUMNS,
        help="Group the rows that agree in these columns.",
    ),
    click.option(
        "--sort",
        metavar="A,...",
        shell_complete=completion.SORTED_COLUMNS,
        help="Columns to sort by; descending with a minus in front: --sort -velocity_rms.",
    ),
    click.option("--limit", type=click.IntRange(min=0), metavar="N", help="Largest number of rows."),
    click.option(
        "--format",
        "form",
        type=click.Choice(["table", "csv", "json"]),
        default="table",
        show_default=True,
        help="csv and json are in full precision.",
    ),
    click.option("--units", is_flag=True, help="Heads with units: V [m s-1]; in json as an object beside rows."),
    OUT,
)


class MapCommand(click.Command):
    """The command `map`, whose help ends with lists of names that are slow to import."""

    def format_epilog(self, context: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the quantities, axes and settings, with their units."""
        from studies.maps.quantities import AXES, QUANTITIES, RUN

        quantities = {name: each.variable for name, each in QUANTITIES.items()}
        for head, named in (("Quantities", quantities), ("Axes", AXES), ("Settings of runs", RUN)):
            texts = [name if each.units == "1" else f"{name} [{each.units}]" for name, each in named.items()]
            with formatter.section(head):
                formatter.write_text(", ".join(texts))
