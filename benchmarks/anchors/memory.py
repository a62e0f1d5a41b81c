"""How fast this machine writes memory, the bound of whatever stores a large regressor."""

from __future__ import annotations

import ctypes

import numpy as np
import numpy.typing as npt

from anchors.build import HERE, OPTIMISED, library

_LINE = 64  # bytes


def aligned(shape: tuple[int, ...]) -> npt.NDArray[np.float64]:
    """A touched array that begins at a line of the cache."""
    size = int(np.prod(shape))
    space = np.ones(size + _LINE // 8)
    start = -space.ctypes.data % _LINE // 8
    return space[start : start + size].reshape(shape)


def write_seconds(
    to: npt.NDArray[np.float64], threads: int, *, past_caches: bool = True
) -> float:
    """Seconds to fill an aligned array, past the caches or by the C library's own fill."""
    built = library([HERE / "memory.cpp"], ("-std=c++17", *OPTIMISED))
    built.anchor_write.restype = ctypes.c_double
    pointer, count = ctypes.c_void_p(to.ctypes.data), ctypes.c_int64(to.size)
    return float(
        built.anchor_write(
            pointer, count, ctypes.c_int(threads), ctypes.c_int(past_caches)
        )
    )
