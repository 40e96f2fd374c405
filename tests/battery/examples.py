"""How many examples Hypothesis tries: few and always the same, or many of a seed.

`python -m pytest tests/battery` tries the same few each time. `FIV_BATTERY=50 python -m pytest tests/battery
--hypothesis-seed=7` tries fifty times as many, drawn by that seed; without the option by one of its own, which it
prints where something fails.
"""

import os

from hypothesis import settings

TIMES = int(os.environ.get("FIV_BATTERY", "0"))
settings.register_profile("quick", derandomize=True, database=None, deadline=None)
settings.register_profile("battery", derandomize=False, database=None, deadline=None, print_blob=True)


def examples(count: int) -> settings:
    """Half as many examples, or `FIV_BATTERY` times as many."""
    profile = settings.get_profile("battery" if TIMES else "quick")
    return settings(profile, max_examples=count * TIMES or count // 2 + 1)
