"""Random robots that can exist, and what sensors would measure on them."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.base.model import BaseModel
from echelon.compute.observe.observation import Observation
from echelon.formats.schema.schema_log import IdentificationEntry
from echelon.identification.physics.bounds import Bounds, Roles, roles
from echelon.robot.inertia import (
    factor,
    from_pseudo_inertia,
    parameter_array,
    pseudo_inertia,
)
from echelon.robot.stated import characteristic_length
from echelon.shared.conventions import PER_BODY
from echelon.shared.errors import InputError

Floats = npt.NDArray[np.float64]


def body_of_points(
    rng: np.random.Generator, size: float = 0.2, mass: float = 1.0
) -> Floats:
    """Six point masses: a body that exists by construction."""
    points = np.column_stack(
        [size * (rng.standard_normal((6, 3)) + rng.standard_normal(3)), np.ones(6)]
    )
    masses = mass * rng.uniform(0.1, 1, 6) / 6
    return np.asarray(from_pseudo_inertia((points.T * masses) @ points))


@cache
def model(name: str) -> tuple[BaseModel, Roles]:
    """An example's base parameters, and which standard parameters are bodies."""
    base = ec.base_parameters(ec.load(f"examples/{name}.yaml"))
    return base, roles(base.mechanism)


def robot(role: Roles, rng: np.random.Generator, mass: float = 1.0) -> Floats:
    """Standard parameters of a robot that can exist, with bodies as large as its links."""
    size = 0.3 * characteristic_length(role.mechanism)
    standard = rng.uniform(0.1, 1, role.size) * mass * size**2
    for column in role.free:
        standard[column] = rng.standard_normal()
    for start in role.starts:
        standard[start : start + 10] = body_of_points(rng, size, mass)
    return standard


def states(
    base: BaseModel, rng: np.random.Generator, samples: int
) -> dict[str, Floats]:
    """Random states of a tree."""
    mechanism = base.mechanism
    q = rng.uniform(-2, 2, (samples, len(mechanism.positions)))
    place = {name: k for k, name in enumerate(mechanism.positions)}
    for motion in mechanism.motions:
        if len(motion.positions) == 4:
            columns = [place[name] for name in motion.positions]
            q[:, columns] /= np.linalg.norm(q[:, columns], axis=1, keepdims=True)
    qd, qdd = (
        rng.uniform(-3, 3, (samples, len(mechanism.velocities))) for _ in range(2)
    )
    return {"q": q, "qd": qd, "qdd": qdd}


def observed(
    base: BaseModel,
    standard: Floats,
    rng: np.random.Generator,
    samples: int = 300,
    noise: float = 0.05,
) -> tuple[Observation, Floats]:
    """An observation with noise, and the weights of the outputs."""
    log = states(base, rng, samples)
    y = base.predict(log["q"], log["qd"], log["qdd"], base.values(standard))
    sigma = noise * np.maximum(np.abs(y).mean(axis=0), 1e-300)
    log["y"] = y + sigma * rng.standard_normal(y.shape)
    return base.accumulate(log), 1 / sigma


def bounds_of(given: dict[str, Any]) -> Bounds:
    """Bounds as the section ``identification`` of a set-up states them."""
    stated = IdentificationEntry.model_validate(given)
    return Bounds(stated.bodies, stated.parameters, stated.total_mass)


def is_physical(values: npt.ArrayLike) -> npt.NDArray[np.bool_]:
    """Whether bodies can exist, with J ≻ 0 beyond rounding; shape (...)."""
    array = parameter_array(values)
    flat = array.reshape(-1, PER_BODY)
    return np.array([_definite(body) for body in flat], dtype=bool).reshape(
        array.shape[:-1]
    )


def _definite(body: Floats) -> bool:
    try:
        unit = factor(body)
    except InputError:
        return False
    # the squares of L's diagonal are the exact pivots; those beneath rounding decide nothing
    pivots = np.square(np.diagonal(unit)) / np.diagonal(pseudo_inertia(body))
    return bool(pivots.min() > 16 * np.finfo(float).eps)
