"""Exact base inertial parameters of robots, in closed form, with a certificate.

>>> import echelon as ec
>>> robot = ec.load("examples/panda.yaml")
>>> base = ec.base_parameters(robot)
>>> base
BaseModel(panda: 43 base parameters of 70)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from echelon.base.classification import Identifiability
from echelon.base.derive import base_parameters, base_structure
from echelon.base.expression import Expression
from echelon.base.linear_base import LinearBase
from echelon.base.match import Match, match
from echelon.base.model import BaseModel
from echelon.base.modes import assembly_modes
from echelon.base.numeric_comparison import NumericComparison, compare_numeric
from echelon.base.recorded_rows import RecordedRows, energy_regressor, power_regressor
from echelon.base.row_space import RowSpaces, same_row_space
from echelon.base.sensors import SensorReport, sensor_report
from echelon.base.special import SpecialGeometry, special_geometry
from echelon.base.structure import Structure
from echelon.base.symbolic import SymbolicRegressor
from echelon.claims.audit import audit
from echelon.claims.findings import Verdict
from echelon.claims.result import Audit
from echelon.codegen.generate import generate
from echelon.errors import (
    CertificateError,
    ClosedFormError,
    EchelonError,
    InputError,
    MissingExtraError,
    UnknownRelationsError,
)
from echelon.formats.linear import load_linear
from echelon.formats.load import load
from echelon.inertia.convert import convert, convert_columns
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.motor_side import joint_side
from echelon.models.linear_model import LinearModel
from echelon.observe.normal import NormalEquations
from echelon.observe.observation import Observation
from echelon.results.saved import load_base, save_base
from echelon.results.verify import verify
from echelon.version import __version__

if TYPE_CHECKING:  # fitting models to logs needs much that deriving them does not, so it is imported when asked for
    from echelon.excite.excite import exciting_trajectory, judged_trajectory
    from echelon.excite.files.reading import read_trajectory
    from echelon.excite.files.writing import write_trajectory
    from echelon.excite.known import information_of_logs
    from echelon.excite.result import ExcitingTrajectory
    from echelon.excite.trajectory import Trajectory
    from echelon.identification.estimators.estimate import Estimate
    from echelon.identification.gains.from_logs import gains_from_logs
    from echelon.identification.gains.gains import drive_gains
    from echelon.identification.gains.payload import Payload
    from echelon.identification.identify import identify
    from echelon.identification.predict import predict_log
    from echelon.identification.result import Identification
    from echelon.identification.settings import Setup
    from echelon.identification.setup import load_setup
    from echelon.report.page import report_html
    from echelon.report.preview.page import preview_html
    from echelon.results.identified import load_identified, save_identification

_LATER = {
    "Estimate": "echelon.identification.estimators.estimate",
    "ExcitingTrajectory": "echelon.excite.result",
    "Identification": "echelon.identification.result",
    "Payload": "echelon.identification.gains.payload",
    "Setup": "echelon.identification.settings",
    "Trajectory": "echelon.excite.trajectory",
    "drive_gains": "echelon.identification.gains.gains",
    "exciting_trajectory": "echelon.excite.excite",
    "gains_from_logs": "echelon.identification.gains.from_logs",
    "identify": "echelon.identification.identify",
    "information_of_logs": "echelon.excite.known",
    "judged_trajectory": "echelon.excite.excite",
    "load_identified": "echelon.results.identified",
    "load_setup": "echelon.identification.setup",
    "predict_log": "echelon.identification.predict",
    "preview_html": "echelon.report.preview.page",
    "read_trajectory": "echelon.excite.files.reading",
    "report_html": "echelon.report.page",
    "save_identification": "echelon.results.identified",
    "write_trajectory": "echelon.excite.files.writing",
}

__all__ = [
    "Audit",
    "BaseModel",
    "CertificateError",
    "ClosedFormError",
    "EchelonError",
    "Estimate",
    "ExcitingTrajectory",
    "Expression",
    "Identifiability",
    "Identification",
    "InputError",
    "LinearBase",
    "LinearModel",
    "Match",
    "Mechanism",
    "MissingExtraError",
    "NormalEquations",
    "NumericComparison",
    "Observation",
    "Payload",
    "RecordedRows",
    "RowSpaces",
    "SensorReport",
    "Setup",
    "SpecialGeometry",
    "Structure",
    "SymbolicRegressor",
    "Trajectory",
    "UnknownRelationsError",
    "Verdict",
    "__version__",
    "assembly_modes",
    "audit",
    "base_parameters",
    "base_structure",
    "compare_numeric",
    "convert",
    "convert_columns",
    "drive_gains",
    "energy_regressor",
    "exciting_trajectory",
    "gains_from_logs",
    "generate",
    "identify",
    "information_of_logs",
    "joint_side",
    "judged_trajectory",
    "load",
    "load_base",
    "load_identified",
    "load_linear",
    "load_setup",
    "match",
    "power_regressor",
    "predict_log",
    "preview_html",
    "read_trajectory",
    "report_html",
    "same_row_space",
    "save_base",
    "save_identification",
    "sensor_report",
    "special_geometry",
    "verify",
    "write_trajectory",
]


def __getattr__(name: str) -> object:
    if name not in _LATER:
        raise AttributeError(f"module 'echelon' has no attribute '{name}'")
    return getattr(import_module(_LATER[name]), name)


def __dir__() -> list[str]:
    return __all__
