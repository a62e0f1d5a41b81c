"""What moves dependently in closed configurations, by least squares: the recorded functions have an elimination."""

from __future__ import annotations

import numpy as np

from echelon.loops.assembly import Assembly
from support.float_regressor import FloatArray


def velocities(
    assembly: Assembly, q: FloatArray, independent: FloatArray
) -> FloatArray:
    """Velocities of all coordinates, (N, velocities), from those of the independent ones."""
    return _solved(
        assembly, q, independent, np.zeros((len(q), len(assembly.closures.owners)))
    )


def accelerations(
    assembly: Assembly, q: FloatArray, qd: FloatArray, independent: FloatArray
) -> FloatArray:
    """Accelerations of all coordinates, from all velocities and the independent accelerations."""
    return _solved(assembly, q, independent, assembly.closures.bias(q, qd))


def completed(
    assembly: Assembly, q: FloatArray, qd: FloatArray, qdd: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """States of all coordinates, from each of q, qd and qdd of all or of the independent ones only."""
    mechanism = assembly.mechanism
    q = q if q.shape[1] == len(mechanism.positions) else assembly.from_independent(q)
    qd = qd if qd.shape[1] == len(mechanism.velocities) else velocities(assembly, q, qd)
    qdd = (
        qdd
        if qdd.shape[1] == len(mechanism.velocities)
        else accelerations(assembly, q, qd, qdd)
    )
    return q, qd, qdd


def _solved(
    assembly: Assembly, q: FloatArray, independent: FloatArray, bias: FloatArray
) -> FloatArray:
    """All x with J x + bias = 0."""
    names = assembly.mechanism.velocities
    free = [names.index(name) for name in assembly.mechanism.independent_velocities]
    bound = [k for k in range(len(names)) if k not in free]
    units, jacobian = assembly.closures.units[: len(names)], assembly.closures.at(q)[1]
    result = np.zeros((len(q), len(names)))
    result[:, free] = independent / units[free]
    opening = (jacobian[:, :, free] @ result[:, free, None])[:, :, 0] + bias
    for k, matrix in enumerate(jacobian[:, :, bound]):
        result[k, bound] = -np.linalg.lstsq(matrix, opening[k], rcond=1e-9)[0]
    scaled: FloatArray = result * units
    return scaled
