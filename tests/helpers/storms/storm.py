"""A sweep to which things happen: its runs, and what is true after each of them."""

import os
import signal
import tempfile
import time
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sweeps import DONE, FAILED, Axis, Grid, open_results
from sweeps.storage.store import Store
from tests.helpers.processes import sweep_programs
from tests.helpers.processes.sweep_programs import end, make
from tests.helpers.storms.clusters import Outside, groups_end
from tests.helpers.storms.readers import contents

# s. No run of a storm takes as long.
PATIENCE = 120.0


@dataclass
class Storm:
    """A sweep, its store, and what has happened to it.

    `log` is one for all storms of a size, for it belongs to what a sweep is.
    """

    folder: Path
    log: Path
    rng: np.random.Generator
    tried: Any
    points: int
    pause: float
    codes: list[int | None] = field(default_factory=list)
    said: list[str] = field(default_factory=list)
    under_way: list[Any] = field(default_factory=list)
    lines: list[tuple[Any, str]] = field(default_factory=list)
    outside: Outside | None = None
    afterwards: ExitStack = field(default_factory=ExitStack)
    # Whether points of another environment are in it.
    mixed: bool = False

    def __post_init__(self):
        self.begun = time.monotonic()
        self.path = self.folder / "store" / "powers.nc"
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.store = Store(self.path)
        self.about = {"points": self.points, "pause": self.pause, "log": self.log}

    def finished(self):
        """The points that are kept."""
        try:
            data = open_results(self.path)
        except FileNotFoundError:
            return set()
        return set(data["x"].values[np.isin(data["status"].values, (DONE, FAILED))].tolist())

    def logged(self):
        """The points that were begun since the log was cleared."""
        return [float(line) for line in self.log.read_text().split()] if self.log.exists() else []

    def backend(self, outside=0.1):
        """Any back end."""
        if self.rng.random() < outside:
            return self.cluster().address
        return str(self.rng.choice(["sync", "threads", "threads", "threads", "processes"]))

    def cluster(self):
        """Somebody else's scheduler and two workers."""
        if self.outside is None:
            self.outside = Outside(self.folder)
            for _ in range(2):
                self.outside.join()
        return self.outside

    def leave_cluster(self):
        """Use the cluster no more."""
        if self.outside is not None:
            self.outside.end()
        self.outside = None

    def say(self, text):
        """Note what happens, and when."""
        self.said.append(f"{time.monotonic() - self.begun:5.1f} s: {text}")

    def __enter__(self):
        self.afterwards.callback(self.leave_cluster)
        return self

    def __exit__(self, *problem):
        for process in self.under_way:
            end(process)
        self.afterwards.close()

    def start(self, scheduler=None, **told):
        """Start a run; what is kept now is not to be computed again."""
        self.before, self.scratch, self.codes = self.finished(), os.listdir(tempfile.gettempdir()), []
        self.log.write_text("")
        return self.one_more(scheduler or self.backend(), **told)

    def one_more(self, scheduler, **told):
        """Start a run beside others."""
        self.say(f"run on {scheduler} {told or ''}")
        process = sweep_programs.start(store=self.path, scheduler=scheduler, **self.about, **told)
        self.under_way.append(process)
        sweep_programs.wait_for(process, "ready")
        return process

    def wait_a_moment(self, process, least=0):
        """Wait until anything between the beginning of a run and its end, or its first points and its middle."""
        if least or self.rng.random() < 0.7:
            left = self.points - len(self.before)
            after = int(self.rng.integers(least, max(left // 2 if least else left, least + 1)))
            for line in process.stdout:
                self.lines.append((process, line))
                if line.startswith("progress") and int(line.split()[1]) >= after:
                    break
            time.sleep(self.rng.uniform(0.0, 0.05))
        else:
            time.sleep(self.rng.uniform(0.0, 0.8))

    def over(self, process, *codes):
        """Wait for a run; it must have ended by one of these codes, in one line, and left nothing behind."""
        until = time.monotonic() + PATIENCE
        while process.poll() is None and time.monotonic() < until:
            time.sleep(0.01)
        code = process.poll()
        left = code is None or not groups_end(process.pid)
        if left:
            end(process)
        self.under_way.remove(process)
        out, err = ("", "") if left else process.communicate()
        lines = [*(line for owner, line in self.lines if owner is process), *out.splitlines()]
        lines = [line.rstrip() for line in lines if not line.startswith("progress")]
        self.say(f"ended by {code}: {lines} {err}")
        self.codes.append(code)
        assert code is not None, "the run did not end"
        assert not left, "processes of the run are left"
        assert code in codes, f"ended by {code}, not {codes}"
        assert "Traceback" not in err, err
        # Whoever is killed may just have said how he ended.
        assert len(lines) == 1 or (code == -signal.SIGKILL and not lines), lines
        return (lines or [""])[0] + err

    def check_kept(self):
        """Nothing that was finished is lost, or was computed again; the store is free, nothing is left."""
        now, again = self.finished(), self.before & set(self.logged())
        assert not again, f"computed again: {sorted(again)}"
        assert self.before <= now, f"lost: {sorted(self.before - now)}"
        assert not self.store.is_locked()
        if -signal.SIGKILL not in self.codes:
            left = {*os.listdir(tempfile.gettempdir())} - {*self.scratch}
            assert not left, f"temporary: {left}"

    def run(self, *codes, scheduler=None, **told):
        """A run from its beginning to its end."""
        line = self.over(self.start(scheduler, **told), *codes)
        self.check_kept()
        return line

    def grow(self):
        """Finish a sweep of every third point first: values are added between those that are there."""
        self.log.write_text("")
        self.say("every third point first")
        third = Grid({"x": Axis(np.arange(0.0, self.points, 3.0), "m")})
        replace(make(**self.about), grid=third).plan(self.path).run("sync")

    def renew(self, expected):
        """Begin anew where nothing is left to be done."""
        if not self.store.manifest.exists() and len(self.finished()) == self.points:
            self.check(expected)
            self.path.unlink()
            self.mixed = False

    def complete(self, expected):
        """Run to the end."""
        self.run(0)
        self.check(expected)

    def check(self, expected):
        """The file is what an undisturbed run makes, and alone."""
        found = contents(self.path)
        if self.mixed:
            assert "9.9" in found["environments"] or found["environments"] == expected["environments"]
            found["environments"] = expected["environments"]
        names = sorted({*found, *expected})
        differing = [name for name in names if repr(found.get(name)) != repr(expected.get(name))]
        assert not differing, f"differing from the undisturbed file: {differing}"
        assert sorted(os.listdir(self.path.parent)) == [f".{self.path.name}.lock", self.path.name]
