"""Exact expressions and angles written by people: ``pi/2``, ``D3/2``, ``-0.0825``, ``sqrt(2)/2``, ``2*cos(alpha)``.

Python's own parser reads the text and a short walk turns it into a :class:`Polynomial`; nothing is ever evaluated as
code.  ``pi`` becomes a generator of that name, so that an angle is a polynomial that is linear in ``pi`` and symbols: a
rational multiple of π plus rational multiples of symbols.

All that is read as an expression is later shown again, in terminals, pages, LaTeX and comments of source code.  So it
is one line of visible characters that all count: comments and control characters are refused here, once for all
readers.
"""

from __future__ import annotations

import ast
import re
import warnings
from collections.abc import Callable, Collection
from dataclasses import dataclass
from fractions import Fraction
from math import comb, isfinite, pi
from typing import Any

from echelon.algebra.exact.polynomial import (
    Number,
    Polynomial,
    Rational,
    Surd,
    cosine,
    cosine_of_turn,
    format_number,
    inverse,
    is_trigonometric,
    multiple_of,
    parts_of,
    repeated,
    simplest,
    sine,
    sine_of_turn,
    square_root,
)
from echelon.shared import shortened

STEPS_PER_HALF_TURN = (
    12  # π is twelve steps of 15°, the angles with a sine and cosine in Q(√2, √3)
)

LARGEST_EXPANSION = 8
"""cos(n x) is a polynomial of degree n in cos(x), with coefficients up to 2ⁿ that cost digits in floating point; beyond
this degree it stays a generator of its own."""


@dataclass(frozen=True)
class Angle:
    """half_turns·π + Σ coefficient·symbol + radians."""

    half_turns: Fraction = Fraction(0)  # multiple of π
    parts: tuple[tuple[str, Rational], ...] = ()  # symbolic part
    # A plain number of radians; it has no exact sine, so a reader must snap it or name it before use
    radians: Fraction = Fraction(0)

    @property
    def is_exact(self) -> bool:
        """Whether sine and cosine are polynomials in the symbols over Q(√2, √3)."""
        steps = self.half_turns * STEPS_PER_HALF_TURN
        return (
            not self.radians
            and steps.denominator == 1
            and all(c.denominator == 1 for _, c in self.parts)
        )

    @property
    def value(self) -> float:
        """The numeric part, rad."""
        return float(self.half_turns) * pi + float(self.radians)

    def cos(self) -> Polynomial:
        """Cosine as a polynomial in cos and sin of the symbols."""
        return self._circle()[0]

    def sin(self) -> Polynomial:
        """Sine as a polynomial in cos and sin of the symbols."""
        return self._circle()[1]

    def _circle(self) -> tuple[Polynomial, Polynomial]:
        if not self.is_exact:
            raise ValueError(
                f"the angle {self} has no exact sine: use a multiple of pi/12 (and whole multiples of symbols), or a "
                "symbol with that value"
            )
        steps = int(self.half_turns * STEPS_PER_HALF_TURN)
        point = (
            Polynomial.constant(cosine_of_turn(steps)),
            Polynomial.constant(sine_of_turn(steps)),
        )
        for symbol, count in self.parts:
            point = added(point, _multiple(symbol, int(count)))
        return point

    def __str__(self) -> str:
        parts = [f"{self.half_turns}*pi"] if self.half_turns else []
        parts += [f"{count}*{symbol}" for symbol, count in self.parts]
        if self.radians:
            parts.append(str(self.radians))
        return " + ".join(parts) or "0"


Point = tuple[Polynomial, Polynomial]  # cosine and sine of an angle


def multiple_of_point(point: Point, count: int) -> Point:
    """Cosine and sine of a multiple of an angle: of a symbol by name, else by repeated squaring of c + i s."""
    if abs(count) > LARGEST_EXPANSION:
        for generator in filter(is_trigonometric, point[0].generators()):
            times, symbol = multiple_of(generator)
            signed = times if point == _multiple(symbol, times) else -times
            if point == _multiple(symbol, signed):
                return _multiple(symbol, signed * count)
    base = (point[0], point[1] if count >= 0 else -point[1])
    return repeated(
        base, abs(count), (Polynomial.constant(1), Polynomial.constant(0)), added
    )


def added(a: Point, b: Point) -> Point:
    """Cosine and sine of a sum of angles."""
    return a[0] * b[0] - a[1] * b[1], a[0] * b[1] + a[1] * b[0]


