"""The command `measure` for measured signals. Heavy packages are imported inside it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click import option

from studies.cli.app import command
from studies.cli.output import columns, say, show

if TYPE_CHECKING:
    from studies.study import Study

UNIT = "Unit of a measured signal, such as mm/s; 50mm/s if 1 in its file, or a WAV's full scale, is 50 mm/s."
SIGNAL = (
    option("--unit", metavar="U", help=UNIT),
    option(
        "--rate", metavar="HZ", help="Sampling rate of a measured signal, such as 50kHz, if it is not in the file."
    ),
    option("--channel", metavar="NAME|N", help="Channel of a measured file with several."),
)
DRAWN = option("--measured", metavar="FILE", help="A measured velocity (fiv measure) to draw beside that of B.")
BAND = option(
    "--band", metavar="LOW:HIGH", default="200Hz:10kHz", show_default=True, help="Band of the dominant frequency."
)
NOTE = """
A signal does not show the state of the contact: quiet spells are read from its envelope and differ from sticks.
The dominant frequency is that outside quiet spells. Periodicity is the autocorrelation after 20 of its periods."""


@command("measure", "Statistics of a measured signal.", click.argument("file"), *SIGNAL, BAND)
def measure(file: str, band: str, **which: Any) -> None:
    """Main frequency, lines, RMS, periodicity and quiet spells of a signal: CSV, WAV, universal file 58, MATLAB.

    \b
    fiv measure squeal.csv
    fiv run fig7 --measured squeal.csv

    The signal is analysed like the velocity of B in a run, in its own unit; nothing is integrated. Times and units
    of a table are in its heads, such as t [ms] and v_B [mm/s], or in --rate and --unit.
    """  # noqa: D301 - the backspace tells click to keep the lines
    from studies.answering import measured
    from studies.declaring import spec

    if band.count(":") != 1:
        raise click.UsageError(f"--band {band}: it must be LOW:HIGH, such as 200Hz:10kHz")
    low, high = (spec.one(end, "band", "Hz") for end in band.split(":"))
    found = measured.statistics(measured.read(file, **which), (low, high))
    units = {"frequency": "Hz", "rate": "Hz", "duration": "s", "time": "s", "rms": found["unit"]}
    rows = list[tuple[str, str]]()
    for name, value in {**found, "quiet_spells": float(len(found["quiet_times"]))}.items():
        if isinstance(value, (float, str)):
            text = value if isinstance(value, str) else f"{value:.5g}"
            unit = units.get(name.removesuffix("_se").rpartition("_")[2], "")
            rows.append((name, "-" if text == "nan" else f"{text} {unit}"))
    show(columns(rows))
    pairs = zip(found["line_frequencies"], found["line_levels"], strict=True)
    show("\n" + columns([("line Hz", "dB"), *((f"{f:.1f}", f"{level:.1f}") for f, level in pairs)]))
    if len(found["line_frequencies"]) and not low <= found["line_frequencies"][0] <= high:
        say(f"fiv: the strongest line is outside of the band, {band}; --band moves that")
    say(NOTE)


def beside(study: Study, file: str | None, **which: Any) -> Study:
    """The study whose figure also shows the measured signal of a file, if one is given."""
    from studies import registry
    from studies.answering import measured
    from sweeps import InputError

    if file is None:
        for name in [name for name, value in which.items() if value is not None]:
            raise InputError(f"--{name} {which[name]}: it is of a measured signal; give --measured FILE, too")
        return study
    figure: Any = study.figure
    if figure is None or "measured" not in signature(figure).parameters:
        others = " or ".join(registry.names_for("measured"))
        raise InputError(f"--measured {file}: {study.name} does not draw it; fiv run {others} does")
    one = measured.velocity(measured.read(file, **which))
    one = replace(one, name=f"{Path(file).name}, {one.name}")
    say(f"measured        {one.name}: in the figure alone, which fiv plot draws without it")
    return replace(study, figure=partial(figure, measured=one))
