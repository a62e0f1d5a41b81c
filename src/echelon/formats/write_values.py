"""Identified values as robot files state them: mass, centre of mass and inertia about it, body by body.

Standard parameters are about the frame's origin, where models are linear in them; files and simulators state the
inertia about the centre of mass.  So every body needs a mass, unless it carries nothing at all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.conventions import PARAMETERS, PER_BODY
from echelon.errors import InputError
from echelon.inertia.convert import convert
from echelon.inertia.spatial import pseudo_inertia
from echelon.mechanism.mechanism import ALL, Body, Mechanism

ROTOR = "rotor"
"""Kind of the joint of a body that is the rotor of a drive."""

_MASS = PARAMETERS.index("M")
_ROUNDING = 1e-9
"""How far below zero an eigenvalue may be, relative to the largest, that a solver left on the edge of the cone."""


@dataclass(frozen=True)
class Load:
    """What a body weighs."""

    mass: float  # kg
    centre: tuple[float, ...]  # centre of mass in the body's frame, m
    moments: tuple[float, ...]  # XX XY XZ YY YZ ZZ about the centre of mass, along the axes of the body's frame, kg·m²


@dataclass(frozen=True)
class IdentifiedValues:
    """Standard parameters sorted by what they describe."""

    bodies: tuple[Floats, ...]  # one per body, zero for what it does not carry
    effects: Mapping[str, float]  # by parameter


def sorted_values(mechanism: Mechanism, standard: npt.ArrayLike) -> IdentifiedValues:
    """Sort standard parameters by body and effect.  Shapes: standard (p,)."""
    values = np.asarray(standard, dtype=float)
    names = mechanism.parameters
    if values.shape != (len(names),):
        raise InputError(f"expected {len(names)} standard parameters of '{mechanism.name}', got shape {values.shape}")
    strange = [name for name, value in zip(names, values, strict=True) if not np.isfinite(value)]
    if strange:
        raise InputError("the value is not a finite number", element=f"parameter '{strange[0]}'")
    bodies = [np.zeros(PER_BODY) for _ in mechanism.bodies]
    effects: dict[str, float] = {}
    for parameter, value in zip(mechanism.columns, values, strict=True):
        if parameter.body is None or parameter.kind is None:
            effects[parameter.name] = float(value)
        else:
            for body in mechanism.sharing[parameter.body]:
                bodies[body][parameter.kind] = value
    for carrier in mechanism.carriers:
        _check_consistency(mechanism.bodies[carrier], bodies[carrier])
    return IdentifiedValues(tuple(bodies), effects)


def has_centre(values: Floats) -> bool:
    """Whether ten parameters have a centre of mass that files can state.  Shapes: values (10,)."""
    return bool(values[_MASS] > 0 or not (values[_MASS] or values[6:9].any()))


def load_of(values: Floats, name: str) -> Load | None:
    """Mass, centre of mass and inertia about it; None of a body without any.  Shapes: values (10,)."""
    if not values.any():
        return None
    if values[_MASS] > 0:
        mass, *rest = (float(v) for v in convert(values, "echelon", "urdf"))
        return Load(mass, tuple(rest[:3]), tuple(rest[3:]))
    if not has_centre(values):
        problem = f"its mass is {values[_MASS]:g} kg; files state a centre of mass, which needs a positive mass"
        raise InputError(problem, element=f"body '{name}'")
    return Load(0.0, (0.0, 0.0, 0.0), tuple(float(v) for v in values[:6]))


def number_text(*values: float) -> str:
    """Numbers with all their digits: reading them back gives the same doubles.

    >>> number_text(0.1, -0.0, 3)
    '0.1 0.0 3.0'
    """
    return " ".join(repr(float(value) + 0.0) for value in values)


def _check_consistency(body: Body, values: Floats) -> None:
    """Refuse parameters that no body has; a part of the ten alone cannot be judged."""
    if body.carried != ALL or not values.any():
        return
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(values))
    if values[_MASS] <= 0 or eigenvalues[0] < -_ROUNDING * eigenvalues[-1]:
        problem = (
            f"no body has these parameters (mass {values[_MASS]:.6g} kg, least eigenvalue of the pseudo-inertia "
            f"{eigenvalues[0]:.3g}); files need physically consistent ones"
        )
        raise InputError(problem, element=f"body '{body.name}'")
