"""Comparison of two runs bit for bit."""

import numpy as np

from fivcore.transient.statistics import SERIES as RECORDED

SERIES = ("time", *RECORDED)


def assert_same_summary(one, other):
    for name, value in one.summary.items():
        assert np.array_equal(value, other.summary[name], equal_nan=not isinstance(value, str)), name


def assert_same_run(one, other):
    """Check scene, all series and all statistics."""
    assert one.scene == other.scene
    for name in SERIES:
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert_same_summary(one, other)
