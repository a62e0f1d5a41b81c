"""Random motions of a mechanism with loops, modulo primes: power series along random curves of closed configurations.

There are no random points of a finite field at which loops close; but from one closed pose, random series for some
coordinates continue to closed series for all (Newton's iteration, which doubles the number of known coefficients).  The
coefficients of a row along such curves span what the row spans at all configurations that the pose can be moved to.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from echelon.errors import SingularPoseError, UnknownRelationsError
from echelon.exact import series
from echelon.exact.field import PrimeField, Residues
from echelon.program.canonical import Turn
from echelon.program.generator_values import GeneratorValues
from echelon.program.operations import Op
from echelon.program.sampling import FieldSampler
from echelon.program.schedule import Schedule, SeriesArithmetic
from echelon.program.tape import Program
from echelon.regressor.closures import Loops
from echelon.regressor.lifting import Choice, choose, lift, tangent
from echelon.regressor.moving import Layout, MovingCoordinates, Pose

DEFAULT_ORDER = 16
_LOST = 2  # coefficients that are not known of accelerations
_FEWEST_CURVES = 2


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
        self.loops, self.order, self.layout = loops, order, Layout(loops.motions)
        functions = [n for n in self._schedule.leaves if n not in self.program.inputs]
        first, last = len(outputs), len(outputs) + len(closing)
        self._main = Schedule(self.program, self.outputs[:first], functions)
        self._closing = Schedule(self.program, self.outputs[first:last], functions)
        self._speeds = Schedule(self.program, self.outputs[last:], functions)
        self._names = {node: entry.name for node, entry in self.program.inputs.items()}
        self._turning = self._turning_generators()
        self._units = np.ones(len(self.layout.turning), dtype=np.int64)
        for generator, place in self._turning.items():
            self._units[place] = self.canonical.unit(generator)

    def evaluate(
        self, field: PrimeField, rng: np.random.Generator, states: int, geometry: Mapping[str, Residues]
    ) -> Residues:
        """Evaluate along random curves for given geometries.

        The coefficients of all curves of a geometry are put together to as many random combinations as there are
        states, so that each state is as good as any.

        See :meth:`echelon.program.sampling.FieldSampler.evaluate`.
        """
        geometries = len(next(iter(geometry.values()))) if geometry else 1
        curves = max(_FEWEST_CURVES, -(-states // self.order))
        samples = geometries * curves
        constants = self._constants_of(field, rng, {n: np.repeat(v, curves) for n, v in geometry.items()}, samples)
        curve = _Curve(self, field, rng, constants, self.layout.zero_pose(samples))
        values = self._main.run(curve.arithmetic, curve.leaves(self._main), samples)[..., : self.order]
        return _mixed(values.reshape(len(values), geometries, -1), states, field, rng)

    # -- leaves ----------------------------------------------------------------------------------------------------

    def _turning_generators(self) -> dict[str, int]:
        """Generators that are parts of the angles of coordinates, with the coordinate's place among those that turn."""
        place = {f"q[{m.name}]": k for k, m in enumerate(self.layout.turning)}
        sources = {self.canonical.input_generator(n).name: name for n, name in self._names.items()}
        found: dict[str, int] = {}
        for node in self._functions:
            form = self._form(node, ())
            moving = {g for g in _generators(form) if not self.canonical.generators[g].constant}
            for name in moving:
                inner = self.canonical.generators[name].element.symbols()
                source = sources.get(inner[0], "") if len(inner) == 1 else ""
                if not isinstance(form, Turn) or source not in place:
                    shown = Op(self.program.ops[node]).name.lower()
                    raise UnknownRelationsError(f"{shown} of what moves in a mechanism with loops")
                found[name] = place[source]
        return found

    def _constants_of(
        self, field: PrimeField, rng: np.random.Generator, geometry: Mapping[str, Residues], samples: int
    ) -> _Constants:
        inputs = [n for n in self._schedule.leaves if self._is_symbol(n)]
        forms = {n: self._form(n, ()) for n in self._functions}
        wanted = {g for form in forms.values() for g in _generators(form)} - self._turning.keys()
        drawn = GeneratorValues(self.canonical, field, rng, geometry, {}, samples, self._constants())
        generators = drawn.draw(wanted, inputs)
        circles = self._circles(generators, field)
        values = {n: drawn.inputs[n] for n in inputs}
        for node, form in forms.items():
            if not _generators(form) & self._turning.keys():
                everywhere = np.arange(samples)
                values[node] = self._combined(node, [((), everywhere)], generators, circles, field, samples)
        return _Constants(values, circles)


