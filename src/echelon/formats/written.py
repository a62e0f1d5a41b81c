"""Small pieces of written descriptions: exact expressions and frames."""

from __future__ import annotations

from typing import Any

from echelon.exact.numbers import decimal_text
from echelon.exact.polynomial import Polynomial, format_polynomial
from echelon.mechanism.placement import IDENTITY, ORIGIN, Placement


def expression_text(value: Polynomial) -> str:
    """An expression that reads back as the same polynomial."""
    number = value.number
    return format_polynomial(value) if number is None else decimal_text(number)


def frame_data(placement: Placement) -> dict[str, Any]:
    """A frame, without what is zero."""
    written: dict[str, Any] = {}
    if placement.translation != ORIGIN:
        written["xyz"] = [expression_text(part) for part in placement.translation]
    if placement.rotation != IDENTITY:
        written["rotation"] = [[expression_text(entry) for entry in row] for row in placement.rotation]
    return written
