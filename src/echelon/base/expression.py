"""Base parameters as expressions a person reads: XX3 − YY3 + YY4 + 2·d4·MZ4 + d4²·(M4 + M5 + M6)."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

from echelon.algebra import (
    PER_PI,
    PI,
    Monomial,
    Number,
    Polynomial,
    RationalFunction,
    Surd,
    decimal_text,
    is_negative,
    is_trigonometric,
    multiple_of,
)
from echelon.base.matrix import in_units
from echelon.shared import PARAMETERS, one_line, public

DECIMAL_DIGITS = 9
"""Digits of a coefficient that is shown as a decimal number."""
MOST_TERMS = 12
"""Terms of a coefficient that is shown as a formula: a longer one says no more than its value does."""


@dataclass(frozen=True)
class ParameterGroup:
    """Standard parameters with a common coefficient."""

    coefficient: RationalFunction
    parameters: tuple[str, ...]
    # whether the coefficient is a number in place of a closed form, to be shown with a few digits
    decimal: bool = False
    terms: int = (
        0  # of the coefficient, where only their number is to be shown; 0 where all are
    )


@public
@dataclass(frozen=True)
class Expression:
    """One base parameter, with parameters of equal coefficient collected.

    Attributes
    ----------
    name : str
        The representative, which has coefficient 1.
    unit : str
    groups : tuple of ParameterGroup
        The first is the representative alone.
    """

    name: str
    unit: str
    groups: tuple[ParameterGroup, ...]

    def __str__(self) -> str:
        return render(self, TextStyle())

    @property
    def latex(self) -> str:
        """LaTeX, without dollar signs."""
        return render(self, LatexStyle())

    @property
    def longest(self) -> int:
        """Terms of the longest coefficient."""
        return max(count_terms(group.coefficient) for group in self.groups)

    def readable(self, value: Callable[[RationalFunction], float | None]) -> Expression:
        """An expression for people: long coefficients are their value, or the count of their terms where it is None.

        So are coefficients in units of angles, which no user has named.
        """
        return replace(
            self, groups=tuple(_readable(group, value) for group in self.groups)
        )

    def _repr_latex_(self) -> str:
        return f"${self.latex}$"


def count_terms(coefficient: RationalFunction) -> int:
    """Terms of numerator and denominator."""
    denominator = 0 if coefficient.is_polynomial else len(coefficient.denominator.terms)
    return len(coefficient.numerator.terms) + denominator


def _readable(
    group: ParameterGroup, value: Callable[[RationalFunction], float | None]
) -> ParameterGroup:
    terms = count_terms(group.coefficient)
    if terms <= MOST_TERMS and not in_units(group.coefficient):
        return group
    number = value(group.coefficient)
    if number is None:
        return replace(group, terms=terms)
    return ParameterGroup(
        RationalFunction(Fraction(number)), group.parameters, decimal=True
    )


def collect(
    name: str,
    unit: str,
    terms: Sequence[tuple[str, RationalFunction]],
    decimals: Collection[str] = (),
) -> Expression:
    """Group terms with equal coefficients, the representative first; those of ``decimals`` are numbers."""
    groups: dict[tuple[RationalFunction, bool], list[str]] = {}
    for parameter, coefficient in terms:
        if parameter != name:
            groups.setdefault(
                (coefficient, parameter in decimals and _is_decimal(coefficient)), []
            ).append(parameter)
    head = ParameterGroup(RationalFunction(1), (name,))
    return Expression(
        name,
        unit,
        (
            head,
            *(ParameterGroup(c, tuple(names), d) for (c, d), names in groups.items()),
        ),
    )


def _is_decimal(coefficient: RationalFunction) -> bool:
    """Whether a number is best shown as a decimal: it is one, or a long fraction, or none."""
    number = coefficient.numerator.number
    return (
        not isinstance(number, Fraction)
        or "/" not in decimal_text(number)
        or len(str(number)) > DECIMAL_DIGITS
    )


def angle_text(
    generator: str, style: TextStyle, symbol: Callable[[str], str] = str
) -> str:
    """The argument of a sine or cosine: an angle symbol, or a multiple of one."""
    count, name = multiple_of(generator)
    return symbol(name) if count == 1 else f"{count}{style.times}{symbol(name)}"


_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


class TextStyle:
    """How pieces of an expression are written: Unicode for terminals."""

    times, minus = "·", "−"

    def parameter(self, name: str) -> str:
        """A standard parameter, by its name."""
        return one_line(name)

    def generator(self, name: str, exponent: int) -> str:
        """A power of a symbol, sine or cosine: ``d4²``, ``cos²(a)``, ``sin(40·a)``."""
        power = str(exponent).translate(_SUPERSCRIPTS) if exponent > 1 else ""
        if is_trigonometric(name):
            return f"{name[:3]}{power}({angle_text(name, self)})"
        return f"{name}{power}"

    def number(self, value: Number) -> str:
        """A non-negative number, or a surd: ``3/2``, ``√2/2``."""
        if not isinstance(value, Surd):
            return str(value)
        return (
            re.sub(r"sqrt\((\d)\)", r"√\1", repr(value))
            .replace("*", "")
            .replace("-", self.minus)
        )

    def decimal(self, text: str) -> str:
        """A non-negative decimal number, perhaps with an exponent after ``e``, as it is."""
        return text

    def count(self, terms: int) -> str:
        """A sum of which only the number of terms is shown."""
        return f"({terms} terms)"

    def fraction(self, top: str, bottom: str) -> str:
        """A quotient with a slash, in parentheses because it is followed by a product."""
        if self.times in bottom and not bottom.startswith("("):
            return f"({top}/({bottom}))"
        return f"({top}/{bottom})"


class LatexStyle(TextStyle):
    """LaTeX math."""

    times, minus = r"\,", "-"

    def parameter(self, name: str) -> str:
        """E.g. ``XX_{3}``; of an effect's parameter all before the digits at its end, such as ``Fv_{1}``."""
        inertial = (
            k for k in sorted(PARAMETERS, key=len, reverse=True) if name.startswith(k)
        )
        kind = next(inertial, re.sub(r"[0-9]+$", "", name) or name)
        rest = name[len(kind) :]
        return f"\\mathit{{{_escape(kind)}}}" + (
            f"_{{{_escape(rest)}}}" if rest else ""
        )

    def generator(self, name: str, exponent: int) -> str:
        """A power, with the name's digits as index."""
        power = f"^{{{exponent}}}" if exponent > 1 else ""
        if is_trigonometric(name):
            return f"\\{name[:3]}{power}({angle_text(name, self, latex_symbol)})"
        if name == PER_PI:
            return rf"\pi^{{-{exponent}}}"
        return (r"\pi" if name == PI else latex_symbol(name)) + power

    def number(self, value: Number) -> str:
        """With small fractions and roots."""
        if isinstance(value, Surd):
            return re.sub(r"sqrt\((\d)\)", r"\\sqrt{\1}", repr(value)).replace("*", "")
        fraction = Fraction(value)
        if fraction.denominator == 1:
            return str(fraction.numerator)
        return f"\\tfrac{{{fraction.numerator}}}{{{fraction.denominator}}}"

    def decimal(self, text: str) -> str:
        """With a power of ten."""
        mantissa, _, exponent = text.partition("e")
        return rf"{mantissa}\cdot 10^{{{int(exponent)}}}" if exponent else text

    def count(self, terms: int) -> str:
        """As text."""
        return rf"(\text{{{terms} terms}})"

    def fraction(self, top: str, bottom: str) -> str:
        """With a fraction bar."""
        return f"\\frac{{{_bare(top)}}}{{{_bare(bottom)}}}"


