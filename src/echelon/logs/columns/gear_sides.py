"""From what was measured on either side of the gears to joint coordinates and to the mechanism's outputs.

Positions behind the gears follow from θ = T q.  Every column is one equation, of a joint (q_i = …) or of a motor
(a row of T), so a log may mix both as long as there are as many equations as unknowns; with more of them the user has
to say which sensors to believe, since link- and motor-side encoders differ by the elasticity between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.hints import nearest_of
from echelon.logs.columns.quantities import actuators, coordinates
from echelon.logs.finding import listed
from echelon.mechanism.effect import Side
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.motor_side import transmission_matrix
from echelon.mechanism.output import Channel, JointForce, Output
from echelon.mechanism.stated import symbol_values

Given = Mapping[str, Floats]
Symbols = Mapping[str, float] | None


def joint_coordinates(mechanism: Mechanism, kind: str, given: Given, symbols: Symbols = None) -> Floats:
    """Positions, velocities or accelerations (N, coordinates) from columns by coordinate or actuator, SI units.

    With loops, of the independent coordinates only where only these are given.
    """
    names = coordinates(mechanism, kind)
    motors = {actuator.name for actuator in actuators(mechanism)}
    if mechanism.closures and not given.keys() - motors - set(mechanism.independent_velocities):
        names = mechanism.independent_velocities
    check_names(mechanism, kind, given)
    found = {name: values for name, values in given.items() if name in names}
    moved = [name for name in given if name not in names]
    if moved:
        found |= _behind_gears(mechanism, kind, {name: given[name] for name in moved}, found, symbols)
    missing = [name for name in names if name not in found]
    if missing:
        raise InputError(_say_missing(mechanism, kind, missing), element=kind)
    return _columns([found[name] for name in names])


def check_names(mechanism: Mechanism, kind: str, given: Iterable[str]) -> None:
    """Refuse keys that are no coordinates, outputs or actuators; suggests what was probably meant."""
    motors = [actuator.name for actuator in actuators(mechanism)]
    if kind == "output":
        valid = [*(output.name for output in mechanism.outputs), *(a.name for a in mechanism.transmission.actuators)]
    elif kind == "input":
        valid = [*mechanism.velocities, *(a.name for a in mechanism.transmission.actuators)]
    else:
        valid = [*coordinates(mechanism, kind), *motors]
    for name in given:
        if name in mechanism.dependent and kind != "output":
            raise InputError("it follows from others through a coupling; leave it out", element=f"{kind} of '{name}'")
        if name not in valid:
            what = "output or actuator" if kind == "output" else "coordinate or actuator"
            problem = f"{mechanism.name} has no {what} of this name{nearest_of(name, valid)}"
            raise InputError(problem, element=f"{kind} of '{name}'")


def _say_missing(mechanism: Mechanism, kind: str, missing: Sequence[str]) -> str:
    text = f"columns are missing for {listed(missing)}"
    motors = [a.name for a in actuators(mechanism) if any(joint in missing for joint, _ in a.terms)]
    text += f", or for the actuators {listed(motors)}" if motors else ""
    return text if kind == "position" else f"{text}; give all or none"


def _behind_gears(mechanism: Mechanism, kind: str, motors: Given, joints: Given, symbols: Symbols) -> dict[str, Floats]:
    """The driven coordinates that are not measured at the joint."""
    driven, matrix = transmission_matrix(mechanism, symbols)
    every = [actuator.name for actuator in mechanism.actuators]
    unknown = [name for name in driven if name not in joints]
    rows = matrix[[every.index(name) for name in motors]]
    if len(motors) < len(unknown):
        raise InputError(_say_missing(mechanism, kind, unknown) + f"; {listed(motors)} alone do not determine them")
    if len(motors) > len(unknown):
        raise InputError(
            f"{listed([*joints, *motors])} are measured on both sides of a gear; keep one column for each coordinate",
            element=kind,
        )
    solved_by = rows[:, [driven.index(name) for name in unknown]]
    if np.linalg.matrix_rank(solved_by) < len(unknown):
        raise InputError(f"the actuators {listed(motors)} do not determine {listed(unknown)}", element=kind)
    known = [name for name in driven if name in joints]
    right = np.stack(list(motors.values()))
    if known:
        right = right - rows[:, [driven.index(name) for name in known]] @ np.stack([joints[name] for name in known])
    return dict(zip(unknown, np.linalg.solve(solved_by, right) + 0.0, strict=True))


# -- outputs ----------------------------------------------------------------------------------------------------------


def measured_outputs(mechanism: Mechanism, given: Given, symbols: Symbols = None) -> Floats:
    """Outputs (N, outputs) from columns by output or actuator, SI units; joint forces also as τ_q = Tᵀ τ_θ."""
    check_names(mechanism, "output", given)
    names = {output.name for output in mechanism.outputs}
    motors = {name: values for name, values in given.items() if name not in names}
    missing = [output for output in mechanism.outputs if output.name not in given]
    if not motors:
        if missing:
            text = f"columns are missing for {listed(o.name for o in missing)}"
            raise InputError(f"{text}; or state in the description that they are not measured", element="output")
        return _columns([given[output.name] for output in mechanism.outputs])
    found = {name: values for name, values in given.items() if name in names}
    used: set[str] = set()
    for output in missing:
        found[output.name] = _from_motors(mechanism, output, motors, symbols, used)
    idle = next((name for name in motors if name not in used), None)
    if idle is not None:
        problem = f"no output needs it (outputs: {listed(names)}); leave it out"
        raise InputError(problem, element=f"output of '{idle}'")
    return _columns([found[output.name] for output in mechanism.outputs])


def _columns(channels: Sequence[Floats]) -> Floats:
    """Channels as columns, each of which lies together in memory, because they are looked at one by one."""
    return np.stack(channels).T


def _from_motors(mechanism: Mechanism, output: Output, motors: Given, symbols: Symbols, used: set[str]) -> Floats:
    total = np.zeros(len(next(iter(motors.values()))))
    for channel, weight in output.terms:
        known = symbol_values(mechanism, weight.symbols(), symbols)
        scale = weight.at(known)
        for name, ratio in _shares(mechanism, output, channel, symbols).items():
            if name not in motors:
                problem = f"a column is missing for it, or for the actuator '{name}'"
                raise InputError(problem, element=f"output '{output.name}'")
            used.add(name)
            total = total + scale * ratio * motors[name]
    return total


def _shares(mechanism: Mechanism, output: Output, channel: Channel, symbols: Symbols) -> dict[str, float]:
    """Actuators whose forces make a channel, with their ratios."""
    where = f"output '{output.name}'"
    if not isinstance(channel, JointForce):
        raise InputError(
            "a column is missing for it; only forces of joints follow from those of actuators", element=where
        )
    driven, matrix = transmission_matrix(mechanism, symbols)
    found = {channel.coordinate: 1.0}
    if channel.coordinate in driven:
        column = matrix[:, driven.index(channel.coordinate)]
        found = {a.name: float(r) for a, r in zip(mechanism.actuators, column, strict=True) if r}
    for effect in mechanism.effects:
        lossy = next((a.at for a in effect.actions if a.side is Side.ACTUATOR and a.at in found), None)
        if lossy is not None:
            raise InputError(
                f"the force of actuator '{lossy}' differs from that at the joint by the effect '{effect.parameter}' in "
                "the drive: state the actuators' forces as outputs, or the effect at the joint",
                element=where,
            )
    return found
