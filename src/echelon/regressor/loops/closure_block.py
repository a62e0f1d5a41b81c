"""Loops that are closed together: their equations as polynomials, and the coordinates that solve them.

A turning coordinate enters by the cosine and sine of its angle, a ball by its quaternion.  Each coordinate occurs once
in every chain, so the equations are linear in cosines, sines and sliding coordinates, and quadratic in quaternions.  So
their values where the variables of every coordinate are at a few points give all coefficients.

A ball of which some velocities are to be solved for and others drawn is sought in a random plane through the drawn
quaternion, of one dimension more than there are velocities to solve for; the unit sphere cuts it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import combinations_with_replacement, product
from math import prod

import numpy as np
import numpy.typing as npt

from echelon.exact.field import PrimeField, Residues
from echelon.exact.zero_dimensional import Solutions, Solver
from echelon.regressor.loops.moving import Pose
from echelon.regressor.loops.positions import Positions, Recorded

_SEED, _LARGEST = 2016, 1 << 15  # of the directions of planes
_QUATERNION = 4

Polynomial = dict[tuple[int, ...], Residues]
Integers = npt.NDArray[np.int64]


class ClosureBlock:
    """Equations, and the coordinates to solve them for."""

    def __init__(self, recorded: Recorded, rows: tuple[int, ...], unknown: tuple[int, ...]) -> None:
        self.recorded, self.rows, self.unknown = recorded, rows, unknown
        self._parts = _parts(recorded, unknown)
        widths = [part.width for part in self._parts]
        self._offsets = [sum(widths[:k]) for k in range(len(widths))]
        self._variables = sum(widths)
        self.points = prod(len(part.points) for part in self._parts)
        self._solver = Solver(self._variables)
        self._equations = recorded.some_equations(rows)

    def fewer(self) -> ClosureBlock:
        """The block with one of the unknown coordinates drawn."""
        return ClosureBlock(self.recorded, self.rows, self.unknown[1:])

    def solve(self, positions: Positions, pose: Pose) -> Solutions:
        """Values of the unknown coordinates at which the equations hold."""
        return self._solver.solve(self._polynomials(positions, pose), positions.field)

    def put(self, pose: Pose, sample: int, point: Residues, field: PrimeField) -> None:
        """Write a solution into the pose that it was found from."""
        for part, offset in zip(self._parts, self._offsets, strict=True):
            part.put(pose, np.array([sample]), point[offset : offset + part.width], field)

    def _polynomials(self, positions: Positions, pose: Pose) -> list[Polynomial]:
        """The equations by the coefficients of their monomials; circles and spheres are among them."""
        coefficients = self._coefficients(positions, pose)
        monomials = [sum(m, ()) for m in product(*(part.monomials for part in self._parts))]
        equations: list[Polynomial] = []
        for values in coefficients.reshape(len(coefficients), len(monomials), -1).transpose(2, 1, 0):
            present = np.flatnonzero(values.any(axis=1))
            if present.size:
                equations.append({monomials[k]: values[k] for k in present})
        for part, offset in zip(self._parts, self._offsets, strict=True):
            after = (0,) * (self._variables - offset - part.width)
            condition = part.condition(pose, positions.field)
            if condition:
                equations.append({(0,) * offset + m + after: value for m, value in condition.items()})
        return equations

    def _coefficients(self, positions: Positions, pose: Pose) -> Residues:
        """Coefficients, (samples, monomials of every unknown …, equations)."""
        field, samples = positions.field, len(pose.turns)
        sizes = [len(part.points) for part in self._parts]
        corners = list(product(*(range(size) for size in sizes)))
        probes = pose.repeated(len(corners))
        for number, corner in enumerate(corners):
            places = np.arange(number, samples * len(corners), len(corners))
            for part, k in zip(self._parts, corner, strict=True):
                part.put(probes, places, part.points[k], field)
        repeated = positions.at(np.repeat(np.arange(samples), len(corners)))
        values = repeated.equations(probes, self._equations).reshape(samples, *sizes, len(self.rows))
        for axis, part in enumerate(self._parts, 1):
            values = np.moveaxis(part.interpolated(np.moveaxis(values, axis, 0), field), 0, axis)
        return values


@dataclass(frozen=True)
class _Part:
    """An unknown coordinate, or those of a ball."""

    place: int  # among the coordinates of its kind
    width: int = 1  # number of variables
    degree: int = 1  # of the equations in these

    @cached_property
    def points(self) -> Integers:
        """Values of the variables that determine a polynomial, (points, variables)."""
        unit = np.eye(self.width, dtype=np.int64)
        sums = [unit[i] + unit[j] for i in range(self.width) for j in range(i)]
        more = [*-unit, *sums] if self.degree > 1 else []
        return np.array([np.zeros_like(unit[0]), *unit, *more])

    @cached_property
    def monomials(self) -> list[tuple[int, ...]]:
        """Exponents, as many as there are points."""
        variables = range(self.width)
        chosen = [c for d in range(self.degree + 1) for c in combinations_with_replacement(variables, d)]
        return [tuple(c.count(k) for k in variables) for c in chosen]

    def interpolated(self, values: Residues, field: PrimeField) -> Residues:
        """Coefficients of the monomials, along the first axis, from values at the points."""
        combined = np.tensordot(self._twice, values % field.p, axes=1) % field.p
        return np.asarray(combined * field.invert(2) % field.p)

    @cached_property
    def _twice(self) -> Integers:
        """Twice the matrix from values to coefficients, which is then integral."""
        powers = np.prod(self.points[:, None, :] ** np.array(self.monomials), axis=2)
        return np.asarray(np.rint(2 * np.linalg.inv(powers)), dtype=np.int64)

    def put(self, pose: Pose, samples: npt.NDArray[np.intp], point: Residues, field: PrimeField) -> None:
        """Write values of the variables into some samples of a pose."""
        raise NotImplementedError

    def condition(self, pose: Pose, field: PrimeField) -> Polynomial:
        """Equation between the variables; without terms if there is none."""
        raise NotImplementedError


class _Slide(_Part):
    def put(self, pose: Pose, samples: npt.NDArray[np.intp], point: Residues, field: PrimeField) -> None:
        pose.slides[samples, self.place] = point[0] % field.p

    def condition(self, pose: Pose, field: PrimeField) -> Polynomial:  # noqa: ARG002
        return {}


class _Turn(_Part):
    def put(self, pose: Pose, samples: npt.NDArray[np.intp], point: Residues, field: PrimeField) -> None:
        pose.turns[samples, self.place] = point % field.p

    def condition(self, pose: Pose, field: PrimeField) -> Polynomial:
        one = np.ones(len(pose.turns), dtype=np.int64)
        return {(2, 0): one, (0, 2): one, (0, 0): -one % field.p}


class _Ball(_Part):
    """A quaternion in a plane of as many dimensions as there are variables."""

    @cached_property
    def _directions(self) -> Integers:
        """Of the plane, (variables, 4); it goes through the drawn quaternion unless it is everything."""
        if self.width == _QUATERNION:
            return np.eye(_QUATERNION, dtype=np.int64)
        rng = np.random.default_rng([_SEED, self.place])
        return rng.integers(1, _LARGEST, size=(self.width, _QUATERNION))

    def put(self, pose: Pose, samples: npt.NDArray[np.intp], point: Residues, field: PrimeField) -> None:
        pose.balls[samples, self.place] = self._at(pose.balls[samples, self.place], point, field)

    def condition(self, pose: Pose, field: PrimeField) -> Polynomial:
        drawn = pose.balls[:, self.place]
        sizes = np.array([_square(self._at(drawn, point, field), field) for point in self.points])
        return dict(zip(self.monomials, self.interpolated(sizes - 1, field), strict=True))

    def _at(self, drawn: Residues, point: Residues, field: PrimeField) -> Residues:
        """Points of the planes through drawn quaternions, (samples, 4)."""
        start = np.zeros_like(drawn) if self.width == _QUATERNION else drawn
        terms = [x * direction % field.p for x, direction in zip(point, self._directions, strict=True)]
        return np.asarray(reduce(np.add, terms, start) % field.p)


def _square(quaternions: Residues, field: PrimeField) -> Residues:
    return np.asarray((quaternions * quaternions % field.p).sum(axis=-1))


def _parts(recorded: Recorded, unknown: tuple[int, ...]) -> list[_Part]:
    layout = recorded.layout
    turn = {int(column): place for place, column in enumerate(layout.turn_places)}
    slide = {int(column): place for place, column in enumerate(layout.slide_places)}
    ball = {int(column): place for place, columns in enumerate(layout.ball_places) for column in columns}
    parts: list[_Part] = [_Turn(turn[c], 2) if c in turn else _Slide(slide[c]) for c in unknown if c not in ball]
    balls = [ball[c] for c in unknown if c in ball]
    return parts + [_Ball(place, balls.count(place) + 1, 2) for place in dict.fromkeys(balls)]
