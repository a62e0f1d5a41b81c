"""The expressions of a description: lengths, angles, directions and plain numbers, with errors that name the place.

Angles may be given as decimals, which round: 1.5708 is read as π/2 by the same rules as in other robot files (see
:mod:`echelon.formats.intent`).  An angle that is stated exactly, with ``pi`` or symbols, is never moved.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from fractions import Fraction

from echelon.errors import InputError
from echelon.exact.angle import STEPS_PER_HALF_TURN, Angle
from echelon.exact.expressions import PI, as_angle, parse
from echelon.exact.numbers import Number, Rational, Surd
from echelon.exact.polynomial import Polynomial
from echelon.formats.description_text import Document
from echelon.formats.intent import Intent
from echelon.formats.literal import LiteralTree
from echelon.formats.options import ReadingOptions
from echelon.formats.size import NOT_FINITE, checked_size
from echelon.hints import nearest
from echelon.mechanism.mechanism import Symbol
from echelon.mechanism.placement import Vector

_MOST_TERMS = 5000
_LEADING_ZERO = re.compile(r"[+-]?0\d+")


class Expressions:
    """Reads the expressions of one description."""

    def __init__(
        self,
        document: Document,
        options: ReadingOptions,
        literal: Collection[str],
        symbols: Mapping[str, Symbol],
    ) -> None:
        self.document = document
        self.declared = frozenset(symbols)
        self.intent = Intent(LiteralTree(document.source, document.source, ()), options, literal, dict(symbols))

    @property
    def named(self) -> dict[str, Symbol]:
        """Symbols that were given to angles without an exact sine."""
        return {name: symbol for name, symbol in self.intent.symbols.items() if name not in self.declared}

    def error(self, path: str, problem: str) -> InputError:
        """An error about the element at a path."""
        return self.document.error(path, problem)

    def polynomial(self, text: str, path: str, coordinates: Collection[str] = ()) -> Polynomial:
        """Any expression in declared symbols, pi, and coordinates where they may stand."""
        value = self.parsed(text, path)
        for name in value.symbols():
            if name not in self.declared and name not in coordinates and name != PI:
                problem = f"the symbol '{name}' in '{text}' is not declared: list it in symbols"
                if coordinates:
                    problem = f"'{name}' in '{text}' is neither a coordinate nor a declared symbol"
                raise self.error(path, problem + nearest(name, [*self.declared, *coordinates]))
        return value

    def parsed(self, text: str, path: str) -> Polynomial:
        """An expression in any names."""
        self._check_spelling(text, path)
        try:
            value = parse(text)
            if len(value.terms) > _MOST_TERMS:
                raise ValueError(f"the expression expands to {len(value.terms)} terms (at most {_MOST_TERMS})")
            for coefficient in value.terms.values():
                checked_size(coefficient, text)
        except ValueError as error:
            raise self.error(path, str(error)) from None
        return value

    def _check_spelling(self, text: str, path: str) -> None:
        if NOT_FINITE.fullmatch(text) and text not in self.declared:
            raise self.error(path, f"'{text}' is not a finite number")
        if _LEADING_ZERO.fullmatch(text) and int(text):
            raise self.error(path, f"'{text}' could be decimal or octal: write it without the leading zero")
        if "°" in text or text.endswith("deg"):
            raise self.error(path, f"'{text}' is in degrees: angles are in radians, such as 30*pi/180")

    def length(self, text: str, path: str) -> Polynomial:
        """An expression that is not an angle, so without pi."""
        value = self.polynomial(text, path)
        if PI in value.generators():
            raise self.error(path, f"pi can occur in angles only, not in '{text}': use a symbol or a number")
        return value

    def vector(self, texts: Sequence[str], path: str) -> Vector:
        """Three lengths, or three components of gravity."""
        x, y, z = (self.length(text, f"{path}[{i}]") for i, text in enumerate(texts))
        return (x, y, z)

    def number(self, text: str, path: str) -> Number:
        """A number without symbols."""
        value = self.length(text, path).number
        if value is None:
            raise self.error(path, f"'{text}' must be a number here, without symbols")
        return value

    def real(self, text: str, path: str) -> float:
        """A number as a float."""
        return float(self.number(text, path))

    def direction(self, axis: str | Sequence[str], path: str) -> tuple[Rational, Rational, Rational]:
        """A direction: a coordinate axis such as ``-x``, or three numbers that are not all zero."""
        if isinstance(axis, str):
            sign = -1 if axis.startswith("-") else 1
            x, y, z = (sign if letter == axis[-1] else 0 for letter in "xyz")
            return (x, y, z)
        numbers = [self.number(text, f"{path}[{i}]") for i, text in enumerate(axis)]
        if not any(numbers):
            raise self.error(path, "the axis is zero; it needs a direction such as z or [0, 0, 1]")
        # only directions are taken from these numbers, as floats, so a square root may be rounded like one
        a, b, c = (Fraction(float(n)) if isinstance(n, Surd) else n for n in numbers)
        return (a, b, c)

    def angle(self, text: str, path: str, name: str) -> Angle:
        """An angle in radians."""
        return self.exact_angle(self.polynomial(text, path), path, name)

    def exact_angle(self, value: Polynomial, path: str, name: str) -> Angle:
        """An expression as an angle with exact sine and cosine."""
        try:
            stated = as_angle(value)
        except ValueError as error:
            raise self.error(path, str(error)) from None
        for symbol, count in stated.parts:
            if count.denominator != 1:
                problem = f"'{value}' holds a fraction of the angle {symbol}: make the smaller angle the symbol"
                raise self.error(path, problem)
        has_steps = (stated.half_turns * STEPS_PER_HALF_TURN).denominator == 1
        turns = stated.half_turns if has_steps else Fraction(0)
        if not has_steps:
            # stated exactly as a part of pi, so it must not be mistaken for a rounded multiple of 15°
            read = self.intent.named_angle(Angle(stated.half_turns, radians=stated.radians), path, name)
        elif stated.radians:
            read = self.intent.angle(stated.radians, path, name)
        else:
            read = Angle()
        return Angle(turns + read.half_turns, (*stated.parts, *read.parts))
