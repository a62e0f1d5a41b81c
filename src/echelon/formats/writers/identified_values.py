"""Identified values as robot files state them: inertia about the centre of mass, and one number of friction per joint.

Standard parameters are about the frame's origin, where models are linear in them; files and simulators state the
inertia about the centre of mass.  So every body needs a mass, unless it carries nothing at all.

Files know joints, not drives.  An effect in a drive with a ratio of its own, θ = N q, appears at the joint N² times as
large, dry friction |N| times.  Whatever is no such number (offsets, friction of coupled drives, zeros of sensors) is
listed by value.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.formats.snapping import PRECISION
from echelon.formats.usual_effects import slides
from echelon.formats.writers.xml_editor import comment
from echelon.robot import (
    ALL,
    CONSTANTS,
    SOLVER_TOLERANCE,
    Action,
    Body,
    JointNumber,
    Mechanism,
    Side,
    about_centre,
    known_values,
    pseudo_inertia,
    with_zeros,
)
from echelon.shared import PARAMETERS, PER_BODY, Floats, InputError, in_quotes, listed

ROTOR = "rotor"  # kind of the joint of a body that is the rotor of a drive

_MASS = PARAMETERS.index("M")

NEGLIGIBLE_BODY = 1e-12
"""Parameters of a body, relative to the largest of all bodies, that are zero but for rounding."""


@dataclass(frozen=True)
class Load:
    """Mass properties of a body about its centre of mass."""

    mass: float  # kg
    centre: tuple[float, ...]  # centre of mass in the body's frame, m
    moments: tuple[
        float, ...
    ]  # XX XY XZ YY YZ ZZ about the centre of mass, along the axes of the body's frame, kg·m²


@dataclass(frozen=True)
class IdentifiedValues:
    """Standard parameters sorted by what they describe."""

    bodies: tuple[Floats, ...]  # one per body, zero for what it does not carry
    effects: Mapping[str, float]  # by parameter
    kept: frozenset[str] = frozenset()  # bodies with the values of their file


def sorted_values(mechanism: Mechanism, standard: npt.ArrayLike) -> IdentifiedValues:
    """Sort standard parameters by body and effect.  Shapes: standard (p,)."""
    values = np.asarray(standard, dtype=float)
    names = mechanism.parameters
    if values.shape != (len(names),):
        raise InputError(
            f"expected {len(names)} standard parameters of '{mechanism.name}', got shape {values.shape}"
        )
    strange = [
        name
        for name, value in zip(names, values, strict=True)
        if not np.isfinite(value)
    ]
    if strange:
        raise InputError(
            "the value is not a finite number", element=f"parameter '{strange[0]}'"
        )
    bodies = [np.zeros(PER_BODY) for _ in mechanism.bodies]
    effects: dict[str, float] = {}
    for parameter, value in zip(mechanism.columns, values, strict=True):
        if parameter.body is None or parameter.kind is None:
            effects[parameter.name] = float(value)
        else:
            for body in mechanism.sharing[parameter.body]:
                bodies[body][parameter.kind] = value
    kept = {
        body.name
        for body, ten in zip(mechanism.bodies, bodies, strict=True)
        if body.inertial is not None
        and ten.any()
        and np.array_equal(body.inertial, ten)
    }
    least = NEGLIGIBLE_BODY * max((np.abs(body).max() for body in bodies), default=0.0)
    for ten in bodies:
        if np.abs(ten).max() < least:
            ten[:] = 0.0
    for carrier in mechanism.carriers:
        _check_consistency(mechanism.bodies[carrier], bodies[carrier])
    found = (
        ten if body.name in kept else with_zeros(ten)
        for body, ten in zip(mechanism.bodies, bodies, strict=True)
    )
    return IdentifiedValues(tuple(found), effects, frozenset(kept))


def has_centre(values: Floats) -> bool:
    """Whether ten parameters have a centre of mass that files can state.  Shapes: values (10,)."""
    return bool(values[_MASS] > 0 or not (values[_MASS] or values[6:9].any()))


def load_of(values: Floats, name: str) -> Load | None:
    """Mass, centre of mass and inertia about it; None of a body without any.  Shapes: values (10,)."""
    if not values.any():
        return None
    if values[_MASS] > 0:
        mass, centre, moments = about_centre(values)
        return Load(mass, tuple(centre.tolist()), tuple(moments.tolist()))
    if not has_centre(values):
        problem = f"its mass is {values[_MASS]:g} kg; files state a centre of mass, which needs a positive mass"
        raise InputError(problem, element=f"body '{name}'")
    return Load(0.0, (0.0, 0.0, 0.0), tuple(float(v) for v in values[:6]))


def number_text(*values: float) -> str:
    """Numbers with all their digits: reading them back gives the same doubles.

    >>> number_text(0.1, -0.0, 3)
    '0.1 0.0 3.0'
    """
    return " ".join(repr(float(value) + 0.0) for value in values)


def _check_consistency(body: Body, values: Floats) -> None:
    """Refuse parameters that no body has; a part of the ten alone cannot be judged."""
    if body.carried != ALL or not values.any():
        return
    eigenvalues = np.linalg.eigvalsh(pseudo_inertia(values))
    if values[_MASS] <= 0 or eigenvalues[0] < -SOLVER_TOLERANCE * eigenvalues[-1]:
        problem = (
            f"no body has these parameters (mass {values[_MASS]:.6g} kg, least eigenvalue of the pseudo-inertia "
            f"{eigenvalues[0]:.3g}); files need physically consistent ones"
        )
        raise InputError(problem, element=f"body '{body.name}'")


def head_comment(notes: Sequence[str]) -> list[str]:
    """Lines of the comment at the head of a written file."""
    return comment(
        [
            "Inertial parameters identified with Echelon.",
            *(f"Note: {note}." for note in notes),
        ]
    )


def rotor_notes(
    mechanism: Mechanism, values: IdentifiedValues, file_format: str
) -> Iterator[str]:
    """Spin inertias of rotors that are bodies of their own, which no robot file has."""
    spins = [
        f"{name} = {value!r} {unit}" for name, value, unit in _spins(mechanism, values)
    ]
    if spins:
        yield f"{file_format} has no rotors that turn with joints, left out: {', '.join(spins)}"


def _spins(
    mechanism: Mechanism, values: IdentifiedValues
) -> Iterator[tuple[str, float, str]]:
    for parameter in mechanism.columns:
        body, kind = parameter.body, parameter.kind
        if body is None or kind is None:
            continue
        if mechanism.bodies[body].joint.kind == ROTOR:
            yield parameter.name, float(values.bodies[body][kind]), parameter.unit


def rotor_doubts(
    mechanism: Mechanism,
    values: IdentifiedValues,
    effects: JointEffects,
    file_format: str,
) -> tuple[str, ...]:
    """A doubt about simulations with a file that lacks rotor inertias, if it lacks any."""
    spins = [some for some in _spins(mechanism, values) if some[1] > 0]
    rotors = [
        *effects.lost_rotors,
        *(f"{name} = {value:.4g} {unit} of its drive" for name, value, unit in spins),
    ]
    if not rotors:
        return ()
    text = (
        f"{file_format} has no place for some rotor inertias, so simulations with this file have wrong accelerations: "
        f"add them in the simulator, such as  armature  in MuJoCo: {listed(rotors)}"
    )
    return (text,)


def reading_notes(
    mechanism: Mechanism, values: IdentifiedValues, root: Any, file_format: str
) -> Iterator[str]:
    """Remarks on an edited file: rotors, numbers that were read as others, files that it refers to."""
    yield from rotor_notes(mechanism, values, file_format)
    snaps = mechanism.reading.snaps if mechanism.reading is not None else ()
    moved = [snap.difference for snap in snaps if snap.difference > PRECISION]
    if moved:
        yield (
            f"{len(moved)} rounded numbers of the geometry stay as written although Echelon took them as exact, up "
            f"to {np.max(moved):.2g} away; predictions of this file differ accordingly"
        )
    files = [
        value
        for e in root.iter()
        for key, value in e.items()
        if key in ("filename", "file")
    ]
    if any("://" not in file and not PurePath(file).is_absolute() for file in files):
        yield "files that it refers to are looked for relative to the folder of the input"


@dataclass(frozen=True)
class JointEffects:
    """Effects as numbers of joints."""

    # by coordinate: the format's attribute and its value at the joint, SI units
    attributes: Mapping[str, Mapping[str, float]]
    notes: tuple[str, ...]  # the others, with their values
    lost_rotors: tuple[str, ...] = ()  # rotor inertias among the others, at joints


@dataclass(frozen=True)
class _Simple:
    """An effect that is one number of one joint."""

    number: JointNumber
    constants: Collection[str]  # what its law needs besides
    coordinate: str
    value: float


def joint_effects(
    mechanism: Mechanism,
    values: Mapping[str, float],
    supported: Mapping[JointNumber, str],
    coordinates: Collection[str],
    file_format: str,
) -> JointEffects:
    """Sort effects into attributes of joints and what a format cannot say.

    ``supported`` has the names of attributes.
    """
    attributes: dict[str, dict[str, float]] = {}
    lost: dict[str, list[str]] = {}
    lost_rotors: list[str] = []
    for effect in mechanism.effects:
        value = values[effect.parameter]
        # one parameter may be that of several joints
        simple = [_simple(mechanism, action, value) for action in effect.actions]
        reason = next(
            filter(
                None,
                (_obstacle(s, supported, coordinates, file_format) for s in simple),
            ),
            "",
        )
        if reason:
            lost.setdefault(reason, []).append(
                f"{effect.parameter} = {value!r} {effect.unit}"
            )
            if value > 0 and any(
                action.number is JointNumber.ARMATURE for action in effect.actions
            ):
                shown = f"{effect.parameter} = {value:.4g} {effect.unit}"
                lost_rotors += [_rotor(mechanism, at, shown) for at in simple]
            continue
        for at in filter(None, simple):
            found = attributes.setdefault(at.coordinate, {})
            name = supported[at.number]
            found[name] = found.get(name, 0.0) + at.value
            for constant in at.constants:
                reason = f"{file_format} states {at.number} without a {constant}, which is left out"
                lost.setdefault(reason, []).append(effect.parameter)
    return JointEffects(
        attributes,
        tuple(f"{reason}: {', '.join(entries)}" for reason, entries in lost.items()),
        tuple(lost_rotors),
    )


def _rotor(mechanism: Mechanism, at: _Simple | None, shown: str) -> str:
    """A rotor inertia as one number of a joint, or as a file states that of coupled drives."""
    if at is None:
        return f"{shown} of coupled drives"
    unit = "kg" if slides(mechanism, at.coordinate) else "kg·m²"
    return f"{at.value:.4g} {unit} at '{at.coordinate}'"


def kept_notes(
    stated: Mapping[str, Mapping[str, float]],
    written: Mapping[str, Mapping[str, float]],
) -> Iterator[str]:
    """Notes on numbers of joints that a file states and the identified model does not have."""
    kept: dict[str, list[str]] = {}
    for joint, numbers in stated.items():
        for name, value in numbers.items():
            if value and name not in written.get(joint, {}):
                kept.setdefault(name, []).append(joint)
    for name, joints in kept.items():
        yield f"{name} stays as in the input, since the identified model has no such effect: {in_quotes(joints)}"


def _simple(mechanism: Mechanism, action: Action, value: float) -> _Simple | None:
    """An effect as one number of one joint; None for effects of other kinds, or on several joints."""
    number, constants = action.number, CONSTANTS.get(action.kind, {})
    if number is None or action.side is Side.OUTPUT:
        return None
    if action.side is Side.JOINT:
        return _Simple(number, constants, action.at, value)
    terms = next(
        a.terms for a in mechanism.transmission.actuators if a.name == action.at
    )
    known = known_values(mechanism)
    if len(terms) != 1 or not known.keys() >= set(terms[0][1].symbols()):
        return None
    coordinate, ratio = terms[0]
    scale = number.at_joint(ratio.at(known))
    return _Simple(number, constants, coordinate, value * scale)


def _obstacle(
    simple: _Simple | None,
    supported: Mapping[JointNumber, str],
    coordinates: Collection[str],
    file_format: str,
) -> str:
    """The reason why an effect cannot be an attribute of a joint; empty if it can."""
    if simple is None:
        return f"{file_format} has no place for these effects, left out"
    if simple.number not in supported:
        return f"{file_format} has no place for {simple.number}, left out"
    if simple.coordinate not in coordinates:
        return f"{file_format} states effects of single-axis joints only, left out"
    if simple.value < 0 and simple.number is not JointNumber.FORCE:
        return f"simulators refuse negative {simple.number}, left out"
    return ""
