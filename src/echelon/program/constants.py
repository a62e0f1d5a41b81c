"""Names for the generators that are constants of a model: ``a``, ``exp[a/2]``, ``log[2]``, ``root2[a]``.

Coefficients of B may depend on them like on any other constant, so they are symbols to everyone else.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from fractions import Fraction

from echelon.exact.numbers import Number, Surd
from echelon.exact.polynomial import Monomial, Polynomial
from echelon.exact.rational import RationalFunction
from echelon.program.canonical import CanonicalForms, Generator


@dataclass(frozen=True)
class ConstantName:
    """A generator that is a constant of the model."""

    name: str  # without parentheses, so that it is a symbol and not the cosine of one
    # an expression in the model's constants (see :mod:`echelon.program.text`); equal to the name for a plain one
    definition: str
    is_angle: bool = False  # whether values stand for the tangent of half of the constant


def constant_names(canonical: CanonicalForms, numeric: Collection[str]) -> dict[str, ConstantName]:
    """Names of all generators known so far that are constants, by generator."""
    names: dict[str, ConstantName] = {}
    for generator in canonical.generators.values():
        if not generator.constant or generator.kind == "root":
            continue
        if all(g in names for g in generator.element.symbols()):
            names[generator.name] = _named(canonical, generator, numeric, names)
    return names


def _named(
    canonical: CanonicalForms, generator: Generator, numeric: Collection[str], names: dict[str, ConstantName]
) -> ConstantName:
    unit = canonical.unit(generator.name)
    if generator.kind == "input":
        plain = canonical.program.inputs[generator.node].name
        return ConstantName(plain, plain) if unit == 1 else ConstantName(f"root{unit}[{plain}]", f"{plain}^(1/{unit})")
    inner = generator.element.symbols()
    is_input = len(inner) == 1 and generator.element == Polynomial.generator(inner[0])
    if generator.kind == "angle" and unit == 1 and is_input and canonical.generators[inner[0]].kind == "input":
        plain = names[inner[0]].definition
        if inner[0] not in numeric:
            return ConstantName(plain, plain, is_angle=True)
    share = 2 * unit if generator.kind == "angle" else unit
    element = generator.element * RationalFunction(Polynomial.constant(1), share)
    function = "tan" if generator.kind == "angle" else generator.kind
    shown = _renamed(element, {g: names[g].name for g in inner})
    definition = _renamed(element, {g: _grouped(names[g].definition, " *^/") for g in inner})
    bare = f"abs({definition})" if function == "log" and " " in definition else definition
    return ConstantName(f"{function}[{shown}]", f"{function}({bare})")


def _renamed(element: RationalFunction, names: dict[str, str]) -> str:
    """An element as text, with its generators called by name."""

    def written(polynomial: Polynomial) -> str:
        return " + ".join(term(m, c) for m, c in polynomial.sorted_terms()).replace("+ -", "- ") or "0"

    def term(monomial: Monomial, coefficient: Number) -> str:
        if isinstance(coefficient, Surd):
            factors, below = [f"({coefficient})"], 1
        else:
            number, below = Fraction(coefficient).numerator, Fraction(coefficient).denominator
            factors = [] if abs(number) == 1 and monomial else [str(abs(number))]
        factors += [f"{names[g]}^{e}" if e > 1 else names[g] for g, e in monomial]
        sign = "-" if not isinstance(coefficient, Surd) and coefficient < 0 else ""
        return sign + "*".join(factors) + (f"/{below}" if below > 1 else "")

    top = written(element.numerator)
    if element.is_polynomial:
        return top
    bottom = written(element.denominator)
    return f"{_grouped(top, ' ')}/{_grouped(bottom, ' */')}"


def _grouped(text: str, separators: str) -> str:
    """Text in parentheses if one of some characters is in it."""
    return f"({text})" if any(c in text for c in separators) else text
