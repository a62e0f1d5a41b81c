"""How finely a file states its geometry: the last decimal of its lengths, of its angles, and of its directions.

Files have three decimals or seventeen.  Relations that the numbers keep to their last decimal only, such as axes that
are parallel or lengths that are equal, may be meant to be exact; what depends on them is judged by how much it shows
(:mod:`echelon.base.spectrum`).  Numbers of few decimals are taken to be exact: nobody rounds 0.25 m.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction

from echelon.algebra import Rational, parts_of
from echelon.formats.literal import (
    DOUBLE_DIGITS,
    LiteralMotion,
    LiteralPlacement,
    LiteralTree,
)
from echelon.formats.snapping import ANGLE_TOLERANCE, nearest_step
from echelon.robot import Mechanism, Placement, characteristic_length

COARSEST = 0.05
"""Largest unit of a last decimal that means something, rad or a share of the size."""
FEWEST_DECIMALS = 3
"""Decimals from which a number may be rounded: shorter ones are meant."""
FEWEST_DIGITS = 5
"""Digits of numbers that were printed to some significant digits, as C's %g does: six of them, more rarely others."""
GRID = Fraction(5, 1000)
"""m or rad: one in five numbers with three decimals is a multiple; where several are, and no other, none is rounded."""
MOST_COMPUTED = 0.05
"""Share of the numbers that are not short which have the last decimal: a few may have been computed to more digits."""


def rounding_of_tree(tree: LiteralTree) -> float:
    """The largest unit of the last decimal of a robot file, in rad or as a share of the robot's size; 0 if exact."""
    steps = [step for link in tree.links for step in (*link.steps, *link.rest)]
    for closure in tree.closures:
        steps += [*closure.first_frame, *(closure.second_frame or ())]
    placed = [step for step in steps if isinstance(step, LiteralPlacement)]
    lengths = [value for step in placed for value in step.xyz]
    turns = [value for step in placed for value in step.rpy]
    turns += [
        value
        for step in steps
        if isinstance(step, LiteralMotion)
        for value in step.axis
    ]
    size = max((abs(float(value)) for value in lengths), default=0.0)
    return _coarsest(tree.placed or lengths, tree.turned or turns, size)


def rounding_of_mechanism(mechanism: Mechanism) -> float:
    """Largest unit of the last decimal of a described mechanism, in rad or as a share of its size; 0 if exact."""
    placed = [
        step
        for body in mechanism.bodies
        for step in body.joint.steps
        if isinstance(step, Placement)
    ]
    placed += [closure.first_frame for closure in mechanism.closures]
    numbers = [entry.number for placement in placed for entry in placement.translation]
    lengths = [
        part for number in numbers if number is not None for part in parts_of(number)
    ]
    exact = [symbol.number for symbol in mechanism.symbols.values()]
    turns = [parts_of(number)[0] for number in exact if number is not None]
    return _coarsest(lengths, turns, characteristic_length(mechanism))


def _coarsest(
    lengths: Iterable[Rational], turns: Iterable[Rational], size: float
) -> float:
    general = [
        value
        for value in turns
        if abs(float(value) - nearest_step(float(value))) > ANGLE_TOLERANCE
    ]
    return max(last_decimal(lengths) / (size or 1.0), last_decimal(general))


def last_decimal(numbers: Iterable[Rational]) -> float:
    """The unit of the last decimal that many numbers have, of the largest one's where all have as many digits.

    0 if all are short, or on a grid.
    """
    sizes = [abs(Fraction(number)) for number in numbers]
    long = [value for value in sizes if _decimals(value) >= FEWEST_DECIMALS]
    on_grid = not any(value % GRID for value in long) and len(set(long)) > 2
    if on_grid or not long:
        return 0.0
    decimals = [_decimals(value) for value in long]
    digits = [
        len(str(int(value * 10**count)))
        for value, count in zip(long, decimals, strict=True)
    ]
    most_decimals, most_digits = _nearly_most(decimals), _nearly_most(digits)
    if most_digits >= FEWEST_DIGITS and digits.count(most_digits) > decimals.count(
        most_decimals
    ):
        return float(
            10.0
            ** (
                len(str(int(max(long) * 10**DOUBLE_DIGITS)))
                - DOUBLE_DIGITS
                - most_digits
            )
        )
    return float(10.0**-most_decimals)


def _nearly_most(counts: Sequence[int]) -> int:
    return sorted(counts)[-1 - int(MOST_COMPUTED * len(counts))]


def _decimals(number: Rational) -> int:
    """Decimals of a number, at most 15."""
    value = Fraction(number)
    return next(
        (d for d in range(DOUBLE_DIGITS) if (value * 10**d).denominator == 1),
        DOUBLE_DIGITS,
    )
