"""Loops that are closed together: their equations as polynomials, and the coordinates that solve them.

A turning coordinate enters by the cosine and sine of its angle, a ball by its quaternion.  Each coordinate occurs once
in every chain, so the equations are linear in cosines, sines and sliding coordinates, and quadratic in quaternions.  So
their values where the variables of every coordinate are at a few points give all coefficients.

A ball of which some velocities are to be solved for and others drawn is sought in a random plane through the drawn
quaternion, of one dimension more than there are velocities to solve for; the unit sphere cuts it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from itertools import combinations_with_replacement, product
from math import prod

import numpy as np

from echelon.arrays import Integers
from echelon.exact.field import PrimeField, Residues
from echelon.program.zero_dimensional import AT_ONCE, Solutions
from echelon.regressor.loops.moving import Pose
from echelon.regressor.loops.positions import Positions, Recorded

_SEED, _LARGEST = 2016, 1 << 15  # of the directions of planes

Polynomial = dict[tuple[int, ...], Residues]


class ClosureBlock:
    """Equations, and the coordinates to solve them for."""

    def __init__(self, recorded: Recorded, nodes: Sequence[int], unknown: tuple[int, ...]) -> None:
        self.recorded, self.nodes, self.unknown = recorded, nodes, unknown
        self._parts = _parts(recorded, unknown)
        widths = [part.width for part in self._parts]
        self._offsets = [sum(widths[:k]) for k in range(len(widths))]
        self._variables = sum(widths)
        self.points = prod(len(_points(part.width, part.degree)) for part in self._parts)
        self.equations = recorded.schedule(nodes)
        self._known = recorded.unmoved(nodes, self.solved)
        self._before, self._moved = recorded.schedule(self._known), recorded.schedule(nodes, self._known)
        self._tried = self._closed = 0  # samples, over all primes
        self.is_open = False  # whether solutions are infinitely many, as at all of some random samples

    @property
    def work(self) -> int:
        """Operations for the coefficients of one sample."""
        return self._before.size + self.points * self._moved.size

    @property
    def fails(self) -> float:
        """How often the equations have no solution."""
        return (1 + self._tried - self._closed) / (2 + self._tried)

    @property
    def solved(self) -> set[str]:
        """Names of the unknown coordinates."""
        return {self.recorded.layout.names[c] for c in self.unknown}

    @cached_property
    def moving(self) -> set[str]:
        """Names of the coordinates that the equations depend on."""
        return self.recorded.moving(self.equations.leaves)

    @cached_property
    def fewer(self) -> ClosureBlock:
        """The block with one of the unknown coordinates drawn."""
        return ClosureBlock(self.recorded, self.nodes, self.unknown[1:])

    def solve(self, positions: Positions, pose: Pose, spend: Callable[[float], None]) -> Solutions:
        """Values of the unknown coordinates at which the equations hold; see :meth:`Solver.solve`."""
        spend(len(pose.numbers) * self.work / AT_ONCE)
        found = self.recorded.solver.solve(self._polynomials(positions, pose), positions.field, spend)
        self.is_open = not self._tried and len(found.counts) > 1 and bool((found.counts < 0).all())
        self._tried += len(found.counts)
        self._closed += int(np.count_nonzero(found.counts))
        return found

    def put(self, pose: Pose, points: Residues, field: PrimeField) -> None:
        """Write solutions (samples, variables) into poses, those that they were found from."""
        for part, offset in zip(self._parts, self._offsets, strict=True):
            part.put(pose, points[:, offset : offset + part.width].T, field)

    def _polynomials(self, positions: Positions, pose: Pose) -> list[Polynomial]:
        """The equations by the coefficients of their monomials; circles and spheres are among them."""
        coefficients, field = self._coefficients(positions, pose), positions.field
        monomials = [sum(m, ()) for m in product(*(_monomials(part.width, part.degree) for part in self._parts))]
        equations: list[Polynomial] = []
        for values in coefficients.reshape(len(coefficients), len(monomials), -1).transpose(2, 1, 0):
            present = np.flatnonzero(values.any(axis=1))
            if present.size:
                equations.append({monomials[k]: values[k] for k in present})
        for part, offset in zip(self._parts, self._offsets, strict=True):
            if len(part.columns) == 1:  # of what slides
                continue
            before, after = (0,) * offset, (0,) * (self._variables - offset - part.width)
            sizes = np.stack([part.size(pose, point, field) - 1 for point in _points(part.width, 2)])
            values = _interpolated(sizes, part.width, 2, field)
            equations.append({before + m + after: v for m, v in zip(_monomials(part.width, 2), values, strict=True)})
        return equations

    def _coefficients(self, positions: Positions, pose: Pose) -> Residues:
        """Coefficients, (samples, monomials of every unknown …, equations)."""
        field, samples = positions.field, len(pose.numbers)
        points = [_points(part.width, part.degree) for part in self._parts]
        corners = np.indices([len(point) for point in points]).reshape(len(points), prod(map(len, points)))
        probes = pose.repeated(corners.shape[1])
        for part, point, corner in zip(self._parts, points, corners, strict=True):
            part.put(probes, np.tile(point[corner].T, samples), field)
        owners = np.repeat(np.arange(samples), corners.shape[1])
        known = positions.equations(pose, self._before)[owners].T
        repeated = positions.at(owners).equations(probes, self._moved, dict(zip(self._known, known, strict=True)))
        values = repeated.reshape(samples, *map(len, points), len(self.nodes))
        for axis, part in enumerate(self._parts, 1):
            moved = _interpolated(np.moveaxis(values, axis, 0), part.width, part.degree, field)
            values = np.moveaxis(moved, 0, axis)
        return values


@dataclass(frozen=True)
class _Part:
    """An unknown coordinate, or those of a ball: a combination of directions, from zero or from what is drawn."""

    columns: list[int]  # of the numbers of a pose
    directions: Integers  # (variables, components)
    degree: int = 1  # of the equations in the variables
    drawn: bool = False

    @property
    def width(self) -> int:
        """Number of variables."""
        return len(self.directions)

    def put(self, pose: Pose, point: Residues, field: PrimeField) -> None:
        """Write values of the variables, (variables, samples), into a pose."""
        pose.numbers[:, self.columns] = self._at(pose.numbers[:, self.columns], point, field)

    def size(self, pose: Pose, point: Residues, field: PrimeField) -> Residues:
        """Square of the point's size at every sample: 1 on circles and spheres."""
        values = self._at(pose.numbers[:, self.columns], point, field)
        return np.asarray((values * values % field.p).sum(axis=1))

    def _at(self, values: Residues, point: Residues, field: PrimeField) -> Residues:
        start = values if self.drawn else np.zeros_like(values)
        terms = [x[..., None] * direction % field.p for x, direction in zip(point, self.directions, strict=True)]
        return np.asarray(reduce(np.add, terms, start) % field.p)


