"""Rows at real states in ball arithmetic: what samples models whose rows are no rational functions of free variables.

Such are mechanisms with loops, whose states solve equations, and models with functions such as exp.  Which columns are
independent is found at the stated values of the symbols.  Coefficients as functions of symbols are found as those of
trees are, by values modulo primes: a residue ρ is the fraction a/b next to the stated value with a ≡ ρ b, states are
real there, the coefficients are read as short exact numbers from balls, and these have residues.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from functools import cached_property
from math import tan
from typing import TYPE_CHECKING, Any

import flint
import numpy as np

from echelon.algebra import (
    AGREEING_POINTS,
    DEFAULT_SEED,
    Geometry,
    Number,
    PrimeField,
    Residues,
    random_generator,
    stated_ball,
    twice_arc_text,
)
from echelon.base.ball_rows import ball_rows, states_in
from echelon.base.ball_tables import Balls, combinations_of, exact_number, vanishes
from echelon.base.elimination import Independent, eliminated, sizes_shown
from echelon.base.prime_states import MOST_VISITS
from echelon.dynamics import Rows
from echelon.shared import (
    ClosedFormError,
    DegenerateSampleError,
    Floats,
    InputError,
    SingularPoseError,
)

if TYPE_CHECKING:
    from echelon.loops import Loops

_BITS = (640, 1280, 2560)
"""Precisions that are tried: values of chains of loops fall smoothly past 1e-54."""
FIRST_ROWS = 64
"""Rows at first; where more columns seem independent, twice as many are taken."""
SURPLUS = 20
"""Rows beyond the rank."""
OTHER_ROWS = 10
"""Rows at further poses, at which relations are checked."""
MOST_POSES = 1000
"""Poses after which relations that still fail are given up."""
FEWEST_POSES = 8
"""Poses of a table at least, however many motions go through each."""
GEOMETRIES_AT_ONCE = 16
"""Values of the symbols at which the loops are closed together."""
BALL_COST = 1e3
"""Cost of an operation in ball arithmetic with its share of Newton's method, in operations modulo a prime."""
LARGEST_CHANGE = 0.03
"""Change of symbols, relative to a stated value, or in rad or m where it is zero."""
FRACTION_SPACING = 1 / 128
"""Distance of the fractions with a given residue, relative to the smallest value of a symbol."""


