"""Cone programmes: minimise ½ xᵀP x + qᵀx with b − A x in a product of cones, straight to the solver.

A modelling language would compile one programme per fit, and choosing the weight of a prior takes dozens.  The blocks
here are few and regular (ten numbers per body), so they are written down as sparse rows at once.  One form serves two
solvers: Clarabel, an interior-point method, and SCS, a first-order method for when the first one fails.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import EchelonError, InputError, MissingExtraError
from echelon.identification.physics.triangles import order

_KINDS = ("zero", "nonnegative", "second_order", "semidefinite", "exponential")
"""In the order in which SCS wants them."""

_UNITS = (1.0, 1e-2, 1e-4, 1e-6)
"""Units of the objective that are tried one after another."""
_ALMOST = "Almost"
_ITERATIONS, _WORK = 50_000, 2e10
"""Iterations of the first-order solver, and entries that they may go through together: a minute or so."""

SOLVED, INFEASIBLE, UNBOUNDED, FAILED = "solved", "infeasible", "unbounded", "failed"


@dataclass(frozen=True)
class ConeSolution:
    """What a solver found.

    Attributes
    ----------
    x : array of shape (n,)
    status : str
        ``"solved"``, ``"infeasible"``, ``"unbounded"`` or ``"failed"``.
    solver, message : str
        Who found it, and the solver's own word for it.
    iterations : int
    """

    x: Floats
    status: str
    solver: str
    message: str
    iterations: int


@dataclass
class ConeProgram:
    """A cone programme that grows block by block.

    Attributes
    ----------
    size : int
        Variables.
    """

    size: int
    _blocks: dict[str, list[tuple[Any, Floats]]] = field(default_factory=lambda: {kind: [] for kind in _KINDS})

    def add(self, kind: str, matrix: Any, offset: Floats) -> None:
        """Require matrix · x + offset to be in a cone.

        Parameters
        ----------
        kind : str
            ``"zero"``, ``"nonnegative"``, ``"second_order"`` (first entry bounds the norm of the others),
            ``"semidefinite"`` (upper triangle by columns, off-diagonal entries times √2), or ``"exponential"``
            (x, y, z with y exp(x/y) ≤ z).
        matrix : sparse or dense array of shape (rows, size)
        offset : array of shape (rows,)
        """
        from scipy.sparse import csr_array

        if len(offset):
            self._blocks[kind].append((csr_array(matrix), np.asarray(offset, dtype=float)))

    def solve(self, quadratic: Any, linear: Floats, solver: str = "CLARABEL") -> ConeSolution:
        """Minimise ½ xᵀ quadratic x + linearᵀ x.

        Parameters
        ----------
        quadratic : sparse array of shape (size, size)
            Symmetric, positive semidefinite.
        linear : array of shape (size,)
        solver : str
            ``"CLARABEL"`` or ``"SCS"``.

        Raises
        ------
        InputError
            For an unknown solver.
        MissingExtraError
            If the solver is not installed.
        """
        solvers: dict[str, Callable[..., ConeSolution]] = {"CLARABEL": _clarabel, "SCS": _scs}
        if solver.upper() not in solvers:
            raise InputError(f"unknown solver '{solver}' (valid: {', '.join(solvers)})")
        from scipy.sparse import csc_array, triu, vstack

        blocks = [block for kind in _KINDS for block in self._blocks[kind]]
        rows = csc_array(vstack([-matrix for matrix, _ in blocks]))
        offsets = np.concatenate([offset for _, offset in blocks])
        return solvers[solver.upper()](self, csc_array(triu(quadratic)), linear, rows, offsets)

    def lengths(self, kind: str) -> list[int]:
        """Rows of every block of a kind."""
        return [len(offset) for _, offset in self._blocks[kind]]


def solve_with_fallback(program: ConeProgram, quadratic: Any, linear: Floats, solver: str) -> ConeSolution:
    """Solve; if the solver gives up without a verdict, with the objective in other units, then by the other solver.

    Solvers stop by a mixture of relative and absolute tolerances, so the unit of the objective matters to them.

    Raises
    ------
    EchelonError
        If no attempt comes to a verdict.
    """
    attempts = []
    for unit in _UNITS if solver.upper() == "CLARABEL" else _UNITS[:1]:
        attempts.append(program.solve(unit * quadratic, unit * linear, solver))
        if attempts[-1].status != FAILED and not attempts[-1].message.startswith(_ALMOST):
            return attempts[-1]
    almost = next((found for found in attempts if found.status != FAILED), None)
    if almost is not None:
        return almost
    first, other = attempts[0], "SCS" if solver.upper() == "CLARABEL" else "CLARABEL"
    try:
        second = program.solve(quadratic, linear, other)
    except MissingExtraError:
        raise EchelonError(f"{first.solver} gave up ({first.message}) and {other} is not installed") from None
    if second.status == FAILED:
        raise EchelonError(
            f"{first.solver} gave up ({first.message}), and so did {other} ({second.message}): "
            "check the scale of the data and of the prior"
        )
    return second


def _clarabel(program: ConeProgram, P: Any, q: Floats, A: Any, b: Floats) -> ConeSolution:
    try:
        import clarabel
    except ImportError:
        raise MissingExtraError("clarabel", "identify") from None
    cones = [clarabel.ZeroConeT(k) for k in program.lengths("zero")]
    cones += [clarabel.NonnegativeConeT(k) for k in program.lengths("nonnegative")]
    cones += [clarabel.SecondOrderConeT(k) for k in program.lengths("second_order")]
    cones += [clarabel.PSDTriangleConeT(order(k)) for k in program.lengths("semidefinite")]
    cones += [clarabel.ExponentialConeT() for k in program.lengths("exponential") for _ in range(k // 3)]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    found = clarabel.DefaultSolver(P, q, A, b, cones, settings).solve()
    words = {
        "Solved": SOLVED,
        "AlmostSolved": SOLVED,
        "PrimalInfeasible": INFEASIBLE,
        "AlmostPrimalInfeasible": INFEASIBLE,
        "DualInfeasible": UNBOUNDED,
        "AlmostDualInfeasible": UNBOUNDED,
    }
    message = str(found.status)
    x = np.array(found.x, dtype=float)
    return ConeSolution(x, words.get(message, FAILED), "CLARABEL", message, found.iterations)


def _scs(program: ConeProgram, P: Any, q: Floats, A: Any, b: Floats) -> ConeSolution:
    try:
        import scs
    except ImportError:
        raise MissingExtraError("scs", "identify") from None
    from scipy.sparse import csc_matrix

    permutation = _lower_triangles(program)
    data = {"P": csc_matrix(P), "c": q, "A": csc_matrix(A)[permutation], "b": b[permutation]}
    cone = {
        "z": sum(program.lengths("zero")),
        "l": sum(program.lengths("nonnegative")),
        "q": program.lengths("second_order"),
        "s": [order(k) for k in program.lengths("semidefinite")],
        "ep": sum(program.lengths("exponential")) // 3,
    }
    entries = P.nnz + A.nnz + sum(order(k) ** 3 for k in program.lengths("semidefinite"))
    most = min(_ITERATIONS, 1 + int(_WORK / entries))
    found = scs.SCS(data, cone, verbose=False, eps_abs=1e-7, eps_rel=1e-7, max_iters=most).solve()
    info = found["info"]
    words = {1: SOLVED, 2: FAILED, -1: UNBOUNDED, -2: INFEASIBLE}
    status = words.get(info["status_val"], FAILED)
    return ConeSolution(np.array(found["x"]), status, "SCS", info["status"], info["iter"])


def _lower_triangles(program: ConeProgram) -> npt.NDArray[np.int64]:
    """Rows in the order of SCS, which takes lower triangles by columns where Clarabel takes upper ones."""
    start = sum(sum(program.lengths(kind)) for kind in _KINDS[:3])
    rows = list(range(start))
    for length in program.lengths("semidefinite"):
        n = order(length)
        place = {(i, j): start + j * (j + 1) // 2 + i for j in range(n) for i in range(j + 1)}
        rows += [place[j, i] for j in range(n) for i in range(j, n)]
        start += length
    rows += range(start, start + sum(program.lengths("exponential")))
    return np.array(rows, dtype=np.int64)
