"""Values of surfaces at real points, in double precision and, where it decides, in ball arithmetic."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

import flint
import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, SignArray
from echelon.exact.numbers import Rational
from echelon.program.balls import BallArithmetic, ball
from echelon.program.intervals import interval_values
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.surfaces import Surfaces

_BITS = (128, 512)


class RealValues:
    """Evaluates surfaces at real points."""

    def __init__(self, surfaces: Surfaces, constants: Mapping[int, Rational | float]) -> None:
        self.surfaces, self.constants = surfaces, constants
        self.variables = [n for n in surfaces.inputs if n not in constants]
        program = surfaces.program
        rows = [*surfaces.nodes, *surfaces.positive, *surfaces.nonzero]
        self._schedule = Schedule(program, rows)
        place = {n: k for k, n in enumerate(self.variables)}
        self.spheres = [[place[n] for n in group] for group in program.unit_groups if all(n in place for n in group)]
        self.cones = [self._cone(n) for n in rows]
        self._nested = np.array([n in surfaces.nested for n in surfaces.nodes], dtype=bool)

    def _cone(self, node: int) -> list[int]:
        """Places of the variables that a surface depends on."""
        needed = set(self.surfaces.program.needed([node]))
        return [k for k, n in enumerate(self.variables) if n in needed]

    def normal(self, points: Floats) -> Floats:
        """Points with quaternions of unit length."""
        for group in self.spheres:
            size = np.sqrt((points[group] ** 2).sum(axis=0))
            points[group] /= np.where(size > 0, size, 1.0)
        return points

    def at(self, points: Floats) -> Floats:
        """Values of the surfaces, then of what must be positive, and of what must not vanish."""
        # shapes: points (variables, points); returns (surfaces + positive + nonzero, points)
        count = points.shape[1]
        leaves = {n: points[k] for k, n in enumerate(self.variables)}
        leaves |= {n: np.full(count, float(value)) for n, value in self.constants.items()}
        with np.errstate(all="ignore"):
            return np.asarray(self._schedule.run(FloatArithmetic(), leaves, count), dtype=np.float64)

    def inside(self, values: Floats) -> npt.NDArray[np.bool_]:
        """Which points are in the domain and on no surface, but for those that may vanish on a region."""
        count = len(self.surfaces.nodes)
        good = self.in_domain(values)
        good &= ((values[:count] != 0) | self._nested[:, None]).all(axis=0)
        return np.asarray(good, dtype=bool)

    def in_domain(self, values: Floats) -> npt.NDArray[np.bool_]:
        """Which points are in the domain."""
        first, last = len(self.surfaces.nodes), len(self.surfaces.nodes) + len(self.surfaces.positive)
        good = ~np.isnan(values).any(axis=0) & (values[first:last] > 0).all(axis=0) & (values[last:] != 0).all(axis=0)
        return np.asarray(good, dtype=bool)

    def certain(self, point: Floats, free: frozenset[int] = frozenset()) -> SignArray | None:
        """The signs at a point as ball arithmetic proves them, None if it cannot."""
        # shapes: point (variables,); returns (surfaces,)
        count = len(self.surfaces.nodes)
        for bits in _BITS:
            values = self._balls(point, bits)
            last = count + len(self.surfaces.positive)
            if not (all(v > 0 for v in values[count:last]) and all(v != 0 for v in values[last:])):
                continue
            known = [self._sign(v, bits, nested) for v, nested in zip(values, self._nested, strict=False)]
            if all(s is not None or n in free for s, n in zip(known, self.surfaces.nodes, strict=True)):
                return np.array([s or 0 for s in known], dtype=np.int8)
        return None

    def _sign(self, value: flint.arb, bits: int, nested: bool) -> int | None:
        if value > 0 or value < 0:
            return 1 if value > 0 else -1
        return 0 if nested and bits == _BITS[-1] and value.is_finite() and value.rad() < 2.0 ** (-bits / 2) else None

    def _balls(self, point: Floats, bits: int) -> list[flint.arb]:
        before = flint.ctx.prec
        try:
            flint.ctx.prec = bits
            known = {n: ball(x if isinstance(x, float) else Fraction(x)) for n, x in self.constants.items()}
            known |= {n: ball(float(x)) for n, x in zip(self.variables, point, strict=True)}
            leaves = {n: np.array([x], dtype=object) for n, x in known.items()}
            return [row[0] for row in self._schedule.run(BallArithmetic(), leaves, 1)]
        finally:
            flint.ctx.prec = before

    def vanishing(self, points: Floats) -> frozenset[int]:
        """Surfaces that ball arithmetic cannot tell from zero at any of some points of the domain."""
        count, suspects = len(self.surfaces.nodes), set(self.surfaces.nodes) - set(self.variables)
        for point in points.T:
            if not suspects:
                break
            values = self._balls(point, _BITS[-1])
            suspects -= {n for n, v in zip(self.surfaces.nodes, values[:count], strict=True) if v > 0 or v < 0}
        return frozenset(suspects) if points.shape[1] else frozenset()

    def one_sided(self) -> dict[int, int]:
        """Surfaces whose values have one sign everywhere by interval arithmetic, or in the domain."""
        program, surfaces = self.surfaces.program, self.surfaces
        everything = (np.asarray(-np.inf), np.asarray(np.inf))
        inputs = dict.fromkeys(self.variables, everything)
        inputs |= {n: (np.asarray(float(x)), np.asarray(float(x))) for n, x in self.constants.items()}
        found = {n: 1 for n in surfaces.nodes if n in surfaces.positive}
        for n, (low, high) in zip(surfaces.nodes, interval_values(program, surfaces.nodes, inputs), strict=True):
            if n not in surfaces.nested and (low >= 0 or high <= 0):
                found[n] = 1 if low >= 0 else -1
        return found
