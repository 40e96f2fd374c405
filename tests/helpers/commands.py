"""The command as whole processes, and what it leaves behind."""

import os
import subprocess
import sys
import time
from pathlib import Path

FIV = str(Path(sys.executable).with_name("fiv"))


def fiv(folder, *arguments, command=(FIV,)):
    environment = {k: v for k, v in os.environ.items() if k != "FIV_RESULTS"}
    return subprocess.run([*command, *arguments], cwd=folder, capture_output=True, text=True, env=environment)


def written(folder) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in Path(folder).rglob("*") if p.is_file())


# fig5 with a function of one's own in front of it; `again` says whether it is mended.
PICKY = """
import dataclasses, os, sys, time, studies.cli.progress, studies.gallery.fig5 as f
from studies.cli.main import main
whole = f.modes
def picky(points, **constants):
    if (points['mu'] == 0.25).any() and not os.path.exists('mended'):
        raise ArithmeticError('not this one')
    return whole(points, **constants)
def slow(points, **constants):
    time.sleep(0.4 * len(points['mu']))
    return whole(points, **constants)
f.STUDY = dataclasses.replace(f.STUDY, function={function})
studies.cli.progress.INTERVAL = 0.5
sys.argv = ['fiv', *{arguments}]
main()
"""


def program(function: str, *arguments: str) -> tuple[str, ...]:
    return (sys.executable, "-c", PICKY.format(function=function, arguments=list(arguments)))


def begun(folder, *arguments):
    """A slow run, once it has finished its first batches."""
    running = subprocess.Popen(
        program("slow", *arguments), cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    until = time.monotonic() + 60.0
    parts = folder / "results" / "fig5" / "fig5.parts"
    while len(list(parts.glob("0*.part"))) < 4:
        assert running.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    return running
