"""The public names and where each is declared: type checkers read this file, and so does ``__init__.py``."""

from echelon.base.claims.audit import audit as audit
from echelon.base.claims.result import Audit as Audit
from echelon.base.claims.result import Verdict as Verdict
from echelon.base.derive import base_parameters as base_parameters
from echelon.base.derive import base_structure as base_structure
from echelon.base.expression import Expression as Expression
from echelon.base.linear_base import LinearBase as LinearBase
from echelon.base.match import Match as Match
from echelon.base.match import match as match
from echelon.base.matrix import Identifiability as Identifiability
from echelon.base.model import BaseModel as BaseModel
from echelon.base.numeric_comparison import NumericComparison as NumericComparison
from echelon.base.numeric_comparison import compare_numeric as compare_numeric
from echelon.base.row_space import RecordedRows as RecordedRows
from echelon.base.row_space import RowSpaces as RowSpaces
from echelon.base.row_space import energy_regressor as energy_regressor
from echelon.base.row_space import power_regressor as power_regressor
from echelon.base.row_space import same_row_space as same_row_space
from echelon.base.saved.model_file import load_model as load_model
from echelon.base.saved.saved import load_base as load_base
from echelon.base.saved.saved import load_linear_base as load_linear_base
from echelon.base.saved.saved import save_base as save_base
from echelon.base.saved.saved import verify as verify
from echelon.base.sensors import SensorReport as SensorReport
from echelon.base.sensors import sensor_report as sensor_report
from echelon.base.special import SpecialGeometry as SpecialGeometry
from echelon.base.special import special_geometry as special_geometry
from echelon.base.structure import Structure as Structure
from echelon.base.symbolic import SymbolicRegressor as SymbolicRegressor
from echelon.calibration.calibrating import Calibration as Calibration
from echelon.calibration.calibrating import CalibrationScore as CalibrationScore
from echelon.calibration.calibrating import calibrate as calibrate
from echelon.calibration.calibrating import calibration_base as calibration_base
from echelon.calibration.poses import CalibrationPoses as CalibrationPoses
from echelon.calibration.poses import calibration_poses as calibration_poses
from echelon.codegen.source import generate as generate
from echelon.compute.observe.observation import NormalEquations as NormalEquations
from echelon.compute.observe.observation import Observation as Observation
from echelon.dynamics.models import LinearModel as LinearModel
from echelon.excite.excite import ExcitingTrajectory as ExcitingTrajectory
from echelon.excite.excite import exciting_trajectory as exciting_trajectory
from echelon.excite.excite import judged_trajectory as judged_trajectory
from echelon.excite.files.trajectory_file import read_trajectory as read_trajectory
from echelon.excite.files.trajectory_file import write_trajectory as write_trajectory
from echelon.excite.problem.prior_model import (
    information_of_logs as information_of_logs,
)
from echelon.excite.problem.trajectory import Trajectory as Trajectory
from echelon.formats.linear_models import load_linear as load_linear
from echelon.formats.robot_file import load as load
from echelon.identification.estimators.estimate import Estimate as Estimate
from echelon.identification.gains import drive_gains as drive_gains
from echelon.identification.gains import gains_from_logs as gains_from_logs
from echelon.identification.identifying import identify as identify
from echelon.identification.payload import Payload as Payload
from echelon.identification.predict import predict_log as predict_log
from echelon.identification.result import Identification as Identification
from echelon.identification.saved.identified import load_identified as load_identified
from echelon.identification.saved.identified import (
    save_identification as save_identification,
)
from echelon.identification.servos.servo_fit import ServoFit as ServoFit
from echelon.identification.servos.servo_fit import fit_servos as fit_servos
from echelon.identification.setup.setup import Setup as Setup
from echelon.identification.setup.setup import load_setup as load_setup
from echelon.report.calibration import calibration_html as calibration_html
from echelon.report.preview import preview_html as preview_html
from echelon.report.report import report_html as report_html
from echelon.robot.inertia import convert as convert
from echelon.robot.inertia import convert_columns as convert_columns
from echelon.robot.mechanism import Mechanism as Mechanism
from echelon.robot.motor_side import joint_side as joint_side
from echelon.shared.errors import AssemblyWarning as AssemblyWarning
from echelon.shared.errors import CertificateError as CertificateError
from echelon.shared.errors import ClosedFormError as ClosedFormError
from echelon.shared.errors import DoubtWarning as DoubtWarning
from echelon.shared.errors import EchelonError as EchelonError
from echelon.shared.errors import InputError as InputError
from echelon.shared.errors import MissingExtraError as MissingExtraError
from echelon.shared.version import __version__ as __version__
