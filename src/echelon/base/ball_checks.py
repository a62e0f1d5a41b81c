"""Check of a base parameter set at real states in ball arithmetic, at stated values of the symbols.

The coefficients of the claimed representatives are solved for anew, from rows that show these to be independent; that
is a minor, so it proves their number.  What is then left of the other columns in further rows has to hold zero to
hundreds of digits, each beside the size of its own column, and the solved coefficients have to be the claimed ones.  So
no column is passed over, no tolerance depends on another column, and neither large nor small terms hide anything.

Precision is raised until it tells.  What needs more is refused, not accepted.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from math import log10
from typing import Any

import flint
import numpy as np

from echelon.algebra import (
    SURPLUS_ROWS,
    FloatArithmetic,
    Op,
    RationalFunction,
    Schedule,
    ball,
)
from echelon.base.ball_rows import ball_rows, bits_of_span, stated_generators
from echelon.base.ball_tables import Balls, combinations_of, doubles, exponent, vanishes
from echelon.base.elimination import SHOWN_BY_DOUBLES
from echelon.base.matrix import BaseMatrix
from echelon.dynamics import LinearForms
from echelon.shared import CertificateError, Floats, InputError, independent_columns

SURPLUS_ROWS_FOR_SIGNS = 60
"""Surplus rows where signs make regions, which random closed states have to meet."""
OTHER_POSES = 4
"""Closed poses beyond those that determine the coefficients, at which relations are checked."""
LARGEST_RELATIVE_ERROR = 1e-20
"""Relative error of a coefficient above which a comparison is refused."""
_LOG10_2 = log10(2.0)


@dataclass(frozen=True)
class _Attempt:
    """How rows are made: the next one is taken where one does not tell."""

    bits: int
    share_poses: bool  # whether several motions start from each closed pose, which takes less time
    times: int  # as many rows as are needed, that many times


_MINOR_ONLY = _Attempt(128, share_poses=True, times=1)
"""The first attempt where no coefficients are compared."""
_ATTEMPTS = (
    _Attempt(512, share_poses=True, times=1),
    _Attempt(512, share_poses=False, times=2),
    _Attempt(1280, share_poses=False, times=4),
    _Attempt(2560, share_poses=False, times=4),
)


@dataclass(frozen=True)
class BallEvidence:
    """Evidence that columns are the claimed combinations of independent ones."""

    states: int  # real states whose rows determine the coefficients
    log10_residual: float  # bound on what is left in further rows, beside the largest entry of the column


def check_in_balls(
    regressor: LinearForms,
    matrix: BaseMatrix,
    columns: Collection[int],
    at: Mapping[str, str],
    rng: np.random.Generator,
) -> BallEvidence:
    """Show that the pivots are independent at stated values, and some other columns the claimed combinations of them.

    Parameters
    ----------
    regressor : LinearForms
        X or combinations of its rows.
    matrix : BaseMatrix
    columns : collection of int
        Columns whose coefficients are compared.
    at : mapping of str to str
        Exact values of the symbols, radians for angles.
    rng : numpy.random.Generator

    Returns
    -------
    BallEvidence

    Raises
    ------
    CertificateError
        If the set is too large, incomplete or wrong, or the highest precision does not tell.
    DegenerateSampleError
        If there are no real states at the values, as where loops do not close.
    """
    check = _Check(regressor, matrix, sorted(columns), at, rng)
    try:
        span = bits_of_span(check.forms, at, rng)
    except InputError as error:
        raise CertificateError(str(error)) from None
    for attempt in _ATTEMPTS if columns else (_MINOR_ONLY, *_ATTEMPTS):
        attempt = replace(attempt, bits=attempt.bits + span)
        with flint.ctx.workprec(attempt.bits):
            evidence = check.evidence(attempt)
        if evidence is not None:
            return evidence
    raise CertificateError(
        f"the {matrix.rank} representatives are not shown to be independent at the stated values, with "
        f"{_ATTEMPTS[-1].bits} bits: the set is too large, or its effects are too small"
    )


class _Check:
    def __init__(
        self,
        regressor: LinearForms,
        matrix: BaseMatrix,
        others: list[int],
        at: Mapping[str, str],
        rng: np.random.Generator,
    ) -> None:
        self.matrix, self.others, self.at, self.rng = matrix, others, at, rng
        self.forms = regressor.columns([*matrix.pivots, *others])
        self.loops = regressor.loops

    def evidence(self, attempt: _Attempt) -> BallEvidence | None:
        """Evidence of one attempt; None if it does not tell."""
        rank, bits = self.matrix.rank, attempt.bits
        try:
            table, states = self._rows(attempt)
        except InputError as error:
            raise CertificateError(str(error)) from None
        scales = [_size(column) for column in table.T]
        table = table / np.array(scales, dtype=object)
        solved = combinations_of(table, range(rank), range(rank, table.shape[1]))
        if solved is None:
            self._refuse_dependent(table[:, :rank], bits)
            return None
        solution, left = solved
        verdicts = {
            column: [vanishes(x, bits) for x in left[:, k]]
            for k, column in enumerate(self.others)
        }
        for column, zero in verdicts.items():
            if False in zero:
                name = self.matrix.parameters[column]
                raise CertificateError(
                    f"the set is incomplete or wrong: it does not reproduce the effect of {name}"
                )
        if any(
            None in zero for zero in verdicts.values()
        ) or not self._coefficients_agree(solution, scales, bits):
            return None
        largest = max((x.abs_upper() for x in left.flat), default=flint.arb(0))
        return BallEvidence(states, _log10(largest, bits))

    def _rows(self, attempt: _Attempt) -> tuple[Balls, int]:
        """Rows of the pivots and the other columns, and the number of states that they come from."""
        surplus = SURPLUS_ROWS_FOR_SIGNS if self.forms.has_signs else SURPLUS_ROWS
        wanted = attempt.times * (self.matrix.rank + surplus)
        states = -(-wanted // self.forms.shape[0])
        if self.loops is None:
            regions = self.forms.points.count
            return ball_rows(self.forms, self.at, states + regions, self.rng), states
        mechanism = self.loops.mechanism
        motions = self.loops.motions if attempt.share_poses else 1
        # the mass matrix and gravity show at rest, which takes less time; all other forces of bodies follow from them
        at_rest = mechanism.measures_every_force and not mechanism.effects
        many = ball_rows(
            self.forms, self.at, states, self.rng, motions, at_rest=at_rest
        )
        return np.vstack(
            [many, ball_rows(self.forms, self.at, OTHER_POSES, self.rng)]
        ), states

    def _refuse_dependent(self, table: Balls, bits: int) -> None:
        """Refuse representatives of which some are combinations of the others to all digits."""
        firm = independent_columns(doubles(table), SHOWN_BY_DOUBLES)
        rest = [k for k in range(table.shape[1]) if k not in firm]
        found = combinations_of(table, firm, rest)
        if rest and found is not None and all(vanishes(x, bits) for x in found[1].flat):
            raise CertificateError(
                f"the set is too large: its {self.matrix.rank} representatives span only {len(firm)} dimensions at the "
                "stated values"
            )

    def _coefficients_agree(
        self, solution: Balls, scales: list[Any], bits: int
    ) -> bool:
        """Whether the claimed coefficients are the solved ones; False if these are not precise enough."""
        if not self.others:
            return True
        rank = self.matrix.rank
        claims = {
            id(c): self._claimed(c) for row in self.matrix.rows for c in row.values()
        }
        for k, (pivot, row) in enumerate(
            zip(self.matrix.pivots, self.matrix.rows, strict=True)
        ):
            for place, column in enumerate(self.others):
                claimed = claims[id(row[column])] if column in row else flint.arb(0)
                found = solution[k, place]
                if claimed.contains(0):
                    agrees = vanishes(found, bits)
                else:
                    agrees = self._agrees(
                        claimed, found * (scales[rank + place] / scales[k]), column
                    )
                if agrees is None:
                    return False
                if not agrees:
                    p, c = self.matrix.parameters[pivot], self.matrix.parameters[column]
                    raise CertificateError(
                        f"the set is wrong at the stated values: the coefficient of {c} in {p}"
                    )
        return True

    def _claimed(self, coefficient: RationalFunction) -> Any:
        """The ball of a claimed coefficient at the stated values."""
        silent = sorted(set(coefficient.symbols()) - self.at.keys())
        if silent:
            raise CertificateError(
                f"a coefficient needs '{silent[0]}', which has no stated value"
            )
        try:
            return coefficient.evaluate(
                stated_generators(coefficient.generators(), self.at), ball
            )
        except ZeroDivisionError:
            raise CertificateError(
                "a denominator is zero at the stated values"
            ) from None

    def _agrees(self, claimed: Any, found: Any, column: int) -> bool | None:
        """Whether a claimed coefficient is the solved one, within the stated error of numbers; None if unknown."""
        if not found.rel_accuracy_bits() * _LOG10_2 > -log10(LARGEST_RELATIVE_ERROR):
            return None
        numbers = self.matrix.numbers
        rounded = numbers is not None and column in numbers.columns
        difference = abs(claimed - found)
        if not rounded or numbers is None:
            return bool(difference.contains(0))
        return (
            bool(difference < LARGEST_RELATIVE_ERROR * abs(found))
            and not difference > numbers.radius
        )


def _size(column: Balls) -> Any:
    """A power of two of the size of a column's largest entry; 1 where all entries may be zero."""
    largest = max((x.abs_lower() for x in column), default=flint.arb(0))
    return flint.arb(2) ** exponent(largest) if largest > 0 else flint.arb(1)


