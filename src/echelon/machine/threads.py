"""Threads of linear algebra, on whose number the order of additions depends, and with it the last digits."""

from __future__ import annotations

from contextlib import AbstractContextManager

VARIABLES = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "BLIS_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""Environment variables that libraries of linear algebra read when they are loaded."""


def one_thread() -> AbstractContextManager[object]:
    """Linear algebra on one thread, so that results are the same on machines with more and with fewer.

    Matrices are small here: threads that wait for one another cost more than they bring.
    """
    from threadpoolctl import threadpool_limits

    limits: AbstractContextManager[object] = threadpool_limits(1, user_api="blas")
    return limits
