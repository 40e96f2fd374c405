"""Files and checks for tests of back ends."""

import os

import numpy as np

from sweeps import FAILED, Grid, Sweep

QUIET = {"silence_logs": 50, "dashboard_address": None, "scheduler_kwargs": {"dashboard_address": "127.0.0.1:0"}}
# A cluster in this process.
INSIDE = QUIET | {"processes": False, "protocol": "tcp://"}


def simple(function, grid=None, **options):
    return Sweep("simple", function, grid or Grid({"x": np.arange(24.0)}), **({"variables": ["y"]} | options))


def visible(folder):
    """The files in a folder, without the empty lock file."""
    return [name for name in os.listdir(folder) if not name.endswith(".lock")]


def assert_right(data, failed=(7.0,)):
    """Check that a result of `sweep_programs.make` equals that of its function, to the bit."""
    x = data["x"].values
    is_failed = np.isin(x, failed)
    np.testing.assert_array_equal(data["status"], np.where(is_failed, FAILED, 1))
    np.testing.assert_array_equal(data["error"] != "", is_failed)
    np.testing.assert_array_equal(data["square"], np.where(is_failed, np.nan, x**2))
    rows = x[:, None] ** np.arange(3.0)
    np.testing.assert_array_equal(data["powers"], np.where(is_failed[:, None], np.nan, rows))
