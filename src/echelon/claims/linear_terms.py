"""Expressions that are linear in the standard parameters, read exactly.

The same Python parser as in :mod:`echelon.exact.expressions`, but a walk of its own: the coefficients are rational
functions of the geometry (``MX2/a2`` is fine), and a product of two parameters is refused.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

from echelon.exact.expressions import parse
from echelon.exact.numbers import parse_decimal
from echelon.exact.polynomial import Polynomial
from echelon.exact.rational import RationalFunction
from echelon.exact.syntax import expression_tree

Terms = dict[str, RationalFunction]
"""Coefficients by parameter; the key "" holds the part without a parameter."""

_LARGEST_EXPONENT = 32
_ONE = RationalFunction(1)
_SIGNS = str.maketrans({"−": "-", "·": "*", "×": "*", "–": "-"})
_SUPERSCRIPT = re.compile("[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_DIGITS = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹", "0123456789")
_NAME = re.compile(r"[^\W\d]\w*")
_FUNCTIONS = frozenset({"sin", "cos", "sqrt", "pi"})


def plain_text(text: str) -> str:
    """An expression with the signs of formatted output (−, ·, ², √2, ^) in plain characters."""
    text = _SUPERSCRIPT.sub(lambda found: f"**{found[0].translate(_DIGITS)}", text.translate(_SIGNS))
    text = re.sub(r"\b(sin|cos)\*\*(\d+)\(([^()]*)\)", r"\1(\3)**\2", text)
    return re.sub(r"√(\d)", r"sqrt(\1)", text).replace("^", "**")


def names_in(text: str) -> list[str]:
    """Names that occur in an expression, in order."""
    return [name for name in _NAME.findall(plain_text(text)) if name not in _FUNCTIONS]


@dataclass(frozen=True)
class LinearReader:
    """Reads expressions."""

    parameter: Callable[[str], str | None]  # for a name its standard parameter, or None if it is not one
    symbol: Callable[[str], Polynomial]  # the value of any other name; raises ValueError if there is none

    def read(self, text: str) -> dict[str, RationalFunction]:
        """Non-zero coefficients by standard parameter, in the order of the text."""
        python = plain_text(text).strip()
        try:
            terms = _Walk(self, python.encode()).read(expression_tree(python))
        except (SyntaxError, RecursionError):
            raise ValueError(f"'{text}' is not an expression such as XX2 - YY2 + 2*l1*MX3 - 0.0506*M3") from None
        except ZeroDivisionError:
            raise ValueError(f"'{text}' divides by zero") from None
        constant = terms.pop("", None)
        if constant:
            raise ValueError(f"the term {constant} stands without a standard parameter")
        return {name: value for name, value in terms.items() if value}


@dataclass(frozen=True)
class _Walk:
    reader: LinearReader
    data: bytes

    def read(self, node: ast.expr) -> Terms:
        match node:
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return self._sum(node)
            case ast.Constant(value=int() | float()):
                return {"": RationalFunction(parse_decimal(self._source(node)))}
            case ast.Name(id=name):
                parameter = self.reader.parameter(name)
                return {parameter: _ONE} if parameter else {"": RationalFunction(self._named(name))}
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _scaled(self.read(operand), RationalFunction(-1))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.read(operand)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                return _product(self.read(left), self.read(right))
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                divisor = self._coefficient(right)
                if not divisor:
                    raise ZeroDivisionError
                return _scaled(self.read(left), _ONE / divisor)
            case ast.BinOp(left=left, op=ast.Pow(), right=right):
                return {"": self._power(left, right)}
            case ast.Call():
                return {"": RationalFunction(self._function(node))}
        raise ValueError(f"'{self._source(node)}' is not allowed in an expression")

    def _sum(self, node: ast.expr) -> Terms:
        """A chain of + and −, by a loop, because a long sum is a deep tree."""
        parts: list[tuple[ast.expr, int]] = []
        while isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
            parts.append((node.right, 1 if isinstance(node.op, ast.Add) else -1))
            node = node.left
        total = self.read(node)
        for part, sign in reversed(parts):
            for name, value in self.read(part).items():
                signed = value if sign > 0 else -value
                total[name] = total[name] + signed if name in total else signed
        return total

    def _named(self, name: str) -> Polynomial:
        return Polynomial.generator(name) if name == "pi" else self.reader.symbol(name)

    def _function(self, node: ast.expr) -> Polynomial:
        value = parse(self._source(node))
        for name in value.symbols():
            if self.reader.symbol(name) != Polynomial.generator(name):
                raise ValueError(f"'{name}' is defined by an expression and cannot stand in '{self._source(node)}'")
        return value

    def _coefficient(self, node: ast.expr) -> RationalFunction:
        terms = self.read(node)
        if set(terms) - {""}:
            raise ValueError(f"'{self._source(node)}' holds a standard parameter, which must be linear")
        return terms.get("", RationalFunction(0))

    def _power(self, base: ast.expr, exponent: ast.expr) -> RationalFunction:
        value = self._coefficient(exponent)
        number = value.numerator.number if value.is_polynomial else None
        whole = isinstance(number, int | Fraction) and Fraction(number).denominator == 1
        if not whole or not 0 <= int(number) <= _LARGEST_EXPONENT:  # type: ignore[arg-type]
            raise ValueError(f"only powers 0 to {_LARGEST_EXPONENT} are possible, not '{self._source(exponent)}'")
        factor, result = self._coefficient(base), _ONE
        for _ in range(int(number)):  # type: ignore[arg-type]
            result = result * factor
        return result

    def _source(self, node: ast.expr) -> str:
        return self.data[node.col_offset : node.end_col_offset].decode()


def _scaled(terms: Mapping[str, RationalFunction], factor: RationalFunction) -> Terms:
    return {name: value * factor for name, value in terms.items()}


def _product(left: Terms, right: Terms) -> Terms:
    if set(left) <= {""}:
        return _scaled(right, left.get("", RationalFunction(0)))
    if set(right) <= {""}:
        return _scaled(left, right.get("", RationalFunction(0)))
    raise ValueError(f"the product of {_first(left)} and {_first(right)} is not linear in the standard parameters")


def _first(terms: Terms) -> str:
    return next(name for name in terms if name)
