"""Two descriptions of one robot: their standard and base parameters, one in terms of the other.

With the frames aligned, ζ' = T ζ holds body by body, and both sets see the same if B' T = M B for a square M.  Both
sides are exact numbers (roots included) where the descriptions are exact, so the equation is a proof, and ζ̄' = M ζ̄.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from math import cos, sin

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.conventions import PER_BODY
from echelon.errors import InputError
from echelon.exact.numbers import Number, Surd, format_number
from echelon.exact.polynomial import Polynomial, cosine, sine
from echelon.inertia.spatial import frame_change
from echelon.mechanism.alignment import Alignment, align
from echelon.mechanism.axes import as_floats
from echelon.mechanism.mechanism import Mechanism, setup_expressions
from echelon.mechanism.placement import Placement
from echelon.mechanism.substitute import substituted

Row = dict[int, Number]

_ROUNDING = 1e-9


@dataclass(frozen=True, repr=False)
class Match:
    """One robot in two descriptions.

    Made by :func:`echelon.match`.

    Attributes
    ----------
    first, second : BaseModel
    alignment : Alignment
        Where the frames of the first are in those of the second, and how their coordinates differ.
    standard_map : array of shape (n, n)
        T: standard parameters of the second = T · those of the first.
    rows : tuple of mapping of int to Number
        Exact rows of M: base parameters of the second = M · those of the first, non-zero entries only.
    exact : bool
        Whether B' T = M B holds exactly; else within 1e-9, because numbers of the descriptions are rounded.
    """

    first: BaseModel
    second: BaseModel
    alignment: Alignment
    standard_map: Floats
    rows: tuple[Mapping[int, Number], ...]
    exact: bool

    @property
    def base_map(self) -> Floats:
        """M in floats, shape (r, r)."""
        matrix = np.zeros((self.second.rank, self.first.rank))
        for i, row in enumerate(self.rows):
            for k, value in row.items():
                matrix[i, k] = float(value)
        return matrix

    def standard(self, values: npt.ArrayLike) -> Floats:
        """Standard parameters of the second description from those of the first.

        Parameters
        ----------
        values : array of shape (..., n)
        """
        return np.asarray(values, dtype=float) @ self.standard_map.T

    def base(self, values: npt.ArrayLike) -> Floats:
        """Base parameters of the second description from those of the first.

        Parameters
        ----------
        values : array of shape (..., r)
        """
        return np.asarray(values, dtype=float) @ self.base_map.T

    def __str__(self) -> str:
        proof = "exactly" if self.exact else "within rounding"
        lines = [f"{self.first.mechanism.name} and {self.second.mechanism.name}: the same {self.first.rank} base "]
        lines[0] += f"parameters ({proof})"
        for k, (name, row) in enumerate(zip(self.second.pivots, self.rows, strict=True), 1):
            lines.append(f"{k:>3}  [{name}]' = {_sum(row, self.first.pivots)}")
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"Match({self.first.mechanism.name} = {self.second.mechanism.name}: {self.first.rank} base parameters)"


def match(first: BaseModel | Mechanism, second: BaseModel | Mechanism, *, tolerance: float = 1e-6) -> Match:
    """Match two descriptions of the same robot, such as a DH table and a URDF.

    Parameters
    ----------
    first, second : BaseModel or Mechanism
        Trees of revolute and prismatic joints; all symbols need values.
    tolerance : float
        How far apart joint axes may be, m and rad.

    Returns
    -------
    Match

    Raises
    ------
    InputError
        If the geometry differs (names the first joints that do), or one description sees what the other does not.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/rx90.yaml")
    >>> ec.match(robot, robot)
    Match(rx90 = rx90: 36 base parameters)
    """
    models = [m if isinstance(m, BaseModel) else base_parameters(m) for m in (first, second)]
    for model in models:
        _check_columns(model.mechanism)
    numbers = [_numbers(model.mechanism) for model in models]
    plain = [
        substituted(model.mechanism, {g: Polynomial.constant(v) for g, v in known.items()})
        for model, known in zip(models, numbers, strict=True)
    ]
    alignment = align(plain[0], plain[1], tolerance)
    blocks = {body.second: (body.first, _exact_change(body.placement)) for body in alignment.bodies}
    moved = [_moved(row, models, blocks) for row in _rows(models[1], numbers[1])]
    rows, exact = _expressed(moved, models, _rows(models[0], numbers[0]))
    return Match(models[0], models[1], alignment, _standard_map(models, alignment), rows, exact)


def _check_columns(mechanism: Mechanism) -> None:
    strange = next((p.name for p in mechanism.columns if p.body is None), None)
    if strange is not None:
        raise InputError(f"'{strange}' belongs to no body; only inertial parameters can be matched")
    shared = next((k for k in mechanism.carriers if len(mechanism.sharing[k]) > 1), None)
    if shared is not None:
        problem = "share their parameters, which cannot be matched: give each a label of its own"
        raise InputError(problem, element=f"bodies {mechanism.carrier_name(shared)}")
    partial = next((b.name for b in mechanism.bodies if len(b.carried) not in (0, PER_BODY)), None)
    if partial is not None:
        raise InputError("it carries some inertial parameters only and cannot be matched", element=f"body '{partial}'")


def _numbers(mechanism: Mechanism) -> dict[str, Number]:
    """Numbers for all generators: exact lengths, and rounded sines and cosines."""
    found: dict[str, Number] = {}
    expressions = [*setup_expressions(mechanism), *(mechanism.gravity or ())]
    used = {s for body in mechanism.bodies for s in body.joint.symbols()}
    for name in sorted(used | {s for expression in expressions for s in expression.symbols()}):
        symbol = mechanism.symbols.get(name)
        if symbol is None or symbol.value is None:
            raise InputError(f"symbol '{name}' of {mechanism.name} has no value, so its geometry cannot be compared")
        found[name] = Fraction(repr(symbol.value)) if symbol.number is None else symbol.number
        found[cosine(name)], found[sine(name)] = Fraction(cos(symbol.value)), Fraction(sin(symbol.value))
    return found


def _rows(model: BaseModel, numbers: Mapping[str, Number]) -> list[Row]:
    """B with numbers for its symbols."""
    known = {g: _quotient(value) for g, value in numbers.items()}
    return [{c: value.evaluate(known, _quotient) for c, value in row.items()} for row in model.matrix.rows]


def _quotient(x: Number) -> Number:
    """A number that divides exactly."""
    return x if isinstance(x, Surd) else Fraction(x)


def _exact_change(placement: Placement) -> npt.NDArray[np.object_]:
    """The matrix of a change of frame, in exact numbers."""
    matrix = np.zeros((4, 4), dtype=object)
    for i in range(3):
        matrix[i, :3] = [entry.number for entry in placement.rotation[i]]
        matrix[i, 3] = placement.translation[i].number
    matrix[3, 3] = 1
    return frame_change(matrix)


def _moved(row: Row, models: list[BaseModel], blocks: Mapping[int, tuple[int, npt.NDArray[np.object_]]]) -> Row:
    """A row of B' T: a row for the second's parameters as one for the first's."""
    columns = models[1].mechanism.columns
    start = models[0].mechanism.first_column
    total: Row = {}
    for column, factor in row.items():
        parameter = columns[column]
        assert parameter.body is not None
        assert parameter.kind is not None
        body, change = blocks[parameter.body]
        for k in range(PER_BODY):
            if change[parameter.kind, k]:
                place = start[body] + k
                total[place] = total.get(place, 0) + factor * change[parameter.kind, k]
    return {c: value for c, value in total.items() if value}


