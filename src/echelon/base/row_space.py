"""Do two models see the same combinations of parameters?  Their row spaces, compared exactly.

Rows of both are taken at random states of the same random geometry modulo a prime.  Non-zero minors prove the ranks of
the two and of their union from below; that they are no larger follows from points that are more than enough, at two
primes and geometries that agree.  An unlucky point can only make a rank smaller.

Rows may be others than forces: the total energy and its power, as linear forms in the standard parameters.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np

from echelon.algebra import (
    AGREEING_POINTS,
    BALL_BITS,
    DEFAULT_SEED,
    MOST_ATTEMPTS,
    SURPLUS_ROWS,
    PrimeField,
    Residues,
    ball,
    combine,
    random_generator,
    rank,
    rational,
    reduced_echelon,
)
from echelon.base.ball_rows import stated_generators
from echelon.base.ball_tables import Balls, vanishes
from echelon.base.derive import base_parameters
from echelon.base.elimination import eliminated
from echelon.base.linear_base import LinearBase
from echelon.base.matrix import BaseMatrix
from echelon.base.model import BaseModel
from echelon.base.real_states import RealStates
from echelon.dynamics import (
    LinearForms,
    LinearModel,
    Rows,
    energy_form,
    power_form,
    virtual_power_form,
)
from echelon.robot import Mechanism, Readable, loaded, mechanism_of
from echelon.shared import DegenerateSampleError, EchelonError, InputError, public


@public
@dataclass(frozen=True)
class RecordedRows:
    """Rows that are linear in named parameters.

    Attributes
    ----------
    name : str
    forms : LinearForms
    auxiliary : int
        Leading columns that belong to no parameter: 1 for energies, which are known up to a constant.
    parameters : tuple of str
        Names of the columns after these.
    """

    name: str
    forms: LinearForms
    auxiliary: int
    parameters: tuple[str, ...]

    def __repr__(self) -> str:
        return (
            f"RecordedRows({self.name}: {self.forms.shape[0]} × {len(self.parameters)})"
        )


@public
def energy_regressor(mechanism: Mechanism | Readable) -> RecordedRows:
    """The total mechanical energy, up to a constant, as a row in the standard parameters.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        Without effects such as friction, which have no energy of their own.

    Returns
    -------
    RecordedRows

    Raises
    ------
    InputError
        If there are effects.
    """
    mechanism = mechanism_of(mechanism)
    if mechanism.effects:
        names = ", ".join(effect.parameter for effect in mechanism.effects[:4])
        raise InputError(
            f"effects such as {names} have no energy: leave them out of the description"
        )
    return RecordedRows(
        f"energy of {mechanism.name}", energy_form(mechanism), 1, mechanism.parameters
    )


@public
def power_regressor(mechanism: Mechanism | Readable) -> RecordedRows:
    """The power Σ force · velocity of all independent coordinates, as a row in the standard parameters.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        A robot, or the file of one.

    Returns
    -------
    RecordedRows
    """
    mechanism = mechanism_of(mechanism)
    return RecordedRows(
        f"power of {mechanism.name}", power_form(mechanism), 0, mechanism.parameters
    )


Model = Mechanism | BaseModel | LinearModel | LinearBase | RecordedRows | LinearForms
"""What has a row space."""


@public
@dataclass(frozen=True)
class RowSpaces:
    """Two row spaces compared; true if they are the same.

    Attributes
    ----------
    first, second, union : int
        Dimensions.
    only_first, only_second : str
        A combination of parameters that this model sees and the other one does not; empty if there is none.
    primes : tuple of int
        The primes at which all three dimensions agreed.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/double_pendulum.yaml")
    >>> ec.same_row_space(robot, ec.energy_regressor(robot))
    RowSpaces(same, of dimension 6)
    """

    first: int
    second: int
    union: int
    only_first: str
    only_second: str
    primes: tuple[int, ...]

    def __bool__(self) -> bool:
        return self.first == self.second == self.union

    def __repr__(self) -> str:
        if self:
            return f"RowSpaces(same, of dimension {self.union})"
        parts = [f"dimensions {self.first} and {self.second}, together {self.union}"]
        if self.only_first:
            parts.append(f"only the first sees {self.only_first}")
        if self.only_second:
            parts.append(f"only the second sees {self.only_second}")
        return f"RowSpaces(different: {'; '.join(parts)})"


@public
def same_row_space(
    a: Model | Readable, b: Model | Readable, *, seed: int = DEFAULT_SEED
) -> RowSpaces:
    """Whether two models see the same combinations of parameters.

    Parameters
    ----------
    a, b : Mechanism, BaseModel, LinearModel, LinearBase, RecordedRows, LinearForms or path-like
        Models, or files of them.
        With the same parameters, in any order; forms without names with as many columns.  Symbols of equal names have
        equal values, which are general ones.
    seed : int
        Seed of the random points.

    Returns
    -------
    RowSpaces

    Raises
    ------
    InputError
        If the parameters are not the same.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/double_pendulum.yaml")
    >>> ec.same_row_space(robot, ec.load("examples/double_pendulum.yaml", gravity="none"))
    RowSpaces(different: dimensions 6 and 4, together 6; only the first sees MX1 + l1·M2)
    """
    rng = random_generator(seed)
    first, second = _Side(a), _Side(b)
    places = _places(first.names, second.names, first.columns, second.columns)
    if first.real or second.real:
        return _compared_in_balls(first, second, places, rng)
    seen: list[_Comparison] = []
    for _ in range(MOST_ATTEMPTS):
        field = PrimeField.random(rng)
        try:
            geometry = {
                s: field.draw(rng, (1,))
                for s in sorted({*first.symbols, *second.symbols})
            }
            upper = first.rows(field, rng, geometry)
            lower = second.rows(field, rng, geometry)[:, places]
        except DegenerateSampleError:
            continue
        seen.append(_Comparison(field, upper, lower))
        most = tuple(max(s.ranks[k] for s in seen) for k in range(3))
        agreeing = [s for s in seen if s.ranks == most]
        if len(agreeing) >= AGREEING_POINTS:
            names = (
                first.names
                or second.names
                or tuple(f"p{k + 1}" for k in range(first.columns))
            )
            upper_only, lower_only = (
                _witness(agreeing, (first, second), side, names) for side in (0, 1)
            )
            primes = tuple(s.field.p for s in agreeing)
            return RowSpaces(*agreeing[0].ranks, upper_only, lower_only, primes)
    raise EchelonError(
        "results at random points keep contradicting each other; please report these models"
    )


class _Comparison:
    """Rows of both models modulo one prime, and the dimensions that they span."""

    def __init__(self, field: PrimeField, upper: Residues, lower: Residues) -> None:
        self.field, self.sides = field, (upper, lower)
        self.ranks = (
            rank(upper, field),
            rank(lower, field),
            rank(np.concatenate([upper, lower]), field),
        )

    def unseen(self, side: int) -> dict[int, int] | None:
        """A row of one side's echelon form that is not in the other's row space."""
        if self.ranks[2] == self.ranks[1 - side]:
            return None
        reduced, pivots = reduced_echelon(self.sides[side], self.field)
        columns = self.sides[side].shape[1]
        for k in range(len(pivots)):
            row = np.array(
                [[int(reduced[k, c]) for c in range(columns)]], dtype=np.int64
            )
            if (
                rank(np.concatenate([self.sides[1 - side], row]), self.field)
                > self.ranks[1 - side]
            ):
                return {c: int(row[0, c]) for c in range(columns) if row[0, c]}
        return None


class _Side:
    """One of the models: its parameters, symbols, and how its rows are sampled."""

    def __init__(self, model: Any) -> None:
        model = loaded(model) if isinstance(model, str | os.PathLike) else model
        self.model = model
        self.names: tuple[str, ...] = ()
        matrix: BaseMatrix | None = None
        if isinstance(model, BaseModel | LinearBase):
            self.names, matrix = model.parameters, model.matrix
            self.rows: Callable[..., Residues] = lambda field, _, at: (
                model.matrix.dense_modulo(at, field)
            )
        elif isinstance(model, Mechanism):
            self.names = model.parameters
            forms = virtual_power_form(model)
            auxiliary = 0
        elif isinstance(model, LinearModel):
            self.names, forms, auxiliary = model.parameters, model.regressor, 0
        elif isinstance(model, RecordedRows):
            self.names = model.parameters
            forms = model.forms
            auxiliary = model.auxiliary
        elif isinstance(model, LinearForms):
            forms, auxiliary = model, 0
        else:
            kinds = "a mechanism, BaseModel, LinearModel, LinearBase, RecordedRows, LinearForms or the path of a model"
            raise InputError(f"{kinds} is needed, not {type(model).__name__}")
        self.matrix, self.real = (
            matrix,
            False,
        )  # whether rows are to be compared in ball arithmetic
        self.states: RealStates | None = None
        if matrix is not None:
            self.symbols, self.columns = list(matrix.symbols), len(self.names)
            return
        self.columns = forms.shape[1] - auxiliary
        self.states = RealStates(Rows(forms, auxiliary))
        if not forms.rational:
            self.real, self.symbols = True, []
            return
        self.symbols = forms.sampler().symbols
        self.rows = lambda field, rng, at: row_space(forms, field, rng, at, auxiliary)

    def in_balls(self, at: Mapping[str, str]) -> Balls:
        """Rows that span the row space, at values of the symbols."""
        if self.matrix is not None:
            values = stated_generators(self.matrix.generators, at)
            table = np.full(self.matrix.shape, flint.arb(0), dtype=object)
            for target, row in zip(table, self.matrix.rows, strict=True):
                for column, coefficient in row.items():
                    target[column] = coefficient.evaluate(values, ball)
                    if self.matrix.numbers and column in self.matrix.numbers.columns:
                        target[column] += flint.arb(0, self.matrix.numbers.radius)
            return table
        assert self.states is not None  # of models that are no sets
        return self.states.independent(at).basis

    def closed_form(self, pivot: str) -> str | None:
        """The base parameter of this representative, where there are closed forms."""
        model = (
            base_parameters(self.model)
            if isinstance(self.model, Mechanism | LinearModel)
            else self.model
        )
        if not isinstance(model, BaseModel | LinearBase) or pivot not in model.pivots:
            return None
        return str(model.expressions[model.pivots.index(pivot)])


def _compared_in_balls(
    first: _Side, second: _Side, places: Sequence[int], rng: np.random.Generator
) -> RowSpaces:
    """Row spaces of models with loops or functions in ball arithmetic, at random values of symbols near stated ones."""
    sides = (first, second)
    models = [side.states for side in sides if side.states is not None]
    numbers = [
        side.matrix.numbers
        for side in sides
        if side.matrix is not None and side.matrix.numbers is not None
    ]
    at = {
        name: text for states in models for name, text in states.states.values.items()
    }
    if not numbers:
        at |= {
            name: text
            for states in models
            for name, text in states.elsewhere(rng).items()
        }
    # with coefficients in forty decimals, what is below 2^-64 counts as zero
    decimals = any(found.radius for found in numbers)
    bits = BALL_BITS // 2 if decimals else 2 * BALL_BITS
    with flint.ctx.workprec(2 * BALL_BITS):
        upper, lower = (side.in_balls(at) for side in sides)
        lower = lower[:, list(places)]
        both = [
            eliminated(table, bits)
            for table in (upper, lower, np.vstack([upper, lower]))
        ]
        ranks = [len(found.pivots) for found in both if found is not None]
        if len(ranks) < len(both):
            raise EchelonError(
                f"{bits} bits do not decide whether the models see the same"
            )
        names = (
            first.names
            or second.names
            or tuple(f"p{k + 1}" for k in range(first.columns))
        )
        only = [
            _unseen_in_balls(own, other, side, names, bits)
            if ranks[2] > rank_of_other
            else ""
            for own, other, side, rank_of_other in (
                (upper, lower, first, ranks[1]),
                (lower, upper, second, ranks[0]),
            )
        ]
    return RowSpaces(ranks[0], ranks[1], ranks[2], only[0], only[1], ())


def _unseen_in_balls(
    own: Balls, other: Balls, side: _Side, names: Sequence[str], bits: int
) -> str:
    """The first row of one side's echelon form that the other side does not see, as text."""
    found, known = eliminated(own, bits), eliminated(other, bits)
    assert found is not None
    assert known is not None
    ordered = found.in_order(range(own.shape[1]))
    for pivot, row in zip(ordered.pivots, ordered.basis, strict=True):
        together = eliminated(np.vstack([other, row[None]]), bits)
        if together is None or len(together.pivots) > len(known.pivots):
            present = [
                names[c] for c, x in enumerate(row) if vanishes(x, bits) is False
            ]
            return (
                side.closed_form(names[pivot])
                or f"a combination of {', '.join(present)}"
            )
    return ""


