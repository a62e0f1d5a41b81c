"""Names that other rooms may use, and where each is defined."""

from echelon.identification.cluster import connect as connect
from echelon.identification.estimators.estimate import CLEAR as CLEAR
from echelon.identification.estimators.estimate import Estimate as Estimate
from echelon.identification.fit_findings import all_usable as all_usable
from echelon.identification.fit_findings import limited as limited
from echelon.identification.identifying import identify as identify
from echelon.identification.judge.judge import Judged as Judged
from echelon.identification.judging import explained_rate as explained_rate
from echelon.identification.logs.columns.column_map import Channel as Channel
from echelon.identification.logs.columns.column_map import Locked as Locked
from echelon.identification.logs.faults.locked_joints import (
    check_locked as check_locked,
)
from echelon.identification.logs.files.log_file import Table as Table
from echelon.identification.logs.files.log_file import decoding as decoding
from echelon.identification.logs.files.log_file import existing_file as existing_file
from echelon.identification.logs.files.open_log import log_paths as log_paths
from echelon.identification.logs.files.open_log import open_log as open_log
from echelon.identification.logs.files.open_log import read_table as read_table
from echelon.identification.logs.finding import Finding as Finding
from echelon.identification.logs.finding import Severity as Severity
from echelon.identification.logs.finding import counted as counted
from echelon.identification.logs.finding import listed as listed
from echelon.identification.logs.finding import note as note
from echelon.identification.logs.finding import warning as warning
from echelon.identification.logs.positions import logged_positions as logged_positions
from echelon.identification.logs.preparation.prepare import Preparation as Preparation
from echelon.identification.logs.units import factor as factor
from echelon.identification.masses import BodyMass as BodyMass
from echelon.identification.origins import inertia_origins as inertia_origins
from echelon.identification.physics.feasibility import Feasibility as Feasibility
from echelon.identification.physics.fit import KIND as KIND
from echelon.identification.physics.fit import PhysicalFit as PhysicalFit
from echelon.identification.physics.prior_information import prior_from as prior_from
from echelon.identification.predict import Prediction as Prediction
from echelon.identification.predict import predict_log as predict_log
from echelon.identification.result import Identification as Identification
from echelon.identification.rows.rows import ModelRows as ModelRows
from echelon.identification.saved.identified import (
    identification_to_json as identification_to_json,
)
from echelon.identification.saved.identified import load_identified as load_identified
from echelon.identification.saved.identified import score_record as score_record
from echelon.identification.saved.identified import servo_document as servo_document
from echelon.identification.saved.identified import servo_to_json as servo_to_json
from echelon.identification.saved.schema import IdentifiedRecord as IdentifiedRecord
from echelon.identification.scores import Score as Score
from echelon.identification.scores import Trace as Trace
from echelon.identification.scores import Validation as Validation
from echelon.identification.servos.servo_fit import ServoFit as ServoFit
from echelon.identification.servos.servo_fit import fit_servos as fit_servos
from echelon.identification.servos.servo_start import servo_joints as servo_joints
from echelon.identification.setup.logs import with_logs as with_logs
from echelon.identification.setup.setup import Setup as Setup
from echelon.identification.setup.setup import check_single as check_single
from echelon.identification.setup.setup import load_setup as load_setup
from echelon.identification.setup.setup import setup_of as setup_of
from echelon.identification.setup.setup import with_file_effects as with_file_effects
from echelon.identification.setup.skeleton import skeleton as skeleton
from echelon.identification.surveying import FirstLook as FirstLook
from echelon.identification.surveying import first_look as first_look
from echelon.identification.surveying import surveyed_plan as surveyed_plan
from echelon.identification.verdict import Judgement as Judgement
