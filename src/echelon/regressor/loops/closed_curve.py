"""Random motions of a mechanism with loops modulo a prime: for every sample a closed curve, and a motion along it.

From a closed pose, random series of some coordinates are continued to closed series of all by Newton's iteration.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echelon.errors import InputError, SingularPoseError
from echelon.exact import series
from echelon.exact.elimination import reduced_echelon
from echelon.exact.field import PrimeField, Residues
from echelon.program.schedule import Schedule, SeriesArithmetic
from echelon.regressor.loops.exponentials import Exponentials
from echelon.regressor.loops.moving import MovingCoordinates, Pose
from echelon.regressor.loops.positions import Positions

OfSeries = Callable[[Residues], Residues]
"""From local coordinates (samples, coordinates, order) to the equations (samples, equations, order), or to their
derivatives by local coordinates (samples, equations, coordinates, order)."""


@dataclass(frozen=True)
class Choice:
    """A square non-singular part of a Jacobian."""

    rows: tuple[int, ...]  # equations that the others follow from, to first order
    dependent: tuple[int, ...]  # columns that the equations are solved for
    independent: tuple[int, ...]  # the others


def choose(jacobian: Residues, field: PrimeField, preferred: Sequence[int] = ()) -> Choice:
    """Choose equations, and the columns to solve them for; preferred ones, the most wanted first, rather not."""
    columns = jacobian.shape[1]
    # pivots are the leftmost columns possible, so what should be independent comes last
    wanted = list(dict.fromkeys(preferred))
    order = [c for c in range(columns) if c not in wanted][::-1] + wanted[::-1]
    _, pivots = reduced_echelon(jacobian[:, order], field)
    dependent = tuple(sorted(order[k] for k in pivots))
    _, rows = reduced_echelon(jacobian[:, dependent].T, field)
    independent = tuple(c for c in range(columns) if c not in dependent)
    return Choice(tuple(rows), dependent, independent)


def lift(equations: OfSeries, slopes: OfSeries, choice: Choice, free: Residues, field: PrimeField) -> Residues:
    """Continue series of independent local coordinates, zero at t = 0, to closed ones of all, by Newton's iteration.

    DegenerateSampleError if the Jacobian of a sample is singular where that of the choice is not; SingularPoseError if
    an equation that was left out does not hold along the curves: the pose is singular, or it is isolated.
    """
    samples, _, order = free.shape
    dependent, independent = list(choice.dependent), list(choice.independent)
    square = np.ix_(range(samples), choice.rows, dependent)
    local = np.zeros((samples, len(dependent) + len(independent), order), dtype=np.int64)
    known, inverses = 1, None
    while known < order:
        target = min(2 * known, order)
        local[:, independent, :target] = free[..., :target]
        values = equations(local[..., :target])
        if values[..., :known].any():
            raise SingularPoseError(
                "they do not stay closed along a curve: redundant constraints contradict each other near the pose"
            )
        # half the coefficients of the derivatives do, for what is added begins with the power t^known
        residual = values[:, list(choice.rows), None, known:target]
        change, inverses = series.solve(slopes(local[..., :known])[square], residual, field, inverses)
        local[:, dependent, known:target] = -change[:, :, 0] % field.p
        known = target
    return local


def tangent(jacobian: Residues, choice: Choice, free: Residues, field: PrimeField) -> Residues:
    """All velocities that keep the loops closed, from those of the independent columns."""
    dependent, independent = list(choice.dependent), list(choice.independent)
    samples, order = free.shape[0], free.shape[-1]
    result = np.zeros((samples, jacobian.shape[2], order), dtype=np.int64)
    result[:, independent] = free
    if dependent:
        rows = range(samples)
        driven = series.matrix_product(jacobian[np.ix_(rows, choice.rows, independent)], free[:, :, None], field)
        solved, _ = series.solve(jacobian[np.ix_(rows, choice.rows, dependent)], driven, field)
        result[:, dependent] = -solved[:, :, 0] % field.p
    return result


class ClosedCurve:
    """One random curve of closed configurations for every sample, and a random motion along it."""

    def __init__(
        self,
        positions: Positions,
        pose: Pose,
        rng: np.random.Generator,
        order: int,
        given: Mapping[str, int] | None,
        speeds: Schedule,
        signs: Mapping[int, Residues],
        exponentials: Exponentials,
    ) -> None:
        self.positions, self.pose, self.rng = positions, pose, rng
        self.field, self.order = positions.field, order
        self._given, self._speeds, self._signs, self._exponentials = given, speeds, signs, exponentials
        self.arithmetic = SeriesArithmetic(self.field, order)
        self._drawn: dict[str, Residues] = {}
        self.moving = self._lifted()

    def leaves(self, schedule: Schedule) -> dict[int, Residues]:
        """Values of a schedule's leaves along the curves."""
        return {node: self._leaf(node) for node in schedule.leaves}

    def _lifted(self) -> MovingCoordinates:
        choice = choose(self.positions.jacobian(self.pose)[0], self.field)
        free = self.field.draw(self.rng, (self.positions.samples, len(choice.independent), self.order))
        free[..., 0] = 0

        def equations(local: Residues) -> Residues:
            return self.positions.along(self.positions.moving(self.pose, local))

        def slopes(local: Residues) -> Residues:
            moving = self.positions.moving(self.pose, local)
            return moving.pulled_back(self.positions.slopes(moving))

        return self.positions.moving(self.pose, lift(equations, slopes, choice, free, self.field))

    # -- values of leaves ------------------------------------------------------------------------------------------

    def _leaf(self, node: int) -> Residues:
        if node in self._signs:
            return series.constant(self._signs[node], self.order)
        if node in self._exponentials.nodes:
            return self._exponential[node]
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
    def _exponential(self) -> dict[int, Residues]:
        schedule, samples = self._exponentials.arguments, self.positions.samples
        arguments = schedule.run(self.arithmetic, self.leaves(schedule), samples)
        starts = self._exponentials.starts(self._signs, self.field, self.rng, samples)
        return self._exponentials.series(starts, arguments, self._signs, self.field)

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
        jacobian = self.positions.slopes(self.moving, names)
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
        problem = "the motion does not determine it: redundant constraints of the loops leave it open"
        raise InputError(problem, element=stuck[0].partition(" #")[0])
    loose = [names[k] for k in choice.independent if k not in independent]
    if loose:
        raise SingularPoseError(f"'{loose[0]}' does not follow from the independent coordinates at the pose")
    return Choice(choice.rows, choice.dependent, tuple(independent))
