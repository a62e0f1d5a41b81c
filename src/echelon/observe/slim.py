"""R-factors of slim matrices that are in memory, by the kernel that also serves streams of samples.

LAPACK spreads matrices of a few thousand entries over threads, which wait for one another longer than they work, the
more so where other threads keep the processors busy.  The kernel does the same on one thread, and frees the
interpreter meanwhile.
"""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from echelon.arrays import Floats
from echelon.machine.batch import aligned
from echelon.machine.kernel import loaded
from echelon.machine.target import Target, host
from echelon.machine.text import module_text
from echelon.observe.qr_text import qr_text
from echelon.observe.tiles import GROUP, tiling
from echelon.observe.triangle import positive

_POINTER, _INTEGER = ctypes.c_void_p, ctypes.c_int64
_UPDATE = (_POINTER, _POINTER, _INTEGER, _POINTER, _POINTER, _POINTER)


class SlimQr:
    """Householder reflectors in machine code, for matrices of any shape.

    Parameters
    ----------
    target : Target, optional
        The processor at hand if omitted.

    Examples
    --------
    >>> SlimQr().triangle(np.array([[3.0, 1.0], [4.0, 7.0]])).round(9)
    array([[5. , 6.2],
           [0. , 3.4]])
    """

    def __init__(self, target: Target | None = None) -> None:
        target = target or host()
        self._rows = tiling(target).rows
        self._kernel = loaded(module_text(qr_text(tiling(target))), target)
        self._update = self._kernel.function("update", _UPDATE)

    def triangle(self, *parts: Floats) -> Floats:
        """R of matrices on top of one another, with a diagonal that is not negative.

        Parameters
        ----------
        *parts : arrays of shape (rows, n)
            Missing rows count as zero.

        Returns
        -------
        array of shape (n, n)
        """
        n = parts[0].shape[1]
        if not n:
            return np.zeros((0, 0))
        groups = -(-n // GROUP)
        R, numbers = aligned((n, n), zero=True), np.arange(n, dtype=np.int64)
        block = aligned((n, self._rows))
        v, t = aligned((groups * GROUP * self._rows,)), aligned((groups * GROUP * GROUP,))
        for part in parts:
            for start in range(0, len(part), self._rows):
                rows = part[start : start + self._rows]
                block[:, : len(rows)] = rows.T
                block[:, len(rows) :] = 0.0
                addresses = (block, numbers, R, v, t)
                place, columns, found, reflectors, triangles = (some.ctypes.data for some in addresses)
                self._update(place, columns, n, found, reflectors, triangles)
        return positive(R)


@cache
def slim_qr() -> SlimQr:
    """The kernel of the processor at hand, made once."""
    return SlimQr()
