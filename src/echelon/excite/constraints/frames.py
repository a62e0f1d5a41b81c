"""Where points of the robot may go: boxes and half-spaces in the base frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from echelon.dynamics.arguments import Arguments, geometry_values
from echelon.dynamics.kinematics import body_frames
from echelon.errors import InputError
from echelon.excite.constraints.state import StateLimits
from echelon.hints import nearest_of
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function
from echelon.program.tape import Program
from echelon.regressor.spatial import add, apply
from echelon.regressor.steps import Recorder

Point = tuple[float, float, float]


@dataclass(frozen=True)
class PointLimit:
    """low ≤ direction · p ≤ high for a point p of a body, in the base frame.

    Attributes
    ----------
    name : str
        For messages: ``"z of tool"``.
    body : str
    point : 3 floats
        In the body's frame, m.
    direction : 3 floats
        Unit vector in the base frame.
    low, high : float
        m; infinite for none.
    """

    name: str
    body: str
    point: Point
    direction: Point
    low: float
    high: float


def point_limits(
    mechanism: Mechanism, limits: Sequence[PointLimit], symbols: Mapping[str, float] | None = None
) -> StateLimits:
    """Limits of points as constraints of the state.

    Parameters
    ----------
    mechanism : Mechanism
        Without loops.
    limits : sequence of PointLimit
        At least one.
    symbols : mapping of str to float, optional

    Raises
    ------
    InputError
        If there is no body of a name.
    """
    program = Program()
    frames = body_frames(Recorder(mechanism, program))
    names = [body.name for body in mechanism.bodies]
    entries: dict[tuple[int, ...], int] = {}
    for row, limit in enumerate(limits):
        if limit.body not in names:
            raise InputError(f"there is no body '{limit.body}'{nearest_of(limit.body, names)}", element="frames")
        rotation, shift = frames[names.index(limit.body)]
        point = [program.constant(Fraction(x)) for x in limit.point]
        place = add(shift, apply(rotation, (point[0], point[1], point[2])))
        value = sum((Fraction(d) * x for d, x in zip(limit.direction, place, strict=True)), program.zero)
        if value.node != program.zero.node:
            entries[(row,)] = value.node
    arguments = Arguments(mechanism, program, {}).of(("q", "symbols"), entries.values())
    function = Function("points", program, arguments, entries, (_axis(limits),))
    uniform = geometry_values(mechanism, arguments, symbols)
    low, high = np.array([limit.low for limit in limits]), np.array([limit.high for limit in limits])
    return StateLimits(function, uniform, _axis(limits), ("m",) * len(limits), low, high)


def _axis(limits: Sequence[PointLimit]) -> tuple[str, ...]:
    return tuple(limit.name for limit in limits)
