"""The information that a motion gives about base parameters, criteria of it, and derivatives by the coefficients.

F = Σ X̄ᵀ diag(1/σ²) X̄ is the inverse covariance of the parameters that least squares will find.  Every criterion φ is
a function of F alone that is minimised; its slope is the symmetric matrix M with dφ = tr(M dF).  Derivatives by the
entries of X̄, which are cheap, become derivatives by q, q̇ and q̈ through s = Σ G_k X_k with constant G: reverse mode
through the same recorded program, which costs a few times the regressor itself and is exact.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from echelon.algebra import Argument, Function, Scalar, derivatives, smooth_function
from echelon.compute import Kernel
from echelon.dynamics import STATE, geometry_values, robot_function
from echelon.excite.problem.trajectory import Basis
from echelon.robot import Mechanism
from echelon.shared import Floats, InputError

if TYPE_CHECKING:  # processes of the solver need no schemas
    from echelon.shared import Optimality

ADJOINT = "adjoint"


@dataclass(frozen=True)
class OutputEntries:
    """Entries of one output."""

    entries: slice  # where they are among all entries
    columns: npt.NDArray[np.intp]  # base parameters that they belong to


class StateRegressor:
    """The entries of a reduced regressor at states, and their pullback, in machine code.

    With ``smooth``, a velocity in rad/s or m/s within which dry friction changes sign gradually, the entries have
    derivatives everywhere.  With loops, states are all positions, independent velocities and accelerations.
    """

    def __init__(
        self, mechanism: Mechanism, pivots: Sequence[int], smooth: float | None = None
    ) -> None:
        function = robot_function("regressor", mechanism, pivots)
        function = replace(
            function, entries=dict(sorted(function.entries.items()))
        )  # row by row
        if any(argument.name == "inputs" for argument in function.arguments):
            names = ", ".join(
                next(a.labels for a in function.arguments if a.name == "inputs")
            )
            raise InputError(
                f"effects need the measured inputs of {names}, which a trajectory does not determine"
            )
        self.recorded = function  # without smoothing
        self.function = (
            function if smooth is None else smooth_function(function, smooth)
        )
        self._geometry = geometry_values(mechanism, self.function.arguments)
        self._entries = Kernel(self.function, sparse=True)
        self._pullback = Kernel(pullback(self.function))

    @property
    def size(self) -> int:
        """Number of entries."""
        return len(self.function.entries)

    @property
    def rows(self) -> list[OutputEntries]:
        """The entries of each output."""
        indices = np.array(list(self.function.entries), dtype=np.intp).reshape(-1, 2)
        cuts = np.searchsorted(
            indices[:, 0], np.arange(self.function.shape[0] + 1)
        ).tolist()
        return [OutputEntries(slice(a, b), indices[a:b, 1]) for a, b in pairwise(cuts)]

    def entries(self, state: Mapping[str, Floats]) -> Floats:
        """Values of all entries, shape (N, size)."""
        return self._entries({**state, **self._geometry})

    def pulled(
        self, state: Mapping[str, Floats], adjoint: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Derivatives by q, q̇ and q̈, each of its shape, from those by the entries, of shape (N, size)."""
        found = self._pullback({**state, **self._geometry, ADJOINT: adjoint})
        sizes = [
            len(argument)
            for argument in self.function.arguments
            if argument.name in STATE
        ]
        by_q, by_qd, by_qdd = np.split(found, np.cumsum(sizes)[:-1], axis=1)
        return by_q, by_qd, by_qdd


def pullback(function: Function) -> Function:
    """Derivatives of Σ adjoint_k · entry_k by all states."""
    program = function.program
    labels = [",".join(map(str, index)) for index in function.entries]
    weights = [program.input(f"{ADJOINT}[{label}]") for label in labels]
    total = program.zero
    for weight, node in zip(weights, function.entries.values(), strict=True):
        total = total + weight * Scalar(program, node)
    states = [a for name in STATE for a in function.arguments if a.name == name]
    inputs = [node for argument in states for node in argument.nodes]
    found = derivatives(program, [total.node], inputs, reverse=True)
    adjoint = Argument(
        ADJOINT,
        tuple(w.node for w in weights),
        tuple(labels),
        ("1",) * len(labels),
        "weights",
    )
    axis = tuple(
        f"{argument.name}[{label}]" for argument in states for label in argument.labels
    )
    arguments = (*function.arguments, adjoint)
    return Function(
        f"{function.name}_pullback",
        program,
        arguments,
        {(j,): n for (_, j), n in found.items()},
        (axis,),
    )


def sample_times(duration: float, rate: float) -> Floats:
    """Samples that a criterion counts, from 0 on, the end left out."""
    return np.arange(max(round(duration * rate), 1)) / rate


