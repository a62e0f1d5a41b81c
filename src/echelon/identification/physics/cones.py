"""Cone programmes: minimise ½ xᵀP x + qᵀx with b − A x in a product of cones, straight to the solver.

A modelling language would compile one programme per fit, and choosing the weight of a prior takes dozens.  The blocks
here are few and regular (ten numbers per body), so they are written down as sparse rows at once and
given to Clarabel, an interior-point method.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import EchelonError, MissingExtraError
from echelon.identification.physics.triangles import order

_KINDS = ("zero", "nonnegative", "second_order", "semidefinite", "exponential")

_UNITS = (1.0, 1e-2, 1e-4, 1e-6)
"""Units of the objective that are tried one after another."""
_ALMOST = "Almost"

SOLVED, INFEASIBLE, UNBOUNDED, FAILED = "solved", "infeasible", "unbounded", "failed"


@dataclass(frozen=True)
class ConeSolution:
    """What a solver found.

    Attributes
    ----------
    x : array of shape (n,)
    status : str
        ``"solved"``, ``"infeasible"``, ``"unbounded"`` or ``"failed"``.
    message : str
        The solver's status.
    iterations : int
    """

    x: Floats
    status: str
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

    def solve(self, quadratic: Any, linear: Floats) -> ConeSolution:
        """Minimise ½ xᵀ quadratic x + linearᵀ x with a symmetric, positive semidefinite, sparse quadratic part."""
        from scipy.sparse import csc_array, triu, vstack

        blocks = [block for kind in _KINDS for block in self._blocks[kind]]
        rows = csc_array(vstack([-matrix for matrix, _ in blocks]))
        offsets = np.concatenate([offset for _, offset in blocks])
        return _clarabel(self, csc_array(triu(quadratic)), linear, rows, offsets)

    def lengths(self, kind: str) -> list[int]:
        """Rows of every block of a kind."""
        return [len(offset) for _, offset in self._blocks[kind]]


def solve_in_units(program: ConeProgram, quadratic: Any, linear: Floats) -> ConeSolution:
    """Solve; if the solver gives up without a verdict, with the objective in other units.

    Solvers stop by a mixture of relative and absolute tolerances, so the unit of the objective matters to them.

    Raises
    ------
    EchelonError
        If no attempt comes to a verdict.
    """
    attempts = []
    for unit in _UNITS:
        attempts.append(program.solve(unit * quadratic, unit * linear))
        if attempts[-1].status != FAILED and not attempts[-1].message.startswith(_ALMOST):
            return attempts[-1]
    almost = next((found for found in attempts if found.status != FAILED), None)
    if almost is None:
        problem = f"the solver gave up ({attempts[0].message}): check the scale of the data and of the prior"
        raise EchelonError(problem)
    return almost


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
    return ConeSolution(x, words.get(message, FAILED), message, found.iterations)
