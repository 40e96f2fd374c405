"""Processes of a run, and Dask clusters as somebody else would have started them."""

import os
import shutil
import signal
import subprocess
import time
from contextlib import suppress
from typing import Any

from tests import HOME
from tests.helpers.processes.sweep_programs import end, program


def groups_end(leader, seconds=30.0):
    """Whether all processes of a group end in time."""
    until = time.monotonic() + seconds
    with suppress(ProcessLookupError):
        while time.monotonic() < until:
            os.killpg(leader, 0)
            time.sleep(0.02)
        return False
    return True


def send(process, number):
    """Send a signal, unless the process has ended."""
    with suppress(ProcessLookupError):
        os.kill(process, number)


def workers_of(leader):
    """The processes that compute for a run."""
    options = ["ps", "-ww", "-o", "pid=,args=", "--ppid", str(leader)]
    lines = subprocess.run(options, capture_output=True, text=True).stdout.splitlines()
    return [int(line.split()[0]) for line in lines if "spawn_main" in line]


class Outside:
    """A Dask scheduler and workers as somebody else would have started them, a process each."""

    def __init__(self, folder):
        self.folder = folder
        self.workers: list[Any] = []
        self.scheduler, self.address = self._started()

    def _started(self, home=HOME, **told):
        process = program("storms.dask_programs", told | {"folder": self.folder}, home)
        address = process.stdout.readline().strip()
        if not address:
            raise AssertionError(f"no server: {process.stderr.read()}")
        return process, address

    def join(self, home=HOME, **told):
        """One more worker, which may have other versions."""
        self.summon(home, **told)()

    def summon(self, home=HOME, **told):
        """What has one more worker join at once."""
        worker, _ = self._started(home, worker=self.address, waits=True, **told)
        self.workers.append(worker)

        def admit():
            os.kill(worker.pid, signal.SIGUSR1)
            assert worker.stdout.readline(), worker.stderr.read()

        return admit

    def end(self):
        """End what has not ended yet."""
        for process in (self.scheduler, *self.workers):
            if process.poll() is None:
                end(process)


def altered_home(folder):
    """Helpers in which the function of the sweeps has another code."""
    helpers = folder / "tests" / "helpers"
    shutil.copytree(HOME / "tests" / "helpers", helpers, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(HOME / "tests" / "__init__.py", folder / "tests")
    file = helpers / "sweep_programs.py"
    code = file.read_text()
    assert '"square": x**2' in code
    file.write_text(code.replace('"square": x**2', '"square": x**2 + 1e-9'))
    return folder
