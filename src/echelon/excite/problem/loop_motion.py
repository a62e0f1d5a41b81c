"""Motions of mechanisms with loops: all coordinates from the independent ones, and derivatives by these.

Configurations are followed from the assembly pose in short steps, as :class:`CompiledAssembly` does it, but samples
that cannot be closed are marked and not refused, because a solver tries motions beyond what the loops allow.  A sample
that was closed when it was last asked for is followed from there.  Velocities and accelerations of all coordinates are
recorded functions of all positions and of the independent rates, so their derivatives are pullbacks in machine code;
derivatives by all positions count along the motions of the independent coordinates.

The elimination inside functions of closed states would make interval bounds useless, because quotients of intervals
grow.  So :class:`ClosureBounds` bounds the closure equations, and :mod:`echelon.excite.verify.loop_enclosures` what
follows from them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.dynamics.arguments import Arguments, geometry_values
from echelon.dynamics.closed_states import Builder, CompiledAssembly
from echelon.dynamics.loop_functions import closed_accelerations, closed_velocities, motion_function
from echelon.excite.problem.information import ADJOINT, pullback
from echelon.excite.problem.state_limits import enclosures_of
from echelon.machine.kernel import Kernel
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Argument, Function
from echelon.program.intervals import Interval
from echelon.program.tape import Program, Scalar
from echelon.regressor.loops.assembly import LARGEST_CORRECTION, STRIDE
from echelon.regressor.loops.closed_motion import largest, normalised, position_rates
from echelon.regressor.loops.dependent_motion import DependentMotion
from echelon.seeds import DEFAULT_SEED, random_generator

Index = tuple[int, ...]


class ClosureBounds:
    """Closure equations of a mechanism, those that count, in units of lengths and speeds."""

    def __init__(self, mechanism: Mechanism) -> None:
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
        self._jacobian = _Code("closure_jacobian", jacobian, (), mechanism, program)
        self._bias = _Code("closure_bias", bias, (self._qd,), mechanism, program)

    def jacobian(self, q: Floats) -> Floats:
        """The Jacobian by velocity coordinates, shape (N, equations, velocities)."""
        found = np.zeros((len(q), len(self._row_units), len(self.units)))
        found[:, *self._jacobian.places] = self._jacobian.kernel({"q": q, **self._jacobian.geometry})
        scaled: Floats = found * (self.units / self._row_units[:, None])
        return scaled

    def jacobian_enclosures(self, q: Interval) -> Interval:
        """Bounds of the Jacobian while positions stay in intervals, each of shape (cells, equations, velocities)."""
        low, high = self._jacobian.enclosures({"q": q}, (len(self._row_units), len(self.units)))
        scale = self.units / self._row_units[:, None]
        return low * scale, high * scale

    def bias_enclosures(self, q: Interval, qd: Interval) -> Interval:
        """Bounds of J̇ q̇, each of shape (cells, equations)."""
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
    ) -> None:
        nodes = {index: value.node for index, value in values.items() if not value.is_zero}
        arguments = (*Arguments(mechanism, program, {}).of(["q", "symbols"], nodes.values()), *more)
        rank = max((len(index) for index in nodes), default=1)
        axes = tuple(tuple(map(str, range(1 + max(i[k] for i in nodes)))) if nodes else () for k in range(rank))
        self.places = np.array(list(nodes), dtype=np.intp).reshape(-1, rank).T
        self.geometry = geometry_values(mechanism, arguments)
        self._function = Function(name, program, arguments, nodes, axes)
        self.kernel = Kernel(self._function, sparse=True)

    def enclosures(self, ranges: Mapping[str, Interval], shape: tuple[int, ...]) -> Interval:
        bounds = enclosures_of(self._function, self.geometry, ranges)
        found = tuple(np.zeros((len(bounds[0]), *shape)) for _ in bounds)
        for whole, part in zip(found, bounds, strict=True):
            whole[:, *self.places] = part
        return found[0], found[1]


_SHORTEST = 2e-3  # of a step on the way to a configuration, rad or characteristic lengths
_REMEMBERED = 4  # sets of samples: those of the criterion and of the constraints
_POSES = 64  # that tell what openness is usual
_SINGULAR = 1e-9  # openness; beyond this dependent rates are of no use


@dataclass(frozen=True)
class Closed:
    """States of all coordinates."""

    # of all coordinates, shape (N, ...); where loops are not closed, q is as near as was reached, the others are zero
    q: Floats
    qd: Floats
    qdd: Floats
    done: Flags  # shape (N,); where the loops are closed
    # shape (N, k); what is left of the way to the independent positions, rad or characteristic lengths; 0 where
    # they are reached
    missing: Floats
    openness: Floats  # shape (N,); see :attr:`DependentMotion.openness`; zero where the loops are not closed

    def counted(self, values: Floats) -> Floats:
        """Values of shape (N, ...) where the loops are closed, and zeros."""
        found: Floats = np.where(self.done[:, None], values, 0.0)
        return found


def openness(mechanism: Mechanism, _pivots: object) -> Function:
    """Record :attr:`DependentMotion.openness`."""
    motion = DependentMotion(mechanism, Program())
    return motion_function("openness", motion, [motion.openness], ("openness",), "q", "distance from singular poses")


class LoopPositions(CompiledAssembly):
    """Closed configurations from independent positions."""

    functions: ClassVar[tuple[Builder, ...]] = (*CompiledAssembly.functions, openness)

    def __init__(self, mechanism: Mechanism) -> None:
        super().__init__(mechanism)
        self.bounds = ClosureBounds(mechanism)
        self._last: dict[int, tuple[Floats, Closed]] = {}

    def __getstate__(self) -> dict[str, object]:
        """Copies remember nothing, so that what they find does not depend on when they were made."""
        return {**vars(self), "_last": {}}

    @property
    def speed_units(self) -> Floats:
        """Units of the velocity coordinates' speeds, shape (velocities,)."""
        return self.bounds.units

    @property
    def independent_units(self) -> Floats:
        """Units of the independent positions, shape (k,)."""
        units: Floats = self.bounds.units[self._independent]
        return units

    @property
    def columns(self) -> tuple[list[int], list[int]]:
        """Places of the independent velocities, and of the dependent ones."""
        return list(self._independent), list(self._dependent)

    @cached_property
    def reference(self) -> float:
        """The largest openness of some poses about that of the assembly, which may itself be nearly singular."""
        poses, _, _ = self.random_closed_states(random_generator(DEFAULT_SEED), _POSES)
        poses = np.vstack([self.pose, poses])
        return float(np.nanmax(self.run("openness", q=poses)))

    # -- configurations --------------------------------------------------------------------------------------------

    def positioned(self, wanted: Floats) -> Closed:
        """Configurations at rest, or the nearest to them that were reached."""
        known = self._last.get(len(wanted))
        if known is not None and np.array_equal(known[0], wanted):
            return known[1]
        q = np.repeat(self.pose[None], len(wanted), axis=0)
        gone, left = np.zeros(len(wanted)), np.ones(len(wanted), dtype=bool)
        if known is not None:
            near, done = self._stepped(known[1], wanted)
            q[known[1].done], left = known[1].q[known[1].done], ~done
            q[done], gone[done] = near[done], 1.0
        q[left], gone[left] = self.followed(q[left], wanted[left], _SHORTEST)
        away = (wanted - q[:, self.independent_places]) / self.independent_units
        open_ = self.run("openness", q=q)[:, 0]
        done = (gone >= 1) & (open_ > _SINGULAR)
        still = np.zeros((len(q), len(self.speed_units)))
        missing = np.where(gone[:, None] < 1, away, 0.0)
        closed = Closed(q, still, still, done, missing, np.where(done, open_, 0.0))
        others = [(count, last) for count, last in self._last.items() if count != len(wanted)]
        self._last = dict([*others[1 - _REMEMBERED :], (len(wanted), (wanted.copy(), closed))])
        return closed

    def _stepped(self, last: Closed, wanted: Floats) -> tuple[Floats, Flags]:
        """One step from what was found before."""
        change = wanted - last.q[:, self.independent_places]
        done = last.done & (largest(change / self.independent_units) < STRIDE)
        change[~done] = 0.0
        rates = last.counted(self.run("closed_velocities", q=last.q, qd=change))
        guess = normalised(self.mechanism, last.q + position_rates(self.mechanism, last.q, rates))
        found, closed = self.near(guess)
        return found, done & closed & (largest((found - guess) / self.position_units) < LARGEST_CORRECTION)

    def single(self, q: Floats) -> Floats:
        """Positions in the places of their velocities, shape (N, velocities); zero for balls."""
        found = np.zeros((len(q), len(self.mechanism.velocities)))
        found[:, self._single[1]] = q[:, self._single[0]]
        return found

    def position_reach(self, moved: Floats) -> Floats:
        """How far positions can be away when no velocity coordinate's way is longer, shape (N, positions)."""
        found = np.zeros((len(moved), len(self.mechanism.positions)))
        found[:, self._single[0]] = moved[:, self._single[1]]
        for place, speed in self._balls:  # a unit quaternion moves by half of the angle
            found[:, place : place + 4] = np.linalg.norm(moved[:, speed : speed + 3], axis=1, keepdims=True) / 2
        return found

    @cached_property
    def _single(self) -> tuple[list[int], list[int]]:
        """Places of coordinates that are no balls, among positions and among velocities."""
        places, speeds = self.mechanism.positions, self.mechanism.velocities
        names = [m.name for m in self.mechanism.motions if m.kind is not MotionKind.BALL and m.name in places]
        return [places.index(name) for name in names], [speeds.index(name) for name in names]

    @cached_property
    def _balls(self) -> list[tuple[int, int]]:
        """First places of balls, among positions and among velocities."""
        places, speeds = self.mechanism.positions, self.mechanism.velocities
        balls = [m for m in self.mechanism.motions if m.kind is MotionKind.BALL]
        return [(places.index(m.positions[0]), speeds.index(m.velocities[0])) for m in balls]


