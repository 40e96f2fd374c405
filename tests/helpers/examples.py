"""Examples drawn by Hypothesis: the same each time, or with FIV_EXAMPLES=N different ones, N times as many."""

import os

from hypothesis import settings

FRESH = "FIV_EXAMPLES" in os.environ
TIMES = int(os.environ.get("FIV_EXAMPLES", "1"))


def examples(count):
    """Set the number of examples of a test."""
    return settings(max_examples=count * TIMES)
