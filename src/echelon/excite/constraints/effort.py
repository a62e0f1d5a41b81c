"""Limits of torques and forces, by a model that was known before, with a margin for what it does not know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from echelon.dynamics.arguments import geometry_values
from echelon.dynamics.functions import robot_function
from echelon.errors import InputError
from echelon.excite.constraints.effort_bounds import EffortBounds, EffortLimit
from echelon.excite.constraints.effort_model import EffortModel
from echelon.excite.constraints.state import StateLimits
from echelon.excite.constraints.uncertain import UncertainEfforts
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.output import ActuatorForce, JointForce, Output, plain


def effort_limits(
    mechanism: Mechanism,
    limits: Sequence[EffortLimit],
    model: EffortModel,
    margin: float,
    smooth: float | None,
    symbols: Mapping[str, float] | None = None,
) -> StateLimits | UncertainEfforts:
    """Limits of efforts as constraints of the state.

    Parameters
    ----------
    mechanism : Mechanism
        With loops, states are those that functions take: all positions, independent velocities and accelerations.
    limits : sequence of EffortLimit
        At least one.
    model : EffortModel
        By which they are predicted; with one that is not certain each limit holds for the prediction plus and minus
        the deviations that are kept free.
    margin : float
        Share of each limit that is kept free as well.
    smooth : float, optional
        See :class:`StateLimits`.
    symbols : mapping of str to float, optional

    Raises
    ------
    InputError
        If a parameter is not a number.
    """
    check_model(mechanism, model)
    measured = replace(mechanism, measured=tuple(effort_output(mechanism, limit) for limit in limits), reading=None)
    bounds = EffortBounds.of(limits, model, margin)
    if not model.certain:
        return UncertainEfforts(measured, model, bounds, smooth, symbols)
    function = robot_function("inverse_dynamics", measured, model.places(mechanism))
    uniform = {"parameters": model.values, **geometry_values(mechanism, function.arguments, symbols)}
    return StateLimits(function, uniform, bounds.labels, bounds.units, bounds.low, bounds.high, smooth)


def check_model(mechanism: Mechanism, model: EffortModel) -> None:
    """Refuse a model that leaves parameters open."""
    columns = zip(model.places(mechanism), model.values, strict=True)
    lacking = [mechanism.parameters[k] for k, value in columns if not np.isfinite(value)]
    if lacking:
        raise InputError(f"limits of torques need a prior model; {', '.join(lacking[:6])} have no values")


def effort_output(mechanism: Mechanism, limit: EffortLimit) -> Output:
    """The effort of an actuator, or of a coordinate that none of its name drives, as an output."""
    drives = {actuator.name for actuator in mechanism.transmission.actuators}
    channel = ActuatorForce(limit.name) if limit.name in drives else JointForce(limit.name)
    return plain(limit.name, limit.unit, channel)
