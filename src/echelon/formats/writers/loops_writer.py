"""Small pieces of written descriptions: exact expressions and frames.

Loops of a mechanism in the description format.
"""

from __future__ import annotations

from typing import Any

from echelon.exact.numbers import decimal_text
from echelon.exact.polynomial import Polynomial, format_polynomial
from echelon.formats.bodies import BASE
from echelon.mechanism.closure import Closure
from echelon.mechanism.mechanism import GROUND, Mechanism
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


def write_loops(mechanism: Mechanism) -> dict[str, Any]:
    """The keys ``loops``, ``independent``, ``assembly`` and ``closed_at``, where there are loops."""
    if not mechanism.closures:
        return {}
    closures = mechanism.stated_closures or mechanism.closures
    written: dict[str, Any] = {"loops": [_loop(closure, mechanism) for closure in closures]}
    if mechanism.independent:
        written["independent"] = list(mechanism.independent)
    if mechanism.assembly:
        written["assembly"] = {name: repr(float(value)) for name, value in mechanism.assembly.items()}
    if mechanism.closed_at:
        pose = mechanism.closed_at.items()
        written["closed_at"] = {name: [expression_text(x) for x in position] for name, position in pose}
    return written


def _loop(closure: Closure, mechanism: Mechanism) -> dict[str, Any]:
    return {
        "name": closure.name,
        "joint": closure.kind.value,
        "connects": [_part(body, mechanism) for body in (closure.first, closure.second)],
        "at": frame_data(closure.first_frame),
        "on_second": frame_data(closure.second_frame),
    }


def _part(body: int, mechanism: Mechanism) -> str | None:
    if body != GROUND:
        return mechanism.bodies[body].name
    # a body may have the base's name; null is the ground in any case
    return None if any(b.name == BASE for b in mechanism.bodies) else BASE
