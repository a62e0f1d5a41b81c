"""Functions of robots in plain double precision."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.algebra.program.function import Function
from echelon.algebra.program.schedule import FloatArithmetic
from echelon.robot.joint import MotionKind
from echelon.robot.mechanism import Mechanism
from echelon.robot.stated import symbol_values
from support.small_kernels import FloatArray, by_numpy


class ComplexArithmetic(FloatArithmetic):
    """Complex numbers, for derivatives by an imaginary step."""

    dtype = np.complex128


def evaluate(
    function: Function,
    mechanism: Mechanism,
    values: Mapping[str, npt.ArrayLike],
    arithmetic: FloatArithmetic | None = None,
) -> FloatArray:
    """A function's result, shape (samples, ...), from the values of its arguments by name.

    The symbols are the mechanism's own unless they are given.
    """
    symbols = [
        a for a in function.arguments if a.name == "symbols" and a.name not in values
    ]
    own = {a.name: list(symbol_values(mechanism, a.labels).values()) for a in symbols}
    return by_numpy(function, {**values, **own}, arithmetic)


def normalised(mechanism: Mechanism, q: FloatArray) -> FloatArray:
    """Positions with unit quaternions, also if they are complex."""
    q = q.copy()
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            first = mechanism.positions.index(motion.positions[0])
            q[:, first : first + 4] /= np.sqrt(
                (q[:, first : first + 4] ** 2).sum(axis=1, keepdims=True)
            )
    return q
