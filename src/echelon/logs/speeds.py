"""Speeds of outputs: where dry friction acts, and so where an output's rows say nothing near rest."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.exact.polynomial import float_generators
from echelon.mechanism.effect import Side
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.output import ActuatorForce, Cut, JointForce, Output
from echelon.mechanism.values import symbol_values


def speed_rows(mechanism: Mechanism, output: Output, names: Sequence[str]) -> Floats | None:
    """Speeds that belong to an output, as combinations of velocities: of its joints, or of its actuators.

    Parameters
    ----------
    mechanism : Mechanism
    output : Output
    names : sequence of str
        Velocities.

    Returns
    -------
    array of shape (speeds, velocities), or None for a wrench, which feels bodies only

    Raises
    ------
    InputError
        If a transmission ratio has no value.
    """
    if any(isinstance(channel, Cut) for channel, _ in output.terms):
        return None
    rows = np.zeros((len(output.terms), len(names)))
    for row, (channel, _) in zip(rows, output.terms, strict=True):
        if isinstance(channel, JointForce):
            row[names.index(channel.coordinate)] = 1.0
        elif isinstance(channel, ActuatorForce):
            actuator = next(a for a in mechanism.transmission.actuators if a.name == channel.actuator)
            for name, ratio in actuator.terms:
                known = symbol_values(mechanism, sorted(ratio.symbols()))
                row[names.index(name)] = ratio.evaluate(float_generators(ratio.generators(), known), float)
    return rows


def rubs(mechanism: Mechanism, output: Output) -> bool:
    """Whether dry friction is in an output: an effect with a sign that it can see.

    Parameters
    ----------
    mechanism : Mechanism
    output : Output
    """
    dry = {(a.at, a.side) for effect in mechanism.effects for a in effect.actions if "sign(" in a.term}
    for channel, _ in output.terms:
        if isinstance(channel, Cut):
            continue
        if mechanism.closures:
            return bool(dry)
        if isinstance(channel, JointForce):
            if (channel.coordinate, Side.JOINT) in dry:
                return True
        else:
            moved = mechanism.transmission.inverse[channel.actuator]
            if (channel.actuator, Side.ACTUATOR) in dry or any((name, Side.JOINT) in dry for name in moved):
                return True
    return False
