"""The exact rank beside what numeric ranks would have said of the same robot at usual tolerances."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from echelon.algebra import DEFAULT_SEED, random_generator
from echelon.base.numeric_ranks import TOLERANCES, NumericRanks, numeric_ranks
from echelon.base.stated_values import stated_structure
from echelon.robot import Mechanism, Readable, mechanism_of
from echelon.shared import NotNegative, public


@public
@dataclass(frozen=True)
class NumericComparison:
    """Exact and numeric ranks of one robot.

    Attributes
    ----------
    rank : int
        The exact rank of the intended reading.
    literal_rank : int
        The exact rank of the numbers as they stand in the file.
    numeric : NumericRanks
        Of these numbers, too.
    """

    rank: int
    literal_rank: int
    numeric: NumericRanks

    @property
    def right(self) -> tuple[float, ...]:
        """Tolerances at which singular values and QR with column pivoting give the exact rank."""
        pairs = zip(
            self.numeric.ranks,
            self.numeric.ranks_by_qr or self.numeric.ranks,
            strict=True,
        )
        tolerances = zip(self.numeric.tolerances, pairs, strict=True)
        return tuple(
            tolerance
            for tolerance, ranks in tolerances
            if ranks == (self.rank, self.rank)
        )

    @property
    def verdict(self) -> str:
        """One line: whether a numeric rank is right, and why not."""
        if len(self.right) == len(self.numeric.tolerances):
            return "a numeric rank is right here, at every tolerance"
        where = " and ".join(f"{tolerance:.0e}" for tolerance in self.right)
        head = (
            f"a numeric rank is right at {where} only"
            if where
            else "a numeric rank is wrong at every tolerance"
        )
        return f"{head}: {self._reason}"

    @property
    def _reason(self) -> str:
        found, rank = self.numeric, self.rank
        if self.literal_rank != rank:
            return f"rounded numbers in the file give {self.literal_rank}; the robot that they stand for has {rank}"
        gap, widest = found.gap(rank), found.widest_gap(besides=rank)
        if widest is not None and widest[1] > gap:
            return f"the widest gap is a ratio of {widest[1]:.1g} at {widest[0]}, beside {gap:.1g} at {rank}"
        if not 0 < rank < len(found.singular):
            return "rounding errors count as parameters"
        kept, dropped = found.singular[rank - 1], found.singular[rank]
        return f"the tolerance must lie between {dropped:.1e} and {kept:.1e}, which nobody knows in advance"


@public
def compare_numeric(
    mechanism: Mechanism | Readable,
    *,
    seed: int = DEFAULT_SEED,
    tolerances: Sequence[NotNegative] = TOLERANCES,
    symbols: Mapping[str, float] | None = None,
) -> NumericComparison:
    """The exact rank beside those of singular values and of QR with column pivoting at customary tolerances.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        Every symbol that the regressor needs has a value.
    seed : int
    tolerances : sequence of float
        Relative to the largest singular value.
    symbols : mapping of str to float, optional
        Values that replace or complete those of the mechanism.

    Returns
    -------
    NumericComparison

    Raises
    ------
    InputError
        As :func:`echelon.base.reading_report.numeric_ranks`.
    """
    mechanism = mechanism_of(mechanism)
    found = numeric_ranks(mechanism, seed, tolerances, pivoted=True, symbols=symbols)
    rng = random_generator(seed)
    rank = stated_structure(mechanism, rng).rank
    reading = mechanism.reading
    snapped = reading is not None and bool(reading.snaps)
    literal = (
        stated_structure(reading.literal(), rng).rank
        if reading is not None and snapped
        else rank
    )
    return NumericComparison(rank, literal, found)
