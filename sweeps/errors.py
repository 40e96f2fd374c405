"""Errors of a sweep as a whole. A point's failure is no error: it is kept with the point."""

from __future__ import annotations


def reason(problem: BaseException) -> str:
    """Why a disk refuses, in a few words."""
    if isinstance(problem, OSError):
        return problem.strerror or str(problem)
    # The netCDF library says no more when a disk is full.
    return f"{problem} (is the disk full?)" if "HDF error" in str(problem) else str(problem)


# What reading a file may raise that is damaged or something else: also by values that are none, by what is nested
# too deeply (RuntimeError), and by what is too large (MemoryError).
UNREADABLE = (
    OSError,
    RuntimeError,
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    ArithmeticError,
    MemoryError,
)


def said(problem: BaseException) -> str:
    """Text of an exception, in one line."""
    kind = "" if isinstance(problem, InputError) else f"{type(problem).__name__}: "
    return " ".join(f"{kind}{problem}".split())


class StoreError(RuntimeError):
    """The place where results are to be kept cannot be used; the message says why."""


class LockedError(StoreError):
    """Another run is writing there; the message says which."""


class SweepStoppedError(RuntimeError):
    """A point failed and the sweep was to stop at once; what was finished is kept."""


class MixedWarning(UserWarning):
    """Points of one result are computed in different environments; the message says how these differ."""


class InputError(ValueError):
    """An argument that cannot be used; the message names it, its value and what would do."""


class MissingFileError(InputError, FileNotFoundError):
    """There is no such file; the message names it, and what makes it."""


class SchedulerError(InputError):
    """The scheduler that was asked for cannot be used; the message says why."""


class ClusterLostError(RuntimeError):
    """The scheduler or all its workers went while they computed; what a store has of it is kept."""


class AbandonedError(KeyboardInterrupt):
    """A second interrupt, while threads compute: they have been given up, but they cannot be ended.

    What was finished is kept, the store is released, and nothing is written to it any more. Python waits for such
    threads at its end; who does not want to leaves with `os._exit`.
    """
