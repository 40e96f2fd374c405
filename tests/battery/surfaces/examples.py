"""How many examples Hypothesis tries of a surface: few and always the same, or many of a seed."""

from collections.abc import Callable
from functools import wraps
from typing import Any

from hypothesis import settings

from tests.battery.harness import TRIED

settings.register_profile("quick", derandomize=True, database=None, deadline=None)
settings.register_profile("battery", derandomize=False, database=None, deadline=None, print_blob=True)
# Set before any test is loaded, by `tests.battery.harness`.
at_length = False


def surface(name: str, times: int) -> Callable[[int], Callable[[Any], Any]]:
    """Of a file's tests: half as many examples as each says, or so many times as many, which are counted."""

    def examples(count: int) -> Callable[[Any], Any]:
        profile = settings.get_profile("battery" if at_length else "quick")
        chosen = settings(profile, max_examples=count * times if at_length else count // 2 + 1)
        return lambda test: chosen(_counted(test, name))

    return examples


def _counted(test: Any, name: str) -> Any:
    inner = test.hypothesis.inner_test

    @wraps(inner)
    def one(*arguments: Any, **named: Any) -> Any:
        TRIED[name] += 1
        return inner(*arguments, **named)

    test.hypothesis.inner_test = one
    return test
