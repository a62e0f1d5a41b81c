"""Sine, cosine and tangent of an angle with an exact part: a multiple of 15° is turned by exactly."""

from __future__ import annotations

from echelon.exact.angle import STEPS_PER_HALF_TURN
from echelon.exact.numbers import cosine_of_turn, sine_of_turn
from echelon.program.operations import Op
from echelon.program.scalar import Scalar


def turned(op: Op, rest: Scalar, steps: int) -> Scalar:
    """A circular function of an angle plus a number of steps of 15°."""
    program = rest.program
    if not steps % (2 * STEPS_PER_HALF_TURN):
        return program.function(op, rest)
    c, s = program.cos(rest), program.sin(rest)
    c_turn, s_turn = cosine_of_turn(steps), sine_of_turn(steps)
    cosine, sine = c * c_turn - s * s_turn, s * c_turn + c * s_turn
    return sine / cosine if op is Op.TAN else cosine if op is Op.COS else sine