FIRST_STATES = 32
"""States at first; more follow while the rank may grow."""


def row_space(
    forms: LinearForms,
    field: PrimeField,
    rng: np.random.Generator,
    at: Mapping[str, Residues],
    auxiliary: int = 0,
) -> Residues:
    """A basis of the row space at one geometry; of rows that are free of auxiliary columns, without these.

    Most forms show much less than they have columns, so states are few at first.
    """
    sampler, columns = forms.sampler(), forms.shape[1]
    states = max(min(FIRST_STATES, columns + SURPLUS_ROWS), sampler.regions)
    seen = -1
    while True:
        reduced, pivots = reduced_echelon(
            forms.stacked(sampler.evaluate(field, rng, states, at))[0], field
        )
        enough = states >= min(len(pivots), columns) + SURPLUS_ROWS
        if enough and (sampler.regions == 1 or len(pivots) == seen):
            break
        # with too few states, or because a region of signs may have more to show
        states, seen = 2 * states, len(pivots) if enough else -1
    kept = [k for k, pivot in enumerate(pivots) if pivot >= auxiliary]
    rows = [[int(reduced[k, c]) for c in range(auxiliary, columns)] for k in kept]
    return np.array(rows, dtype=np.int64).reshape(len(kept), columns - auxiliary)