def _bare(text: str) -> str:
    """A factor without parentheses around all of it, which a fraction bar makes superfluous."""
    depth = 0
    for position, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if not depth and position < len(text) - 1:
            return text
    return text[1:-1] if text.startswith("(") else text


def latex_symbol(name: str) -> str:
    """A symbol with its trailing digits as index: ``d4`` → ``d_{4}``, ``px4`` → ``p_{x4}``."""
    offset = re.fullmatch(r"p([xyz])(\d\w*)", name)
    if offset:
        return f"p_{{{offset[1]}{_escape(offset[2])}}}"
    indexed = re.fullmatch(r"([^\W\d_]+)_?(\d\w*)", name)
    stem, index = (indexed[1], indexed[2]) if indexed else (name, "")
    stem = _escape(stem) if len(stem) == 1 else f"\\mathrm{{{_escape(stem)}}}"
    return f"{stem}_{{{_escape(index)}}}" if index else stem


def latex_polynomial(polynomial: Polynomial) -> str:
    """A polynomial in symbols and π."""
    text = _factor(polynomial, LatexStyle()) if polynomial else "0"
    return _bare(text)


_WORDS = {"\\": "\\backslash ", "^": "\\wedge ", "~": "\\sim "}


def _escape(text: str) -> str:
    """Text that is safe in LaTeX math."""
    return re.sub(
        r"[_#$%&{}\\^~]",
        lambda found: _WORDS.get(found[0], "\\" + found[0]),
        one_line(text),
    )


