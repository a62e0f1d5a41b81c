"""Mechanisms with loops: poses in which they close, motions that keep them closed, and random closed states.

:func:`close` reads a mechanism's loops and chooses its independent coordinates.  From there on, :class:`Assembly` walks
from the assembly pose to other closed poses in double precision; :class:`ClosedMotion` and :class:`DependentMotion`
complete velocities and accelerations, in numbers and as recorded formulas; and :class:`Loops` keeps recorded rows on
closed states, which :func:`closed_states` encloses in ball arithmetic.
"""

from echelon.loops.assembly import LARGEST_CORRECTION, STRIDE, Assembly
from echelon.loops.closed_balls import ClosedBalls, closed_states
from echelon.loops.closed_motion import (
    NEGLIGIBLE,
    ClosedMotion,
    largest,
    normalised,
    position_rates,
)
from echelon.loops.closing import check_independent, close, locked_joints
from echelon.loops.dependent_motion import DependentMotion
from echelon.loops.recorded_loops import Loops, loops_of, real_inputs

__all__ = [
    "LARGEST_CORRECTION",
    "NEGLIGIBLE",
    "STRIDE",
    "Assembly",
    "ClosedBalls",
    "ClosedMotion",
    "DependentMotion",
    "Loops",
    "check_independent",
    "close",
    "closed_states",
    "largest",
    "locked_joints",
    "loops_of",
    "normalised",
    "position_rates",
    "real_inputs",
]
