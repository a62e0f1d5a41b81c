"""What a numeric tool does: stack the joint torque regressor at random states, factor it, count by a tolerance."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

QR_TOLERANCE = 1e-8
"""Diagonal entries of R below this fraction of the largest count as zero."""

_ROWS_PER_COLUMN = 2
_FEWEST_STATES = 32


def observation_matrix(model: Any, seed: int = 1) -> Floats:
    """Pinocchio's joint torque regressor at random states, with about twice as many rows as columns."""
    import pinocchio as pin

    rng = np.random.default_rng(seed)
    data = model.createData()
    neutral = pin.neutral(model)
    columns = 10 * (model.njoints - 1)
    states = states_of(columns, model.nv)
    stacked = np.empty((states, model.nv, columns))
    for block in stacked:
        q = pin.integrate(model, neutral, rng.uniform(-3, 3, model.nv))
        qd, qdd = rng.uniform(-3, 3, model.nv), rng.uniform(-10, 10, model.nv)
        block[:] = pin.computeJointTorqueRegressor(model, data, q, qd, qdd)
    return stacked.reshape(-1, columns)


def states_of(columns: int, rows: int) -> int:
    """How many states are stacked where each gives so many rows."""
    return max(_FEWEST_STATES, -(-_ROWS_PER_COLUMN * columns // rows))


def rank_by_svd(model: Any) -> int:
    """Singular values with NumPy's own tolerance."""
    return int(np.linalg.matrix_rank(observation_matrix(model)))


def rank_by_qr(model: Any) -> int | None:
    """QR with column pivoting; None where SciPy is not installed."""
    try:
        from scipy.linalg import qr
    except ImportError:
        return None
    diagonal = np.abs(
        np.diag(qr(observation_matrix(model), mode="r", pivoting=True)[0])
    )
    return int(np.count_nonzero(diagonal > QR_TOLERANCE * diagonal[0]))
