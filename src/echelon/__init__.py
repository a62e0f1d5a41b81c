"""Exact base inertial parameters of robots, in closed form, with a certificate.

>>> import echelon as ec
>>> robot = ec.load("examples/panda.yaml")
>>> base = ec.base_parameters(robot)
>>> base
BaseModel(panda: 43 base parameters of 70)
"""

from echelon.base.classification import Identifiability
from echelon.base.derive import base_parameters, base_structure
from echelon.base.expression import Expression
from echelon.base.linear_base import LinearBase
from echelon.base.match import Match, match
from echelon.base.model import BaseModel
from echelon.base.modes import assembly_modes
from echelon.base.sensors import SensorReport, sensor_report
from echelon.base.special import SpecialGeometry, special_geometry
from echelon.base.structure import Structure
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

__all__ = [
    "Audit",
    "BaseModel",
    "CertificateError",
    "ClosedFormError",
    "EchelonError",
    "Expression",
    "Identifiability",
    "InputError",
    "LinearBase",
    "LinearModel",
    "Match",
    "Mechanism",
    "MissingExtraError",
    "NormalEquations",
    "Observation",
    "SensorReport",
    "SpecialGeometry",
    "Structure",
    "UnknownRelationsError",
    "Verdict",
    "__version__",
    "assembly_modes",
    "audit",
    "base_parameters",
    "base_structure",
    "convert",
    "convert_columns",
    "generate",
    "joint_side",
    "load",
    "load_base",
    "load_linear",
    "match",
    "save_base",
    "sensor_report",
    "special_geometry",
    "verify",
]