def _multiple(symbol: str, count: int) -> Point:
    """Cosine and sine of a multiple of a symbol, expanded where that is short."""
    if abs(count) <= LARGEST_EXPANSION:
        return multiple_of_point(
            (Polynomial.generator(cosine(symbol)), Polynomial.generator(sine(symbol))),
            count,
        )
    argument = f"{abs(count)}*{symbol}"
    return Polynomial.generator(cosine(argument)), Polynomial.generator(
        sine(argument)
    ) * (1 if count > 0 else -1)


PI, PER_PI = "pi", "1/pi"
"""Generators for π and its inverse.  π is transcendental: no other numbers here are related to it."""
RESERVED = frozenset(
    {PI, "sin", "cos", "sqrt"}
)  # names with a fixed meaning, which no symbol may take

PIECE = 500
"""Characters of a part of a long sum, which is read by recursion."""
LONGEST_TERM = 4 * PIECE
"""Characters of a term, which cannot be divided."""
LONGEST = 1_000_000
"""Characters of an expression: seconds of reading."""
LARGEST_EXPONENT = 32
"""Exponent of a power of an expression."""
MOST_TERMS = 20_000
"""Terms of an expanded product or power."""
MOST_BITS = 20_000
"""Bits of a power of a number."""


Named = Callable[[Angle], Angle]
"""Puts a symbol in the place of an angle without an exact sine."""


def parse(
    text: str, symbols: Collection[str] | None = None, named: Named | None = None
) -> Polynomial:
    """Read an exact expression, with symbols for angles of numbers such as 63/50 if there is what names them.

    >>> parse("D3/2 - 0.5*D3 + 2*L^2")
    2*L^2
    >>> parse("cos(pi/4)")
    sqrt(2)/2
    """
    text = text.strip()
    if len(text) > LONGEST:
        raise ValueError(
            f"an expression of {len(text)} characters is too long (at most {LONGEST})"
        )
    # the walk below recurses along sums, so a long sum is read piece by piece
    value = Polynomial.sum(
        _parse_piece(piece, symbols, named) for piece in _pieces(text)
    )
    if not all(map(in_double_range, value.terms.values())):
        raise ValueError(f"'{shortened(text)}' is {BEYOND_DOUBLES}")
    return value


def _pieces(text: str) -> list[str]:
    """The text cut before signs that stand between terms, into parts that are no longer than necessary."""
    cuts, depth, start = [0], 0, 0
    for position, character in enumerate(text):
        depth += (character == "(") - (character == ")")
        if (
            position - start <= PIECE
            or depth
            or character not in "+-"
            or text[position - 1] != " "
        ):
            continue
        if text[start:position].rstrip()[-1] not in "+-*/^(":
            cuts.append(position)
            start = position
    return [
        text[a:b].strip() for a, b in zip(cuts, [*cuts[1:], len(text)], strict=True)
    ]


def _parse_piece(
    text: str, symbols: Collection[str] | None, named: Named | None
) -> Polynomial:
    if len(text) > LONGEST_TERM:
        raise ValueError(
            f"a term of {len(text)} characters is too long (at most {LONGEST_TERM})"
        )
    python = text.replace("^", "**")
    try:
        return _ExpressionReader(python, symbols, named).read(expression_tree(python))
    except (SyntaxError, RecursionError):
        raise ValueError(
            f"'{text}' is not an expression such as 0.5, pi/2, D3/2 or 2*cos(alpha)"
        ) from None


def parse_angle(text: str) -> Angle:
    """Read an angle in radians: a rational combination of ``pi``, symbols and plain numbers."""
    return as_angle(parse(text))


def as_angle(polynomial: Polynomial) -> Angle:
    """A polynomial that is linear in pi and symbols, as an angle."""
    turns: Rational = 0
    radians: Rational = 0
    parts: list[tuple[str, Rational]] = []
    for monomial, coefficient in polynomial.sorted_terms():
        if isinstance(coefficient, Surd) or sum(e for _, e in monomial) > 1:
            raise ValueError(
                f"'{polynomial}' is not an angle: it must be linear in pi and symbols"
            )
        name = monomial[0][0] if monomial else ""
        if name == PI:
            turns = coefficient
        elif name == PER_PI or name.endswith(")"):
            raise ValueError(f"'{polynomial}' is not an angle: it holds {name}")
        elif name:
            parts.append((name, coefficient))
        else:
            radians = coefficient
    return Angle(Fraction(turns), tuple(parts), Fraction(radians))


