"""Which part of a rank is due to rounding of a file's numbers, read from the spectrum at real closed states.

What rounding breaks, such as the equal sides of a parallelogram, shows as little as the last decimals are large, and
changes as a whole when these change.  What the geometry shows in truth hardly changes, however little it is.  So the
numbers of the file are changed by a small part of their last decimal, at random: singular values whose relative change
is of the order of that part are made by rounding.  Where all these come last, the others are the intended rank, with
the gap; where true ones are among them, the file leaves it open.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf, log

import numpy as np

from echelon.algebra import DEFAULT_SEED, random_generator
from echelon.base.elimination import Independent
from echelon.base.nudge import nudged
from echelon.base.real_states import SURPLUS, RealStates
from echelon.dynamics import rows_of
from echelon.robot import Mechanism, characteristic_length
from echelon.shared import MOST_NAMED, Floats

EXPLAINED = 10_000.0
"""Singular value, as a share of the largest, that rounding by one unit of the last decimal explains at most."""
LARGEST_EXPLAINED = 0.05
"""Share of the largest singular value above which rounding explains nothing, however coarse the file is."""
_PART = Fraction(1, 10_000)
"""Part of the last decimal by which numbers are changed."""
DRAWS = 3
"""Random changes of the last decimals: in one alone, a value may stay by chance."""
FIRM_CHANGE = 0.02
"""Relative change of a value, for a change of numbers by a whole last decimal, up to which rounding does not make it:
that would take fifty last decimals."""
LIKELY_CHANGE = 0.3
"""Relative change from which on rounding is likely to make a value."""
COARSE_ROUNDING = 1e-4
"""Last decimal, rad or a share of the size, from which fifty units are half a percent: nobody rounds so twice."""
WIDEST_GAP = 1e4
"""Fall of the spectrum that separates whatever follows."""
BETWEEN_ORDERS = 1.5
"""Power of the last decimal between the values that rounding makes (1) and those that its square makes (2)."""
CLEAR_GAP = 300.0
"""Fall of the spectrum behind the last firm value that is clear: only 2 of 86 exact mechanisms have larger ones."""


@dataclass(frozen=True)
class RankSpectrum:
    """Residual norms of the base parameters' columns, and how many of them rounding explains.

    Attributes
    ----------
    shown : tuple of float
        As shares of the first, descending.
    intended : int
        How many are not due to rounding.
    fall : float
        The last of these by the next; infinite if there is none.
    counts : tuple of int
        What the number may be: one where that is clear.
    """

    shown: tuple[float, ...]
    intended: int
    fall: float
    counts: tuple[int, ...]

    @property
    def literal(self) -> int:
        """The number to the letter of the file."""
        return len(self.shown)

    @property
    def doubt(self) -> str:
        """Reason to doubt the intended number; empty if it is clear."""
        if len(self.counts) < 2:
            return ""
        named = f"{self.counts[0]} to {self.counts[-1]}, most likely {self.intended},"
        if len(self.counts) <= MOST_NAMED:
            named = f"{', '.join(map(str, self.counts[:-1]))} or {self.counts[-1]}"
        return (
            f"{named} base parameters: the file's last decimals do not decide, since rounding may cause effects "
            f"({self._size(min(self.counts))} of the others, and less) as large as the real ones; state the "
            "geometry with more digits, or exactly"
        )

    @property
    def note(self) -> str:
        """Message about columns that were left out; empty if there are none."""
        if self.intended == self.literal:
            return ""
        return (
            f"{self.literal} base parameters in the literal reading, {self.intended} intended: the effect of the rest is "
            f"{self._size(self.intended)} of the others', which the file's last decimals explain (a gap of "
            f"{self.fall:.0e})"
        )

    def _size(self, index: int) -> str:
        return f"{self.shown[index]:.0e}" if index < len(self.shown) else "nothing"


def units_of(
    mechanism: Mechanism, columns: Sequence[int], auxiliary: int
) -> list[float] | None:
    """Units in which columns of inertial parameters are comparable; None where numbers are exact.

    Infinite for auxiliary columns and parameters of effects, which have units of their own.
    """
    if not mechanism.rounding:
        return None
    length = characteristic_length(mechanism)
    kinds = [mechanism.columns[column] for column in columns]
    return [
        *[inf] * auxiliary,
        *(inf if k.kind is None else length**-k.length_degree for k in kinds),
    ]


def spectrum_of(
    mechanism: Mechanism, states: RealStates, columns: Sequence[int], found: Independent
) -> RankSpectrum:
    """Read the spectrum of some columns of a mechanism with loops."""
    shown = tuple(sorted(found.shown, reverse=True))
    count = len(shown)
    most = min(LARGEST_EXPLAINED, EXPLAINED * mechanism.rounding)
    first = next((k for k, size in enumerate(shown) if size <= most), count)
    if not mechanism.rounding or first == count:
        return RankSpectrum(shown, count, inf, (count,))
    changes = _changes(mechanism, states, columns, found)
    firm = (np.arange(count) < first) | (changes < FIRM_CHANGE)
    made = ~firm & (changes > LIKELY_CHANGE)
    coarse = mechanism.rounding > COARSE_ROUNDING
    if firm.all() or (coarse and not made.any()):
        return RankSpectrum(shown, count, inf, (count,))
    falls = np.divide(
        shown,
        [*shown[1:], 0.0],
        out=np.full(count, inf),
        where=np.array([*shown[1:], 0.0]) > 0,
    )
    intended = int(firm.argmin())
    fall = float(falls[intended - 1]) if intended else inf
    # what is as small as the last decimals changes as a whole, made by rounding or not: a wider gap may follow.  Gaps
    # towards what is made by squares of the last decimals mean nothing
    last = max(
        intended + 1, int((np.array(shown) > mechanism.rounding**BETWEEN_ORDERS).sum())
    )
    widest = float(falls[intended:last].max())
    if not firm[intended:].any() and fall >= min(WIDEST_GAP, max(CLEAR_GAP, widest)):
        return RankSpectrum(shown, intended, fall, (intended,))
    likely = count - int(made.sum())
    return RankSpectrum(
        shown,
        likely,
        float(falls[likely - 1]) if likely else inf,
        tuple(range(intended, count + 1)),
    )


def _changes(
    mechanism: Mechanism, states: RealStates, columns: Sequence[int], found: Independent
) -> Floats:
    """Relative change of every singular value, for a change of the file's numbers by a whole last decimal."""
    rng, length = random_generator(DEFAULT_SEED), characteristic_length(mechanism)
    amount = Fraction(mechanism.rounding) * _PART
    largest = np.zeros(len(found.shown))
    before = _logs(states, states, found)
    for _ in range(DRAWS):
        other = nudged(mechanism, amount, length, rng)
        near = RealStates(rows_of(other).columns(columns), states.units)
        largest = np.maximum(
            largest, np.abs(_logs(near, states, found) - before)
        )  # not a number where one is lost
    return np.asarray(np.nan_to_num(largest, nan=inf) / float(_PART))


def _logs(states: RealStates, like: RealStates, found: Independent) -> Floats:
    """Logarithms of as many singular values as were found, at states next to known ones."""
    count = len(found.shown)
    sizes = states.sizes(like, count + SURPLUS, found.bits)
    padded = [*sizes, *[0.0] * count][:count]
    return np.array([log(size) if size > 0 else np.nan for size in padded])
