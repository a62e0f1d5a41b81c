"""Loops of a mechanism in the description format."""

from __future__ import annotations

from typing import Any

from echelon.formats.description_parts import BASE
from echelon.formats.written import expression_text, frame_data
from echelon.mechanism.closure import Closure
from echelon.mechanism.mechanism import GROUND, Mechanism


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
