"""Each check of `fiv check` can fail, and an error is a check that failed."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fivcore import simulate
from studies.cli import installation as check
from sweeps import Plan


def late(scene, duration, method="fast", **options):
    return simulate(replace(scene, mu=0.21) if method == "fast" else scene, duration, method, **options)


def changed(*given, **options):
    """The results of a run with the last bit of one value changed."""
    data = RUN(*given, **options).load()
    if "velocity_rms" in data and given[1:2] != ("threads",):
        values = data["velocity_rms"].values.copy()
        values[0] = np.nextafter(values[0], 1.0)
        data["velocity_rms"] = ("V", values)
    return data


RUN = Plan.run
# What breaks the checks of each group, and words of every check that fails then.
FAULTS = {
    "stability": (
        {
            "check.GLUED": tuple(1.00001 * f for f in check.GLUED),
            "check.ONSETS": (0.111, *check.ONSETS[1:]),
            "check.FREQUENCIES": (2802.0, *check.FREQUENCIES[1:]),
            "check.GROWTH": (383.7, 1764.18),
        },
        ["natural frequencies", "flutter onsets: friction", "flutter onsets: frequency", "growth rates"],
    ),
    "motion": (
        {"check.simulate": late, "check.ENERGY": 1e-9},
        ["first slip", "velocity of B", "energy balance"],
    ),
    "engine": (
        {"Plan.run": changed, "check.SPEEDS": np.array([1e-3, 2e-3, 0.0])},
        ["in sequence", "completes it", "points computed"],
    ),
    "study": (
        {"image.imread": lambda file: np.ones((10, 10, 4)), "check.ONSETS": (0.111, *check.ONSETS[1:])},
        ["pixels", "onsets in its file"],
    ),
}


@pytest.mark.parametrize("group", FAULTS)
def test_each_check_can_fail(tmp_path, monkeypatch, group):
    faults, failing = FAULTS[group]
    places = {"check": check, "Plan": Plan, "image": check.image}
    for name, value in faults.items():
        place, _, attribute = name.partition(".")
        monkeypatch.setattr(places[place], attribute, value)
    for name in FAULTS.keys() - {group}:
        monkeypatch.setattr(check, name, lambda folder: iter(()))
    failed = [what for what, _, _, passed in check.checks(tmp_path) if not passed]
    assert all(any(re.search(name, what) for what in failed) for name in failing), failed


@pytest.mark.slow
def test_here_all_pass_and_nothing_is_left_behind(here, tmp_path):
    done = here("check")
    assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "all is well")
    assert list(tmp_path.iterdir()) == []


def test_an_error_is_a_check_that_failed_and_the_others_go_on(tmp_path, monkeypatch, here):
    def raises(folder):
        raise OSError("no \x1b[2J\nscreen")

    for name in ("stability", "motion", "engine", "study"):
        monkeypatch.setattr(check, name, raises)
    done = here("check")
    assert done.returncode == 1
    assert done.stdout.count(r"OSError: no \x1b[2J screen  no error  FAILED") == 4
    assert done.stdout.splitlines()[-1].startswith("4 of 4 failed")
