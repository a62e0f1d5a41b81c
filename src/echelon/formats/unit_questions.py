"""Questions about units: angles that look like degrees, and offsets that look like millimetres.

Robots have angles within a turn and offsets of metres.  Beyond, a number of radians that is no multiple of 15° is
hardly meant as one, and neither is a whole or half number, such as 90.  Angles below a turn, such as 5, may be both,
and nothing is asked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from fractions import Fraction
from math import pi

from echelon.algebra import Rational
from echelon.formats.snapping import ANGLE_TOLERANCE, nearest_step
from echelon.robot import (
    GROUND,
    Body,
    Mechanism,
    Motion,
    Placement,
    known_values,
    largest_offset,
)
from echelon.shared import listed

_MORE_THAN_A_TURN = 2 * pi * (1 + 1e-3)
"""Angles up to a turn, rounded to a few digits, are radians, rad."""

LARGEST_METRES = 100.0
"""Offset between joints, m, from which a file is asked for millimetres: cranes have less, arms that many of them."""


def looks_like_degrees(angle: Rational) -> bool:
    """Whether a number of radians is hardly meant as one."""
    number = float(angle)
    if abs(number) <= _MORE_THAN_A_TURN:
        return False
    is_round = (2 * Fraction(angle)).denominator == 1
    return is_round or abs(number - nearest_step(number)) > ANGLE_TOLERANCE


def unit_questions(
    mechanism: Mechanism, angles: Mapping[str, Rational], *, in_world: bool
) -> Iterator[str]:
    """Questions about stated angles by element, rad, and about offsets between joints.

    Where the base of a robot stands in a world, ``in_world``, is not asked about.
    """
    odd = {
        element: angle for element, angle in angles.items() if looks_like_degrees(angle)
    }
    if odd:
        named = [f"{element}: {float(angle):.9g}" for element, angle in odd.items()]
        first = next(iter(odd.values()))
        yield (
            f"angles of more than a turn, in radians ({listed(named, 3, '; ')}): degrees? "
            f"write {_in_radians(first)} for {float(first):.9g}"
        )
    known = known_values(mechanism)
    sizes = {
        body.joint.name: _offset(body, known, in_world=in_world)
        for body in mechanism.bodies
    }
    largest = max(sizes, key=lambda name: sizes[name], default="")
    if largest and sizes[largest] >= LARGEST_METRES:
        size = sizes[largest]
        yield f"joint '{largest}' has an offset of {size:g} m: millimetres? write {size / 1000:g}, and so everywhere"


def _offset(body: Body, known: Mapping[str, float], *, in_world: bool) -> float:
    """The largest component of a translation of a joint, m."""
    steps = body.joint.steps
    if in_world and body.parent == GROUND:
        first = next(
            (k for k, step in enumerate(steps) if isinstance(step, Motion)), len(steps)
        )
        steps = steps[first:]
    return largest_offset(
        [step for step in steps if isinstance(step, Placement)], known
    )


def _in_radians(degrees: Rational) -> str:
    """A number of degrees in radians: as a part of pi where that is short, and as a decimal."""
    value = float(degrees) * pi / 180
    part = Fraction(degrees) / 180
    if part.denominator > 180:
        return f"{value:.9g}"
    top = "pi" if abs(part.numerator) == 1 else f"{abs(part.numerator)}*pi"
    text = top if part.denominator == 1 else f"{top}/{part.denominator}"
    sign = "-" if part < 0 else ""
    return f"{sign}{text} ({value:.9g})"
