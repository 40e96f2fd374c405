"""Decorators that compile kernels with Numba, and array types."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numba.extending import register_jitable
from numpy.typing import NDArray

from fivcore import kernel_store

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Function = TypeVar("Function", bound=Callable[..., Any])


class ReadOnlyArrays:
    """Base of data classes: every array in them is read-only."""

    def __post_init__(self) -> None:
        for part in vars(self).values():
            if isinstance(part, np.ndarray):
                part.setflags(write=False)


_OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}


def _labelled(function: Function, options: dict[str, Any]) -> Function:
    """Store the options in an attribute: they affect the last bits but are not part of the code."""
    texts = {name: sorted(value) if isinstance(value, set) else str(value) for name, value in options.items()}
    cast(Any, function).compiled_with = texts
    return function


def kernel(function: Function) -> Function:
    """Compile a function that Python calls; it releases the lock, and 1 / 0 is infinite.

    Operations keep the order in which they are written (no fast-math).
    """
    options = _OPTIONS | {"fastmath": False}
    return cast(Any, kernel_store.attach(njit(**options)(_labelled(function, options))))


def _part(**more: Any) -> Callable[[Function], Function]:
    """Compile a function into the kernels that call it; for Python it stays as it is."""
    # Without its own `fastmath` it would inherit that of the kernel that compiles it first.
    options = _OPTIONS | {"no_cfunc_wrapper": True} | more
    compiling: Any = register_jitable(**options)
    return lambda function: compiling(_labelled(function, options))


# Compiled as a call, or inlined where a call would cost more than the body ...
called = _part(fastmath=False)
inlined = _part(fastmath=False, forceinline=True)
# ... with fused multiply-add in the order written ...
contracted = _part(fastmath={"contract"}, forceinline=True)
# ... or with sums in any order, the only ones that use vector registers. Their width determines the last bits,
# which therefore agree only between machines of one kind, like those of eigenvectors.
reordered = _part(fastmath={"reassoc", "contract", "nsz"}, forceinline=True)
reordered_call = _part(fastmath={"reassoc", "contract", "nsz"})
