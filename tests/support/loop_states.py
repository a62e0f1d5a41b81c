"""Closed states of mechanisms with loops, and columns that are independent there."""

from __future__ import annotations

import numpy as np

from echelon.loops.assembly import Assembly
from echelon.robot.mechanism import Mechanism
from support.float_regressor import FloatArray


def random_parameters(mechanism: Mechanism, seed: int = 7) -> FloatArray:
    zeta = np.random.default_rng(seed).uniform(-1.0, 1.0, len(mechanism.parameters))
    zeta[9::10] += 2.0  # masses, which Pinocchio divides by
    return zeta


def closed_states(
    mechanism: Mechanism, count: int = 6
) -> tuple[FloatArray, FloatArray, FloatArray]:
    return Assembly(mechanism).random_closed_states(np.random.default_rng(5), count)


def independent_columns(mechanism: Mechanism) -> list[int]:
    return [
        mechanism.velocities.index(name) for name in mechanism.independent_velocities
    ]
