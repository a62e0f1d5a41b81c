"""Types of NumPy arrays that many modules share, factorisations that NumPy lacks, and the threads of linear algebra."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]
SignArray = npt.NDArray[np.int8]


def pivoted_qr(matrix: Floats) -> tuple[Floats, Integers]:
    """Sizes on the diagonal of R, and the order of columns, of a QR that takes the longest remaining column next.

    Businger and Golub, Numerische Mathematik 7, 1965, with norms taken anew at every step, so that none is cancelled.

    >>> sizes, order = pivoted_qr(np.array([[1.0, 3.0, 3.0], [0.0, 4.0, 4.0]]))
    >>> sizes.round(9).tolist(), order.tolist()
    ([5.0, 0.8], [1, 0, 2])
    """
    rest: Floats = np.array(matrix, dtype=np.float64)
    order: Integers = np.arange(rest.shape[1])
    sizes: Floats = np.zeros(min(rest.shape))
    for k in range(len(sizes)):
        norms = np.linalg.norm(rest[k:, k:], axis=0)
        best = k + int(np.argmax(norms))
        rest[:, [k, best]], order[[k, best]] = rest[:, [best, k]], order[[best, k]]
        sizes[k] = norms[best - k]
        if not sizes[k]:
            break
        mirror = rest[k:, k] / sizes[k]
        mirror[0] += np.copysign(1.0, mirror[0])
        rest[k:, k:] -= np.outer(mirror / abs(mirror[0]), mirror @ rest[k:, k:])
    return sizes, order


def cut_at(sizes: Floats, explained: float, floor: float, clear: float) -> int:
    """How many of some descending sizes lie above what an error explains.

    Where sizes fall by less than ``clear`` there, the widest fall behind it counts.  Sizes below the floor are alike.

    >>> cut_at(np.array([1.0, 0.2, 1e-5, 4e-6]), 1e-4, 1e-12, 10.0)
    2
    """
    above = int((sizes > explained).sum())
    if above in (0, len(sizes)):
        return above
    clipped = np.maximum(sizes, floor)
    falls = clipped[:-1] / clipped[1:]
    if falls[above - 1] < clear:
        above += int(falls[above - 1 :].argmax())
    return above


def independent_columns(matrix: Floats, tolerance: float) -> list[int]:
    """Columns of which more than a tolerance is left when those chosen before are projected out.

    The tolerance is relative to the length of a column that is longer than 1.

    >>> independent_columns(np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 1.0]]), 1e-9)
    [0, 2]
    """
    basis: Floats = np.zeros((0, len(matrix)))
    chosen: list[int] = []
    for k, column in enumerate(matrix.T):
        rest = column
        for _ in range(2):  # twice is enough for orthogonality (Kahan)
            rest = rest - basis.T @ (basis @ rest)
        size = np.linalg.norm(rest)
        if size > tolerance * max(1.0, float(np.linalg.norm(column))):
            basis = np.vstack([basis, rest / size])
            chosen.append(k)
    return chosen


@contextmanager
def one_thread() -> Iterator[None]:
    """Linear algebra on one thread, so that results are the same on machines with more and with fewer."""
    # matrices are small here: threads that wait for one another cost more than they bring, most of all where others
    # use the processor, too
    if sys.platform == "emscripten":  # has no threads
        yield
        return
    with _libraries("scipy.linalg" in sys.modules).limit(limits=1, user_api="blas"):
        yield


@cache
def _libraries(scipy: bool) -> Any:  # noqa: ARG001 (looked for anew once SciPy is there)
    """The libraries of linear algebra in this process; SciPy brings one of its own."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
