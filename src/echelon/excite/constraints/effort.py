"""Limits of torques and forces, by a model that was known before, with a margin for what it does not know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from echelon.dynamics.arguments import geometry_values
from echelon.dynamics.functions import robot_function
from echelon.errors import InputError
from echelon.excite.constraints.state import StateLimits
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.output import ActuatorForce, JointForce, Output, plain

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class EffortLimit:
    """The largest torque or force of a drive or joint.

    Attributes
    ----------
    name : str
        Actuator, or joint coordinate on the joint's side of its drive.
    unit : str
    limit : float
        N·m or N, both directions.
    """

    name: str
    unit: str
    limit: float


def effort_limits(
    mechanism: Mechanism,
    limits: Sequence[EffortLimit],
    standard: Floats,
    margin: float,
    smooth: float | None,
    symbols: Mapping[str, float] | None = None,
) -> StateLimits:
    """Limits of efforts as constraints of the state.

    Parameters
    ----------
    mechanism : Mechanism
        Without loops.
    limits : sequence of EffortLimit
        At least one.
    standard : array of shape (p,)
        Standard parameters of the prior model, SI units, in the order of ``mechanism.parameters``.
    margin : float
        Share of each limit that is kept free.
    smooth : float, optional
        See :class:`StateLimits`.
    symbols : mapping of str to float, optional

    Raises
    ------
    InputError
        If a parameter is not a number.
    """
    if not np.isfinite(standard).all():
        lacking = [name for name, value in zip(mechanism.parameters, standard, strict=True) if not np.isfinite(value)]
        raise InputError(f"limits of torques need a prior model; {', '.join(lacking[:6])} have no values")
    outputs = tuple(_output(mechanism, limit) for limit in limits)
    measured = replace(mechanism, measured=outputs, reading=None)
    function = robot_function("inverse_dynamics", measured, range(len(mechanism.parameters)))
    uniform = {"parameters": standard, **geometry_values(mechanism, function.arguments, symbols)}
    high = np.array([limit.limit for limit in limits]) * (1 - margin)
    labels = tuple(f"{'force' if limit.unit == 'N' else 'torque'} of {limit.name}" for limit in limits)
    return StateLimits(function, uniform, labels, tuple(limit.unit for limit in limits), -high, high, smooth)


def _output(mechanism: Mechanism, limit: EffortLimit) -> Output:
    drives = {actuator.name for actuator in mechanism.transmission.actuators}
    channel = ActuatorForce(limit.name) if limit.name in drives else JointForce(limit.name)
    return plain(limit.name, limit.unit, channel)
