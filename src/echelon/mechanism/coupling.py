"""Couplings: coordinates that depend on others through sums of polynomials."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf, isfinite
from typing import Any, TypeVar

import numpy as np

from echelon.arrays import Floats
from echelon.exact.polynomial import Polynomial

T = TypeVar("T")
_ZERO = Polynomial({})
_CELLS = 500


@dataclass(frozen=True)
class Powers:
    """f(x) = Σ aᵢ xⁱ over i ≥ 1, so that f(0) = 0; with one coefficient a linear function."""

    coefficients: tuple[Polynomial, ...]  # a₁, a₂, …; trailing zeros are dropped

    def __post_init__(self) -> None:
        kept = len(self.coefficients)
        while kept and not self.coefficients[kept - 1]:
            kept -= 1
        object.__setattr__(self, "coefficients", self.coefficients[:kept])

    def __str__(self) -> str:
        x = Polynomial.generator("x")
        powers = Polynomial.sum(c * x**k for k, c in enumerate(self.coefficients, start=1))
        return str(powers if self.ratio is None else self.ratio)

    @property
    def ratio(self) -> Polynomial | None:
        """The factor of a linear function; None for any other."""
        if len(self.coefficients) > 1:
            return None
        return self.coefficients[0] if self.coefficients else _ZERO

    def mapped(self, put: Callable[[Polynomial], Polynomial]) -> Powers:
        """The function with other coefficients."""
        return Powers(tuple(map(put, self.coefficients)))

    def __add__(self, other: Powers) -> Powers:
        length = max(len(self.coefficients), len(other.coefficients))
        a, b = ([*s.coefficients, *[_ZERO] * (length - len(s.coefficients))] for s in (self, other))
        return Powers(tuple(x + y for x, y in zip(a, b, strict=True)))

    def after(self, inner: Powers, offset: Polynomial) -> tuple[Powers, Polynomial]:
        """The function of another one, x ↦ f(g(x) + offset), as powers and a constant."""
        argument, total = [offset, *inner.coefficients], [_ZERO]
        for coefficient in reversed((_ZERO, *self.coefficients)):
            total = _product(total, argument)
            total[0] = total[0] + coefficient
        return Powers(tuple(total[1:])), total[0]

    def derivatives(self, x: T, number: Callable[[Polynomial], T]) -> tuple[T, T, T]:
        """f, f′ and f″ at a point, over any ring."""
        a = (_ZERO, *self.coefficients)
        slopes = [k * c for k, c in enumerate(a)][1:]
        curvatures = [k * c for k, c in enumerate(slopes)][1:]
        return _horner(a, x, number), _horner(slopes, x, number), _horner(curvatures, x, number)

    def floats(self, x: Floats | float, symbols: Mapping[str, float]) -> tuple[Any, Any, Any]:
        """f, f′ and f″ in double precision, at one point or at an array of points."""
        point: Any = x
        return self.derivatives(point, lambda c: c.at(symbols))

    def steepest(self, reach: float, symbols: Mapping[str, float]) -> float:
        """What |f′| does not exceed while |x| stays within a reach: values on a grid, and what can lie between them."""
        if self.ratio is not None:
            return abs(self.ratio.at(symbols))
        if not isfinite(reach):
            return inf
        slopes = self.floats(np.linspace(-reach, reach, 2 * _CELLS + 1)[1::2], symbols)[1]
        # |f″| is at most what the sizes of all terms add up to at the end
        sizes = self.mapped(lambda c: Polynomial.constant(Fraction(abs(c.at(symbols)))))
        return float(np.abs(slopes).max() + sizes.floats(reach, {})[2] * reach / _CELLS)


def linear(ratio: Polynomial) -> Powers:
    """The linear function ratio · x."""
    return Powers((ratio,))


def _horner(coefficients: Sequence[Polynomial], x: T, number: Callable[[Polynomial], T]) -> T:
    total: Any = number(_ZERO)
    for coefficient in reversed(coefficients):
        total = total * x + number(coefficient)
    return total  # type: ignore[no-any-return]


def _product(a: Sequence[Polynomial], b: Sequence[Polynomial]) -> list[Polynomial]:
    return [Polynomial.sum(_terms(a, b, k)) for k in range(len(a) + len(b) - 1)]


def _terms(a: Sequence[Polynomial], b: Sequence[Polynomial], k: int) -> Iterator[Polynomial]:
    return (a[i] * b[k - i] for i in range(len(a)) if 0 <= k - i < len(b))


@dataclass(frozen=True)
class Coupling:
    """A dependent coordinate as a sum of functions of independent ones: q = Σ f_k(q_k), with f_k(0) = 0.

    A constant offset belongs into the geometry (a placement), not here.
    """

    coordinate: str
    terms: tuple[tuple[str, Powers], ...]

    @property
    def is_linear(self) -> bool:
        """Whether the coordinate is a linear combination of others."""
        return all(function.ratio is not None for _, function in self.terms)
