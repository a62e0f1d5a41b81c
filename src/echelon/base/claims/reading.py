"""Claimed base parameters: from text, CSV or JSON, one expression each, to exact coefficients of standard parameters.

A program that prints ``0.050625`` and ``0.07`` in one set means 0.070000 by the latter: trailing zeros are dropped.  So
the precision belongs to the set: its longest decimal tells the number of decimals, or of significant digits, to which
all are rounded.  More than nine are floating-point noise.

Expressions are linear in the standard parameters, in the notation of :mod:`echelon.base.claims.notation`.  The Python
parser of :mod:`echelon.algebra.exact.expressions` reads them, but a walk of its own follows: the coefficients are
rational functions of the geometry (``MX2/a2`` is fine), and a product of two parameters is refused.

How other programs write the standard parameters is one table.  A naming is a list of patterns; with the labels and
names of a model's bodies they give the vocabulary, all texts that stand for a parameter of this model.  Sources:
SYMORO's `.par` and `.dyn` files (Khalil & Creusot 1997), SymPyBotics' `dynparms`, and FIGAROH's `params_std`, which
follows Pinocchio's `toDynamicParameters`.
"""

from __future__ import annotations

import ast
import csv
import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from difflib import get_close_matches
from fractions import Fraction
from math import floor, log10
from pathlib import Path
from typing import Any

from echelon.algebra import (
    LARGEST_EXPONENT,
    Polynomial,
    RationalFunction,
    expression_tree,
    parse,
    parse_decimal,
)
from echelon.base.claims.notation import COMMENT, Line, Notation, lines_of
from echelon.base.expression import DECIMAL_DIGITS
from echelon.base.model import BaseModel
from echelon.shared import PARAMETERS, InputError, parse_json, read_document

_HEADERS = (
    "expression", "closed form", "base parameter", "base parameters", "base", "base_parameter", "base_parameters",
    "parameter", "parameters", "params_base", "name",
)  # fmt: skip
"""Titles of a column of expressions, most telling first."""
_SCHEMA = "echelon.base-model/1"
_DECIMAL = re.compile(
    r"(?<![\w.])(?:(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)(?![\d.])"
)


@dataclass(frozen=True)
class Claim:
    """One claimed base parameter, as text."""

    text: str  # the expression
    where: str  # where it stands: ``line 3``, ``entry 'beta_2'``
    name: str | None = None  # the name that its author gave it
    # other cells of its row, such as values, by title or number
    columns: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class WrittenClaims:
    """Claims as they were written."""

    claims: tuple[Claim, ...] = ()
    lines: tuple[
        Line, ...
    ] = ()  # of a text, each of which may be several claims or none

    @property
    def texts(self) -> list[str]:
        """All that was written, piece by piece."""
        return [*(c.text for c in self.claims), *(line.text for line in self.lines)]


def read_claims(
    source: str | os.PathLike[str] | Sequence[str] | Mapping[str, str],
) -> WrittenClaims:
    """Claims from a file or from texts."""
    if isinstance(source, str | os.PathLike):
        return _read_file(Path(source))
    claims = _from_json(
        source if isinstance(source, Mapping) else list(source), "claims"
    )
    if not claims:
        raise InputError("no base parameters are claimed")
    return WrittenClaims(claims)


def _read_file(file: Path) -> WrittenClaims:
    text = read_document(file)
    match file.suffix.lower():
        case ".json":
            claims = WrittenClaims(_from_json(parse_json(text, str(file)), str(file)))
        case ".csv" | ".tsv":
            claims = WrittenClaims(_from_table(text))
        case _:
            claims = WrittenClaims(lines=tuple(lines_of(text)))
    if not claims.texts:
        raise InputError(
            "holds no base parameters: expected rows such as XX2R = XX2 - YY2",
            source=str(file),
        )
    return claims


def _from_table(text: str) -> tuple[Claim, ...]:
    lines = text.splitlines()
    first = next((line for line in lines if line.strip()), "")
    delimiter = max(",;\t", key=first.count)
    rows = [
        (n, [cell.strip() for cell in row])
        for n, row in enumerate(csv.reader(lines, delimiter=delimiter), 1)
    ]
    rows = [(n, row) for n, row in rows if any(row) and not COMMENT.match(row[0])]
    if not rows:
        return ()
    titles = [cell.lower() for cell in rows[0][1]]
    column = next(
        (titles.index(header) for header in _HEADERS if header in titles), None
    )
    if column is None:
        titles = [str(k + 1) for k in range(max(len(row) for _, row in rows))]
        column = 0
    else:
        rows = rows[1:]
    claims = []
    for number, row in rows:
        cells = dict(zip(titles, row, strict=False))
        expression = cells.pop(titles[column], "")
        name = cells.get("name") or None
        if expression:
            claims.append(Claim(expression, f"line {number}", name, cells))
    return tuple(claims)