def render(expression: Expression, style: TextStyle) -> str:
    """An expression in a style."""
    return _sum([_group(group, style) for group in expression.groups], style)


def _sum(terms: Sequence[tuple[int, str]], style: TextStyle) -> str:
    """A sum of terms, each by its sign and absolute value."""
    (sign, first), *others = terms
    text = (style.minus if sign < 0 else "") + first
    return text + "".join(
        f" {style.minus if s < 0 else '+'} {term}" for s, term in others
    )


def _group(group: ParameterGroup, style: TextStyle) -> tuple[int, str]:
    """Sign and absolute value of a group."""
    names = [style.parameter(name) for name in group.parameters]
    if group.terms:
        sign, factor = 1, style.count(group.terms)
    elif group.decimal:
        sign, factor = _decimal_text(group, style)
    else:
        sign, factor = coefficient_text(group.coefficient, style)
    if not factor:
        joiner = f" {style.minus if sign < 0 else '+'} "
        return sign, joiner.join(names)
    body = names[0] if len(names) == 1 else f"({' + '.join(names)})"
    return sign, f"{factor}{style.times}{body}"


def _decimal_text(group: ParameterGroup, style: TextStyle) -> tuple[int, str]:
    """Sign and absolute value of a number; the text is empty for ±1."""
    value = group.coefficient.evaluate({}, float)
    size = f"{abs(value):.{DECIMAL_DIGITS}g}"
    return (-1 if value < 0 else 1), "" if size == "1" else style.decimal(size)


def coefficient_text(
    coefficient: RationalFunction, style: TextStyle
) -> tuple[int, str]:
    """Sign and absolute value of a coefficient; the text is empty for ±1."""
    top, bottom = coefficient.numerator, coefficient.denominator
    _, lead = next(top.sorted_terms(), ((), 1))
    sign = -1 if is_negative(lead) else 1
    top = -top if sign < 0 else top
    if coefficient.is_polynomial:
        return sign, "" if top == 1 else _factor(top, style)
    return sign, style.fraction(_factor(top, style), _factor(bottom, style))


def _factor(polynomial: Polynomial, style: TextStyle) -> str:
    """A polynomial as a factor: in parentheses when it is a sum."""
    terms = [_term(m, c, style) for m, c in polynomial.sorted_terms()]
    if len(terms) == 1 and terms[0][0] > 0:
        return terms[0][1]
    return f"({_sum(terms, style)})"


def _term(monomial: Monomial, coefficient: Number, style: TextStyle) -> tuple[int, str]:
    sign = -1 if is_negative(coefficient) else 1
    size = -coefficient if sign < 0 else coefficient
    factors = [style.generator(g, e) for g, e in monomial]
    if size != 1 or not factors:
        text = style.number(size)
        several = isinstance(size, Surd) and sum(map(bool, size.parts)) > 1
        factors.insert(0, f"({text})" if several else text)
    return sign, style.times.join(factors)