class Information:
    """F(C) = F₀ + Σ X̄ᵀ diag(weights) X̄ over the samples of a motion with coefficients C.

    X̄ of some thousand samples stays in the caches, where forming F and the derivatives by X̄ from it is cheaper than
    making it twice.  Only entries that are not structurally zero are made.
    """

    def __init__(
        self,
        regressor: StateRegressor,
        basis: Basis,
        times: Floats,
        weights: Floats,
        prior: Floats,
    ) -> None:
        self.regressor, self.weights, self.prior = (
            regressor,
            weights,
            prior,
        )  # F₀ has shape (r, r)
        self.phi = tuple(
            np.ascontiguousarray(basis.values(times, order)) for order in range(3)
        )
        self.rows = regressor.rows

    @property
    def size(self) -> int:
        """Number of entries of all samples."""
        return len(self.phi[0]) * self.regressor.size

    def __call__(self, coefficients: Floats) -> MotionInformation:
        """The information of a motion with coefficients of shape (basis.size, n)."""
        state = {
            name: phi @ coefficients for name, phi in zip(STATE, self.phi, strict=True)
        }
        entries = self.regressor.entries(state)
        F = self.prior.copy()
        for rows, weight in zip(self.rows, self.weights, strict=True):
            block = entries[:, rows.entries]
            F[np.ix_(rows.columns, rows.columns)] += weight * (block.T @ block)
        return MotionInformation(self, state, entries, F)


@dataclass(frozen=True, eq=False)
class MotionInformation:
    """The information of one motion, with what its derivatives need."""

    source: Information
    state: dict[str, Floats]
    entries: Floats  # shape (N, entries)
    F: Floats  # shape (r, r); the information matrix

    def gradient(self, slope: Floats) -> Floats:
        """Derivatives by the coefficients, (basis.size, n), of a function φ of F with dφ = tr(M dF), M the slope."""
        source, adjoint = self.source, np.empty_like(self.entries)
        for rows, weight in zip(source.rows, source.weights, strict=True):
            part = slope[np.ix_(rows.columns, rows.columns)] * (2 * weight)
            adjoint[:, rows.entries] = self.entries[:, rows.entries] @ part
        pulled = source.regressor.pulled(self.state, adjoint)
        return np.hstack([phi.T for phi in source.phi]) @ np.vstack(pulled)


Slope = tuple[float, Floats]

SHARPNESS = 8
"""Exponent of the norms that stand for the largest and the smallest eigenvalue: high ones follow them closely, low ones
are smooth.  The result is a bound of the condition number, and reported is the number itself."""

NO_INFORMATION = 1e-100
"""Information that counts as none: squares of its inverse are still numbers."""


@dataclass(frozen=True, eq=False)
class OptimalityCriterion:
    """A function of the information matrix that is minimised."""

    # minus log det of F per parameter, the logarithm of the trace of its inverse, or of the condition number of the
    # observation matrix, which is smoothed
    name: Optimality
    # shape (r,); units in which parameters are measured: one of size ``scales[k]`` counts as one.  Of no influence
    # on where the first one is least.
    scales: Floats

    def evaluate(self, F: Floats) -> Slope:
        """The value, and the slope M of shape (r, r)."""
        units = np.outer(self.scales, self.scales)
        value, slope = _FUNCTIONS[self.name](F * units)
        return value, slope * units


def condition_number(F: Floats) -> float:
    """Condition number of an observation matrix with this information; infinite if columns depend on one another."""
    values = np.linalg.eigvalsh(F)
    if values[0] > 1e-15 * values[-1]:
        return float(np.sqrt(values[-1] / values[0]))
    return float("inf")


def log_det(F: Floats) -> float:
    """log det of an information matrix; −∞ if it is singular."""
    sign, value = np.linalg.slogdet(F)
    return float(value) if sign > 0 else -float("inf")


def _d_optimal(F: Floats) -> Slope:
    values, vectors = _spectrum(F)
    n = len(values)
    return -float(np.sum(np.log(values))) / n, -(vectors / values) @ vectors.T / n


def _a_optimal(F: Floats) -> Slope:
    values, vectors = _spectrum(F)
    trace = float(np.sum(1 / values))
    return float(np.log(trace)), -(vectors / values**2) @ vectors.T / trace


def _condition(F: Floats) -> Slope:
    values, vectors = _spectrum(F)
    if values[-1] <= NO_INFORMATION:  # nothing is seen, which is not well conditioned
        return -0.5 * float(np.log(np.finfo(float).eps)), np.zeros_like(F)
    large, small = values / values[-1], values[0] / values
    p = SHARPNESS
    up, down = np.sum(large**p), np.sum(small**p)
    value = 0.5 * (np.log(values[-1] / values[0]) + (np.log(up) + np.log(down)) / p)
    slopes = 0.5 * (large**p / up - small**p / down) / values
    return float(value), (vectors * slopes) @ vectors.T


def _spectrum(F: Floats) -> tuple[Floats, Floats]:
    """Eigenvalues, ascending, and eigenvectors; what is lost in rounding counts as the least that is not."""
    values, vectors = np.linalg.eigh(F)
    return np.maximum(
        values, max(np.finfo(float).eps * float(values[-1]), NO_INFORMATION)
    ), vectors


_FUNCTIONS: dict[str, Callable[[Floats], Slope]] = {
    "d_optimal": _d_optimal,
    "a_optimal": _a_optimal,
    "condition": _condition,
}