@dataclass(frozen=True)
class _Constants:
    """Values of leaves that do not move, and circle points of angles that do not, one for each sample."""

    leaves: Mapping[int, Residues]
    circles: Mapping[str, tuple[Residues, Residues]]


class _Curve:
    """One random curve for every sample."""

    def __init__(
        self, sampler: CurveSampler, field: PrimeField, rng: np.random.Generator, constants: _Constants, pose: Pose
    ) -> None:
        self.sampler, self.field, self.rng, self.constants, self.pose = sampler, field, rng, constants, pose
        self.samples, self.order = len(pose.turns), sampler.order + _LOST
        self.arithmetic = SeriesArithmetic(field, self.order)
        self.moving = self._lifted()

    def leaves(self, schedule: Schedule) -> dict[int, Residues]:
        """Values of a schedule's leaves along the curves."""
        return {node: self._leaf(node) for node in schedule.leaves}

    # -- closed curves ---------------------------------------------------------------------------------------------

    def _lifted(self) -> MovingCoordinates:
        _, jacobian = self._closure(self._at(np.zeros((self.samples, len(self.sampler.layout.names), 1), np.int64)))
        choice = choose(jacobian[0, :, :, 0], self.field)
        free = self.field.draw(self.rng, (self.samples, len(choice.independent), self.order))
        free[..., 0] = 0

        def equations(local: Residues) -> tuple[Residues, Residues]:
            moving = self._at(local)
            values, jacobian = self._closure(moving)
            return values, moving.pulled_back(jacobian)

        return self._at(lift(equations, choice, free, self.field))

    def _at(self, local: Residues) -> MovingCoordinates:
        return MovingCoordinates(self.sampler.layout, self.field, self.sampler._units, self.pose, local)

    def _closure(self, moving: MovingCoordinates, names: Sequence[str] | None = None) -> tuple[Residues, Residues]:
        """Equations and their derivatives by velocities: of all coordinates, or of the named freedoms."""
        sampler, order = self.sampler, moving.local.shape[-1]
        schedule, entries = sampler._closing, sampler.loops.equations.jacobian
        leaves = {node: self._position_leaf(node, moving) for node in schedule.leaves}
        values = schedule.run(SeriesArithmetic(self.field, order), leaves, self.samples)
        count = len(sampler.loops.equations.equations)
        columns = {name: k for k, name in enumerate(names or sampler.layout.names)}
        jacobian = np.zeros((self.samples, count, len(columns), order), dtype=np.int64)
        for (row, name), value in zip(entries, values[count:], strict=True):
            if name in columns:
                jacobian[:, row, columns[name]] = value
        return values[:count].transpose(1, 0, 2), jacobian

    # -- values of leaves ------------------------------------------------------------------------------------------

    def _leaf(self, node: int) -> Residues:
        name = self.sampler._names.get(node, "")
        kind, coordinate = name.partition("[")[0], name[name.find("[") + 1 : -1]
        columns = self.sampler.layout.names
        if kind in ("qd", "qdd") and coordinate in columns:
            return (self._rates if kind == "qd" else self._accelerations)[:, columns.index(coordinate)]
        if kind == "v":
            return self._virtual[coordinate]
        if kind in ("u", "i"):
            return self._random(name)
        return self._position_leaf(node, self.moving)

    def _position_leaf(self, node: int, moving: MovingCoordinates) -> Residues:
        """Value of a constant, a function of positions, or a position."""
        sampler, order = self.sampler, moving.local.shape[-1]
        if node in self.constants.leaves:
            return series.constant(self.constants.leaves[node], order)
        if node not in sampler.program.inputs:
            return self._turned(node, moving)
        name = sampler._names[node]
        for k, motion in enumerate(sampler.layout.sliding):
            if name == f"q[{motion.name}]":
                return moving.slides[:, k]
        for k, motion in enumerate(sampler.layout.balls):
            for part, position in enumerate(motion.positions):
                if name == f"q[{position}]":
                    return moving.quaternions[:, k, part]
        raise UnknownRelationsError(f"the input {name} of a mechanism with loops")

    def _turned(self, node: int, moving: MovingCoordinates) -> Residues:
        """Sine or cosine of a sum of angles."""
        sampler, order = self.sampler, moving.local.shape[-1]
        form = sampler._form(node, ())
        assert isinstance(form, Turn)
        points = []
        for generator, count in form.multiples.items():
            if generator in sampler._turning:
                point = tuple(part[:, sampler._turning[generator]] for part in moving.turns)
            else:
                point = tuple(series.constant(part, order) for part in self.constants.circles[generator])
            points.append(_multiplied((point[0], point[1]), count, self.field))
        point = reduce(lambda a, b: _added(a, b, self.field), points)
        return point[0 if sampler.program.ops[node] == Op.COS else 1]

    @cached_property
    def _rates(self) -> Residues:
        return self.moving.rates()

    @cached_property
    def _accelerations(self) -> Residues:
        return series.derivative(self._rates, self.field)

    @cached_property
    def _virtual(self) -> dict[str, Residues]:
        """Virtual velocities that keep the loops closed, of freedoms that are not given."""
        sampler, given = self.sampler, self.sampler.loops.speeds
        names = [*sampler.layout.names, *(name for name in given or () if name not in sampler.layout.names)]
        _, jacobian = self._closure(self.moving, names)
        if given is None:
            choice = choose(jacobian[0, :, :, 0], self.field)
            free = self.field.draw(self.rng, (self.samples, len(choice.independent), self.order))
        else:
            choice = self._choice_of(jacobian, names, given)
            free = sampler._speeds.run(self.arithmetic, self.leaves(sampler._speeds), self.samples).transpose(1, 0, 2)
        speeds = tangent(jacobian, choice, free, self.field)
        return {name: speeds[:, k] for k, name in enumerate(names)}

    def _choice_of(self, jacobian: Residues, names: Sequence[str], given: Collection[str]) -> Choice:
        """The choice in which the freedoms whose velocities are given are the independent ones."""
        independent = [names.index(name) for name in given]
        choice = choose(jacobian[0, :, :, 0], self.field, independent)
        if set(choice.independent) != set(independent):
            raise SingularPoseError(self._undetermined(choice, names, independent))
        return Choice(choice.rows, choice.dependent, tuple(independent))

    def _undetermined(self, choice: Choice, names: Sequence[str], given: Sequence[int]) -> str:
        stuck = [names[k] for k in given if k in choice.dependent]
        if stuck:
            return f"'{stuck[0]}' cannot move by itself while the loops stay closed: what it measures is not determined"
        loose = next(names[k] for k in choice.independent if k not in given)
        return f"'{loose}' is not determined by the independent coordinates"

    def _random(self, name: str) -> Residues:
        if not hasattr(self, "_drawn"):
            self._drawn: dict[str, Residues] = {}
        if name not in self._drawn:
            self._drawn[name] = self.field.draw(self.rng, (self.samples, self.order))
        return self._drawn[name]


def _generators(form: object) -> set[str]:
    return set(form.multiples) if isinstance(form, Turn) else set(form.symbols())  # type: ignore[attr-defined]


def _added(a: tuple[Residues, Residues], b: tuple[Residues, Residues], field: PrimeField) -> tuple[Residues, Residues]:
    cosine = series.product(a[0], b[0], field) - series.product(a[1], b[1], field)
    sine = series.product(a[0], b[1], field) + series.product(a[1], b[0], field)
    return cosine % field.p, sine % field.p


def _multiplied(point: tuple[Residues, Residues], count: int, field: PrimeField) -> tuple[Residues, Residues]:
    turned = (point[0], point[1] if count > 0 else -point[1] % field.p)
    total = turned
    for _ in range(abs(count) - 1):
        total = _added(total, turned, field)
    return total


def _mixed(values: Residues, states: int, field: PrimeField, rng: np.random.Generator) -> Residues:
    """Random combinations of the coefficients of all curves of a geometry."""
    result = np.zeros((*values.shape[:2], states), dtype=np.int64)
    for k, weights in enumerate(field.draw(rng, (values.shape[2], states))):
        result += values[:, :, k, None] * weights % field.p
    return result % field.p
