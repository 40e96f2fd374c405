"""What a file holds, and who reads it while it is written."""

import itertools
import multiprocessing
import time
import traceback
from typing import Any

import netCDF4
import numpy as np

from sweeps import PENDING, open_results, status
from tests.helpers.processes.sweep_programs import COMPARED

# What two runs do not have in common: computing times, and the date.
OWN = {"wall_time"}, {"history"}
FLOATS = ("square", "powers")


def contents(path):
    """Everything that a file holds, bit for bit, but what every run has of its own."""
    with netCDF4.Dataset(path) as file:
        file.set_auto_maskandscale(False)
        file.set_auto_chartostring(False)
        held: dict[str, Any] = {name: file.getncattr(name) for name in file.ncattrs() if name not in OWN[1]}
        for name, variable in file.variables.items():
            described = variable.dimensions, variable.dtype, variable.filters(), variable.chunking()
            values = b"" if name in OWN[0] else np.asarray(variable[...]).tobytes()
            held[f"{name}()"] = described, repr(vars(variable)), values
        return held


def look(path, expected, over, told):
    """Read beside a writer until it is over; tell how often, and what was neither right nor not there yet."""
    reads, wrong = 0, []
    places = dict(zip(expected["x"].tolist(), itertools.count(), strict=False))
    while not over.is_set() and len(wrong) < 3:
        try:
            data = open_results(path)
            known = data["status"].values != PENDING
            rows = [places[x] for x in data["x"].values[known].tolist()]
            for name in COMPARED:
                assert np.array_equal(data[name].values[known], expected[name][rows], equal_nan=name in FLOATS), (
                    name
                )
            state = status(path)
            assert state.done + state.failed + state.pending == state.points, state
            reads += 1
        except FileNotFoundError:
            reads += 1
        except Exception:  # noqa: BLE001 - whatever it is, a reader is not to see it
            wrong.append(traceback.format_exc())
        time.sleep(0.01)
    told.send((reads, wrong))


class Reader:
    """Somebody who reads all the time, until he is told to stop."""

    def __init__(self, path, expected):
        forked = multiprocessing.get_context("fork")
        self.over, (self.hear, tell) = forked.Event(), forked.Pipe(duplex=False)
        self.process = forked.Process(target=look, args=(path, expected, self.over, tell))
        self.process.start()
        tell.close()

    def stop(self):
        """How often he has read, and the first of what he has seen that is wrong."""
        self.over.set()
        try:
            if not self.hear.poll(60.0):
                return 0, "nothing more: he hangs"
            reads, wrong = self.hear.recv()
            return reads, "".join(wrong[:1])
        finally:
            self.process.kill()
            self.process.join()
