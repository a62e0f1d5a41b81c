"""Whether a trajectory keeps its limits: margins at every time, or with closed loops at samples."""

from __future__ import annotations

from echelon.errors import EchelonError
from echelon.excite.problem.clearance import Clearance
from echelon.excite.problem.closed_loops import LoopLimits
from echelon.excite.problem.state_limits import Enclosed
from echelon.excite.problem.task import Task
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.verify.clearance_bounds import clearance_margins
from echelon.excite.verify.margins import Margin, loop_margins, motion_margins, state_margins


def margins_of(trajectory: Trajectory, task: Task) -> list[Margin]:
    """How far a trajectory stays from all limits, first those of the motion, then those of the state in their order."""
    found = motion_margins(trajectory, task.limits.motion)
    for constraint in task.constraints:
        if isinstance(constraint, Enclosed):
            found += state_margins(trajectory, constraint)
        elif isinstance(constraint, Clearance):
            found += clearance_margins(trajectory, constraint)
        elif isinstance(constraint, LoopLimits):
            found += loop_margins(trajectory, constraint)
        else:
            raise EchelonError(f"nothing bounds {', '.join(constraint.labels[:3])} between samples")
    return found