Triple = tuple[Floats, Floats, Floats]


class LoopMotion(LoopPositions):
    """Closed states from independent ones, and derivatives."""

    def at(self, q: Floats, qd: Floats, qdd: Floats) -> Closed:
        """States of all coordinates; at rest where the loops are not closed."""
        closed = self.positioned(q)
        state = {"q": closed.q, "qd": qd, "qdd": qdd}
        rates = [self.run(name, **state) for name in ("closed_velocities", "closed_accelerations")]
        return replace(closed, qd=closed.counted(rates[0]), qdd=closed.counted(rates[1]))

    def independent(self, closed: Closed) -> dict[str, Floats]:
        """The arguments q, q̇ and q̈ of recorded functions: all positions, and independent rates."""
        free = self.columns[0]
        return {"q": closed.q, "qd": closed.qd[:, free], "qdd": closed.qdd[:, free]}

    # -- derivatives -----------------------------------------------------------------------------------------------

    def pulled(
        self, closed: Closed, by_q: Floats | None, by_qd: Floats | None = None, by_qdd: Floats | None = None
    ) -> Triple:
        """Derivatives by the independent q, q̇ and q̈, each of shape (N, k), from those by the whole state.

        Zero for samples whose loops are not closed.
        """
        places, count = closed.q.shape[1], len(self.columns[0])
        total = np.zeros((len(closed.q), places + 2 * count))
        if by_q is not None:
            total[:, :places] += by_q
        for name, adjoint in (("closed_velocities", by_qd), ("closed_accelerations", by_qdd)):
            if adjoint is not None:
                found = self._pulled(name, closed, adjoint)
                total[:, : found.shape[1]] += found
        first, rest = self.along(closed, total[:, :places]), closed.counted(total[:, places:])
        return first, rest[:, :count], rest[:, count:]

    def along(self, closed: Closed, by_q: Floats) -> Floats:
        """Derivatives along the motions of the independent coordinates, (N, k), from those by all positions."""
        return self._pulled("position_rates", closed, by_q)[:, closed.q.shape[1] :]

    def openness_slopes(self, closed: Closed, weights: Floats) -> Floats:
        """Derivatives of openness by all positions, times weights of shape (N,); shape (N, positions)."""
        return self._pulled("openness", closed, weights[:, None])

    def _pulled(self, name: str, closed: Closed, adjoint: Floats) -> Floats:
        kernel, geometry = self._pullbacks[name]
        names = {argument.name for argument in kernel.function.arguments}
        state = {k: v for k, v in self.independent(closed).items() if k in names}
        return closed.counted(kernel({**state, **geometry, ADJOINT: np.ascontiguousarray(adjoint)}))

    @cached_property
    def _pullbacks(self) -> dict[str, tuple[Kernel, Mapping[str, Floats]]]:
        """Machine code of the pullbacks, with the geometry that it takes."""
        builders = (closed_velocities, closed_accelerations, openness, _position_rates)
        made = {function.name: pullback(function) for function in (build(self.mechanism, ()) for build in builders)}
        return {n: (Kernel(f), geometry_values(self.mechanism, f.arguments)) for n, f in made.items()}


def _position_rates(mechanism: Mechanism, _pivots: object) -> Function:
    """Rates of all positions; linear in the independent velocities."""
    motion = DependentMotion(mechanism, Program())
    found = motion.position_rates({name: motion.given()[f"qd[{name}]"] for name in mechanism.velocities})
    nodes = [motion.program.input(f"q[{name}]").node for name in mechanism.positions]
    values = [found.get(node, motion.program.zero) for node in nodes]
    return motion_function("position_rates", motion, values, mechanism.positions, "q qd", "rates of all positions")
