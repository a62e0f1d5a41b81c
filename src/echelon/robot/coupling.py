"""Couplings: coordinates that depend on others through sums of polynomials and cubic splines."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import pairwise
from math import inf, isfinite
from typing import Any, TypeVar

import flint
import numpy as np

from echelon.algebra import Polynomial, Rational
from echelon.shared import Floats

T = TypeVar("T")
_ZERO = Polynomial({})
_CUBIC = 3  # degree of a spline's powers behind its knots
CELLS = 500
"""Cells of a range, in each of which a bound of the second derivative bounds the slope."""


@dataclass(frozen=True)
class Spline:
    """f(x) = Σ aᵢ xⁱ + Σ cₖ |x − xₖ|³ over the knots that lie between 0 and x, so that f(0) = 0.

    Without knots it is a polynomial, and with one coefficient a linear function.  A cubic spline is the polynomial of
    its piece at zero, and from each knot on, seen from zero, what the third derivative's jump there adds.
    """

    coefficients: tuple[Polynomial, ...]  # a₁, a₂, …; trailing zeros are dropped
    knots: tuple[
        tuple[Rational, Polynomial], ...
    ] = ()  # pairs xₖ, cₖ, sorted; those with cₖ = 0 are dropped

    def __post_init__(self) -> None:
        kept = len(self.coefficients)
        while kept and not self.coefficients[kept - 1]:
            kept -= 1
        added: dict[Rational, Polynomial] = {}
        for knot, jump in self.knots:
            added[knot] = added.get(knot, _ZERO) + jump
        object.__setattr__(self, "coefficients", self.coefficients[:kept])
        object.__setattr__(
            self, "knots", tuple((x, added[x]) for x in sorted(added) if added[x])
        )

    def __str__(self) -> str:
        x = Polynomial.generator("x")
        text = str(
            Polynomial.sum(c * x**k for k, c in enumerate(self.coefficients, start=1))
        )
        if self.ratio is not None:
            return str(self.ratio)
        return text + f" and {len(self.knots)} knots" * bool(self.knots)

    @property
    def ratio(self) -> Polynomial | None:
        """The factor of a linear function; None for any other."""
        if self.knots or len(self.coefficients) > 1:
            return None
        return self.coefficients[0] if self.coefficients else _ZERO

    @property
    def expressions(self) -> tuple[Polynomial, ...]:
        """All coefficients."""
        return (*self.coefficients, *(jump for _, jump in self.knots))

    def mapped(self, put: Callable[[Polynomial], Polynomial]) -> Spline:
        """The function with other coefficients."""
        return Spline(
            tuple(map(put, self.coefficients)),
            tuple((x, put(jump)) for x, jump in self.knots),
        )

    def __add__(self, other: Spline) -> Spline:
        length = max(len(self.coefficients), len(other.coefficients))
        a, b = (
            [*s.coefficients, *[_ZERO] * (length - len(s.coefficients))]
            for s in (self, other)
        )
        return Spline(
            tuple(x + y for x, y in zip(a, b, strict=True)), (*self.knots, *other.knots)
        )

    def after(self, inner: Spline, offset: Polynomial) -> tuple[Spline, Polynomial]:
        """The function of another one, x ↦ f(g(x) + offset), as a spline and a constant."""
        if self.ratio is not None:
            ratio = self.ratio
            return inner.mapped(lambda c: c * ratio), ratio * offset
        if inner.ratio == 1 and not offset:
            return self, offset
        if self.knots or inner.knots:
            raise ValueError(
                "a spline of a coordinate that itself depends on others is not supported"
            )
        argument, total = [offset, *inner.coefficients], [_ZERO]
        for coefficient in reversed((_ZERO, *self.coefficients)):
            total = _product(total, argument)
            total[0] = total[0] + coefficient
        return Spline(tuple(total[1:])), total[0]

    def derivatives(
        self, x: T, number: Callable[[Polynomial], T], beyond: Callable[[T], T]
    ) -> tuple[T, T, T]:
        """f, f′ and f″ at a point, over any ring."""
        a = (_ZERO, *self.coefficients)
        slopes = [k * c for k, c in enumerate(a)][1:]
        curvatures = [k * c for k, c in enumerate(slopes)][1:]
        value, slope, curvature = (
            _horner(c, x, number) for c in (a, slopes, curvatures)
        )
        for knot, jump in self.knots:
            sign = 1 if knot >= 0 else -1
            distance: Any = (x - number(Polynomial.constant(knot))) * sign  # type: ignore[operator]
            over = distance * beyond(distance)
            value = value + number(jump) * over * over * over
            slope = slope + number(jump * (_CUBIC * sign)) * over * over
            curvature = curvature + number(jump * (_CUBIC * 2)) * over
        return value, slope, curvature

    def floats(
        self, x: Floats | float, symbols: Mapping[str, float]
    ) -> tuple[Any, Any, Any]:
        """f, f′ and f″ in double precision, at one point or at an array of points."""
        point: Any = x
        return self.derivatives(
            point, lambda c: c.at(symbols), lambda distance: 1.0 * (distance > 0)
        )

    def steepest(self, reach: float, symbols: Mapping[str, float]) -> float:
        """An upper bound of |f′| while |x| stays within a reach, from values on a grid and a bound of |f″|."""
        if self.ratio is not None:
            return abs(self.ratio.at(symbols))
        if not isfinite(reach):
            return inf
        slopes = self.floats(np.linspace(-reach, reach, 2 * CELLS + 1)[1::2], symbols)[
            1
        ]
        # |f″| is at most what the sizes of all terms add up to at the end, each knot counted from zero on
        sizes = self.mapped(lambda c: Polynomial.constant(Fraction(abs(c.at(symbols)))))
        bend = Spline(
            sizes.coefficients, tuple((0, size) for _, size in sizes.knots)
        ).floats(reach, {})[2]
        return float(np.abs(slopes).max() + bend * reach / CELLS)


def linear(ratio: Polynomial) -> Spline:
    """The linear function ratio · x."""
    return Spline((ratio,))


def natural_spline(
    points: Sequence[tuple[Rational, Rational]],
) -> tuple[Spline, Rational]:
    """The natural cubic spline through points, straight beyond the first and the last, as a spline and a constant."""
    ordered = sorted((Fraction(x), Fraction(y)) for x, y in points)
    if len(ordered) < 2 or any(a[0] == b[0] for a, b in pairwise(ordered)):
        raise ValueError("a spline needs two points or more, each with an x of its own")
    x, y = zip(*ordered, strict=True)
    # from the left it is a line to which every knot adds c (x − xₖ)³; beyond the last, Σ c = Σ c xₖ = 0 leave a line
    rows = [[1, point, *(max(point - knot, 0) ** _CUBIC for knot in x)] for point in x]
    start, slope, *jumps = _solved(
        [*rows, [0, 0, *(1 for _ in x)], [0, 0, *x]], [*y, 0, 0]
    )
    pieces = [start, slope, Fraction(0), Fraction(0)]
    for knot, jump in zip(x, jumps, strict=True):
        if knot < 0:
            pieces = [
                p + jump * q
                for p, q in zip(
                    pieces, (-(knot**3), 3 * knot**2, -3 * knot, 1), strict=True
                )
            ]
    found = Spline(tuple(map(Polynomial.constant, pieces[1:])))
    knots = tuple(
        (knot, Polynomial.constant(jump)) for knot, jump in zip(x, jumps, strict=True)
    )
    return replace(found, knots=knots), pieces[0]


def _solved(
    rows: Sequence[Sequence[Rational]], right: Sequence[Rational]
) -> list[Fraction]:
    """The solution of linear equations in rational numbers."""

    def exact(values: Iterable[Rational]) -> list[flint.fmpq]:
        return [flint.fmpq(value.numerator, value.denominator) for value in values]

    left = flint.fmpq_mat([exact(row) for row in rows])
    column = flint.fmpq_mat(len(right), 1, exact(right))
    return [
        Fraction(int(number.p), int(number.q))
        for number in left.solve(column).entries()
    ]


def _horner(
    coefficients: Sequence[Polynomial], x: T, number: Callable[[Polynomial], T]
) -> T:
    total: Any = number(_ZERO)
    for coefficient in reversed(coefficients):
        total = total * x + number(coefficient)
    return total  # type: ignore[no-any-return]


def _product(a: Sequence[Polynomial], b: Sequence[Polynomial]) -> list[Polynomial]:
    found = [_ZERO] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            found[i + j] = found[i + j] + x * y
    return found


@dataclass(frozen=True)
class Coupling:
    """A dependent coordinate as a sum of functions of independent ones: q = Σ f_k(q_k), with f_k(0) = 0.

    A constant offset belongs into the geometry (a placement), not here.
    """

    coordinate: str
    terms: tuple[tuple[str, Spline], ...]

    @property
    def is_linear(self) -> bool:
        """Whether the coordinate is a linear combination of others."""
        return all(function.ratio is not None for _, function in self.terms)