class RealStates:
    """Rows of a model at real states, free or closed."""

    def __init__(self, rows: Rows, units: Sequence[float] | None = None) -> None:
        """``units`` make columns comparable, the auxiliary ones included; see :func:`eliminated`."""
        self.rows, self.units, self.states = rows, units, states_in(rows.forms)
        self._numbers_known: dict[
            int, list[Number]
        ] = {}  # of models without symbols, by the number of sources

    @cached_property
    def symbols(self) -> list[str]:
        """Symbols that coefficients may depend on, sorted."""
        return self.states.symbols

    @cached_property
    def angles(self) -> frozenset[str]:
        """Symbols that are angles."""
        return self.states.angles

    @property
    def singular(self) -> bool:
        """With loops, whether more motions are possible at the assembly pose than near it."""
        return self.states.singular

    @property
    def loops(self) -> Loops:
        """Loop closures that every state satisfies."""
        assert self.rows.forms.loops is not None
        return self.rows.forms.loops

    @property
    def free_velocities(self) -> Floats:
        """With loops, orthonormal velocities that are possible at one closed pose, (velocities, freedoms)."""
        return self.loops.assembly.free_velocities(self.loops.known_poses(0, 1)[0])

    # -- structure ---------------------------------------------------------------------------------------------------

    def independent(self, at: Mapping[str, str] | None = None) -> Independent:
        """Independent columns at the stated values of the symbols, or at others.

        Raises
        ------
        SingularPoseError
            If the loops are not proved to close, or no precision tells.
        DegenerateSampleError
            If entries have no values at most states.
        """
        wanted = min(self.rows.forms.shape[1], FIRST_ROWS)
        for bits, most in dict.fromkeys(
            ((_BITS[0], self.states.motions), *((bits, 1) for bits in _BITS))
        ):
            bits += self.states.span
            with flint.ctx.workprec(bits):
                try:
                    found, wanted = self._independent(at or {}, bits, most, wanted)
                except InputError as error:
                    if self.rows.forms.loops is None:
                        raise
                    raise SingularPoseError(str(error)) from None
            if found is not None:
                return found
        raise SingularPoseError(
            f"{_BITS[-1]} bits do not decide what {self.states.subject} leave independent"
        )

    def sizes(self, like: RealStates, rows: int, bits: int) -> list[float]:
        """Residual norms of the independent columns of some rows, relative to the largest, descending.

        States are next to known ones of another mechanism of the same kind, perhaps the same one.
        """
        poses, motions = self._shared(rows, self.loops.motions)
        known = self.loops.next_to(like.loops.known_poses(0, poses))
        with flint.ctx.workprec(bits):
            rng = random_generator(DEFAULT_SEED)
            table = ball_rows(
                self.rows.forms, {}, poses * motions, rng, motions, poses=known
            )
            return sizes_shown(table, bits, self.rows.auxiliary, self.units)

    def _independent(
        self, at: Mapping[str, str], bits: int, most: int, wanted: int
    ) -> tuple[Independent | None, int]:
        """Independent columns, if the precision tells, and how many rows beyond the surplus it took.

        No more than ``most`` motions go through each pose.
        """
        columns, auxiliary = self.rows.forms.shape[1], self.rows.auxiliary
        rng, used = random_generator(DEFAULT_SEED), 0
        others, used = self._table(at, used, OTHER_ROWS, most, rng)
        table, used = self._table(at, used, wanted + SURPLUS, most, rng)
        while True:
            found = eliminated(table, bits, auxiliary, self.units)
            if found is None:
                return None, wanted
            if auxiliary + len(found.pivots) > wanted and wanted < columns:
                more = min(columns, 2 * wanted) - wanted
                further, used = self._table(at, used, more, most, rng)
                wanted, table = wanted + more, np.vstack([table, further])
            elif found.holds(others):
                return found, wanted
            elif used > max(MOST_POSES, MOST_VISITS * self.states.regions):
                return None, wanted
            else:  # the poses were too few, however many motions went through each
                table = np.vstack([table, others])
                others, used = self._table(at, used, OTHER_ROWS, most, rng)

    def _table(
        self,
        at: Mapping[str, str],
        used: int,
        rows: int,
        most: int,
        rng: np.random.Generator,
    ) -> tuple[Balls, int]:
        """Rows at known poses behind those that were used, and how many of them are used then."""
        poses, motions = self._shared(rows, most)
        return self.states.known([at], used, poses, rng, motions)[0], used + poses

    def _shared(self, rows: int, most: int) -> tuple[int, int]:
        """Poses, and motions through each, no more than some, that make some rows, and visit all regions of signs."""
        states = max(-(-rows // self.rows.forms.shape[0]), self.states.regions)
        poses = min(states, max(FEWEST_POSES, -(-states // most)))
        return poses, -(-states // poses)

    # -- coefficients ------------------------------------------------------------------------------------------------

    def elsewhere(self, rng: np.random.Generator) -> dict[str, str]:
        """Random values of all symbols near the stated ones, which satisfy no relation but those that all values do."""
        field = PrimeField.random(rng)
        return self._lifted(
            {name: int(field.draw(rng, (1,))[0]) for name in self.symbols},
            int(field.p),
            rng,
        )

    def cost(self, sources: int) -> float:
        """Operations modulo primes that take as long as closing the loops and solving for coefficients."""
        return BALL_COST * self.states.size * (self.rows.auxiliary + sources)

    def coefficients(
        self,
        field: PrimeField,
        geometry: Geometry,
        rng: np.random.Generator,
        sources: int,
    ) -> Residues:
        """Coefficients of all columns behind the auxiliary ones and some sources; see :class:`PrimeStates`.

        DegenerateSampleError if there are no such states, ClosedFormError if a coefficient is no short exact number.
        """
        if not self.symbols:
            if sources not in self._numbers_known:
                self._numbers_known[sources] = self._numbers([{}], sources)[0]
            return np.array(
                [[field.embed(number)] for number in self._numbers_known[sources]],
                dtype=np.int64,
            )
        count = max((len(geometry[name]) for name in self.symbols), default=1)
        found = list[list[int]]()
        for first in range(0, count, GEOMETRIES_AT_ONCE):
            at = list[dict[str, str]]()
            for k in range(first, min(first + GEOMETRIES_AT_ONCE, count)):
                residues = {name: int(geometry[name][k]) for name in self.symbols}
                at.append(self._lifted(residues, int(field.p), rng))
            found += [
                [field.embed(number) for number in numbers]
                for numbers in self._numbers(at, sources)
            ]
        return np.array(found, dtype=np.int64).reshape(count, -1).T

    def _numbers(
        self, at: Sequence[Mapping[str, str]], sources: int
    ) -> list[list[Number]]:
        """Exact coefficients at each of some values of the symbols, target by target for each source."""
        poses, motions = self._shared(
            self.rows.auxiliary + sources + AGREEING_POINTS, self.states.motions
        )
        found = list[list[Number]]()
        for bits in _BITS:
            with flint.ctx.workprec(bits + self.states.span):
                left = at[len(found) :]
                try:
                    tables = self.states.known(
                        left, 0, poses, random_generator(DEFAULT_SEED), motions
                    )
                except InputError as error:
                    raise DegenerateSampleError(str(error)) from None
                for table in tables:
                    numbers = self._solved(table, sources, bits + self.states.span)
                    if numbers is None:  # those that are left take more precision
                        break
                    found.append(numbers)
            if len(found) == len(at):
                return found
            poses *= (
                4 if self.states.regions > 1 else 1
            )  # some sources may show in few regions of signs
        raise ClosedFormError("coefficients are not short exact numbers")

    def _solved(self, table: Balls, sources: int, bits: int) -> list[Number] | None:
        """Exact coefficients by a table; None if the precision does not tell."""
        auxiliary = self.rows.auxiliary
        pivots = range(auxiliary + sources)
        others = range(auxiliary + sources, table.shape[1])
        solved = combinations_of(table, pivots, others, AGREEING_POINTS)
        if solved is None:
            return None
        solution, left = solved
        if any(vanishes(x, bits) is False for x in left.flat):
            raise DegenerateSampleError(
                "the columns are independent at these values of the symbols"
            )
        numbers = [self._number(x, bits) for x in solution[auxiliary:].flat]
        if None in numbers:
            return None
        return [number for number in numbers if number is not None]

    def _number(self, x: Any, bits: int) -> Number | None:
        return 0 if vanishes(x, bits) else exact_number(x, self.states.irrational)

    # -- values of symbols -------------------------------------------------------------------------------------------

    def _lifted(
        self, residues: Mapping[str, int], prime: int, rng: np.random.Generator
    ) -> dict[str, str]:
        """Fractions with some residues next to the stated values, all with one denominator, as text."""
        near = {name: self._near(name, rng) for name in residues}
        smallest = min((abs(value) for value in near.values()), default=1.0)
        least = int(prime / (FRACTION_SPACING * min(smallest, 1.0)))
        denominator = int(rng.integers(least, 2 * least))
        values = dict[str, str]()
        for name, residue in residues.items():
            wanted = residue * denominator % prime
            steps = round((near[name] * denominator - wanted) / prime)
            fraction = Fraction(wanted + steps * prime, denominator)
            values[name] = (
                twice_arc_text(fraction) if name in self.angles else str(fraction)
            )
        return values

    def _near(self, name: str, rng: np.random.Generator) -> float:
        """A random value near the stated one; of an angle, the tangent of its half."""
        value = float(stated_ball(self.states.values[name]).mid())
        change = LARGEST_CHANGE * float(rng.uniform(-1.0, 1.0))
        if name in self.angles:
            return tan((value + change) / 2)
        return value + change * (abs(value) or 1.0) or LARGEST_CHANGE
