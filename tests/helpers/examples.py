"""Examples that Hypothesis draws: the same each time, or with FIV_EXAMPLES=N others, N times as many."""

import os

from hypothesis import settings

FRESH = "FIV_EXAMPLES" in os.environ
TIMES = int(os.environ.get("FIV_EXAMPLES", "1"))


def examples(count):
    """Draw so many examples for a test."""
    return settings(max_examples=count * TIMES)
