"""Helpers that several tests share: the regressor in plain double precision, to compare with independent dynamics."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.robot.joint import MotionKind
from echelon.robot.mechanism import Mechanism

FloatArray = npt.NDArray[np.float64]


def float_regressor(
    mechanism: Mechanism, q: npt.ArrayLike, qd: npt.ArrayLike, qdd: npt.ArrayLike
) -> FloatArray:
    """X at N states as an array of shape (N, m, n): outputs ``mechanism.velocities``, columns ``mechanism.parameters``.

    The columns of ``q`` are ``mechanism.positions`` (quaternions as w, x, y, z), those of ``qd`` and ``qdd``
    ``mechanism.velocities``; a single state may be one-dimensional.  Symbols take their values from the mechanism.
    """
    return evaluate_floats(inverse_dynamics_regressor(mechanism), mechanism, q, qd, qdd)


def standard_vector(mechanism: Mechanism) -> FloatArray:
    """ζ as the file states it, zero where it is silent."""
    return np.array(
        [0.0 if value is None else value for value in mechanism.standard_values()]
    )


def random_states(
    mechanism: Mechanism, samples: int, seed: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Random q, q̇, q̈ of N samples, with unit quaternions, seeded."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.0, 2.0, (samples, len(mechanism.positions)))
    for motion in mechanism.motions:
        if motion.kind is MotionKind.BALL:
            first = mechanism.positions.index(motion.positions[0])
            q[:, first : first + 4] /= np.linalg.norm(
                q[:, first : first + 4], axis=1, keepdims=True
            )
    qd, qdd = (
        rng.uniform(-2.0, 2.0, (samples, len(mechanism.velocities))) for _ in range(2)
    )
    return q, qd, qdd
