"""Errors of a sweep as a whole. The failure of a point is not an error: it is stored with the point."""

import zipfile
import zlib

# What reading a damaged or foreign file raises; netCDF4 reports damage as a RuntimeError.
UNREADABLE = (OSError, ValueError, KeyError, RuntimeError, EOFError, zipfile.BadZipFile, zlib.error)

# What a user may do. Messages are for Python; the command line replaces its arguments by options.
HINT_START_OVER = "start over (fresh=True)"
HINT_OTHER_PATH = "choose another path"
HINT_EITHER = f"{HINT_OTHER_PATH}, or {HINT_START_OVER}"
HINT_ADOPT = "keep them with adopt=20 if 20 stored points, computed again, agree"
HINT_MOVE = f"move it away, or {HINT_OTHER_PATH}"
DAMAGED = f"is damaged or not netCDF; {HINT_MOVE}"


def reason(problem: BaseException) -> str:
    """The reason why a file operation failed, in a few words."""
    if isinstance(problem, OSError):
        return problem.strerror or str(problem)
    # The netCDF library gives no other reason when a disk is full.
    return f"{problem} (is the disk full?)" if "HDF error" in str(problem) else str(problem)


def message(problem: BaseException) -> str:
    """Type and message of an exception, in one line."""
    kind = "" if isinstance(problem, InputError) else f"{type(problem).__name__}: "
    return " ".join(f"{kind}{problem}".split())


class StoreError(RuntimeError):
    """The results cannot be stored at this place; the message gives the reason."""


class LockedError(StoreError):
    """Another run is writing there; the message names it."""


class DamagedError(StoreError):
    """A part is damaged or missing; `part` is its file name."""

    def __init__(self, part: str, folder: str = "") -> None:
        super().__init__(f"{part} in {folder} is damaged; the same run computes its points again")
        self.part = part


class SweepStoppedError(RuntimeError):
    """The run stopped at a failure, as requested, or because its first points all failed with the same error."""


class MixedWarning(UserWarning):
    """Points of one result are computed in different environments; the message names the differences."""


class FailedPointsWarning(UserWarning):
    """Points of a result failed; the message counts them and has the reason of the first."""


class PendingWarning(UserWarning):
    """Shares of a result are missing; the message names them."""


class InputError(ValueError):
    """An argument is unusable; the message names it, its value and what is allowed."""


class UndeclaredError(InputError):
    """A function returns a result that its sweep does not declare; no point fails for that reason."""


class MissingFileError(InputError, FileNotFoundError):
    """The file does not exist; the message names it, and the command that creates it."""


class SchedulerError(InputError):
    """The requested scheduler is unusable; the message gives the reason."""


class WorkerDied(Exception):  # noqa: N818 - the run handles it
    """A worker died while it computed a batch."""


class ClusterLostError(RuntimeError):
    """The scheduler or all workers disappeared during a run; finished batches stay in the store."""


class AbandonedError(KeyboardInterrupt):
    """A second interrupt came while threads compute: Python waits for them at its end, `os._exit` does not."""
