"""Closure equations in machine code, with derivatives: what a solver asks for at every step.

The closure equations c(q) of a motion vanish, and so do their derivatives by time, J q̇ and J q̈ + b.  A function of the
whole state then changes with the independent coordinates through multipliers λ of these equations, a set for each of
the three (the implicit function theorem).  Beside J and b that takes the derivatives of Σ A_ij J_ij and of λᵀ b by the
state, for constant A and λ: reverse mode through the recorded equations.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.dynamics.arguments import Arguments, geometry_values
from echelon.excite.constraints.state import enclosures_of
from echelon.excite.pullback import ADJOINT, pullback
from echelon.machine.kernel import Kernel
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.program.derivatives import derivatives
from echelon.program.function import Function
from echelon.program.intervals import Interval
from echelon.program.tape import Program, Scalar
from echelon.regressor.loops.closure_values import ClosureValues
from echelon.regressor.loops.closures import record_closures
from echelon.regressor.probes import Probes
from echelon.regressor.steps import Recorder

Floats = npt.NDArray[np.float64]
Index = tuple[int, ...]


class ClosureKernels(ClosureValues):
    """The values of :class:`ClosureValues`, sooner, and derivatives of them.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.

    Attributes
    ----------
    row_units : array of shape (equations,)
        By which equations are divided: the characteristic length, or one.
    """

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        super().__init__(mechanism, symbols)
        self.row_units = np.where(self.is_length, self.length, 1.0)
        recorded = _Recorded(mechanism, self.freedoms)
        self._equations = _Code(recorded.equations(), mechanism, symbols)
        self._jacobian = _Code(recorded.jacobian(), mechanism, symbols)
        self._bias = _Code(recorded.bias(), mechanism, symbols)
        rows, columns = self._jacobian.places
        self._scales = self.units[columns] / self.row_units[rows]

    def at(self, q: Floats) -> tuple[Floats, Floats]:
        """Values of the equations, shape (N, equations), and their Jacobian by freedoms, (N, equations, freedoms)."""
        values = np.zeros((len(q), len(self.row_units)))
        values[:, self._equations.places[0]] = self._equations(q)
        jacobian = np.zeros((len(q), len(self.row_units), len(self.freedoms)))
        jacobian[:, *self._jacobian.places] = self._jacobian(q) * self._scales
        return values / self.row_units, jacobian

    def bias(self, q: Floats, qd: Floats) -> Floats:
        """Second derivatives of the equations by time while the velocity coordinates stay as they are, (N, equations).

        Parameters
        ----------
        q : array of shape (N, positions)
        qd : array of shape (N, velocities)
        """
        values = np.zeros((len(q), len(self.row_units)))
        values[:, self._bias.places[0]] = self._bias(q, qd)
        return values / self.row_units

    def jacobian_enclosures(self, q: Interval) -> Interval:
        """Bounds of the Jacobian while positions stay in intervals, each of shape (cells, equations, freedoms).

        Parameters
        ----------
        q : (array, array)
            Least and largest positions, of shape (cells, positions).
        """
        low, high = self._jacobian.enclosures({"q": q})
        shape = len(low), len(self.row_units), len(self.freedoms)
        bounds = np.zeros(shape), np.zeros(shape)
        for bound, part in zip(bounds, (low, high), strict=True):
            bound[:, *self._jacobian.places] = part * self._scales
        return bounds

    def bias_enclosures(self, q: Interval, qd: Interval) -> Interval:
        """Bounds of :meth:`bias`, each of shape (cells, equations).

        Parameters
        ----------
        q, qd : (array, array)
            Least and largest positions and velocities.
        """
        low, high = self._bias.enclosures({"q": q, "qd": qd})
        shape = len(low), len(self.row_units)
        bounds = np.zeros(shape), np.zeros(shape)
        for bound, part in zip(bounds, (low, high), strict=True):
            bound[:, self._bias.places[0]] = part
        return bounds[0] / self.row_units, bounds[1] / self.row_units

    def pulled_jacobian(self, q: Floats, adjoint: Floats) -> Floats:
        """Derivatives of Σ adjoint · Jacobian by the positions, shape (N, positions).

        Parameters
        ----------
        q : array of shape (N, positions)
        adjoint : array of shape (N, equations, freedoms)
        """
        return self._jacobian.pulled(adjoint[:, *self._jacobian.places] * self._scales, q)

    def pulled_bias(self, q: Floats, qd: Floats, adjoint: Floats) -> tuple[Floats, Floats]:
        """Derivatives of Σ adjoint · bias by positions and by velocities.

        Parameters
        ----------
        q : array of shape (N, positions)
        qd : array of shape (N, velocities)
        adjoint : array of shape (N, equations)
        """
        found = self._bias.pulled((adjoint / self.row_units)[:, self._bias.places[0]], q, qd)
        return found[:, : q.shape[1]], found[:, q.shape[1] :]


class _Code:
    """Machine code of a function and of its pullback."""

    def __init__(self, function: Function, mechanism: Mechanism, symbols: Mapping[str, float] | None) -> None:
        self.places = np.array(list(function.entries), dtype=np.intp).reshape(-1, len(function.axes)).T
        self._values = geometry_values(mechanism, function.arguments, symbols)
        self._function = function
        self._kernel = Kernel(function, sparse=True)
        self._pullback = Kernel(pullback(function))

    def __call__(self, *state: Floats) -> Floats:
        return self._kernel({**dict(zip(("q", "qd"), state, strict=False)), **self._values})

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        return enclosures_of(self._function, self._values, ranges)

    def pulled(self, adjoint: Floats, *state: Floats) -> Floats:
        values = dict(zip(("q", "qd"), state, strict=False))
        return self._pullback({**values, **self._values, ADJOINT: np.ascontiguousarray(adjoint)})


class _Recorded:
    """The closure equations, their Jacobian and what their second derivatives are without accelerations."""

    def __init__(self, mechanism: Mechanism, freedoms: tuple[str, ...]) -> None:
        self.mechanism, self.freedoms = mechanism, freedoms
        self.program = Program()
        self._recorder = Recorder(mechanism, self.program)
        self._found = record_closures(mechanism, self._recorder, Probes(mechanism, self._recorder))
        self._rows = tuple(str(row) for row in range(len(self._found.owners)))

    def equations(self) -> Function:
        nodes: dict[Index, int] = {(row,): node for row, node in enumerate(self._found.equations)}
        return self._function("closures", nodes, (self._rows,), ["q"])

    def jacobian(self) -> Function:
        place = {name: k for k, name in enumerate(self.freedoms)}
        nodes: dict[Index, int] = {(row, place[name]): node for (row, name), node in self._found.jacobian.items()}
        return self._function("closure_jacobian", nodes, (self._rows, self.freedoms), ["q"])

    def bias(self) -> Function:
        """Σ ∂(J q̇)/∂q · dq/dt."""
        program, velocities = self.program, set(self.mechanism.velocities)
        opening: dict[int, Scalar] = {}
        for (row, name), node in self._found.jacobian.items():
            if name in velocities:
                opening[row] = opening.get(row, program.zero) + Scalar(program, node) * program.input(f"qd[{name}]")
        inputs = [program.input(f"q[{name}]").node for name in self.mechanism.positions]
        slopes = derivatives(program, [value.node for value in opening.values()], inputs)
        rates, rows = self._rates(), list(opening)
        total: dict[Index, Scalar] = {}
        for (k, j), node in slopes.items():
            key = (rows[k],)
            total[key] = total.get(key, program.zero) + Scalar(program, node) * rates[j]
        nodes = {key: value.node for key, value in total.items() if not value.is_zero}
        return self._function("closure_bias", nodes, (self._rows,), ["q", "qd"])

    def _rates(self) -> list[Scalar]:
        """Rates of the positions; a quaternion's is half its product with the velocity."""
        found: list[Scalar] = []
        for motion in self.mechanism.motions:
            if motion.name in self.mechanism.dependent:
                continue
            here = self._recorder.coordinates[motion.name]
            if motion.kind is not MotionKind.BALL:
                found += here.rate
                continue
            (w, x, y, z), (a, b, c) = here.position, here.rate
            twice = (-x * a - y * b - z * c, w * a + y * c - z * b, w * b + z * a - x * c, w * c + x * b - y * a)
            found += [value / 2 for value in twice]
        return found

    def _function(
        self, name: str, nodes: dict[Index, int], axes: tuple[tuple[str, ...], ...], arguments: list[str]
    ) -> Function:
        kept = {key: node for key, node in nodes.items() if node != self.program.zero.node}
        made = Arguments(self.mechanism, self.program, {}).of([*arguments, "symbols"], kept.values())
        return Function(name, self.program, made, kept, axes)
