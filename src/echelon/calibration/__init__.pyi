"""Names that other rooms may use, and where each is defined."""

from echelon.calibration.calibrating import Calibration as Calibration
from echelon.calibration.calibrating import calibrate as calibrate
from echelon.calibration.calibrating import calibration_base as calibration_base
from echelon.calibration.poses import CalibrationPoses as CalibrationPoses
from echelon.calibration.poses import calibration_poses as calibration_poses
from echelon.calibration.record import calibration_document as calibration_document
from echelon.calibration.record import calibration_schema as calibration_schema
