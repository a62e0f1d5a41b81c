"""The model that hypotheses are judged by: with gravity in any direction, where that can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from echelon.base import BaseModel, base_parameters
from echelon.formats import gravity_vector
from echelon.identification.judge.evidence import GRAVITY
from echelon.robot import Mechanism, known_values
from echelon.shared import Floats, InputError

_EARTH = 9.81  # m/s²
_DIGITS = 4  # of gravity's components, in which an estimate is stated


def free_gravity(base: BaseModel, seed: int) -> tuple[BaseModel, Floats | None]:
    """The base model with gravity of any direction, and the gravity that it has, m/s².

    The same model and None where the base moves, loops are closed, or there is no gravity.
    """
    mechanism = base.mechanism
    stated = stated_gravity(mechanism)
    taken = set(mechanism.symbols) & set(GRAVITY)
    if stated is None or taken or not _is_fixed(mechanism):
        return base, None
    return base_parameters(
        replace(mechanism, gravity=gravity_vector("generic")), seed=seed
    ), stated


def stated_gravity(mechanism: Mechanism) -> Floats | None:
    """The gravity of a mechanism, m/s² in the base frame; None if it has none, or one without values."""
    if mechanism.gravity is None:
        return None
    known = known_values(mechanism)
    if any(
        not known.keys() >= set(component.symbols()) for component in mechanism.gravity
    ):
        return None
    found = np.array(
        [component.at(known) for component in mechanism.gravity], dtype=float
    )
    return found if np.any(found) else None


def is_unknown(mechanism: Mechanism) -> bool:
    """Whether gravity has symbols without values, so that its direction is to be found."""
    known = known_values(mechanism)
    return any(
        not known.keys() >= set(component.symbols())
        for component in mechanism.gravity or ()
    )


def standing(mechanism: Mechanism) -> Mechanism:
    """The mechanism with gravity along -z of its base, from where its direction can be found.

    Raises
    ------
    InputError
        If the base moves or loops are closed: no other direction is looked for then.
    """
    if not _is_fixed(mechanism):
        what = "a base that moves" if mechanism.floating_joints else "closed loops"
        raise InputError(
            f"the direction of gravity is not estimated for robots with {what}: state it, as in "
            f"--gravity 0,0,-{_EARTH} or gravity: [0, 0, -{_EARTH}]",
            source=mechanism.name,
        )
    return with_gravity(mechanism, np.array([0.0, 0.0, -_EARTH]))


def _is_fixed(mechanism: Mechanism) -> bool:
    return not (mechanism.dependent_velocities or mechanism.floating_joints)


def with_gravity(mechanism: Mechanism, gravity: Floats) -> Mechanism:
    """The mechanism with another gravity, m/s², to some digits."""
    unit = 10.0 ** np.round(np.log10(max(np.abs(gravity).max(), 1e-300)) - _DIGITS)
    stated = ",".join(f"{unit * np.round(g / unit):.6g}" for g in gravity)
    changed = replace(mechanism, gravity=gravity_vector(stated))
    reading = mechanism.reading
    if reading is None:
        return changed
    return changed.as_read(
        replace(reading, options=replace(reading.options, gravity=stated))
    )