def _expressed(moved: list[Row], models: list[BaseModel], rows: list[Row]) -> tuple[tuple[Row, ...], bool]:
    """Rows as combinations of the rows of B, and whether that is exact."""
    if models[0].rank != models[1].rank:
        raise InputError(f"the first description has {models[0].rank} base parameters, the second {models[1].rank}")
    maps, exact = [], True
    for row, name in zip(moved, models[1].pivots, strict=True):
        combination = {k: row[p] for k, p in enumerate(models[0].matrix.pivots) if p in row}
        rest = dict(row)
        for k, factor in combination.items():
            for column, value in rows[k].items():
                rest[column] = rest.get(column, 0) - factor * value
        largest = max((abs(float(value)) for value in rest.values()), default=0.0)
        if largest > _ROUNDING:
            raise InputError(f"the base parameter {name} of the second description is none of the first")
        exact = exact and not any(rest.values())
        maps.append(combination)
    return tuple(maps), exact


def _standard_map(models: list[BaseModel], alignment: Alignment) -> Floats:
    (to, start), columns = (m.mechanism.first_column for m in (models[1], models[0])), len(models[0].parameters)
    matrix = np.zeros((len(models[1].parameters), columns))
    for body in alignment.bodies:
        if (body.first in start) != (body.second in to):
            name = models[0].mechanism.bodies[body.first].name
            raise InputError("it has parameters in one description only", element=f"body '{name}'")
        if body.first in start:
            i, j = to[body.second], start[body.first]
            matrix[i : i + PER_BODY, j : j + PER_BODY] = frame_change(as_floats(body.placement))
    return matrix


def _sum(row: Mapping[int, Number], names: tuple[str, ...]) -> str:
    terms = [f"{_factor(value)}[{names[k]}]" for k, value in row.items()]
    return " + ".join(terms).replace("+ -", "− ").replace("-", "−") or "0"


def _factor(value: Number) -> str:
    if value in (1, -1):
        return "" if value == 1 else "-"
    if isinstance(value, Surd):
        return f"({format_number(value)})·"
    text = f"{float(value):.9g}"
    return f"{text}·"
