"""What goes wrong with a sweep as a whole. A point's failure is not an error: it is kept with the point."""

from __future__ import annotations


class StoreError(RuntimeError):
    """The place where results are to be kept cannot be used; the message says why."""


class LockedError(StoreError):
    """Another run is writing there; the message says which."""


class SweepStoppedError(RuntimeError):
    """A point failed and the sweep was to stop at once; what was finished is kept."""


class SchedulerError(ValueError):
    """The scheduler that was asked for cannot be used; the message says why."""