class _ExpressionReader:
    """One walk over the syntax tree of an expression."""

    def __init__(
        self, text: str, symbols: Collection[str] | None, named: Named | None
    ) -> None:
        self.text, self.symbols, self.named = text, symbols, named
        self._bytes = text.encode()  # the offsets in a syntax tree are those of bytes

    def read(self, node: ast.expr) -> Polynomial:
        match node:
            case ast.Constant(value=int() | float()):
                return self._number(node)
            case ast.Name(id=name):
                return self._symbol(name)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return -self.read(operand)
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.read(operand)
            case ast.BinOp(left=left, op=operator, right=right):
                return self._binary(operator, self.read(left), self.read(right))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                return self._call(name, self.read(argument))
        raise ValueError(
            f"'{ast.get_source_segment(self.text, node)}' is not allowed in an expression"
        )

    def _source(self, node: ast.Constant) -> str:
        """The text of a node; of long expressions in one line without a look at all of it."""
        if node.end_lineno == 1 and node.end_col_offset is not None:
            return self._bytes[node.col_offset : node.end_col_offset].decode()
        return ast.get_source_segment(self.text, node) or ""

    def _number(self, node: ast.Constant) -> Polynomial:
        literal = self._source(node)
        if (
            literal.isdecimal() and len(literal) <= LONGEST_DECIMAL
        ):  # parts of quotients may be beyond all doubles
            return Polynomial.constant(int(literal))
        return Polynomial.constant(parse_decimal(literal))

    def _symbol(self, name: str) -> Polynomial:
        if name != PI and name in RESERVED:
            raise ValueError(f"'{name}' is a function: write {name}(...)")
        if name != PI and self.symbols is not None and name not in self.symbols:
            known = ", ".join(sorted(self.symbols)) or "none"
            raise ValueError(f"'{name}' is not a declared symbol (declared: {known})")
        return Polynomial.generator(name)

    def _binary(
        self, operator: ast.operator, left: Polynomial, right: Polynomial
    ) -> Polynomial:
        if isinstance(operator, ast.Add):
            return left + right
        if isinstance(operator, ast.Sub):
            return left - right
        if isinstance(operator, ast.Mult):
            if len(left.terms) * len(right.terms) > MOST_TERMS:
                raise ValueError(
                    f"'{self.text}' expands to more than {MOST_TERMS} terms"
                )
            return _without_quotients(left * right)
        value = right.number
        if isinstance(operator, ast.Div):
            return _without_quotients(left * self._inverse(right))
        exponent = (
            int(value)
            if isinstance(value, int | Fraction) and value.denominator == 1
            else -1
        )
        if isinstance(operator, ast.Pow) and 0 <= exponent <= LARGEST_EXPONENT:
            if exponent * _bits(left) > MOST_BITS:
                raise ValueError(
                    f"'{self.text}' has numbers of more than {MOST_BITS} bits"
                )
            if (
                left.terms
                and comb(len(left.terms) + exponent - 1, exponent) > MOST_TERMS
            ):
                raise ValueError(
                    f"'{self.text}' expands to more than {MOST_TERMS} terms"
                )
            return left**exponent
        raise ValueError(
            f"in '{self.text}' only + - * / and powers 0 to {LARGEST_EXPONENT} are possible"
        )

    def _inverse(self, divisor: Polynomial) -> Polynomial:
        """1 by a number, or by a number times a power of pi."""
        problem = f"in '{self.text}' only division by a non-zero number, perhaps times pi, is possible"
        if len(divisor.terms) != 1:
            raise ValueError(problem)
        ((monomial, factor),) = divisor.terms.items()
        inverted = {PI: PER_PI, PER_PI: PI}
        if not inverted.keys() >= {generator for generator, _ in monomial}:
            raise ValueError(problem)
        return Polynomial(
            {
                tuple((inverted[generator], e) for generator, e in monomial): inverse(
                    factor
                )
            }
        )

    def _call(self, name: str, argument: Polynomial) -> Polynomial:
        if name == "sqrt" and argument.number is not None:
            return Polynomial.constant(square_root(argument.number))
        if name in ("cos", "sin"):
            angle = as_angle(argument)
            if self.named is not None and not angle.parts and not angle.is_exact:
                angle = self.named(angle)
            return angle.cos() if name == "cos" else angle.sin()
        raise ValueError(
            f"'{name}' is not a known function (known: sqrt of a number, sin, cos)"
        )


