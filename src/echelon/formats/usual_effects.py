"""The effects of a robot that states none, and what effects at a coordinate are called.

Hardly any file states friction that was measured, and a fit without it spoils inertias.  So every measured drive gets
viscous and Coulomb friction and an offset.  A rotor adds as much as a link to some robots and nothing to others: it is
there where the file gives a joint an armature or a transmission.  Numbers that the file states become prior values.
Force/torque sensors drift, so that each of their components gets an offset, too: its zero.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from math import isfinite

from echelon.robot import Effect, Mechanism, MotionKind, Side, ready_made
from echelon.shared import symbol_stem

DriveNumbers = Mapping[str, Mapping[str, float]]
"""What a file states of the drives of coordinates: kinds of effects with values, nan where only the kind is known."""

EVERYWHERE = ("viscous", "coulomb", "offset")
AT_OUTPUTS = ("offset",)
"""Effects that need no state of the place where they act, as a sensor has none."""
_WHERE_STATED = ("rotor_inertia", "spring")
_ONLY_FIRST = ("spring",)  # its preload is the offset


def with_usual_effects(mechanism: Mechanism, stated: DriveNumbers) -> Mechanism:
    """The mechanism with the usual effects at all that is measured, before its own, which count."""
    found: list[Effect] = []
    places = list(_measured_places(mechanism))
    for kind in (*EVERYWHERE, *_WHERE_STATED):
        for name, side in places:
            if kind in EVERYWHERE or kind in stated.get(name, {}):
                found += _made(mechanism, kind, name, side, stated)
    for output in mechanism.stated_outputs:
        if output.cuts:
            found += made_at(mechanism, "offset", output.name, Side.OUTPUT)
    own = (
        {effect.parameter for effect in mechanism.effects},
        {effect.actions for effect in mechanism.effects},
    )
    found = [
        effect
        for effect in found
        if effect.parameter not in own[0] and effect.actions not in own[1]
    ]
    return _with(mechanism, (*found, *mechanism.effects))


def with_rotors(
    mechanism: Mechanism, drives: Collection[str] | None = None
) -> Mechanism:
    """The mechanism with the inertia of rotors in some drives as well, or in all that have none."""
    rotors = {
        a.at
        for effect in mechanism.effects
        for a in effect.actions
        if a.kind == "rotor_inertia"
    }
    chosen = (
        drives
        if drives is not None
        else {name for name, _ in _measured_places(mechanism)} - rotors
    )
    places = [
        (name, side) for name, side in _measured_places(mechanism) if name in chosen
    ]
    found = [
        effect
        for place in places
        for effect in _made(mechanism, "rotor_inertia", *place, {})
    ]
    return _with(mechanism, (*mechanism.effects, *found))


def _with(mechanism: Mechanism, effects: tuple[Effect, ...]) -> Mechanism:
    changed = replace(mechanism, effects=effects)
    return changed if mechanism.reading is None else changed.as_read(mechanism.reading)


def _measured_places(mechanism: Mechanism) -> Iterator[tuple[str, Side]]:
    """Drives whose force is measured, and joints whose torque is; a floating base has neither."""
    free, seen = mechanism.floating_velocities, set[str]()
    forces = [force for output in mechanism.sensed for force, _ in output.forces]
    for force in sorted(forces, key=lambda force: force.side is Side.JOINT):
        if force.at not in free | seen:
            yield force.at, force.side
        seen.add(force.at)


def _made(
    mechanism: Mechanism, kind: str, name: str, side: Side, stated: DriveNumbers
) -> tuple[Effect, ...]:
    made = made_at(mechanism, kind, name, side)
    value = stated.get(name, {}).get(kind)
    if value is not None and isfinite(value):
        made = (replace(made[0], value=value), *made[1:])
    return made[:1] if kind in _ONLY_FIRST else made


def made_at(
    mechanism: Mechanism,
    kind: str,
    at: str,
    side: Side,
    label: str | None = None,
    constants: dict[str, str] | None = None,
) -> tuple[Effect, ...]:
    """The parameters of a ready-made effect at a coordinate, an actuator or an output."""
    if side is not Side.OUTPUT:
        label = label or effect_label(mechanism, at)
        sliding = slides(mechanism, at)
        return ready_made(kind, at, side, label, sliding=sliding, constants=constants)
    unit = next(o.unit for o in mechanism.stated_outputs if o.name == at)
    made = ready_made(kind, at, side, label or symbol_stem(at), sliding=False)
    return tuple(replace(effect, unit=unit) for effect in made)


def effect_label(mechanism: Mechanism, at: str) -> str:
    """The number of the body that a coordinate moves, or the number at the end of an actuator's name."""
    for index, body in enumerate(mechanism.bodies):
        moved = [name for motion in body.joint.motions for name in motion.velocities]
        if at in moved:
            stem = mechanism.joint_label(index)
            return stem if len(moved) == 1 else f"{stem}_{moved.index(at) + 1}"
    number = re.search(r"\d+$", at)
    return number.group() if number else symbol_stem(at)


def slides(mechanism: Mechanism, at: str) -> bool:
    """Whether a coordinate, or the first joint of an actuator, is a translation."""
    drives = {a.name: a.terms[0][0] for a in mechanism.transmission.actuators}
    joint = drives.get(at, at)
    return any(
        m.kind is MotionKind.TRANSLATION and joint in m.velocities
        for m in mechanism.motions
    )
