"""How large and how small the numbers of robot files may be, so that all that is computed from them has a double.

No robot comes near to these limits; damaged files and other units than SI do.
"""

from __future__ import annotations

import re
from fractions import Fraction
from typing import TypeVar

from echelon.exact.numbers import Number, parts_of

LARGEST = 10**100
"""Of lengths, masses and the like: mass times a distance squared is still far within double precision."""

SMALLEST = Fraction(1, LARGEST)
"""Of what is not zero."""

LARGEST_ANGLE = 10**9
"""Of angles, rad: beyond, the digits of a double no longer say which multiple of 15° is the nearest."""

NOT_FINITE = re.compile(r"[+-]?(\.?(nan|inf|infinity)|∞)", re.IGNORECASE)
"""Words for what is no number, which could else be names of symbols."""

AnyNumber = TypeVar("AnyNumber", bound=Number)


def checked_size(value: AnyNumber, shown: str) -> AnyNumber:
    """A number that is neither too large nor, unless it is zero, too small."""
    if not all(-LARGEST <= part <= LARGEST for part in parts_of(value)):
        raise ValueError(f"'{shown}' is too large a number: robots have lengths and masses up to 1e100, in SI units")
    if any(-SMALLEST < part < SMALLEST and part != 0 for part in parts_of(value)):
        raise ValueError(f"'{shown}' is too small a number to compute with: write 0, or use SI units")
    return value
