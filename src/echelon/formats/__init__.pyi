"""Names that other rooms may use, and where each is defined."""

from echelon.formats.attached_frames import FixedFrame as FixedFrame
from echelon.formats.attached_frames import fixed_frames as fixed_frames
from echelon.formats.attached_frames import named_axes as named_axes
from echelon.formats.attached_frames import other_axes as other_axes
from echelon.formats.description.document import Document as Document
from echelon.formats.inertial_decimals import inertial_rounding as inertial_rounding
from echelon.formats.joint_limits import StatedLimits as StatedLimits
from echelon.formats.joint_limits import stated_limits as stated_limits
from echelon.formats.linear_models import linear_document as linear_document
from echelon.formats.linear_models import read_linear as read_linear
from echelon.formats.literal import LiteralPlacement as LiteralPlacement
from echelon.formats.literal import LiteralTree as LiteralTree
from echelon.formats.literal import numeric_placement as numeric_placement
from echelon.formats.literal import rotation_matrix as rotation_matrix
from echelon.formats.mjcf.mjcf_model import IRRELEVANT as IRRELEVANT
from echelon.formats.mjcf.mjcf_model import absent_meshes as absent_meshes
from echelon.formats.mjcf.mjcf_model import import_mujoco as import_mujoco
from echelon.formats.mjcf.mjcf_model import keep_bodies as keep_bodies
from echelon.formats.mjcf.mjcf_model import mesh_name as mesh_name
from echelon.formats.mjcf.mjcf_model import parse_spec as parse_spec
from echelon.formats.mjcf.mjcf_model import refusal as refusal
from echelon.formats.mjcf.mjcf_model import remove_groups as remove_groups
from echelon.formats.mjcf.mjcf_model import remove_unused as remove_unused
from echelon.formats.mjcf.mjcf_numbers import quaternion_matrix as quaternion_matrix
from echelon.formats.mjcf.mjcf_reader import drives_joint as drives_joint
from echelon.formats.mjcf.mjcf_reader import is_motor as is_motor
from echelon.formats.robot_file import RobotFile as RobotFile
from echelon.formats.robot_file import load as load
from echelon.formats.robot_file import load_model as load_model
from echelon.formats.robot_file import open_robot as open_robot
from echelon.formats.schema.robot_schema import json_schema as json_schema
from echelon.formats.schema.schema_excite import EVERY as EVERY
from echelon.formats.schema.schema_excite import NO_LIMIT as NO_LIMIT
from echelon.formats.schema.schema_excite import ExcitationEntry as ExcitationEntry
from echelon.formats.schema.schema_excite import FrameEntry as FrameEntry
from echelon.formats.schema.schema_excite import LimitsEntry as LimitsEntry
from echelon.formats.schema.schema_log import BodyBoundsEntry as BodyBoundsEntry
from echelon.formats.schema.schema_log import Column as Column
from echelon.formats.schema.schema_log import ColumnEntry as ColumnEntry
from echelon.formats.schema.schema_log import Columns as Columns
from echelon.formats.schema.schema_log import Combination as Combination
from echelon.formats.schema.schema_log import IdentificationEntry as IdentificationEntry
from echelon.formats.schema.schema_log import LogEntry as LogEntry
from echelon.formats.schema.schema_log import PreparationEntry as PreparationEntry
from echelon.formats.schema.schema_measure import MeasureEntry as MeasureEntry
from echelon.formats.schema.schema_measure import MeasureKind as MeasureKind
from echelon.formats.snapping import ReadingOptions as ReadingOptions
from echelon.formats.snapping import gravity_vector as gravity_vector
from echelon.formats.urdf.exact_xml import ExactXml as ExactXml
from echelon.formats.usual_effects import slides as slides
from echelon.formats.usual_effects import with_rotors as with_rotors
from echelon.formats.usual_effects import with_usual_effects as with_usual_effects
from echelon.formats.writers.calibrated_writer import (
    calibrated_robot as calibrated_robot,
)
from echelon.formats.writers.description_writer import (
    write_description as write_description,
)
from echelon.formats.writers.robot_writer import WrittenRobot as WrittenRobot
from echelon.formats.writers.robot_writer import identified_robot as identified_robot