def _without_quotients(value: Polynomial) -> Polynomial:
    """An expression with π·(1/π) = 1 put in."""
    if not {PI, PER_PI} <= set(value.generators()):
        return value
    total = Polynomial({})
    for monomial, coefficient in value.terms.items():
        powers = dict(monomial)
        common = min(powers.get(PI, 0), powers.get(PER_PI, 0))
        left = tuple((g, e - common if g in (PI, PER_PI) else e) for g, e in monomial)
        total = total + Polynomial({tuple((g, e) for g, e in left if e): coefficient})
    return total


def pi_generators(pi: Any) -> dict[str, Any]:
    """Values of the generators π and 1/π in any arithmetic."""
    return {PI: pi, PER_PI: 1 / pi}


def _bits(polynomial: Polynomial) -> int:
    """Length of the longest integer in the coefficients."""
    parts = (part for c in polynomial.terms.values() for part in parts_of(c))
    return max(
        (n.bit_length() for part in parts for n in (part.numerator, part.denominator)),
        default=0,
    )


_QUOTED = re.compile(r"\"[^\"\\]*\"|'[^'\\]*'")


def expression_tree(text: str) -> ast.expr:
    """The syntax tree of an expression."""
    check_characters(text)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SyntaxWarning)
            return ast.parse(text, mode="eval").body
    except (RecursionError, MemoryError):
        raise SyntaxError("nested too deeply") from None


def check_characters(text: str) -> None:
    """Refuse what could hide in an expression: control characters, comments, and digits that only look like digits.

    >>> check_characters("0.3 # in metres")
    Traceback (most recent call last):
    ValueError: '0.3 # in metres' holds a comment: an expression ends where its last term ends
    """
    bare = _QUOTED.sub("", text)
    problem = ""
    if (hidden := next((c for c in text if not c.isprintable()), None)) is not None:
        problem = f"the control character U+{ord(hidden):04X}: an expression is one line of text"
    elif "#" in bare:
        problem = "a comment: an expression ends where its last term ends"
    elif (
        foreign := next((c for c in bare if c.isdigit() and not c.isascii()), None)
    ) is not None:
        problem = f"the digit U+{ord(foreign):04X}: digits are 0 to 9"
    if problem:
        raise ValueError(f"'{shortened(text)}' holds {problem}")


# -- numbers -----------------------------------------------------------------------------------------------------------

LONGEST_DECIMAL = 1000
"""Characters of a number, whose exponent may shift it as far."""
_DECIMAL = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE]([+-]?\d+))?", re.ASCII)
BEYOND_DOUBLES = "beyond the range of double precision (5e-324 to 1.8e308)"
"""What is said about numbers that no double comes near to."""


def parse_decimal(text: str) -> Rational:
    """The exact value of a decimal literal.

    >>> parse_decimal("-0.0825"), parse_decimal("1e-3"), parse_decimal("2.0")
    (Fraction(-33, 400), Fraction(1, 1000), 2)
    """
    if len(text) > LONGEST_DECIMAL:
        raise ValueError(
            f"a number of {len(text)} characters is too long (at most {LONGEST_DECIMAL})"
        )
    found = _DECIMAL.fullmatch(text)
    if found is None:
        raise ValueError(f"'{text}' is not a finite decimal number")
    # a large exponent is refused before it becomes as many digits
    value = Fraction(text) if abs(int(found[3] or 0)) <= 2 * LONGEST_DECIMAL else None
    if value is None or not in_double_range(value):
        raise ValueError(f"'{text}' is {BEYOND_DOUBLES}")
    return simplest(value)


def is_whole(text: str) -> bool:
    """Whether a text is a whole number without sign, in digits that are counted with."""
    return re.fullmatch(r"[0-9]{1,18}", text) is not None


def in_double_range(x: Number) -> bool:
    """Whether a number is zero or has a double next to it that is neither zero nor infinite."""
    try:
        if isinstance(x, Surd):
            return isfinite(float(x)) and all(map(in_double_range, x.parts))
        return not x or float(x) != 0
    except OverflowError:
        return False


def decimal_text(number: Number) -> str:
    """Exact text of a number, as a terminating decimal where it has one."""
    if isinstance(number, Surd):
        return format_number(number)
    denominator = Fraction(number).denominator
    for prime in (2, 5):
        while denominator % prime == 0:
            denominator //= prime
    if denominator != 1:
        return str(number)
    decimal = repr(float(number))
    return decimal if Fraction(decimal) == number else str(number)
