"""Threads of libraries that this process loads."""

from __future__ import annotations

VARIABLES = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "BLIS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)
"""Environment variables that libraries of linear algebra read when they are loaded."""