@cache
def _points(variables: int, degree: int) -> Integers:
    """Values of variables that determine a polynomial of degree one or two, (points, variables)."""
    unit = np.eye(variables, dtype=np.int64)
    sums = [unit[i] + unit[j] for i in range(variables) for j in range(i)]
    more = [*-unit, *sums] if degree > 1 else []
    return np.array([np.zeros_like(unit[0]), *unit, *more])


@cache
def _monomials(variables: int, degree: int) -> list[tuple[int, ...]]:
    """Exponents, as many as there are points."""
    chosen = [c for d in range(degree + 1) for c in combinations_with_replacement(range(variables), d)]
    return [tuple(c.count(k) for k in range(variables)) for c in chosen]


@cache
def _twice(variables: int, degree: int) -> Integers:
    """Twice the matrix from values at the points to coefficients, which is integral."""
    powers = np.prod(_points(variables, degree)[:, None, :] ** np.array(_monomials(variables, degree)), axis=2)
    return np.asarray(np.rint(2 * np.linalg.inv(powers)), dtype=np.int64)


def _interpolated(values: Residues, variables: int, degree: int, field: PrimeField) -> Residues:
    """Coefficients of the monomials, along the first axis, from values at the points."""
    combined = np.tensordot(_twice(variables, degree), values % field.p, axes=1) % field.p
    return np.asarray(combined * field.invert(2) % field.p)


def _parts(recorded: Recorded, unknown: tuple[int, ...]) -> list[_Part]:
    layout = recorded.layout
    ball = {int(column): place for place, columns in enumerate(layout.ball_places) for column in columns}
    single = [layout.columns[layout.names[c]] for c in unknown if c not in ball]
    parts = [_Part(columns, np.eye(len(columns), dtype=np.int64)) for columns in single]
    several = [ball[c] for c in unknown if c in ball]
    return parts + [_ball(place, layout.balls[place], several.count(place) + 1) for place in dict.fromkeys(several)]


def _ball(place: int, columns: Integers, width: int) -> _Part:
    """A quaternion in a plane of as many dimensions as there are variables."""
    if width == len(columns):
        return _Part(columns.tolist(), np.eye(width, dtype=np.int64), 2)
    rng = np.random.default_rng([_SEED, place])
    return _Part(columns.tolist(), rng.integers(1, _LARGEST, size=(width, len(columns))), 2, drawn=True)
