"""Names that other rooms may use, and where each is defined."""

from echelon.loops.assembly import LARGEST_CORRECTION as LARGEST_CORRECTION
from echelon.loops.assembly import STRIDE as STRIDE
from echelon.loops.assembly import Assembly as Assembly
from echelon.loops.closed_balls import ClosedBalls as ClosedBalls
from echelon.loops.closed_balls import closed_states as closed_states
from echelon.loops.closed_motion import NEGLIGIBLE as NEGLIGIBLE
from echelon.loops.closed_motion import ClosedMotion as ClosedMotion
from echelon.loops.closed_motion import largest as largest
from echelon.loops.closed_motion import normalised as normalised
from echelon.loops.closed_motion import position_rates as position_rates
from echelon.loops.closing import check_independent as check_independent
from echelon.loops.closing import close as close
from echelon.loops.closing import locked_joints as locked_joints
from echelon.loops.dependent_motion import DependentMotion as DependentMotion
from echelon.loops.recorded_loops import Loops as Loops
from echelon.loops.recorded_loops import loops_of as loops_of
from echelon.loops.recorded_loops import real_inputs as real_inputs
