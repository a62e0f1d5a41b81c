"""Claimed base parameters from text, CSV or JSON, one expression each; and how exactly their decimals are printed.

A program that prints ``0.050625`` and ``0.07`` in one set means 0.070000 by the latter: trailing zeros are dropped.  So
the precision belongs to the set: its longest decimal tells the number of decimals, or of significant digits, to which
all are rounded.  More than nine are floating-point noise.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import floor, log10
from pathlib import Path
from typing import Any

from echelon.errors import InputError
from echelon.inputs import parse_json, read_document

_HEADERS = (
    "expression", "closed form", "base parameter", "base parameters", "base", "base_parameter", "base_parameters",
    "parameter", "parameters", "params_base", "name",
)  # fmt: skip
"""Titles of a column of expressions, most telling first."""
_COMMENT = re.compile(r"\s*(#|%|//).*$")
_NAMED = re.compile(r"^\s*([^\W\d][\w .\[\]-]*?)\s*[=:]\s*(.+)$")
_SCHEMA = "echelon.base-model/1"
_DECIMAL = re.compile(r"(?<![\w.])(\d*)\.(\d*)(?:[eE]([+-]?\d+))?(?![\w.])|(?<![\w.])(\d+)[eE]([+-]?\d+)")
_MOST_DIGITS = 9


@dataclass(frozen=True)
class Claim:
    """One claimed base parameter, as text."""

    text: str  # the expression
    where: str  # where it stands: ``line 3``, ``entry 'beta_2'``
    name: str | None = None  # the name that its author gave it
    # other cells of its row, such as values, by title or number
    columns: Mapping[str, str] = field(default_factory=dict)


def read_claims(source: str | os.PathLike[str] | Sequence[str] | Mapping[str, str]) -> tuple[Claim, ...]:
    """Claimed expressions from a file or from texts."""
    if isinstance(source, str | os.PathLike):
        return _read_file(Path(source))
    claims = _from_json(source if isinstance(source, Mapping) else list(source), "claims")
    if not claims:
        raise InputError("no base parameters are claimed")
    return claims


def _read_file(file: Path) -> tuple[Claim, ...]:
    text = read_document(file)
    suffix = file.suffix.lower()
    if suffix == ".json":
        claims = _from_json(parse_json(text, str(file)), str(file))
    else:
        claims = _from_table(text) if suffix in (".csv", ".tsv") else _from_lines(text)
    if not claims:
        raise InputError("holds no base parameters: expected one expression per line", source=str(file))
    return claims


def _from_lines(text: str) -> tuple[Claim, ...]:
    claims = []
    for number, line in enumerate(text.splitlines(), 1):
        content = _COMMENT.sub("", line).strip().rstrip(";,")
        named = _NAMED.match(content)
        if content:
            claims.append(Claim(named[2] if named else content, f"line {number}", named[1] if named else None))
    return tuple(claims)


def _from_table(text: str) -> tuple[Claim, ...]:
    lines = text.splitlines()
    first = next((line for line in lines if line.strip()), "")
    delimiter = max(",;\t", key=first.count)
    rows = [(n, [cell.strip() for cell in row]) for n, row in enumerate(csv.reader(lines, delimiter=delimiter), 1)]
    rows = [(n, row) for n, row in rows if any(row) and not _COMMENT.match(row[0])]
    if not rows:
        return ()
    titles = [cell.lower() for cell in rows[0][1]]
    column = next((titles.index(header) for header in _HEADERS if header in titles), None)
    if column is None:
        titles, column = [str(k + 1) for k in range(max(len(row) for _, row in rows))], 0
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
        raise InputError("expected a list of expressions or a mapping of names to expressions", source=source)
    claims = []
    for number, (name, value) in enumerate(entries, 1):
        where = f"entry {number}" if name is None else f"entry '{name}'"
        if not isinstance(value, str):
            raise InputError(f"expected an expression as text, not {value!r:.40}", source=source, element=where)
        claims.append(Claim(value, where, name))
    return tuple(claims)


def _from_base_model(data: Mapping[str, Any], source: str) -> tuple[Claim, ...]:
    """A file of :func:`echelon.save_base`: only its terms are used, nothing it says about itself."""
    if data["schema"] != _SCHEMA:
        raise InputError(f"schema '{data['schema']}' is not a set of base parameters ({_SCHEMA})", source=source)
    try:
        return tuple(
            Claim(
                " + ".join(
                    f"({t['coefficient']})/({t.get('denominator', '1')})*{t['parameter']}" for t in row["terms"]
                ),
                f"base.{k}",
                str(row["name"]),
            )
            for k, row in enumerate(data["base"])
        )
    except (KeyError, TypeError):
        raise InputError(f"not a document of schema {_SCHEMA}", source=source, element="base") from None


@dataclass(frozen=True)
class Precision:
    """Rounding of a set of decimals."""

    decimals: int | None  # digits after the point; None where the set has no decimals, and every number is exact
    significant: int = 0  # significant digits

    @property
    def absolute(self) -> float:
        """What a number may be off and still print the same, for numbers near zero."""
        return 0.0 if self.decimals is None else 0.5 * 10.0**-self.decimals

    def tolerance(self, value: float) -> float:
        """What a printed value may differ from the true one."""
        if self.decimals is None or value == round(value):  # significant digits would be generous to 1.0
            return self.absolute
        return max(self.absolute, 0.5 * 10.0 ** (floor(log10(abs(value))) + 1 - self.significant))

    def __str__(self) -> str:
        return "exact" if self.decimals is None else f"{self.decimals} decimals"


def precision_of(texts: Iterable[str]) -> Precision:
    """The rounding of all decimals in some texts.

    >>> precision_of(["Ixx2 - 1.0*Iyy2 - 0.050625*m3 + 0.07*mz3"])
    Precision(decimals=6, significant=5)
    """
    found = [_digits(*match.groups()) for text in texts for match in _DECIMAL.finditer(text)]
    if not found:
        return Precision(None)
    decimals, significant = (min(_MOST_DIGITS, max(column)) for column in zip(*found, strict=True))
    return Precision(decimals, significant) if decimals else Precision(None)


def _digits(
    whole: str | None, part: str | None, power: str | None, mantissa: str | None, raised: str | None
) -> tuple[int, int]:
    """Decimals and significant digits of a literal."""
    if mantissa is not None:
        return max(0, -int(raised or 0)), len(mantissa)
    digits = f"{whole or ''}{part or ''}"
    return max(0, len((part or "").rstrip("0")) - int(power or 0)), len(digits.strip("0")) or 1
