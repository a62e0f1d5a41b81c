"""Random motions of a mechanism with loops, modulo primes: power series along random curves of closed configurations.

There are no random points of a finite field at which loops close; but from one closed pose, random series for some
coordinates continue to closed series for all (Newton's iteration, which doubles the number of known coefficients).  The
coefficients of a row along such curves span what the row spans at all configurations that the pose can be moved to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from echelon.errors import SingularPoseError, UnknownRelationsError
from echelon.exact import series
from echelon.exact.field import PrimeField, Residues
from echelon.program.canonical import Turn
from echelon.program.generator_values import GeneratorValues
from echelon.program.operations import Op
from echelon.program.sampling import FieldSampler, generators_of
from echelon.program.schedule import Schedule, SeriesArithmetic
from echelon.program.tape import Program
from echelon.regressor.closures import Loops
from echelon.regressor.lifting import Choice, choose, lift, tangent
from echelon.regressor.moving import Layout, MovingCoordinates, Pose
from echelon.regressor.poses import PoseFinder
from echelon.regressor.positions import Constants, Positions, Recorded

DEFAULT_ORDER = 16
_LOST = 2  # coefficients that are not known of accelerations
_REGULAR_ORDER = 6  # coefficients after which a curve from a singular pose fails to be closed
_SURPLUS = 3  # halves: that many more coefficients are taken than states, because some are not independent


class CurveSampler(FieldSampler):
    """Evaluates outputs of a program along random curves of closed configurations.

    Parameters
    ----------
    program : Program
    outputs : sequence of int
        Output nodes.
    loops : Loops
    order : int
        Number of coefficients taken of every curve.

    Raises
    ------
    UnknownRelationsError
        If functions of the motion other than sines and cosines of its angles occur.
    """

    def __init__(self, program: Program, outputs: Sequence[int], loops: Loops, order: int = DEFAULT_ORDER) -> None:
        entries = loops.equations.jacobian
        closing = [*loops.equations.equations, *entries.values()]
        super().__init__(program, [*outputs, *closing, *(loops.speeds or {}).values()])
        self.loops, self.order = loops, order
        layout = Layout(loops.motions)
        functions = [n for n in self._schedule.leaves if n not in self.program.inputs]
        first, last = len(outputs), len(outputs) + len(closing)
        equations = self.outputs[first : first + len(loops.equations.equations)]
        self._main = Schedule(self.program, self.outputs[:first], functions)
        self._speeds = Schedule(self.program, self.outputs[last:], functions)
        turns, turning = self._moving_turns(layout)
        units = np.ones(len(layout.turning), dtype=np.int64)
        for generator, place in turning.items():
            units[place] = self.canonical.unit(generator)
        self._recorded = Recorded(
            self.program,
            layout,
            Schedule(self.program, equations, functions),
            Schedule(self.program, self.outputs[first:last], functions),
            list(entries),
            loops.equations.owners,
            turns,
            turning,
            units,
        )
        self._poses = PoseFinder([layout.names.index(name) for name in loops.preferred], loops.assembly, loops.accepts)

    def evaluate(
        self, field: PrimeField, rng: np.random.Generator, states: int, geometry: Mapping[str, Residues]
    ) -> Residues:
        """Evaluate along random curves for given geometries.

        The coefficients of all curves of a geometry are put together to as many random combinations as there are
        states, so that each state is as good as any.

        See :meth:`echelon.program.sampling.FieldSampler.evaluate`.
        """
        while True:
            pose = self.closed_pose(field, rng, geometry)
            try:
                return self.evaluate_at(field, rng, states, geometry, pose)
            except SingularPoseError:
                if not self._poses.leave_stated():
                    raise

    def closed_pose(self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues]) -> Pose:
        """A closed pose for every geometry.

        Raises
        ------
        SingularPoseError
            If none can be found.
        """
        while True:
            positions = self._positions(field, rng, geometry)
            pose = self._poses.find(positions, rng)
            if not self._poses.takes_stated or self._is_regular(positions, pose, rng):
                return pose
            self._poses.leave_stated()

    def pose_variants(
        self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues], count: int
    ) -> Pose:
        """A closed pose of one geometry and others that share some of its coordinates."""
        pose = self.closed_pose(field, rng, geometry)
        return self._poses.variants(self._positions(field, rng, geometry), pose, count, rng)

    def evaluate_at(
        self, field: PrimeField, rng: np.random.Generator, states: int, geometry: Mapping[str, Residues], pose: Pose
    ) -> Residues:
        """Evaluate along random curves from given closed poses; see :meth:`evaluate`."""
        positions = self._positions(field, rng, geometry)
        geometries, curves = positions.samples, 1 + -(-_SURPLUS * states // (2 * self.order))
        positions = positions.at(np.repeat(np.arange(geometries), curves))
        curve = _Curve(positions, pose.repeated(curves), rng, self.order + _LOST, self.loops.speeds, self._speeds)
        values = self._main.run(curve.arithmetic, curve.leaves(self._main), geometries * curves)[..., : self.order]
        return _mixed(values.reshape(len(values), geometries, -1), states, field, rng)

    def jacobian(self, field: PrimeField, rng: np.random.Generator) -> Residues:
        """Jacobian of the closures by all coordinates at a closed pose of a random geometry.

        Returns
        -------
        array of shape (equations, velocities)
        """
        geometry = {s: field.draw(rng, (1,)) for s in self.symbols}
        pose = self.closed_pose(field, rng, geometry)
        positions = self._positions(field, rng, geometry)
        _, jacobian = positions.closure(positions.resting(pose))
        start: Residues = jacobian[0, :, :, 0]
        return start

    def _is_regular(self, positions: Positions, pose: Pose, rng: np.random.Generator) -> bool:
        """Whether curves of closed poses go on from a pose in all directions that the Jacobian allows."""
        first = np.zeros(1, dtype=np.intp)
        try:
            _Curve(positions.at(first), pose.at(first), rng, _REGULAR_ORDER, None, self._speeds)
        except SingularPoseError:
            return False
        return True

    # -- leaves ----------------------------------------------------------------------------------------------------

    def _moving_turns(self, layout: Layout) -> tuple[dict[int, Turn], dict[str, int]]:
        """Sines and cosines of what moves, and the generators that are parts of angles of coordinates."""
        place = {f"q[{m.name}]": k for k, m in enumerate(layout.turning)}
        sources = {self.canonical.input_generator(n).name: e.name for n, e in self.program.inputs.items()}
        turns: dict[int, Turn] = {}
        turning: dict[str, int] = {}
        for node in self._functions:
            form = self._form(node, ())
            moving = {g for g in generators_of(form) if not self.canonical.generators[g].constant}
            for name in moving:
                inner = self.canonical.generators[name].element.symbols()
                source = sources.get(inner[0], "") if len(inner) == 1 else ""
                if not isinstance(form, Turn) or source not in place:
                    shown = Op(self.program.ops[node]).name.lower()
                    raise UnknownRelationsError(f"{shown} of what moves in a mechanism with loops")
                turning[name] = place[source]
                turns[node] = form
        return turns, turning

    def _positions(self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues]) -> Positions:
        """The given geometries, with random values for what else is constant."""
        samples = len(next(iter(geometry.values()))) if geometry else 1
        inputs = [n for n in self._schedule.leaves if self._is_symbol(n)]
        forms = {n: self._form(n, ()) for n in self._functions}
        wanted = {g for form in forms.values() for g in generators_of(form)} - self._recorded.turning.keys()
        drawn = GeneratorValues(self.canonical, field, rng, geometry, {}, samples, self._constants())
        generators = drawn.draw(wanted, inputs)
        circles = self._circles(generators, field)
        values = {n: drawn.inputs[n] for n in inputs}
        everywhere = np.arange(samples)
        for node in forms.keys() - self._recorded.turns.keys():
            values[node] = self._combined(node, [((), everywhere)], generators, circles, field, samples)
        return Positions(self._recorded, field, Constants(values, circles, dict(geometry)), samples)


class _Curve:
    """One random curve of closed configurations for every sample, and a random motion along it."""

    def __init__(
        self,
        positions: Positions,
        pose: Pose,
        rng: np.random.Generator,
        order: int,
        given: Mapping[str, int] | None,
        speeds: Schedule,
    ) -> None:
        self.positions, self.pose, self.rng = positions, pose, rng
        self.field, self.order = positions.field, order
        self._given, self._speeds = given, speeds
        self.arithmetic = SeriesArithmetic(self.field, order)
        self._drawn: dict[str, Residues] = {}
        self.moving = self._lifted()

    def leaves(self, schedule: Schedule) -> dict[int, Residues]:
        """Values of a schedule's leaves along the curves."""
        return {node: self._leaf(node) for node in schedule.leaves}

    def at_start(self) -> Residues:
        """Jacobian of the closures where the curves begin, (samples, equations, velocities)."""
        _, jacobian = self.positions.closure(self.positions.resting(self.pose))
        start: Residues = jacobian[..., 0]
        return start

    def _lifted(self) -> MovingCoordinates:
        choice = choose(self.at_start()[0], self.field)
        free = self.field.draw(self.rng, (self.positions.samples, len(choice.independent), self.order))
        free[..., 0] = 0

        def equations(local: Residues) -> tuple[Residues, Residues]:
            moving = self.positions.moving(self.pose, local)
            values, jacobian = self.positions.closure(moving)
            return values, moving.pulled_back(jacobian)

        return self.positions.moving(self.pose, lift(equations, choice, free, self.field))

    # -- values of leaves ------------------------------------------------------------------------------------------

    def _leaf(self, node: int) -> Residues:
        recorded = self.positions.recorded
        entry = recorded.program.inputs.get(node)
        if entry is None or entry.role == "symbol":
            return self.positions.leaf(node, self.moving)
        kind, _, rest = entry.name.partition("[")
        coordinate, names = rest[:-1], recorded.layout.names
        if kind == "qd":
            return self._rates[:, names.index(coordinate)]
        if kind == "qdd":
            return self._accelerations[:, names.index(coordinate)]
        if kind == "v":
            return self._virtual[coordinate]
        if kind == "q":
            return self.positions.leaf(node, self.moving)
        if entry.name not in self._drawn:  # virtual velocities of outputs, measured inputs
            self._drawn[entry.name] = self.field.draw(self.rng, (self.positions.samples, self.order))
        return self._drawn[entry.name]

    @cached_property
    def _rates(self) -> Residues:
        return self.moving.rates()

    @cached_property
    def _accelerations(self) -> Residues:
        return series.derivative(self._rates, self.field)

    @cached_property
    def _virtual(self) -> dict[str, Residues]:
        """Virtual velocities that keep the loops closed, of freedoms that are not given."""
        coordinates = self.positions.recorded.layout.names
        names = [*coordinates, *(name for name in self._given or () if name not in coordinates)]
        _, jacobian = self.positions.closure(self.moving, names)
        if self._given is None:
            choice = choose(jacobian[0, :, :, 0], self.field)
            free = self.field.draw(self.rng, (self.positions.samples, len(choice.independent), self.order))
        else:
            choice = _choice_of(jacobian[0, :, :, 0], names, list(self._given), self.field)
            values = self._speeds.run(self.arithmetic, self.leaves(self._speeds), self.positions.samples)
            free = values.transpose(1, 0, 2)
        speeds = tangent(jacobian, choice, free, self.field)
        return {name: speeds[:, k] for k, name in enumerate(names)}


def _choice_of(jacobian: Residues, names: Sequence[str], given: Sequence[str], field: PrimeField) -> Choice:
    """The choice in which the freedoms whose velocities are given are the independent ones."""
    independent = [names.index(name) for name in given]
    choice = choose(jacobian, field, independent)
    stuck = [names[k] for k in independent if k in choice.dependent]
    if stuck:
        raise SingularPoseError(
            f"'{stuck[0]}' cannot move by itself while the loops stay closed, so what is measured there is undetermined"
        )
    loose = [names[k] for k in choice.independent if k not in independent]
    if loose:
        raise SingularPoseError(f"'{loose[0]}' does not follow from the independent coordinates")
    return Choice(choice.rows, choice.dependent, tuple(independent))


def _mixed(values: Residues, states: int, field: PrimeField, rng: np.random.Generator) -> Residues:
    """Random combinations of the coefficients of all curves of a geometry."""
    result = np.zeros((*values.shape[:2], states), dtype=np.int64)
    for k, weights in enumerate(field.draw(rng, (values.shape[2], states))):
        result += values[:, :, k, None] * weights % field.p
    return result % field.p
