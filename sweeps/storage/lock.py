"""One run a store: a lock that the system releases if its holder dies."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress

from filelock import FileLock, Timeout

from sweeps.errors import LockedError, StoreError, reason
from sweeps.storage.store import Store
from sweeps.watch.monitor import owner, read_state, write_state

# s. A reader who asks whether there is a run holds the lock for a moment.
PATIENCE = 0.2


@contextmanager
def locked(store: Store) -> Iterator[None]:
    """Hold the store.

    Raises
    ------
    LockedError
        If another run does; the message names it.
    StoreError
        If nothing can be written there.
    """
    lock = FileLock(store.lock, timeout=PATIENCE)
    try:
        store.file.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise taken(store) from None
    except (OSError, NotImplementedError) as problem:
        raise StoreError(f"{store.file} cannot be written: {reason(problem)}; choose another folder") from None
    try:
        # Only a message needs it, so a full disk is no matter.
        with suppress(OSError):
            store.parts.mkdir(exist_ok=True)
        write_state(store.progress, owner())
        yield
    finally:
        # Without a manifest the folder is nothing.
        if not store.manifest.exists():
            store.clear()
        # Removed while it is held: filelock takes no lock on a file that has lost its name, and tries again.
        with suppress(OSError):
            store.lock.unlink()
        lock.release()


def is_locked(store: Store) -> bool:
    """Whether a run holds the store now."""
    if not store.lock.exists():
        return False
    lock = FileLock(store.lock, timeout=0)
    try:
        lock.acquire()
    except (Timeout, OSError):
        return True
    lock.release()
    return False


def taken(store: Store) -> LockedError:
    """The refusal of a store that a run is writing."""
    return LockedError(f"{store.file} is being written by {holder(store)}; wait for it, or choose another folder")


def holder(store: Store) -> str:
    """The run that holds the store, as a reader would name it."""
    state = read_state(store.progress)
    if "pid" not in state:
        return "another run"
    return f"process {state['pid']} on {state['host']}, begun {state.get('started', 'just now')}"
