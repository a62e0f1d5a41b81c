"""Friction and rotor inertia as robot files have them: one number per joint.

Files know joints, not drives.  An effect in a drive with a ratio of its own, θ = N q, appears at the joint N² times as
large, dry friction |N| times.  Whatever is no such number (offsets, friction of coupled drives) is listed by value.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

from echelon.exact.polynomial import float_generators
from echelon.formats.write_notes import listed
from echelon.mechanism.effect import Action, Side
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.values import known_values

VISCOUS, COULOMB, ROTOR_INERTIA = "viscous friction", "Coulomb friction", "rotor inertia"
_TERMS = {"qd": VISCOUS, "sign(qd)": COULOMB, "qdd": ROTOR_INERTIA}


@dataclass(frozen=True)
class JointEffects:
    """Effects as numbers of joints."""

    # by coordinate: the format's attribute and its value at the joint, SI units
    attributes: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]  # the others, with their values


@dataclass(frozen=True)
class _Simple:
    """An effect that is one number of one joint."""

    kind: str
    coordinate: str
    value: float


def joint_effects(
    mechanism: Mechanism,
    values: Mapping[str, float],
    supported: Mapping[str, str],
    coordinates: Collection[str],
    file_format: str,
) -> JointEffects:
    """Sort effects into attributes of joints and what a format cannot say."""
    attributes: dict[str, dict[str, float]] = {}
    lost: dict[str, list[str]] = {}
    for effect in mechanism.effects:
        value = values[effect.parameter]
        # one parameter may be that of several joints
        simple = [_simple(mechanism, action, value) for action in effect.actions]
        reason = next(filter(None, (_obstacle(s, supported, coordinates, file_format) for s in simple)), "")
        if reason:
            lost.setdefault(reason, []).append(f"{effect.parameter} = {value!r} {effect.unit}")
            continue
        for at in filter(None, simple):
            found = attributes.setdefault(at.coordinate, {})
            name = supported[at.kind]
            found[name] = found.get(name, 0.0) + at.value
    return JointEffects(attributes, tuple(f"{reason}: {', '.join(entries)}" for reason, entries in lost.items()))


def kept_notes(stated: Mapping[str, Mapping[str, float]], written: Mapping[str, Mapping[str, float]]) -> Iterator[str]:
    """What to say of numbers of joints that a file states and the identified model does not have."""
    kept: dict[str, list[str]] = {}
    for joint, numbers in stated.items():
        for name, value in numbers.items():
            if value and name not in written.get(joint, {}):
                kept.setdefault(name, []).append(joint)
    for name, joints in kept.items():
        yield f"{name} stays as in the input where the identified model has no such effect: {listed(joints)}"


def _simple(mechanism: Mechanism, action: Action, value: float) -> _Simple | None:
    """What an effect does at a joint, if it is of a known kind and acts on one joint only."""
    term = "".join(action.term.split()).replace(f"[{action.at}]", "")
    kind = _TERMS.get(term)
    if kind is None:
        return None
    if action.side is Side.JOINT:
        return _Simple(kind, action.at, value)
    terms = next(a.terms for a in mechanism.transmission.actuators if a.name == action.at)
    known = known_values(mechanism)
    if len(terms) != 1 or not known.keys() >= set(terms[0][1].symbols()):
        return None
    coordinate, ratio = terms[0]
    gear = abs(ratio.evaluate(float_generators(ratio.generators(), known), float))
    return _Simple(kind, coordinate, value * (gear if kind == COULOMB else gear * gear))


def _obstacle(
    simple: _Simple | None, supported: Mapping[str, str], coordinates: Collection[str], file_format: str
) -> str:
    """Why an effect cannot be an attribute of a joint; empty if it can."""
    if simple is None:
        return f"{file_format} has no place for these effects, left out"
    if simple.kind not in supported:
        return f"{file_format} has no place for {simple.kind}, left out"
    if simple.coordinate not in coordinates:
        return f"{file_format} has no place for effects at what is no single-axis joint of the file, left out"
    if simple.value < 0:
        return f"simulators refuse negative {simple.kind}, left out"
    return ""
