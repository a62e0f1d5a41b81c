"""Quotients of polynomials, reduced to lowest terms.

In the classical base-to-tip order the entries of B are polynomials, so the denominator is almost always 1 and every
operation takes a short cut.  Other column orders bring true denominators; then common factors are cancelled with
FLINT's multivariate gcd.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any, TypeVar

import flint

from echelon.exact.numbers import Number, Surd, inverse, parts_of, surd
from echelon.exact.polynomial import Monomial, Polynomial, as_polynomial, format_polynomial

T = TypeVar("T")
_ONE = Polynomial.constant(1)


class RationalFunction:
    """An immutable quotient of polynomials in lowest terms, with a normalised denominator.

    Examples
    --------
    >>> a, b = Polynomial.generator("a"), Polynomial.generator("b")
    >>> RationalFunction(a * a - b * b, a * 2 + b * 2)
    a/2 - b/2
    """

    __slots__ = ("denominator", "numerator")

    def __init__(self, numerator: Polynomial | Number, denominator: Polynomial | Number = _ONE) -> None:
        top, bottom = as_polynomial(numerator), as_polynomial(denominator)
        if not bottom:
            raise ZeroDivisionError("a rational function needs a non-zero denominator")
        if bottom != _ONE:
            top, bottom = _lowest_terms(top, bottom)
        self.numerator, self.denominator = top, bottom

    def __add__(self, other: RationalFunction) -> RationalFunction:
        if self.denominator == other.denominator:
            return RationalFunction(self.numerator + other.numerator, self.denominator)
        top = self.numerator * other.denominator + other.numerator * self.denominator
        return RationalFunction(top, self.denominator * other.denominator)

    def __neg__(self) -> RationalFunction:
        return RationalFunction(-self.numerator, self.denominator)

    def __sub__(self, other: RationalFunction) -> RationalFunction:
        return self + (-other)

    def __mul__(self, other: RationalFunction) -> RationalFunction:
        return RationalFunction(self.numerator * other.numerator, self.denominator * other.denominator)

    def __truediv__(self, other: RationalFunction) -> RationalFunction:
        return RationalFunction(self.numerator * other.denominator, self.denominator * other.numerator)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, RationalFunction):
            return isinstance(other, Polynomial | int | Fraction | Surd) and self == RationalFunction(other)
        return self.numerator * other.denominator == other.numerator * self.denominator

    def __hash__(self) -> int:
        if self.is_polynomial:
            return hash(self.numerator)
        return hash(_unique(self.numerator, self.denominator))

    def __bool__(self) -> bool:
        return bool(self.numerator)

    @property
    def is_polynomial(self) -> bool:
        """Whether the denominator is 1."""
        return self.denominator == _ONE

    def symbols(self) -> list[str]:
        """Symbols that occur, sorted."""
        return sorted({*self.numerator.symbols(), *self.denominator.symbols()})

    def evaluate(self, values: Mapping[str, T], number: Callable[[Number], T]) -> T:
        """Value over any field; see :meth:`Polynomial.evaluate`."""
        top: Any = self.numerator.evaluate(values, number)
        return top if self.is_polynomial else top / self.denominator.evaluate(values, number)  # type: ignore[no-any-return]

    def __repr__(self) -> str:
        top = format_polynomial(self.numerator)
        if self.is_polynomial:
            return top
        return f"({top})/({format_polynomial(self.denominator)})"


def _lowest_terms(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    if not top:
        return top, _ONE
    if bottom.number is None:
        ring = Ring(top, bottom)
        short = _coprime(ring.enter(top), ring.enter(bottom))
        plain = _coprime(*ring.rationalised(*short))
        # a true quotient is mostly longer when rationalised, but a polynomial shows itself only then
        top, bottom = map(ring.leave, plain if plain[1].is_constant() else short)
    return _monic(top, bottom)


def _unique(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The one way of writing a quotient with coprime polynomials and no sine or root in the denominator."""
    ring = Ring(top, bottom)
    plain = _coprime(*ring.rationalised(ring.enter(top), ring.enter(bottom)))
    return _monic(*map(ring.leave, plain))


