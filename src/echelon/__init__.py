"""Exact base inertial parameters of robots, in closed form, with a certificate.

>>> import echelon as ec
>>> robot = ec.load("examples/panda.yaml")
>>> base = ec.base_parameters(robot)
>>> base
BaseModel(panda: 43 base parameters of 70)
"""

from echelon.base.derive import base_parameters, base_structure
from echelon.base.expression import Expression
from echelon.base.model import BaseModel, Identifiability
from echelon.base.serialize import load_base, save_base
from echelon.base.structure import Structure
from echelon.base.verify import verify
from echelon.errors import (
    CertificateError,
    ClosedFormError,
    EchelonError,
    InputError,
    MissingExtraError,
)
from echelon.formats.load import load
from echelon.mechanism.mechanism import Mechanism

__version__ = "0.1.0"

__all__ = [
    "BaseModel",
    "CertificateError",
    "ClosedFormError",
    "EchelonError",
    "Expression",
    "Identifiability",
    "InputError",
    "Mechanism",
    "MissingExtraError",
    "Structure",
    "base_parameters",
    "base_structure",
    "load",
    "load_base",
    "save_base",
    "verify",
]
