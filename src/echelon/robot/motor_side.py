"""Positions and velocities measured at motors, as those of joints: q = T⁻¹ θ."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from echelon.robot.mechanism import Mechanism
from echelon.robot.sources import Readable, mechanism_of
from echelon.robot.stated import symbol_values
from echelon.shared import InputError, public


@public
def joint_side(
    mechanism: Mechanism | Readable,
    values: npt.ArrayLike,
    symbols: Mapping[str, float] | None = None,
) -> npt.NDArray[np.float64]:
    """Joint coordinates, velocities or accelerations from those at the motors.

    Parameters
    ----------
    mechanism : Mechanism or path-like
        With actuators θ = T q.
    values : array of shape (N, positions) or (N, velocities), or (N, independent velocities) with loops
        Without N for one state.  In the order of the mechanism's names, where the columns of driven coordinates hold
        the actuators in the order in which these are stated.
    symbols : mapping of str to float, optional
        Values of symbols in the transmission ratios that replace or complete those of the mechanism.

    Returns
    -------
    array of the same shape

    Raises
    ------
    InputError
        If the shape fits none of these, or a symbol has no value.

    Examples
    --------
    >>> import echelon as ec
    >>> robot = ec.load("examples/coupled_arm.yaml")    # m2 = j2 + j3, m3 = j2 - j3, ...
    >>> ec.joint_side(robot, [0, 1.5, 0.5, 0, 0, 0, 0]).tolist()
    [0.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0]
    """
    mechanism = mechanism_of(mechanism)
    driven, matrix = transmission_matrix(mechanism, symbols)
    one = np.ndim(values) == 1
    result = np.array(values, dtype=float, ndmin=2)
    orders = (
        mechanism.velocities,
        mechanism.positions,
        mechanism.independent_velocities,
    )
    names = next(
        (
            order
            for order in orders
            if result.ndim == 2 and len(order) == result.shape[1]
        ),
        None,
    )
    if names is None:
        left = iter(actuator.name for actuator in mechanism.actuators)
        columns_of = [
            next(left) if name in driven else name for name in mechanism.velocities
        ]
        raise InputError(f"expected columns for {', '.join(columns_of)}")
    if driven:
        columns = [names.index(name) for name in driven]
        moved = np.linalg.solve(matrix, result[:, columns].T).T
        result[:, columns] = moved + 0.0  # no negative zeros
    return result[0] if one else result


def transmission_matrix(
    mechanism: Mechanism, symbols: Mapping[str, float] | None = None
) -> tuple[tuple[str, ...], npt.NDArray[np.float64]]:
    """Numbers of the stated part of θ = T q.  Shapes: returns (actuators, driven)."""
    moved = {name for actuator in mechanism.actuators for name, _ in actuator.terms}
    driven = tuple(name for name in mechanism.velocities if name in moved)
    ratios = [ratio for actuator in mechanism.actuators for _, ratio in actuator.terms]
    known = symbol_values(
        mechanism, sorted({s for ratio in ratios for s in ratio.symbols()}), symbols
    )
    matrix = np.zeros((len(mechanism.actuators), len(driven)))
    for row, actuator in enumerate(mechanism.actuators):
        for name, ratio in actuator.terms:
            matrix[row, driven.index(name)] = ratio.at(known)
    return driven, matrix
