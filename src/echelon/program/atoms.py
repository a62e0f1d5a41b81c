"""Arguments of exponentials and angles as rational combinations of independent atoms.

An argument is a quotient of polynomials in generators.  Its atoms are Laurent monomials, and monomials over a common
denominator after division with remainder; atoms are linearly independent over the rationals, also modulo constants.
Then their exponentials, and the circle points of those that are angles, are algebraically independent of one another
and of everything that the atoms are made of (Ax, "On Schanuel's conjectures", Annals of Mathematics 93, 1971; for the
elementary functions: Rosenlicht, "On Liouville's theory of elementary functions", Pacific J. Math. 65, 1976).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction

from echelon.errors import UnknownRelationsError
from echelon.exact.factors import divided, factors, is_rational
from echelon.exact.numbers import Number, Surd, parts_of
from echelon.exact.polynomial import Monomial, Polynomial
from echelon.exact.rational import RationalFunction

_ONE = Polynomial.constant(1)
_BASIS: tuple[Number, ...] = (1, Surd((0, 1, 0, 0)), Surd((0, 0, 1, 0)), Surd((0, 0, 0, 1)))


@dataclass(frozen=True)
class Atom:
    """√radicand · Π generator^exponent / divisor."""

    powers: Monomial  # exponents may be negative
    root: int = 0  # 0 to 3 for a factor 1, √2, √3, √6
    divisor: Polynomial = _ONE

    @property
    def generator(self) -> str | None:
        """The generator that this atom is, if it is just one."""
        bare = len(self.powers) == 1 and self.powers[0][1] == 1 and not self.root and self.divisor == _ONE
        return self.powers[0][0] if bare else None

    @property
    def generators(self) -> set[str]:
        """All generators that occur."""
        return {g for g, _ in self.powers} | set(self.divisor.generators())

    @property
    def element(self) -> RationalFunction:
        """The atom as a quotient of polynomials."""
        top = Polynomial({tuple((g, e) for g, e in self.powers if e > 0): _BASIS[self.root]})
        bottom = Polynomial({tuple((g, -e) for g, e in self.powers if e < 0): 1})
        return RationalFunction(top, bottom * self.divisor)


@dataclass
class AtomBasis:
    """The common denominators of all arguments of one kind, growing as arguments are met."""

    is_constant: Callable[[str], bool]  # whether a generator is a constant of the model
    # least common multiples of the denominators' factors that hold constants only, and of the others; monomials become
    # Laurent monomials instead, as long as no other factor occurs
    constant_divisor: Polynomial = _ONE
    divisor: Polynomial = _ONE
    changed: bool = field(default=False)  # set when a denominator grew: then earlier combinations are to be formed anew

    def combination(self, argument: RationalFunction) -> list[tuple[Fraction, Atom]]:
        """The argument as Σ ratio · atom."""
        top, laurent = self._over_common_denominator(argument)
        if self.divisor == _ONE:
            quotient, rest = top, Polynomial({})
        else:
            quotient, rest = self._divided(top, self.divisor)
        parts = [(rest, self.constant_divisor * self.divisor)]
        if self.constant_divisor == _ONE:
            parts.append((quotient, _ONE))
        else:
            whole, fraction = self._divided(quotient, self.constant_divisor)
            parts += [(whole, _ONE), (fraction, self.constant_divisor)]
        return [
            (Fraction(part), Atom(_times(monomial, laurent), k, divisor))
            for polynomial, divisor in parts
            for monomial, coefficient in polynomial.sorted_terms()
            for k, part in enumerate(parts_of(coefficient))
            if part
        ]

    def _over_common_denominator(self, argument: RationalFunction) -> tuple[Polynomial, Monomial]:
        """Numerator over the two divisors, and the Laurent monomial that multiplies it."""
        bottom = argument.denominator
        if bottom == _ONE and self.divisor == _ONE and self.constant_divisor == _ONE:
            return argument.numerator, ()
        if not is_rational(bottom):
            raise UnknownRelationsError("a function of a quotient with square roots of numbers in its denominator")
        content, found = factors(bottom)
        constant, other, laurent = _ONE, _ONE, []
        bare = [(f, e) for f, e in found if len(f.terms) == 1]
        inside = [(f, e) for f, e in found if len(f.terms) > 1]
        for f, e in inside:
            if all(map(self.is_constant, f.generators())):
                constant = constant * f**e
            else:
                other = other * f**e
        for f, e in bare:
            name = f.generators()[0]
            if self.is_constant(name) or (other == _ONE and self.divisor == _ONE):
                laurent.append((name, -e))
            else:
                other = other * f**e
        self.constant_divisor = self._grown(self.constant_divisor, constant)
        self.divisor = self._grown(self.divisor, other)
        top = argument.numerator * (1 / content)
        lift = RationalFunction(self.constant_divisor, constant).numerator
        return top * lift * RationalFunction(self.divisor, other).numerator, tuple(laurent)

    def _grown(self, divisor: Polynomial, needed: Polynomial) -> Polynomial:
        """The least common multiple, up to a number."""
        missing = RationalFunction(needed, divisor).numerator
        if missing.number is not None:
            return divisor
        self.changed = True
        return _product(factors(divisor * missing)[1])

    def _divided(self, top: Polynomial, divisor: Polynomial) -> tuple[Polynomial, Polynomial]:
        names = sorted({*top.generators(), *divisor.generators()})
        order = sorted(names, key=lambda name: (self.is_constant(name), name))
        if not is_rational(top):
            raise UnknownRelationsError("a function of a quotient with square roots of numbers")
        if any(not self.is_constant(g) for g in divisor.generators()):
            self._check_leading(divisor, order)
        return divided(top, divisor, order)

    def _check_leading(self, divisor: Polynomial, order: Sequence[str]) -> None:
        """Remainders are unique modulo constants if the first coefficient, in what varies, is a number."""
        varying = [name for name in order if not self.is_constant(name)]

        def state(monomial: Monomial) -> tuple[int, ...]:
            powers = dict(monomial)
            return tuple(powers.get(name, 0) for name in varying)

        first = max(map(state, divisor.terms))
        leading = [m for m in divisor.terms if state(m) == first]
        if len(leading) > 1 or any(self.is_constant(g) for g, _ in leading[0]):
            raise UnknownRelationsError("a function of a quotient whose leading coefficient holds constants")


def _product(found: Sequence[tuple[Polynomial, int]]) -> Polynomial:
    total = _ONE
    for f, e in found:
        total = total * f**e
    return total


def _times(monomial: Monomial, other: Monomial) -> Monomial:
    powers = dict(monomial)
    for g, e in other:
        powers[g] = powers.get(g, 0) + e
    return tuple(sorted((g, e) for g, e in powers.items() if e))
