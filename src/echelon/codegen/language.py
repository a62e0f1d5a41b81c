"""A target language: patterns for expressions and statements, and templates for everything around them.

A new target is one such configuration and its templates; see :mod:`echelon.codegen.targets`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from math import isfinite

import numpy as np

from echelon.errors import InputError, one_line
from echelon.exact.numbers import Number
from echelon.program.operations import Op


class Precision(StrEnum):
    """Floating-point types of generated code."""

    DOUBLE = "double"
    SINGLE = "single"

    @classmethod
    def named(cls, name: str) -> Precision:
        """The type of a name that a user gave."""
        if name not in list(cls):
            raise InputError(f"there is no precision '{one_line(name)}' (valid: {', '.join(cls)})")
        return cls(name)

    @property
    def suffix(self) -> str:
        """What C appends to literals and names of functions."""
        return "f" if self is Precision.SINGLE else ""


def decimal(value: Number, precision: Precision) -> str:
    """The shortest decimal of a number, always with a point or an exponent.

    >>> from fractions import Fraction
    >>> decimal(Fraction(1, 3), Precision.DOUBLE), decimal(Fraction(1, 3), Precision.SINGLE)
    ('0.3333333333333333', '0.33333334')
    """
    with np.errstate(over="ignore"):
        rounded = float(value) if precision is Precision.DOUBLE else np.float32(float(value))
    if not isfinite(rounded):
        raise InputError(f"{float(value):.3g} is too large for {precision} precision")
    return str(rounded)


@dataclass(frozen=True)
class Language:
    """How a language writes things."""

    name: str  # the target's name
    # templates by the pattern of the file's name: ``{robot}`` is the robot's identifier; with ``{function}`` there is
    # one file for each function
    files: Mapping[str, str]
    comment: str  # opens every line of documentation
    # patterns of functions of ``{x}``.  Here and in :attr:`number`, ``{f}`` is ``f`` in single precision and empty in
    # double precision
    functions: Mapping[Op, str]
    number: str = "{x}"  # pattern of a literal with the decimal ``{x}``
    # floating-point types
    real: Mapping[Precision, str] = field(default_factory=lambda: {p: p.value for p in Precision})
    element: str = "{name}[{index}]"  # pattern of entry ``{index}`` of the vector ``{name}``
    entry: str = "result[{index}]"  # pattern of the entry ``{index}`` of the result
    # stands between the indices of an entry of the result; None for one index into a dense row-major array
    separator: str | None = None
    # patterns of the statements that give ``{name}`` the value ``{value}``, for the first time or otherwise
    define: str = "{name} = {value}"
    assign: str = "{name} = {value}"
    first: int = 0  # the first index
    # whether the templates make results that start as zeros; otherwise zeros are assigned, or filled in if there are
    # many
    zeroed: bool = False
    # whether sines and cosines are computed several at once, from consecutive entries of q where possible
    windows: bool = False
    splits: bool = False  # whether long functions are cut into parts

    def literal(self, value: Number, precision: Precision) -> str:
        """A constant that is not negative."""
        return self.number.format(x=decimal(value, precision), f=precision.suffix)

    def call(self, op: Op, x: str, precision: Precision) -> str:
        """A function of an expression."""
        return self.functions[op].format(x=x, f=precision.suffix)

    def at(self, name: str, index: int) -> str:
        """An entry of a vector."""
        return self.element.format(name=name, index=index + self.first)

    def result_at(self, index: tuple[int, ...], shape: tuple[int, ...]) -> str:
        """An entry of the result."""
        if self.separator is None:
            place = 0
            for k, size in zip(index, shape, strict=True):
                place = place * size + k
            return self.entry.format(index=place + self.first)
        return self.entry.format(index=self.separator.join(str(k + self.first) for k in index))
