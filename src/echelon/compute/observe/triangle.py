"""The R-factor of a whole observation matrix: all that least squares needs to know of it.

    [W y] = Q [R  Qᵀy; 0  ρ],   ‖W ζ − y‖² = ‖R ζ − Qᵀy‖² + ρ²

so ρ is the norm of the residual that no ζ can remove, and R has the singular values and the column norms of W.

R is made by Householder reflectors in blocks of rows: LAPACK's ``dtpqrt`` clears a block below a triangle and touches
no row twice (Buttari, Langou, Kurzak and Dongarra, Parallel Computing 35, 2009).  For the tall slim matrices of robots
it takes two thirds of the time of ``dgeqrf`` on the triangle and the block.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np

from echelon.shared import Flags, Floats, InputError, extra, listed

ROWS = 384
"""Rows of a block: its columns stay in the cache."""

_REFLECTORS = 8
"""Reflectors that are applied together."""


@dataclass(frozen=True, repr=False)
class Triangle:
    """R, Qᵀy and the residual of a least-squares problem with n parameters."""

    parameters: tuple[str, ...]
    R: Floats  # upper triangular, shape (n, n), with a diagonal that is not negative
    qty: Floats  # the first n entries of Qᵀy
    residual: float  # norm of W ζ − y at the least-squares solution, in the unit of the (weighted) outputs
    samples: int
    rows: int  # rows of W

    @cached_property
    def scales(self) -> Floats:
        """Norms of the columns of W, shape (n,)."""
        return column_norms(self.R)

    @cached_property
    def safe_scales(self) -> Floats:
        """Norms of the columns of W, by which columns can be divided: 1 for those that are zero."""
        return np.where(self.scales == 0, 1.0, self.scales)

    @cached_property
    def scaled(self) -> Floats:
        """R with columns of norm 1; zero columns stay."""
        return self.R / self.safe_scales

    @cached_property
    def singular_values(self) -> Floats:
        """Singular values of W, descending, shape (n,)."""
        return np.asarray(np.linalg.svd(self.R, compute_uv=False), dtype=np.float64)

    @cached_property
    def scaled_singular_values(self) -> Floats:
        """Singular values of W with columns scaled to norm 1 (zero columns stay), descending, shape (n,)."""
        return np.asarray(
            np.linalg.svd(self.scaled, compute_uv=False), dtype=np.float64
        )

    @property
    def condition(self) -> float:
        """Condition number of W in the 2-norm; it depends on the units of the parameters."""
        return _condition(self.singular_values)

    @property
    def scaled_condition(self) -> float:
        """Condition number of W with columns scaled to norm 1, within √n of the best column scaling (van der Sluis)."""
        return _condition(self.scaled_singular_values)

    @property
    def precision(self) -> float:
        """Relative size below which a singular value of the scaled W cannot be told from zero."""
        return float(np.finfo(float).eps) * max(self.rows, len(self.parameters))

    @property
    def rank(self) -> int:
        """Numerical rank of W with scaled columns."""
        values = self.scaled_singular_values
        return int(np.sum(values > self.precision * values[0])) if values.size else 0

    def solve(self) -> Floats:
        """The least-squares solution, shape (n,); refused where the data do not determine all parameters."""
        if self.rank < len(self.parameters):
            raise InputError(self._undetermined())
        # LU with row exchanges of a triangle exchanges nothing, so this is back substitution
        return np.linalg.solve(self.scaled, self.qty) / self.scales

    def _undetermined(self) -> str:
        n, rank = len(self.parameters), self.rank
        start = f"the data determine {rank} of {n} parameters"
        if self.rows < n:
            return f"{start}: there are only {self.rows} rows; give more samples"
        directions = np.linalg.svd(self.scaled)[2][rank:]
        weight = np.abs(directions).max(axis=0)
        involved = [
            self.parameters[k]
            for k in np.argsort(-weight.round(9), kind="stable")
            if weight[k] > 1e-3
        ]
        return f"{start}; those they leave open involve {listed(involved)}: excite them, or leave parameters out with select()"

    def __repr__(self) -> str:
        return (
            f"Triangle({self.rows} × {len(self.parameters)}, {self.samples} samples, "
            f"condition {self.condition:.3g}, scaled {self.scaled_condition:.3g}, residual {self.residual:.6g})"
        )


def column_norms(matrix: Floats) -> Floats:
    """Norms of the columns, safe from overflow and underflow; shape (n,)."""
    if not matrix.size:
        return np.zeros(matrix.shape[1])
    largest = np.abs(matrix).max(axis=0)
    safe = np.where((largest == 0) | ~np.isfinite(largest), 1.0, largest)
    norms: Floats = safe * np.sqrt(((matrix / safe) ** 2).sum(axis=0))
    return norms


def safe_norms(matrix: Floats) -> Floats:
    """Norms of the columns, 1 for those that are zero, shape (n,)."""
    norms = column_norms(matrix)
    return np.where(norms == 0, 1.0, norms)


def upper_triangle(*parts: Floats, start: Floats | None = None) -> Floats:
    """R of a triangle, if there is one, and matrices below it, with a diagonal that is not negative."""
    n = parts[0].shape[1]
    R = (
        np.zeros((n, n), order="F")
        if start is None
        else np.array(start, order="F", dtype=np.float64)
    )
    for part in parts:
        for row in range(0, len(part), ROWS):
            update_triangle(
                R, np.array(part[row : row + ROWS].T, order="C", dtype=np.float64)
            )
    return positive(R)


def update_triangle(R: Floats, columns: Floats) -> None:
    """R of [R; block] in place, from the columns of the block, shape (n, rows); R is in Fortran's order.

    The columns are overwritten, and signs on the diagonal are any.
    """
    n, rows = columns.shape
    if not columns.size:
        return
    together = min(_REFLECTORS, n)
    room = np.empty(2 * together * n)
    sizes = [
        ctypes.c_int(size) for size in (rows, n, 0, together, n, rows, together, 0)
    ]
    m, n_, pentagon, nb, ldr, ldb, ldt, info = (ctypes.byref(size) for size in sizes)
    t, work = room.ctypes.data, room[together * n :].ctypes.data
    _dtpqrt()(
        m,
        n_,
        pentagon,
        nb,
        R.ctypes.data,
        ldr,
        columns.ctypes.data,
        ldb,
        t,
        ldt,
        work,
        info,
    )


@cache
def _dtpqrt() -> Callable[..., None]:
    """LAPACK's routine in SciPy, called without the interpreter's lock, which SciPy's own wrapper keeps."""
    with extra("identify"):
        from scipy.linalg import cython_lapack

    capsule, python = cython_lapack.__pyx_capi__["dtpqrt"], ctypes.pythonapi
    name = ctypes.PYFUNCTYPE(ctypes.c_char_p, ctypes.py_object)(
        ("PyCapsule_GetName", python)
    )
    pointer = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
        ("PyCapsule_GetPointer", python)
    )
    integer, array = ctypes.c_void_p, ctypes.c_void_p
    signature = (
        *[integer] * 4,
        array,
        integer,
        array,
        integer,
        array,
        integer,
        array,
        integer,
    )
    return ctypes.CFUNCTYPE(None, *signature)(pointer(capsule, name(capsule)))


def positive(R: Floats) -> Floats:
    """A triangle with its rows' signs chosen so that the diagonal is not negative."""
    signs = np.where(np.diagonal(R) < 0, -1.0, 1.0)
    result: Floats = R * signs[:, None]
    result[_below(len(R))] = 0.0
    return result


@cache
def _below(n: int) -> Flags:
    """Where a triangle of some size is zero; NumPy's triu makes it anew in every call, slower than QR."""
    return np.tri(n, k=-1, dtype=bool)


def _condition(values: Floats) -> float:
    if not values.size:
        return 1.0
    return float(values[0] / values[-1]) if values[-1] > 0 else float("inf")
