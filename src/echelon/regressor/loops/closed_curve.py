"""Random motions of a mechanism with loops modulo a prime: for every sample a closed curve, and a motion along it.

From a closed pose, random series of some coordinates are continued to closed series of all by Newton's iteration.

Exponentials of what moves, such as those of Stribeck friction, are power series, too: exp a(t) = exp a(0) ·
exp(a(t) − a(0)).  Exponentials of arguments that are linearly independent over the rationals, up to constants, are
algebraically independent on closed configurations (Ax 1971).  So generators have random values at t = 0.  Where loops
tie arguments to one another, as in a parallelogram, this is noticed and refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError, SingularPoseError, UnknownRelationsError
from echelon.exact import series
from echelon.exact.field import PrimeField, Residues, rank, reduced_echelon
from echelon.program.arithmetics import SeriesArithmetic
from echelon.program.canonical import CanonicalForms, Product, Signs
from echelon.program.generators import residues_of
from echelon.program.schedule import Schedule
from echelon.regressor.loops.moving import MovingCoordinates, Pose
from echelon.regressor.loops.positions import Positions

_UNKNOWN = 2  # last coefficients, which are not known of velocities and accelerations


class Exponentials:
    """The exponentials of a program whose arguments move."""

    def __init__(
        self, canonical: CanonicalForms, nodes: Sequence[int], signs: Sequence[int], functions: Sequence[int]
    ) -> None:
        self.nodes, self._canonical = nodes, canonical
        lhs = canonical.program.lhs
        self._sign_of = {lhs[node]: node for node in signs}
        self.arguments = Schedule(canonical.program, [lhs[node] for node in nodes], functions)

    def starts(
        self, signs: Mapping[int, Residues], field: PrimeField, rng: np.random.Generator, samples: int
    ) -> dict[int, Residues]:
        """Values at t = 0 by node, for given values of the nodes that are signs."""
        generators: dict[str, Residues] = {}
        starts = {node: np.zeros(samples, dtype=np.int64) for node in self.nodes}
        for node, wanted, where in self._regions(signs, samples):
            form = self._canonical.form(node, wanted)
            if not isinstance(form, Product) or any(self._canonical.generators[g].constant for g in form.exponents):
                raise UnknownRelationsError("a sum of constants and of what moves in an exponential, with loops")
            for generator in form.exponents:
                generators.setdefault(generator, field.draw(rng, (samples,)))
            own = {g: generators[g][where] for g in form.exponents}
            starts[node][where] = residues_of(form, own, field, len(where))
        return starts

    def _regions(self, signs: Mapping[int, Residues], samples: int) -> list[tuple[int, Signs, npt.NDArray[np.intp]]]:
        """Nodes with the signs that their arguments depend on, and the samples that have these; all forms are known."""
        found = []
        for node in self.nodes:
            watched = self._canonical.signed(node)
            table = np.array([signs[self._sign_of[n]] for n in watched], dtype=np.int64).reshape(len(watched), samples)
            rows, which = np.unique(np.where(table == 1, 1, -1).T, axis=0, return_inverse=True)
            for number, row in enumerate(rows):
                wanted = tuple(zip(watched, map(int, row), strict=True))
                found.append((node, wanted, np.flatnonzero(which.reshape(-1) == number)))
        self._canonical.forms([(node, wanted) for node, wanted, _ in found])
        return found

    def series(
        self, starts: Mapping[int, Residues], arguments: Residues, signs: Mapping[int, Residues], field: PrimeField
    ) -> dict[int, Residues]:
        """Series by node."""
        self._check_independent(arguments, signs, field)
        return {
            node: _exponential(argument, start, field)
            for node, start, argument in zip(self.nodes, starts.values(), arguments, strict=True)
        }

    def _check_independent(self, arguments: Residues, signs: Mapping[int, Residues], field: PrimeField) -> None:
        """The arguments of the first sample must be as independent as their exponents in generators say."""
        forms = []
        for node in self.nodes:
            watched = self._canonical.signed(node)
            wanted = tuple((n, 1 if int(signs[self._sign_of[n]][0]) == 1 else -1) for n in watched)
            forms.append(self._canonical.form(node, wanted))
        names = sorted({g for form in forms if isinstance(form, Product) for g in form.exponents})
        exponents = np.array([[f.exponents.get(g, 0) if isinstance(f, Product) else 0 for g in names] for f in forms])
        if rank(arguments[:, 0, 1:-_UNKNOWN], field) < rank(exponents % field.p, field):
            raise UnknownRelationsError("exponentials of velocities that the loops tie to one another")


def _exponential(argument: Residues, start: Residues, field: PrimeField) -> Residues:
    """start · exp(a − a(0)), from y' = a' y."""
    slope = series.derivative(argument, field)
    result = np.zeros_like(argument)
    result[:, 0] = start
    for n in range(1, argument.shape[-1]):
        total = (slope[:, :n] * result[:, n - 1 :: -1][:, :n] % field.p).sum(axis=1) % field.p
        result[:, n] = total * field.invert(n) % field.p
    return result


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


def lift(positions: Positions, pose: Pose, order: int, rng: np.random.Generator) -> MovingCoordinates:
    """Random closed curves from poses, by Newton's iteration: new coefficients of some coordinates are drawn.

    DegenerateSampleError if the Jacobian of a sample is singular where that of the first one is not; SingularPoseError
    if an equation that was left out does not hold along the curves: the pose is singular, or it is isolated.
    """
    field, moving = positions.field, positions.resting(pose)
    choice = choose(positions.jacobian(pose)[0], field)
    dependent, independent = list(choice.dependent), list(choice.independent)
    square = np.ix_(range(positions.samples), choice.rows, dependent)
    known, inverses = 1, None
    while known < order:
        target, before = min(2 * known, order), moving
        change = np.zeros((positions.samples, len(dependent) + len(independent), target), dtype=np.int64)
        change[:, independent, known:] = field.draw(rng, (positions.samples, len(independent), target - known))
        moving = moving.extended(target).moved(change)
        values = positions.along(moving)
        if values[..., :known].any():
            raise SingularPoseError(
                "they do not stay closed along a curve: redundant constraints contradict each other near the pose"
            )
        # half the coefficients of the derivatives do, for what is added begins with the power t^known
        residual, change = values[:, list(choice.rows), None, known:], np.zeros_like(change)
        solved, inverses = series.solve(positions.slopes(before)[square], residual, field, inverses)
        change[:, dependent, known:] = -solved[:, :, 0] % field.p
        moving, known = moving.moved(change), target
    return moving


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


@dataclass(frozen=True)
class ClosedCurve:
    """One random curve of closed configurations for every sample, and a random motion along it."""

    positions: Positions
    moving: MovingCoordinates
    rng: np.random.Generator
    given: Mapping[str, int] | None  # freedoms whose virtual velocities are given
    speeds: Schedule  # of these
    signs: Mapping[int, Residues]  # values of the nodes that are signs
    exponentials: Exponentials
    _drawn: dict[str, Residues] = field(default_factory=dict)

    @property
    def arithmetic(self) -> SeriesArithmetic:
        """That of the series along the curves."""
        return SeriesArithmetic(self.positions.field, self.moving.order)

    def leaves(self, schedule: Schedule) -> dict[int, Residues]:
        """Values of a schedule's leaves along the curves."""
        return {node: self._leaf(node) for node in schedule.leaves}

    # -- values of leaves ------------------------------------------------------------------------------------------

    def _leaf(self, node: int) -> Residues:
        if node in self.signs:
            return series.constant(self.signs[node], self.moving.order)
        if node in self.exponentials.nodes:
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
            self._drawn[entry.name] = self.positions.field.draw(self.rng, (self.positions.samples, self.moving.order))
        return self._drawn[entry.name]

    @cached_property
    def _exponential(self) -> dict[int, Residues]:
        schedule, samples = self.exponentials.arguments, self.positions.samples
        arguments = schedule.run(self.arithmetic, self.leaves(schedule), samples)
        starts = self.exponentials.starts(self.signs, self.positions.field, self.rng, samples)
        return self.exponentials.series(starts, arguments, self.signs, self.positions.field)

    @cached_property
    def _rates(self) -> Residues:
        return self.moving.rates()

    @cached_property
    def _accelerations(self) -> Residues:
        return series.derivative(self._rates, self.positions.field)

    @cached_property
    def _virtual(self) -> dict[str, Residues]:
        """Virtual velocities that keep the loops closed, of freedoms that are not given."""
        coordinates = self.positions.recorded.layout.names
        names = [*coordinates, *(name for name in self.given or () if name not in coordinates)]
        jacobian = self.positions.slopes(self.moving, names)
        if self.given is None:
            choice = choose(jacobian[0, :, :, 0], self.positions.field)
            free = self.positions.field.draw(
                self.rng, (self.positions.samples, len(choice.independent), self.moving.order)
            )
        else:
            choice = _choice_of(jacobian[0, :, :, 0], names, list(self.given), self.positions.field)
            values = self.speeds.run(self.arithmetic, self.leaves(self.speeds), self.positions.samples)
            free = values.transpose(1, 0, 2)
        speeds = tangent(jacobian, choice, free, self.positions.field)
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
