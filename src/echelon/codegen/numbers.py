"""Exact numbers as decimals of a floating-point type: the fewest digits that read back as the nearest one."""

from __future__ import annotations

from enum import StrEnum
from math import isfinite

import numpy as np

from echelon.errors import InputError, one_line
from echelon.exact.numbers import Number


class Precision(StrEnum):
    """Floating-point types of generated code."""

    DOUBLE = "double"
    SINGLE = "single"

    @classmethod
    def named(cls, name: str) -> Precision:
        """The type of a name that a user gave.

        Raises
        ------
        InputError
            If there is none.
        """
        if name not in list(cls):
            raise InputError(f"there is no precision '{one_line(name)}' (valid: {', '.join(cls)})")
        return cls(name)

    @property
    def suffix(self) -> str:
        """What C appends to literals and names of functions."""
        return "f" if self is Precision.SINGLE else ""


def decimal(value: Number, precision: Precision) -> str:
    """The shortest decimal of a number, always with a point or an exponent.

    Raises
    ------
    InputError
        If the number is too large for the type.

    Examples
    --------
    >>> from fractions import Fraction
    >>> decimal(Fraction(1, 3), Precision.DOUBLE), decimal(Fraction(1, 3), Precision.SINGLE)
    ('0.3333333333333333', '0.33333334')
    """
    with np.errstate(over="ignore"):
        rounded = float(value) if precision is Precision.DOUBLE else np.float32(float(value))
    if not isfinite(rounded):
        raise InputError(f"{float(value):.3g} is too large for {precision} precision")
    return str(rounded)
