"""Origins of inertias: which bodies of a fitted robot the data tell, in part, or not at all."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from echelon.base import Identifiability
from echelon.identification.result import Identification
from echelon.shared import Floats

if TYPE_CHECKING:
    from echelon.robot import Mechanism

BY_DATA = "from the data alone"
IN_PART = "in part from the data, the rest from {}"
BY_FILE = "as in the robot file, since no output sees them"
BY_PRIOR = "from {}, since the data do not tell them"


def inertia_origins(result: Identification) -> str:
    """A sentence that sorts bodies by where their inertias come from; empty without a physical fit.

    A body is told by the data alone if all its parameters are base parameters that the data determine, and in part if
    such base parameters contain some of them.
    """
    if result.physical is None:
        return ""
    rest = "the prior" if result.physical.prior else "bodies of a plain shape"
    sorted_bodies: dict[str, list[str]] = {
        origin: [] for origin in (BY_DATA, IN_PART, BY_FILE, BY_PRIOR)
    }
    robot = result.robot
    determined = result.conditioning.independent_share > 0
    rows = result.base.B_float()[determined]
    for carrier in robot.carriers:
        origin = _origin(result, robot, carrier, rows)
        sorted_bodies[origin].append(f"'{robot.bodies[carrier].name}'")
    parts = [
        f"{origin.format(rest)}: {', '.join(names)}"
        for origin, names in sorted_bodies.items()
        if names
    ]
    return f"inertias {'; '.join(parts)}" if parts else ""


def _origin(
    result: Identification, robot: Mechanism, carrier: int, determined: Floats
) -> str:
    """Origin of the inertias of a body, by the rows of B that the data determine."""
    names = [p.name for p in robot.columns if p.body == carrier]
    columns = [result.base.parameters.index(name) for name in names]
    rows = determined[:, columns]
    kinds = [result.base.classification[name] for name in names]
    if not rows.any() or all(kind is Identifiability.UNIDENTIFIABLE for kind in kinds):
        return BY_FILE if _is_stated(result, robot, carrier, names) else BY_PRIOR
    is_told = rows.any(axis=0).all()
    is_alone = all(kind is Identifiability.ALONE for kind in kinds)
    return BY_DATA if is_told and is_alone else IN_PART


def _is_stated(
    result: Identification, robot: Mechanism, carrier: int, names: Sequence[str]
) -> bool:
    """Whether a body has exactly the values that its file states."""
    fit, stated = result.physical, robot.bodies[carrier].inertial
    assert fit is not None
    values = dict(zip(fit.parameters, fit.standard, strict=True))
    found = [values[name] for name in names]
    return stated is not None and np.array_equal(stated, found)