def _monic(top: Polynomial, bottom: Polynomial) -> tuple[Polynomial, Polynomial]:
    """The same quotient with 1 as first coefficient of the denominator."""
    lead = next(bottom.sorted_terms())[1]
    scale = inverse(lead)
    return top * _plain(scale), bottom * _plain(scale)


def _plain(x: Number) -> Number:
    """An integral fraction as an int."""
    return x.numerator if isinstance(x, Fraction) and x.denominator == 1 else x


def _coprime(top: Any, bottom: Any) -> tuple[Any, Any]:
    """FLINT polynomials divided by their greatest common divisor."""
    divisor = top.gcd(bottom)
    return top / divisor, bottom / divisor


class Ring:
    """FLINT's ring for some polynomials, with √2 and √3 as extra generators.

    FLINT does not know that sines and roots are algebraic, so its gcd may miss a factor that needs their squares.

    Parameters
    ----------
    *polynomials : Polynomial
        That :meth:`enter` is to take.

    Attributes
    ----------
    names : tuple of str
        The generators, in the order of exponents.
    """

    def __init__(self, *polynomials: Polynomial) -> None:
        generators = {g for polynomial in polynomials for g in polynomial.generators()}
        sines = sorted(g for g in generators if g.startswith("sin("))
        generators |= {"cos" + g[3:] for g in sines}
        self.names = (*sorted(generators), "√2", "√3")
        self.context = flint.fmpq_mpoly_ctx.get(("x", len(self.names)), flint.Ordering.lex)
        element = dict(zip(self.names, self.context.gens(), strict=True))
        squares = {"√2": self.context.constant(2), "√3": self.context.constant(3)}
        squares |= {g: 1 - element["cos" + g[3:]] ** 2 for g in sines}
        self.squares = [(self.names.index(g), element[g], square) for g, square in squares.items()]

    def enter(self, polynomial: Polynomial) -> Any:
        """A polynomial as an element of this ring."""
        terms: dict[tuple[int, ...], Any] = {}
        for monomial, coefficient in polynomial.terms.items():
            powers = dict(monomial)
            exponents = [powers.get(name, 0) for name in self.names[:-2]]
            for k, part in enumerate(parts_of(coefficient)):
                if part:
                    terms[*exponents, k & 1, k >> 1] = flint.fmpq(part.numerator, part.denominator)
        return self.context.from_dict(terms)

    def leave(self, element: Any) -> Polynomial:
        """An element without squares of roots as a polynomial."""
        terms: dict[Monomial, Number] = {}
        for exponents, coefficient in element.to_dict().items():
            monomial = tuple((name, int(e)) for name, e in zip(self.names[:-2], exponents, strict=False) if e)
            value = _plain(Fraction(int(coefficient.p), int(coefficient.q)))
            root = surd(*(int(k == exponents[-2] + 2 * exponents[-1]) for k in range(4)))
            terms[monomial] = terms.get(monomial, 0) + root * value
        return Polynomial(terms)

    def reduced(self, element: Any) -> Any:
        """The same element with sines and roots to the first power at most."""
        for index, generator, square in self.squares:
            if element.degrees()[index] > 1:
                p, q = self._split(element, index, square)
                element = p + q * generator
        return element

    def rationalised(self, top: Any, bottom: Any) -> tuple[Any, Any]:
        """The same quotient with a denominator free of sines and roots, by multiplying with its conjugates."""
        for index, element, square in self.squares:
            (p, q), (a, b) = self._split(top, index, square), self._split(bottom, index, square)
            top, bottom = p + q * element, a
            if b:
                top, bottom = p * a - q * b * square + (q * a - p * b) * element, a * a - b * b * square
        return top, bottom

    def _split(self, polynomial: Any, index: int, square: Any) -> tuple[Any, Any]:
        """Parts without and with one generator, whose powers are replaced by powers of its square."""
        by_power: dict[int, dict[tuple[int, ...], Any]] = {}
        for exponents, coefficient in polynomial.to_dict().items():
            rest = (*exponents[:index], 0, *exponents[index + 1 :])
            by_power.setdefault(int(exponents[index]), {})[rest] = coefficient
        halves = [self.context.constant(0), self.context.constant(0)]
        for power, terms in by_power.items():
            halves[power % 2] += self.context.from_dict(terms) * square ** (power // 2)
        return halves[0], halves[1]