def _places(
    first: Sequence[str], second: Sequence[str], columns: int, others: int
) -> list[int]:
    """For every column of the first model, that of the second one."""
    if not first or not second:
        if columns != others:
            raise InputError(f"the models have {columns} and {others} columns")
        return list(range(columns))
    stranger = next(
        (n for n in (*first, *second) if (n in first) != (n in second)), None
    )
    if stranger is not None:
        which = "second" if stranger in first else "first"
        raise InputError(
            f"the {which} model has no parameter '{stranger}'; both need the same parameters"
        )
    return [second.index(name) for name in first]


def _witness(
    seen: Sequence[_Comparison], sides: Sequence[_Side], side: int, names: Sequence[str]
) -> str:
    """A combination that only one side sees, as text; in numbers where all coefficients are numbers."""
    rows = [comparison.unseen(side) for comparison in seen]
    row = rows[0]
    if row is None:
        return ""
    pivot = min(row)
    found = sides[side].closed_form(names[pivot])
    if found is not None:
        return found
    terms: list[str] = []
    for column in row:
        residues = [other.get(column, 0) for other in rows if other is not None]
        value: Any = rational(
            *combine(residues, [comparison.field.p for comparison in seen])
        )
        if value is None:
            return f"a combination of {', '.join(names[c] for c in row)}"
        terms.append(names[column] if value == 1 else f"({value})·{names[column]}")
    return " + ".join(terms)
