"""The structure of B as a picture: which parameters of which bodies make up each base parameter.

Only entries that are not zero are drawn, with a shape for the kind of coefficient: a matrix of a humanoid has tens of
thousands of cells, but only a thousand entries.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import groupby
from math import inf

from echelon.algebra import RationalFunction
from echelon.base import BaseModel, TextStyle, coefficient_text
from echelon.report.page import FORM_WIDTH
from echelon.robot import Mechanism, Parameter
from echelon.shared import PARAMETERS, one_line, shortened

KINDS = ("pivot", "number", "length", "area", "other")
"""Kinds of coefficients: of the representative, a number, a length, a product of two lengths, anything else."""

_CELL_SIZES = {75: 11.0, 160: 7.0, 420: 5.0, inf: 3.0}
"""Largest number of columns, and size of a cell, px.  Beside cells of the first size every row has a name."""


@dataclass(frozen=True)
class Cell:
    """An entry of B that is not zero: its place (px), kind of coefficient, and what it says."""

    x: float
    y: float
    kind: str
    text: str


@dataclass(frozen=True)
class Band:
    """Columns of one body, or rows of base parameters that one body represents."""

    name: str  # of the body, or of what does not belong to one
    label: str
    start: float  # px
    size: float  # px


@dataclass(frozen=True)
class Picture:
    """B, ready to be drawn."""

    cell: float  # size of a cell, px
    width: float  # of the matrix, px
    height: float
    columns: tuple[Band, ...]
    rows: tuple[Band, ...]
    cells: tuple[Cell, ...]
    row_names: tuple[str, ...]  # representatives; empty where there is no room for them
    column_names: tuple[
        str, ...
    ]  # kinds of the columns; empty where there is no room for them
    kinds: Mapping[str, int]  # how many entries of each kind there are


def matrix_picture(base: BaseModel) -> Picture:
    """The picture of a model's B."""
    mechanism, matrix = base.mechanism, base.matrix
    enough = [most for most in _CELL_SIZES if len(matrix.parameters) <= most]
    size = _CELL_SIZES[enough[0]]
    cells = []
    for i, (row, expression) in enumerate(
        zip(matrix.rows, base.expressions, strict=True)
    ):
        pivot, whole = matrix.pivots[i], shortened(str(expression), FORM_WIDTH)
        for column, coefficient in sorted(row.items()):
            kind = _kind(
                coefficient,
                column == pivot,
                mechanism.columns[pivot],
                mechanism.columns[column],
            )
            factor = "1" if column == pivot else _factor(coefficient)
            name = one_line(matrix.parameters[column])
            cells.append(
                Cell(size * column, size * i, kind, f"{name} × {factor} in {whole}")
            )
    readable = len(enough) == len(_CELL_SIZES)
    titles = (
        one_line(p.name) if p.kind is None else PARAMETERS[p.kind]
        for p in mechanism.columns
    )
    return Picture(
        size,
        size * len(matrix.parameters),
        size * matrix.rank,
        _bands(mechanism, range(len(matrix.parameters)), size),
        _bands(mechanism, matrix.pivots, size),
        tuple(cells),
        tuple(one_line(name) for name in base.pivots) if readable else (),
        tuple(titles) if readable else (),
        {kind: sum(1 for cell in cells if cell.kind == kind) for kind in KINDS},
    )


def _factor(coefficient: RationalFunction) -> str:
    sign, text = coefficient_text(coefficient, TextStyle())
    return ("−" if sign < 0 else "") + (text or "1")


def _kind(
    coefficient: RationalFunction, is_pivot: bool, row: Parameter, column: Parameter
) -> str:
    if is_pivot:
        return "pivot"
    if not coefficient.symbols():
        return "number"
    if row.kind is None or column.kind is None:
        return "other"
    return {1: "length", 2: "area"}.get(
        row.length_degree - column.length_degree, "other"
    )


def _bands(
    mechanism: Mechanism, places: range | tuple[int, ...], size: float
) -> tuple[Band, ...]:
    """Neighbouring columns, or rows by their representatives, of the same body."""
    bands: list[Band] = []
    start = 0.0
    for body, columns in groupby(mechanism.columns[column].body for column in places):
        bands.append(Band(*_owner(mechanism, body), start, size * len(list(columns))))
        start += bands[-1].size
    return tuple(bands)


def _owner(mechanism: Mechanism, body: int | None) -> tuple[str, str]:
    if body is None:
        return "effects: friction, drives, springs", "effects"
    return one_line(mechanism.carrier_name(body)), one_line(
        mechanism.bodies[body].label
    )


@dataclass(frozen=True)
class Merging:
    """Where the parameters of one body went."""

    name: str
    label: str
    alone: tuple[str, ...]  # identifiable alone
    absorbs: tuple[
        str, ...
    ]  # bodies whose parameters are parts of base parameters that this body represents
    absorbed: tuple[
        str, ...
    ]  # bodies that represent base parameters which this body's parameters are part of
    unseen: tuple[str, ...]  # parameters in no base parameter


def mergings(base: BaseModel) -> list[Merging]:
    """Where the parameters of every body went, base to tip."""
    matrix, columns, bodies = base.matrix, base.mechanism.columns, base.mechanism.bodies
    owner = [parameter.body for parameter in columns]
    parts: dict[int, set[int]] = {body: set() for body in base.mechanism.carriers}
    wholes: dict[int, set[int]] = {body: set() for body in base.mechanism.carriers}
    alone: set[int] = set()
    for pivot, row in zip(matrix.pivots, matrix.rows, strict=True):
        if len(row) == 1:
            alone |= set(row)
        head = owner[pivot]
        for column in row:
            part = owner[column]
            if head is not None and part is not None and head != part:
                parts[head].add(part)
                wholes[part].add(head)
    seen = {column for row in matrix.rows for column in row}
    found = []
    for body in base.mechanism.carriers:
        own = [c for c in range(len(columns)) if owner[c] == body]
        names = {c: PARAMETERS[columns[c].kind or 0] for c in own}
        found.append(
            Merging(
                one_line(base.mechanism.carrier_name(body)),
                one_line(bodies[body].label),
                tuple(names[c] for c in own if c in alone),
                tuple(one_line(bodies[k].label) for k in sorted(parts[body])),
                tuple(one_line(bodies[k].label) for k in sorted(wholes[body])),
                tuple(names[c] for c in own if c not in seen),
            )
        )
    return found