def _from_json(data: Any, source: str) -> tuple[Claim, ...]:
    if isinstance(data, Mapping) and "schema" in data:
        return _from_base_model(data, source)
    entries: list[tuple[str | None, Any]]
    if isinstance(data, Mapping):
        entries = [(str(name), value) for name, value in data.items()]
    elif isinstance(data, list):
        entries = [(None, value) for value in data]
    else:
        raise InputError(
            "expected a list of expressions or a mapping of names to expressions",
            source=source,
        )
    claims = []
    for number, (name, value) in enumerate(entries, 1):
        where = f"entry {number}" if name is None else f"entry '{name}'"
        if not isinstance(value, str):
            raise InputError(
                f"expected an expression as text, not {value!r:.40}",
                source=source,
                element=where,
            )
        claims.append(Claim(value, where, name))
    return tuple(claims)


def _claim(number: int, row: Mapping[str, Any]) -> Claim:
    """The claim that a saved base parameter makes."""
    terms = []
    for term in row["terms"]:
        coefficient, denominator = term["coefficient"], term.get("denominator", "1")
        terms.append(f"({coefficient})/({denominator})*{term['parameter']}")
    return Claim(" + ".join(terms), f"base.{number}", str(row["name"]))


def _from_base_model(data: Mapping[str, Any], source: str) -> tuple[Claim, ...]:
    """A file of :func:`echelon.save_base`: only its terms are used, nothing it says about itself."""
    if data["schema"] != _SCHEMA:
        raise InputError(
            f"schema '{data['schema']}' is not a set of base parameters ({_SCHEMA})",
            source=source,
        )
    try:
        return tuple(_claim(k, row) for k, row in enumerate(data["base"]))
    except (KeyError, TypeError):
        raise InputError(
            f"not a document of schema {_SCHEMA}", source=source, element="base"
        ) from None


@dataclass(frozen=True)
class DecimalPrecision:
    """Rounding of a set of decimals."""

    decimals: (
        int | None
    )  # digits after the point; None where the set has no decimals, and every number is exact
    significant: int = 0  # significant digits

    @property
    def absolute(self) -> float:
        """The largest change of a number near zero that prints the same."""
        return 0.0 if self.decimals is None else 0.5 * 10.0**-self.decimals

    def tolerance(self, value: float) -> float:
        """The largest difference between a printed value and the true one."""
        if self.decimals is None or value == round(
            value
        ):  # significant digits would be generous to 1.0
            return self.absolute
        return max(
            self.absolute,
            0.5 * 10.0 ** (floor(log10(abs(value))) + 1 - self.significant),
        )

    def __str__(self) -> str:
        return "exact" if self.decimals is None else f"{self.decimals} decimals"


def precision_of(texts: Iterable[str]) -> DecimalPrecision:
    """The rounding of all decimals in some texts.

    >>> precision_of(["Ixx2 - 1.0*Iyy2 - 0.050625*m3 + 0.07*mz3"])
    DecimalPrecision(decimals=6, significant=5)
    """
    found = [
        Decimal(match[0]).normalize().as_tuple()
        for text in texts
        for match in _DECIMAL.finditer(text)
    ]
    decimals = max((-int(number.exponent) for number in found), default=0)
    significant = max((len(number.digits) for number in found), default=0)
    if decimals > 0:
        return DecimalPrecision(
            min(decimals, DECIMAL_DIGITS), min(significant, DECIMAL_DIGITS)
        )
    return DecimalPrecision(None)


# -- expressions that are linear in the parameters ---------------------------------------------------------------------

Terms = dict[
    str, RationalFunction
]  # coefficients by parameter; the key "" holds the part without a parameter

_ONE = RationalFunction(1)


