"""Exact base inertial parameters of robots, in closed form, with a certificate.

>>> import echelon as ec
>>> robot = ec.load("examples/panda.yaml")
>>> base = ec.base_parameters(robot)
>>> base
BaseModel(panda: 43 base parameters of 70)
"""

from __future__ import annotations

TYPE_CHECKING = False  # what the module `typing` says too, without its import: commands answer signals that much sooner

if TYPE_CHECKING:  # a name is imported when it is first asked for, so that no command waits for another's modules
    from echelon.base.classification import Identifiability as Identifiability
    from echelon.base.derive import base_parameters as base_parameters
    from echelon.base.derive import base_structure as base_structure
    from echelon.base.expression import Expression as Expression
    from echelon.base.linear_base import LinearBase as LinearBase
    from echelon.base.match import Match as Match
    from echelon.base.match import match as match
    from echelon.base.model import BaseModel as BaseModel
    from echelon.base.modes import assembly_modes as assembly_modes
    from echelon.base.numeric_comparison import NumericComparison as NumericComparison
    from echelon.base.numeric_comparison import compare_numeric as compare_numeric
    from echelon.base.recorded_rows import RecordedRows as RecordedRows
    from echelon.base.recorded_rows import energy_regressor as energy_regressor
    from echelon.base.recorded_rows import power_regressor as power_regressor
    from echelon.base.row_space import RowSpaces as RowSpaces
    from echelon.base.row_space import same_row_space as same_row_space
    from echelon.base.sensors import SensorReport as SensorReport
    from echelon.base.sensors import sensor_report as sensor_report
    from echelon.base.special import SpecialGeometry as SpecialGeometry
    from echelon.base.special import special_geometry as special_geometry
    from echelon.base.structure import Structure as Structure
    from echelon.base.symbolic import SymbolicRegressor as SymbolicRegressor
    from echelon.claims.audit import audit as audit
    from echelon.claims.findings import Verdict as Verdict
    from echelon.claims.result import Audit as Audit
    from echelon.codegen.generate import generate as generate
    from echelon.errors import AssemblyWarning as AssemblyWarning
    from echelon.errors import CertificateError as CertificateError
    from echelon.errors import ClosedFormError as ClosedFormError
    from echelon.errors import EchelonError as EchelonError
    from echelon.errors import InputError as InputError
    from echelon.errors import MissingExtraError as MissingExtraError
    from echelon.errors import UnknownRelationsError as UnknownRelationsError
    from echelon.excite.excite import exciting_trajectory as exciting_trajectory
    from echelon.excite.excite import judged_trajectory as judged_trajectory
    from echelon.excite.files.reading import read_trajectory as read_trajectory
    from echelon.excite.files.writing import write_trajectory as write_trajectory
    from echelon.excite.known import information_of_logs as information_of_logs
    from echelon.excite.result import ExcitingTrajectory as ExcitingTrajectory
    from echelon.excite.trajectory import Trajectory as Trajectory
    from echelon.formats.linear import load_linear as load_linear
    from echelon.formats.load import load as load
    from echelon.identification.estimators.estimate import Estimate as Estimate
    from echelon.identification.gains.from_logs import gains_from_logs as gains_from_logs
    from echelon.identification.gains.gains import drive_gains as drive_gains
    from echelon.identification.gains.payload import Payload as Payload
    from echelon.identification.identify import identify as identify
    from echelon.identification.predict import predict_log as predict_log
    from echelon.identification.result import Identification as Identification
    from echelon.identification.settings import Setup as Setup
    from echelon.identification.setup import load_setup as load_setup
    from echelon.inertia.convert import convert as convert
    from echelon.inertia.convert import convert_columns as convert_columns
    from echelon.mechanism.mechanism import Mechanism as Mechanism
    from echelon.mechanism.motor_side import joint_side as joint_side
    from echelon.models.linear_model import LinearModel as LinearModel
    from echelon.observe.normal import NormalEquations as NormalEquations
    from echelon.observe.observation import Observation as Observation
    from echelon.report.page import report_html as report_html
    from echelon.report.preview.page import preview_html as preview_html
    from echelon.results.identified import load_identified as load_identified
    from echelon.results.identified import save_identification as save_identification
    from echelon.results.saved import load_base as load_base
    from echelon.results.saved import save_base as save_base
    from echelon.results.verify import verify as verify
    from echelon.version import __version__ as __version__

_NAMES = {
    "base.classification": "Identifiability",
    "base.derive": "base_parameters base_structure",
    "base.expression": "Expression",
    "base.linear_base": "LinearBase",
    "base.match": "Match match",
    "base.model": "BaseModel",
    "base.modes": "assembly_modes",
    "base.numeric_comparison": "NumericComparison compare_numeric",
    "base.recorded_rows": "RecordedRows energy_regressor power_regressor",
    "base.row_space": "RowSpaces same_row_space",
    "base.sensors": "SensorReport sensor_report",
    "base.special": "SpecialGeometry special_geometry",
    "base.structure": "Structure",
    "base.symbolic": "SymbolicRegressor",
    "claims.audit": "audit",
    "claims.findings": "Verdict",
    "claims.result": "Audit",
    "codegen.generate": "generate",
    "errors": (
        "AssemblyWarning CertificateError ClosedFormError EchelonError InputError MissingExtraError "
        "UnknownRelationsError"
    ),
    "excite.excite": "exciting_trajectory judged_trajectory",
    "excite.files.reading": "read_trajectory",
    "excite.files.writing": "write_trajectory",
    "excite.known": "information_of_logs",
    "excite.result": "ExcitingTrajectory",
    "excite.trajectory": "Trajectory",
    "formats.linear": "load_linear",
    "formats.load": "load",
    "identification.estimators.estimate": "Estimate",
    "identification.gains.from_logs": "gains_from_logs",
    "identification.gains.gains": "drive_gains",
    "identification.gains.payload": "Payload",
    "identification.identify": "identify",
    "identification.predict": "predict_log",
    "identification.result": "Identification",
    "identification.settings": "Setup",
    "identification.setup": "load_setup",
    "inertia.convert": "convert convert_columns",
    "mechanism.mechanism": "Mechanism",
    "mechanism.motor_side": "joint_side",
    "models.linear_model": "LinearModel",
    "observe.normal": "NormalEquations",
    "observe.observation": "Observation",
    "report.page": "report_html",
    "report.preview.page": "preview_html",
    "results.identified": "load_identified save_identification",
    "results.saved": "load_base save_base",
    "results.verify": "verify",
    "version": "__version__",
}
"""What is public, by the module that it lives in."""

_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = sorted(_HOME)


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'echelon' has no attribute '{name}'")
    from importlib import import_module

    found = globals()[name] = getattr(import_module(f"echelon.{_HOME[name]}"), name)
    return found


def __dir__() -> list[str]:
    return __all__
