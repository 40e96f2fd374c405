"""`python -m sweeps` prints the engine's API on a page; `python -m pydoc sweeps.Plan.run` documents one name."""

import inspect
import re
from operator import attrgetter
from textwrap import fill

import sweeps

PAGE = {
    "Declare": "pointwise Axis Grid Sample Variable Sweep refined Refinement",
    "Plan and run": "Sweep.plan Plan Plan.run Plan.share Plan.merge",
    "Read and watch": "open_results status Status Snapshot",
    "Warnings": "FailedPointsWarning MixedWarning PendingWarning",
    "Errors": "InputError MissingFileError StoreError LockedError SchedulerError ClusterLostError "
    "SweepStoppedError AbandonedError",
}


def call(name: str) -> str:
    """The signature of a name, without types, and with "..." for defaults that have no short form."""
    what = attrgetter(name)(sweeps)
    if inspect.isclass(what) and issubclass(what, (BaseException, sweeps.Plan)):
        return name
    whole = inspect.signature(what)
    parts = [each.replace(annotation=each.empty) for each in whole.parameters.values() if each.name != "self"]
    return name + re.sub("=<[^>]*>", "=...", str(whole.replace(parameters=parts, return_annotation=whole.empty)))


def page() -> str:
    """All public names with their signatures and the first sentence of their documentation."""
    lines = [str(sweeps.__doc__).strip()]
    for head, names in PAGE.items():
        lines += ["", head]
        for name in names.split():
            first = " ".join(str(inspect.getdoc(attrgetter(name)(sweeps))).partition("\n\n")[0].split())
            lines.append(fill(call(name), 100, initial_indent="  ", subsequent_indent="      "))
            lines.append(fill(first, 100, initial_indent="    ", subsequent_indent="    "))
    return "\n".join([*lines, "", "All of one name: python -m pydoc sweeps.Plan.run"])


if __name__ == "__main__":
    print(page())