@dataclass(frozen=True)
class LinearReader:
    """Reads expressions in plain characters, with all products written."""

    parameter: Callable[
        [str], str | None
    ]  # for a name its standard parameter, or None if it is not one
    symbol: Callable[
        [str], Polynomial
    ]  # the value of any other name; raises ValueError if there is none
    data: bytes = b""  # the expression that is read

    def read(self, text: str) -> dict[str, RationalFunction]:
        """Non-zero coefficients by standard parameter, in the order of the text."""
        try:
            terms = replace(self, data=text.encode())._terms(expression_tree(text))
        except (SyntaxError, RecursionError):
            raise ValueError(
                f"'{text}' is not an expression such as XX2 - YY2 + 2*l1*MX3 - 0.0506*M3"
            ) from None
        except ZeroDivisionError:
            raise ValueError(f"'{text}' divides by zero") from None
        constant = terms.pop("", None)
        if constant:
            raise ValueError(f"the term {constant} stands without a standard parameter")
        return {name: value for name, value in terms.items() if value}

    def _terms(self, node: ast.expr) -> Terms:
        match node:
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return self._sum(node)
            case ast.Constant(value=int() | float()):
                return {"": RationalFunction(parse_decimal(self._source(node)))}
            case ast.Name(id="pi"):
                return {"": RationalFunction(Polynomial.generator("pi"))}
            case ast.Name(id=name):
                parameter = self.parameter(name)
                if parameter:
                    return {parameter: _ONE}
                return {"": RationalFunction(self.symbol(name))}
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return _scaled(self._terms(operand), RationalFunction(-1))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self._terms(operand)
            case ast.BinOp(left=left, op=ast.Mult(), right=right):
                return _product(self._terms(left), self._terms(right))
            case ast.BinOp(left=left, op=ast.Div(), right=right):
                divisor = self._coefficient(right)
                if not divisor:
                    raise ZeroDivisionError
                return _scaled(self._terms(left), _ONE / divisor)
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
        total = self._terms(node)
        for part, sign in reversed(parts):
            for name, value in self._terms(part).items():
                signed = value if sign > 0 else -value
                total[name] = total[name] + signed if name in total else signed
        return total

    def _function(self, node: ast.expr) -> Polynomial:
        value = parse(self._source(node))
        for name in value.symbols():
            if self.symbol(name) != Polynomial.generator(name):
                raise ValueError(
                    f"'{name}' is defined by an expression and cannot stand in '{self._source(node)}'"
                )
        return value

    def _coefficient(self, node: ast.expr) -> RationalFunction:
        terms = self._terms(node)
        if set(terms) - {""}:
            raise ValueError(
                f"'{self._source(node)}' holds a standard parameter, which must be linear"
            )
        return terms.get("", RationalFunction(0))

    def _power(self, base: ast.expr, exponent: ast.expr) -> RationalFunction:
        value = self._coefficient(exponent)
        number = value.numerator.number if value.is_polynomial else None
        whole = isinstance(number, int | Fraction) and Fraction(number).denominator == 1
        if not whole or not 0 <= int(number) <= LARGEST_EXPONENT:  # type: ignore[arg-type]
            raise ValueError(
                f"only powers 0 to {LARGEST_EXPONENT} are possible, not '{self._source(exponent)}'"
            )
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
    raise ValueError(
        f"the product of {_first(left)} and {_first(right)} is not linear in the standard parameters"
    )


def _first(terms: Terms) -> str:
    return next(name for name in terms if name)


# -- namings of parameters ---------------------------------------------------------------------------------------------

AUTO = "auto"


@dataclass(frozen=True)
class Naming:
    """One program's way of writing standard parameters."""

    name: str
    inertial: tuple[
        tuple[str, ...], ...
    ]  # patterns of XX … M; ``{}`` stands for a body's label, name, or joint
    effects: Mapping[
        str, tuple[str, ...]
    ]  # patterns of the usual drive parameters by their kind here: Ia, Fv, Fc, Fo


def _spelled(kinds: str) -> tuple[tuple[str, ...], ...]:
    """Patterns from space-separated kinds: with and without an underscore before the body."""
    return tuple((kind + "{}", kind + "_{}") for kind in kinds.split())


def _patterns(texts: str) -> tuple[tuple[str, ...], ...]:
    return tuple((text,) for text in texts.split())


