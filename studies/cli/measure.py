"""The command that looks at a measured signal. Heavy packages are imported inside it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import TYPE_CHECKING, Any

import click
from click import option

from studies.cli.app import command
from studies.cli.output import columns, say, show

if TYPE_CHECKING:
    from studies.study import Study

UNIT = "Unit of the file's numbers, mm/s; with a number what 1 in the file, or the full scale of WAV, is: 50mm/s."
SIGNAL = (
    option("--unit", metavar="U", help=UNIT),
    option("--rate", metavar="HZ", help="Sampling rate of the file, 50kHz, if that does not say it."),
    option("--channel", metavar="NAME|N", help="Channel of a file with several."),
)
MEASURED = (option("--measured", metavar="FILE", help="A measured velocity (fiv measure) to draw into fig7."), *SIGNAL)
OPTIONS = (
    option("--band", metavar="LOW:HIGH", default="200Hz:10kHz", show_default=True, help="Where lines are sought."),
    option("--start", metavar="TIME", default="0s", help="Leave out what is before."),
    option("--json", "as_json", is_flag=True, help="As JSON, all digits and values."),
)
NOTE = """
A run's summary knows the contact, this only the signal: quiet spells, by its envelope, are not sticks. What vibrates
is what is outside of them; periodicity is the autocorrelation after 20 periods of the main frequency."""


@command("measure", "What can be said of a measured signal.", click.argument("file"), *SIGNAL, *OPTIONS)
def measure(file: str, band: str, start: str, as_json: bool, **which: Any) -> None:
    """Main frequency, lines, RMS, periodicity and quiet spells of a signal: CSV, WAV, universal file 58, MATLAB.

    \b
    fiv measure squeal.csv
    fiv run fig7 --measured squeal.csv

    The observer of a run's velocity of B looks at it, in its own unit; nothing is integrated. A table says its times
    and units in its heads, like t [ms] and v_B [mm/s], or --rate and --unit do.
    """  # noqa: D301 - the backspace tells click to keep the lines
    import studies
    from studies import spec

    low, _, high = band.partition(":")
    ends = spec.one(low, "band", "Hz"), spec.one(high, "band", "Hz")
    found = studies.measure(file, band=ends, start=spec.one(start, "start", "s"), **which)
    if as_json:
        plain = {name: getattr(value, "tolist", lambda v=value: v)() for name, value in found.items()}
        show(json.dumps({name: None if value != value else value for name, value in plain.items()}))
        return
    rms, few = next(name for name in found if name.endswith("_rms")), len(found["quiet_times"])
    text = (
        "signal              {channel} in {unit}, {duration:.4g} s at {rate:.6g} Hz",
        "main frequency      {dominant_frequency:.1f} Hz",
        "periodicity         {periodicity:.3f}",
        f"RMS about its mean  {{{rms}:.4g}} +- {{{rms}_se:.2g}} {{unit}}",
        f"quiet               {{quiet_fraction:.1%}} of the time, {few} whole spells",
        "mean quiet spell    {mean_quiet_time:.4g} +- {mean_quiet_time_se:.2g} s",
        "main while quiet    {quiet_frequency:.1f} Hz",
    )
    show("\n".join(line.format(**found).replace("nan", "-") for line in text))
    pairs = zip(found["line_frequencies"], found["line_levels"], strict=True)
    show("\n" + columns([("line Hz", "dB"), *((f"{f:.1f}", f"{level:.1f}") for f, level in pairs)]))
    say(NOTE)


def beside(study: Study, measured: str | None, **which: Any) -> Study:
    """The study, with a measured signal in its figure if one is given."""
    from studies.measured import files, signal
    from sweeps import InputError

    if measured is None:
        for name in [name for name, value in which.items() if value is not None]:
            raise InputError(f"--{name} {which[name]}: it is of a measured signal; give --measured FILE, too")
        return study
    if study.figure is None or "measured" not in signature(study.figure).parameters:
        raise InputError(f"--measured {measured}: {study.name} draws none; write: fiv run fig7 --measured {measured}")
    return replace(study, figure=partial(study.figure, measured=signal.velocity(files.read(measured, **which))))
