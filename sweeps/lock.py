"""One run a store: a lock that the system releases if its holder dies."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from filelock import FileLock, Timeout

from sweeps.errors import LockedError, StoreError
from sweeps.monitor import owner, read_state, write_state
from sweeps.store import Store


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
    lock = FileLock(store.lock, timeout=0)
    try:
        store.file.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    except Timeout:
        raise LockedError(
            f"{store.file} is being written by {holder(store)}; wait for it, or choose another folder"
        ) from None
    except (OSError, NotImplementedError) as problem:
        reason = getattr(problem, "strerror", None) or problem
        raise StoreError(f"{store.file} cannot be written: {reason}; choose another folder") from None
    try:
        yield
    finally:
        # Removed while it is held: filelock refuses a lock on a file that has lost its name.
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


def holder(store: Store) -> str:
    """The run that holds the store, as a reader would name it."""
    state = read_state(store.progress)
    if "pid" not in state:
        return "another run"
    return f"process {state['pid']} on {state['host']}, begun {state.get('started', 'just now')}"


def announce(store: Store) -> None:
    """Say who holds the store, before there is any progress."""
    started = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
    write_state(store.progress, owner() | {"started": started})
