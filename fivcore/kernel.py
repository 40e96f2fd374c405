"""How compiled kernels are compiled, and the array types that they and their callers share."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile once (kept on disk where there is a place), release the lock, let 1 / 0 be infinite.

    No fast-math: the order of operations is the one written, so results do not depend on where they are
    computed.
    """
    compiled = njit(nogil=True, error_model="numpy")(function)
    # Without a folder that may be written to, every process compiles anew.
    with suppress(RuntimeError):
        compiled.enable_caching()
    return cast(Function, compiled)
