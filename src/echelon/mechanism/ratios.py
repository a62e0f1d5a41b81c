"""Ratios of gears in loops: numbers, because the sine of n·q is algebraic in those of q for rational n only."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.substitute import substituted


def with_numeric_ratios(mechanism: Mechanism) -> Mechanism:
    """A mechanism with loops in which the ratios between turning coordinates are rational numbers.

    Symbols in such ratios are replaced by their values, wherever they occur.
    """
    symbols = {symbol for _, ratio in _turning(mechanism) for symbol in ratio.symbols()}
    if symbols:
        numbers = {name: s.number for name, s in mechanism.symbols.items() if name in symbols}
        known = {name: Polynomial.constant(value) for name, value in numbers.items() if value is not None}
        mechanism = substituted(mechanism, known)
    for where, ratio in _turning(mechanism):
        if not isinstance(ratio.number, int | Fraction):
            problem = "is no rational number, and with loops only those have exact sines and cosines"
            what = "give its symbols exact values such as 3/2, or write a number"
            raise InputError(f"the ratio {ratio} {problem}: {what}", element=where)
    return mechanism


def _turning(mechanism: Mechanism) -> Iterator[tuple[str, Polynomial]]:
    """The ratios of turning coordinates to others, each with the coupling that it stands in."""
    sliding = {m.name for m in mechanism.motions if m.kind is MotionKind.TRANSLATION}
    for coupling in mechanism.couplings:
        if coupling.coordinate in sliding:
            continue
        where = f"coupling of '{coupling.coordinate}'"
        for name, function in coupling.terms:
            if name in sliding:
                problem = f"with loops, what turns cannot follow what slides: state '{name}' as a multiple of"
                raise InputError(f"{problem} '{coupling.coordinate}' instead", element=where)
            if function.ratio is not None:
                yield where, function.ratio
