"""The Jacobian of closure equations and what velocities alone cause, with bounds while positions stay in boxes.

The elimination that functions of closed states have inside would make bounds useless: quotients of intervals grow.  So
what follows from the closures is bounded by :mod:`echelon.excite.loops.enclosures`, from these.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from echelon.arrays import Floats
from echelon.dynamics.arguments import Arguments, geometry_values
from echelon.excite.constraints.state import enclosures_of
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Argument, Function
from echelon.program.intervals import Interval
from echelon.program.tape import Program, Scalar
from echelon.regressor.loops.dependent_motion import DependentMotion

Index = tuple[int, ...]


class ClosureBounds:
    """Closure equations of a mechanism, those that count, in units of lengths and speeds.

    Parameters
    ----------
    mechanism : Mechanism
        With loops.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.

    Attributes
    ----------
    units : array of shape (velocities,)
        Units of the velocity coordinates.
    """

    def __init__(self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None) -> None:
        program = Program()
        motion = DependentMotion(mechanism, program)
        place = {row: k for k, row in enumerate(motion.row_units)}
        speeds = {name: program.input(f"qd[{name}]") for name in mechanism.velocities}
        columns = {name: k for k, name in enumerate(speeds)}
        jacobian: dict[Index, Scalar] = {(place[r], columns[n]): entry for (r, n), entry in motion.jacobian.items()}
        bias: dict[Index, Scalar] = {(place[row],): value for row, value in motion.bias(speeds).items()}
        nodes = tuple(speed.node for speed in speeds.values())
        self._qd = Argument("qd", nodes, mechanism.velocities, ("SI",) * len(nodes))
        self.units = np.array([float(unit) for unit in motion.units.values()])
        self._row_units = np.array([float(unit) for unit in motion.row_units.values()])
        self._jacobian = _Code("closure_jacobian", jacobian, (), mechanism, program, symbols)
        self._bias = _Code("closure_bias", bias, (self._qd,), mechanism, program, symbols)

    def jacobian(self, q: Floats) -> Floats:
        """The Jacobian by velocity coordinates, shape (N, equations, velocities)."""
        found = np.zeros((len(q), len(self._row_units), len(self.units)))
        found[:, *self._jacobian.places] = self._jacobian.kernel({"q": q, **self._jacobian.geometry})
        scaled: Floats = found * (self.units / self._row_units[:, None])
        return scaled

    def jacobian_enclosures(self, q: Interval) -> Interval:
        """Bounds of the Jacobian while positions stay in intervals, each of shape (cells, equations, velocities).

        Parameters
        ----------
        q : (array, array)
            Least and largest positions, of shape (cells, positions).
        """
        low, high = self._jacobian.enclosures({"q": q}, (len(self._row_units), len(self.units)))
        scale = self.units / self._row_units[:, None]
        return low * scale, high * scale

    def bias_enclosures(self, q: Interval, qd: Interval) -> Interval:
        """Bounds of J̇ q̇, each of shape (cells, equations).

        Parameters
        ----------
        q, qd : (array, array)
            Least and largest positions and velocities.
        """
        low, high = self._bias.enclosures({"q": q, "qd": qd}, (len(self._row_units),))
        return low / self._row_units, high / self._row_units


class _Code:
    """A function of q, and perhaps of the velocities of all coordinates."""

    def __init__(
        self,
        name: str,
        values: Mapping[Index, Scalar],
        more: tuple[Argument, ...],
        mechanism: Mechanism,
        program: Program,
        symbols: Mapping[str, float] | None,
    ) -> None:
        nodes = {index: value.node for index, value in values.items() if not value.is_zero}
        arguments = (*Arguments(mechanism, program, {}).of(["q", "symbols"], nodes.values()), *more)
        rank = max((len(index) for index in nodes), default=1)
        axes = tuple(tuple(map(str, range(1 + max(i[k] for i in nodes)))) if nodes else () for k in range(rank))
        self.places = np.array(list(nodes), dtype=np.intp).reshape(-1, rank).T
        self.geometry = geometry_values(mechanism, arguments, symbols)
        self._function = Function(name, program, arguments, nodes, axes)
        self.kernel = Kernel(self._function, sparse=True)

    def enclosures(self, ranges: Mapping[str, Interval], shape: tuple[int, ...]) -> Interval:
        bounds = enclosures_of(self._function, self.geometry, ranges)
        found = tuple(np.zeros((len(bounds[0]), *shape)) for _ in bounds)
        for whole, part in zip(found, bounds, strict=True):
            whole[:, *self.places] = part
        return found[0], found[1]