NAMINGS: tuple[Naming, ...] = (
    Naming(
        "echelon",
        _spelled("XX XY XZ YY YZ ZZ MX MY MZ M"),
        {"Ia": ("Ia{}",), "Fv": ("Fv{}",), "Fc": ("Fc{}",), "Fo": ("Fo{}",)},
    ),
    Naming(
        "symoro",
        _spelled("XX XY XZ YY YZ ZZ MX MY MZ M"),
        {"Ia": ("IA{}",), "Fv": ("FV{}",), "Fc": ("FS{}",), "Fo": ("FO{}", "OFF{}")},
    ),
    Naming(
        "sympybotics",
        _patterns("L_{}xx L_{}xy L_{}xz L_{}yy L_{}yz L_{}zz l_{}x l_{}y l_{}z m_{}"),
        {"Ia": ("Ia_{}",), "Fv": ("fv_{}",), "Fc": ("fc_{}",), "Fo": ("fo_{}",)},
    ),
    Naming(
        "pinocchio",
        _spelled("Ixx Ixy Ixz Iyy Iyz Izz mx my mz m"),
        {
            "Ia": ("Ia{}", "Ia_{}"),
            "Fv": ("fv{}", "fv_{}"),
            "Fc": ("fs{}", "fs_{}"),
            "Fo": ("off{}", "off_{}"),
        },
    ),
)

NAMES = tuple(naming.name for naming in NAMINGS)


def vocabulary(naming: Naming, model: BaseModel) -> dict[str, str]:
    """All texts that stand for a standard parameter of a model, with the parameter's own name.

    Bodies go by label, name or joint; a name that two bodies share stands for none.  Parameters that are not inertial
    also go by their own names, whatever the naming.
    """
    words: dict[str, str] = {}
    identifiers, sharing = _identifiers(model), model.mechanism.sharing
    for column in model.mechanism.columns:
        if column.body is not None and column.kind is not None:
            patterns = naming.inertial[column.kind]
            words.update(
                (p.format(i), column.name)
                for k in sharing[column.body]
                for i in identifiers[k]
                for p in patterns
            )
        else:
            words[column.name] = column.name
            found = re.fullmatch(r"(Ia|Fv|Fc|Fo)(.+)", column.name)
            if found:
                words.update(
                    (pattern.format(found[2]), column.name)
                    for pattern in naming.effects[found[1]]
                )
    return words


def _identifiers(model: BaseModel) -> list[list[str]]:
    """For every body all texts that stand for it: its label, and its name and joint if no other body has them."""
    bodies = model.mechanism.bodies
    labels = {body.label for body in bodies}
    given = [name for body in bodies for name in {body.name, body.joint.name}]
    found = []
    for body in bodies:
        own = sorted({body.name, body.joint.name})
        unique = [name for name in own if given.count(name) == 1]
        found.append([body.label, *(name for name in unique if name not in labels)])
    return found


def find_naming(
    texts: Sequence[str],
    model: BaseModel,
    symbols: Collection[str],
    wanted: str = AUTO,
) -> tuple[Naming, Notation, dict[str, str]]:
    """The naming that formulas are written in, their notation, and its vocabulary."""
    if wanted not in (AUTO, *NAMES):
        raise InputError(
            f"unknown naming '{wanted}' (valid: {', '.join((AUTO, *NAMES))})"
        )
    candidates = []
    for naming in NAMINGS:
        if wanted in (AUTO, naming.name):
            words = vocabulary(naming, model)
            candidates.append((naming, Notation(words, symbols), words))

    def known(candidate: tuple[Naming, Notation, dict[str, str]]) -> int:
        _, notation, words = candidate
        return sum(name in words for text in texts for name in notation.names_in(text))

    return max(candidates, key=known)


def unknown_token(
    token: str, naming: Naming, words: Iterable[str], symbols: Iterable[str]
) -> str:
    """Message about a token that is neither a parameter nor a symbol, with the nearest valid names."""
    valid = [*words, *symbols]
    plain = re.sub(r"^([A-Z]+)R(?=\w)", r"\1", token)
    if plain != token and plain in valid:
        return f"'{token}' is a regrouped parameter, not a standard one: write its expression, such as {plain} + …"
    near = get_close_matches(token, valid, n=4, cutoff=0.5) or sorted(valid)[:4]
    return (
        f"'{token}' is neither a standard parameter in the naming {naming.name} nor a symbol of the robot "
        f"(nearest: {', '.join(near)}; {len(PARAMETERS)} parameters per body); --define {token}=… states a symbol, "
        f"--ignore {token} leaves out a parameter that the robot lacks"
    )