def _log10(bound: Any, bits: int) -> float:
    """Decimal logarithm of a bound; that of the precision where nothing is left at all."""
    if not bound > 0:
        return -bits * _LOG10_2
    return float((bound.log() / flint.arb(10).log()).mid())


def has_plain_signs(regressor: LinearForms, rng: np.random.Generator) -> bool:
    """Whether all signs are those of combinations of speeds, both sides of which random closed states reach.

    A combination is zero at rest, twice as large at twice the speeds, and depends on nothing else.
    """
    program = regressor.program
    needed = program.needed(regressor.entries.values())
    arguments = [
        program.lhs[node] for node in needed if program.ops[node] in (Op.SIGN, Op.ABS)
    ]
    schedule = Schedule(program, arguments)
    names = {node: program.inputs[node].name for node in schedule.leaves}
    drawn = {node: rng.standard_normal(1) for node in schedule.leaves}
    other = {node: rng.standard_normal(1) for node in schedule.leaves}
    constant = {
        node for node in schedule.leaves if program.inputs[node].role == "symbol"
    }
    moving = {node for node, name in names.items() if name.startswith("qd[")}

    def arguments_at(speeds: float) -> Floats:
        moved = {node: speeds * drawn[node] for node in moving}
        fixed = {node: drawn[node] for node in constant}
        return np.asarray(
            schedule.run(FloatArithmetic(), {**other, **fixed, **moved}, 1)
        )

    once, twice, rest = arguments_at(1.0), arguments_at(2.0), arguments_at(0.0)
    other = {node: rng.standard_normal(1) for node in schedule.leaves}
    elsewhere = arguments_at(1.0)
    return bool(
        (rest == 0).all()
        and np.allclose(twice, 2 * once)
        and np.allclose(elsewhere, once)
    )
