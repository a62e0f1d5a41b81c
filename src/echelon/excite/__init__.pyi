"""Names that other rooms may use, and where each is defined."""

from echelon.excite.closeness import FARTHEST as FARTHEST
from echelon.excite.closeness import PairDistance as PairDistance
from echelon.excite.closeness import positions_along as positions_along
from echelon.excite.driven import SampledRank as SampledRank
from echelon.excite.driven import sampled_rank as sampled_rank
from echelon.excite.excite import ExcitingTrajectory as ExcitingTrajectory
from echelon.excite.excite import exciting_trajectory as exciting_trajectory
from echelon.excite.excite import judged_trajectory as judged_trajectory
from echelon.excite.files.trajectory_file import design_to_json as design_to_json
from echelon.excite.files.trajectory_file import read_trajectory as read_trajectory
from echelon.excite.files.trajectory_file import text_of as text_of
from echelon.excite.files.trajectory_file import (
    trajectory_content as trajectory_content,
)
from echelon.excite.files.trajectory_file import trajectory_schema as trajectory_schema
from echelon.excite.problem.prior_model import (
    information_of_logs as information_of_logs,
)
from echelon.excite.problem.shapes import CORNERS as CORNERS
from echelon.excite.problem.shapes import Shape as Shape
from echelon.excite.problem.shapes import ShapeKind as ShapeKind
from echelon.excite.problem.state_limits import ORDERS as ORDERS
from echelon.excite.problem.state_limits import enclosures_of as enclosures_of
from echelon.excite.problem.task import changed as changed
from echelon.excite.problem.task import resolved_limits as resolved_limits
from echelon.excite.problem.task import task_of as task_of
from echelon.excite.verify import ACTIVE as ACTIVE
from echelon.excite.verify import SAMPLES_PER_PERIOD as SAMPLES_PER_PERIOD
from echelon.excite.verify import Margin as Margin
from echelon.excite.verify import when_kept as when_kept
