"""How exactly printed decimals state a coefficient.

A program that prints ``0.050625`` and ``0.07`` in one set means 0.070000 by the latter: trailing zeros are dropped.  So
the precision belongs to the set: its longest decimal tells the number of decimals, or of significant digits, to which
all are rounded.  More than nine are floating-point noise.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from math import floor, log10

_DECIMAL = re.compile(r"(?<![\w.])(\d*)\.(\d*)(?:[eE]([+-]?\d+))?(?![\w.])|(?<![\w.])(\d+)[eE]([+-]?\d+)")
_MOST_DIGITS = 9


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
