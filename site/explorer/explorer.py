"""What the explorer's worker answers: a robot with some changes, derived, as data for the page.

The page asks in JSON and gets JSON, whichever Python answers: Pyodide in the visitor's browser, or CPython in tests.
Changes are those of :class:`Changes`; each is an operation on the mechanism that the file describes, so that the answer
is what ``echelon derive`` says about a file with the same change written into it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any

from echelon.algebra.exact.polynomial import Polynomial
from echelon.base.derive import base_parameters
from echelon.base.display import facts, headline, to_latex
from echelon.base.model import BaseModel
from echelon.base.saved.saved import to_json
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.formats.usual_effects import effect_label, slides
from echelon.report.drawing import CLASSES, drawable_pose, seen_bodies
from echelon.robot.effect import Effect, Side, ready_made
from echelon.robot.experiment import Experiment
from echelon.robot.joint import GROUND, Body, Joint, MotionKind, Placement
from echelon.robot.locking import lock_joints
from echelon.robot.mechanism import Cut, Mechanism, Output
from echelon.robot.substitute import substituted
from echelon.shared.conventions import PARAMETERS
from echelon.shared.errors import EchelonError, InputError, one_line

PAYLOAD = "payload"
"""Name of the body that a payload becomes; its parameters are XXL … ML."""

_DRAWN = {MotionKind.TRANSLATION: "slide", MotionKind.SCREW: "screw"}


@dataclass(frozen=True)
class Changes:
    """What the visitor changed."""

    floating: bool = False
    gravity: str = "file"  # as for :func:`echelon.load`
    zero: tuple[str, ...] = ()  # lengths set to zero
    equal: tuple[
        tuple[str, str], ...
    ] = ()  # pairs of lengths, the second set to the first
    locked: tuple[str, ...] = ()  # coordinates held at zero
    payload: str = ""  # the link that carries a payload
    # "file" for the file's own, "joints", "base", names of links whose wrench is measured; the file's if none
    sensors: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()  # kinds of effects in every drive
    order: str = "base-to-tip"
    prefer: tuple[str, ...] = ()  # parameters or kinds wanted as representatives
    # experiments before this one, each as JSON of what is changed in it: gravity, locked, payload, sensors
    beside: tuple[str, ...] = ()

    @property
    def direction(self) -> tuple[float, ...] | None:
        """Gravity of an experiment; None for that of the file."""
        if self.gravity == "file":
            return None
        try:
            return tuple(map(float, self.gravity.split(",")))
        except ValueError:
            raise InputError(
                "experiments differ in how the base is mounted: choose a direction of gravity for each"
            ) from None

    def kept(self) -> list[Changes]:
        """The changes of all experiments, this one last."""
        before = [Changes.of(json.loads(text)) for text in self.beside]
        same = {
            "floating": self.floating,
            "zero": self.zero,
            "equal": self.equal,
            "effects": self.effects,
        }
        return [*(replace(changes, **same) for changes in before), self]

    @classmethod
    def of(cls, data: dict[str, Any]) -> Changes:
        """From JSON, where tuples are lists."""
        known = {field.name for field in fields(cls)}
        return cls(
            **{name: _frozen(value) for name, value in data.items() if name in known}
        )


def _frozen(value: Any) -> Any:
    return tuple(map(_frozen, value)) if isinstance(value, list) else value


def answer(request: str) -> str:
    """The reply to a request of the page, both JSON; what cannot be accepted becomes the line that the command prints.

    A request has ``name`` and ``text`` of a file, ``changes``, and for a download ``file``.
    """
    asked = json.loads(request)
    try:
        name, changes = asked["name"], Changes.of(asked["changes"])
        robot = read(name, asked["text"], changes)
        base = derive(name, asked["text"], changes)
        reply = (
            written(base, asked["file"])
            if asked.get("file")
            else {
                **shown(last_of(base)),
                **choices(robot),
                "headline": headline(base),
            }
        )
    except EchelonError as error:
        reply = {"error": f"echelon: {one_line(str(error))}"}
    return json.dumps(reply)


@lru_cache(maxsize=4)
def read(name: str, text: str, changes: Changes) -> Mechanism:
    """The robot of a file as it is read: floating or not, in its gravity."""
    file = RobotFile.of(text.encode(), name)
    if file.is_linear_model:
        raise InputError(
            "this is a linear model; the explorer shows robots", source=name
        )
    if not file.is_description and file.root.tag == "mujoco":
        on_a_computer = (
            f'pip install "echelon-robotics[mjcf]", then echelon derive {name}'
        )
        raise InputError(
            f"MJCF is read by MuJoCo, which no browser has; on a computer: {on_a_computer}",
            source=name,
        )
    if not file.is_description and "<xacro:" in text:
        raise InputError(
            f"the explorer does not read xacro; on a computer: xacro {name} > robot.urdf, then drop robot.urdf here",
            source=name,
        )
    return file.mechanism(
        ReadingOptions(floating=changes.floating, gravity=changes.gravity)
    )


@lru_cache(maxsize=16)
def derive(name: str, text: str, changes: Changes) -> BaseModel:
    """Base parameters of the changed robot."""
    options = {"order": changes.order, "prefer": changes.prefer}
    if not changes.beside:
        return base_parameters(changed(read(name, text, changes), changes), **options)
    experiments = []
    for kept in changes.kept():
        upright = replace(kept, gravity="file", beside=())
        robot = changed(read(name, text, upright), upright)
        experiments.append(Experiment(robot, gravity=kept.direction))
    return base_parameters(experiments, **options)


def last_of(base: BaseModel) -> BaseModel:
    """The model of the experiment that the page shows, in the base parameters of all."""
    names = base.mechanism.experiments
    return base.experiment(names[-1]) if names else base


# -- changes -----------------------------------------------------------------------------------------------------------


def changed(robot: Mechanism, changes: Changes) -> Mechanism:
    """A mechanism with everything changed that is not a matter of reading the file."""
    if changes.zero or changes.equal:
        robot = _with_lengths(robot, changes)
    robot = lock_joints(robot, dict.fromkeys(changes.locked, 0.0))
    if changes.payload:
        robot = _with_payload(robot, changes.payload)
    if changes.sensors:
        robot = _with_sensors(robot, changes.sensors)
    if changes.effects:
        robot = replace(
            robot, effects=(*robot.effects, *_effects(robot, changes.effects))
        )
    return robot


def _with_lengths(robot: Mechanism, changes: Changes) -> Mechanism:
    known = lengths(robot)
    unknown = next(
        (
            n
            for n in (*changes.zero, *(n for pair in changes.equal for n in pair))
            if n not in known
        ),
        None,
    )
    if unknown is not None:
        raise InputError(
            f"there is no length '{unknown}' (valid: {', '.join(known) or 'none'})"
        )
    values = {name: Polynomial({}) for name in changes.zero}
    for first, second in changes.equal:
        values[second] = values.get(first, Polynomial.generator(first))
    return substituted(robot, values)


def lengths(robot: Mechanism) -> list[str]:
    """Symbols that occur in translations of joints, base to tip."""
    steps = [
        step
        for body in robot.bodies
        for step in body.joint.steps
        if isinstance(step, Placement)
    ]
    found = [
        name for step in steps for entry in step.translation for name in entry.symbols()
    ]
    angles = {
        name
        for step in steps
        for row in step.rotation
        for entry in row
        for name in entry.symbols()
    }
    return [name for name in dict.fromkeys(found) if name not in angles]


def _with_payload(robot: Mechanism, link: str) -> Mechanism:
    if any(body.label == "L" or body.name == PAYLOAD for body in robot.bodies):
        raise InputError(f"the robot has a link '{PAYLOAD}' or labelled L already")
    body = Body(PAYLOAD, "L", _link(robot, link), Joint(PAYLOAD, "fixed", ()))
    return replace(robot, bodies=(*robot.bodies, body))


def _link(robot: Mechanism, name: str) -> int:
    names = [body.name for body in robot.bodies]
    if name not in names:
        raise InputError(f"there is no link '{name}' (valid: {', '.join(names)})")
    return names.index(name)


def _with_sensors(robot: Mechanism, sensors: Sequence[str]) -> Mechanism:
    """With other outputs: the file's, of the drives, under the base, at links.

    A floating base feels the wrench of its joint.
    """
    every = replace(robot, measured=None)
    free = _base_coordinates(robot)
    own = {
        "file": list(robot.outputs),
        "joints": [output for output in every.outputs if output.name not in free],
        "base": [output for output in every.outputs if output.name in free]
        or list(_wrench("base", GROUND)),
    }
    links = {
        name: list(_wrench(name, _link(robot, name)))
        for name in sensors
        if name not in own
    }
    chosen = dict.fromkeys(
        output
        for name, some in {**own, **links}.items()
        if name in sensors
        for output in some
    )
    return (
        every
        if set(chosen) == set(every.outputs)
        else replace(robot, measured=tuple(chosen))
    )


def _base_coordinates(robot: Mechanism) -> set[str]:
    """Velocities of a floating base."""
    joint = robot.bodies[0].joint
    return (
        {name for motion in joint.motions for name in motion.velocities}
        if joint.kind == "floating"
        else set()
    )


def _wrench(name: str, body: int) -> Iterator[Output]:
    """The six components of what a link gets from its parent, in the link's frame."""
    for angular, unit in ((False, "N"), (True, "N·m")):
        for axis in range(3):
            component = f"{name}.{'t' if angular else 'f'}{'xyz'[axis]}"
            yield Cut(body, Placement(), False, axis, angular).output(component, unit)


def _effects(robot: Mechanism, kinds: Sequence[str]) -> Iterator[Effect]:
    free = _base_coordinates(robot)
    for kind in kinds:
        for drive in robot.transmission.actuators:
            if drive.name not in free:
                label = effect_label(robot, drive.name)
                yield from ready_made(
                    kind,
                    drive.name,
                    Side.ACTUATOR,
                    label,
                    sliding=slides(robot, drive.name),
                )


# -- what the page shows -----------------------------------------------------------------------------------------------


def choices(robot: Mechanism) -> dict[str, Any]:
    """What can be changed of a robot."""
    known = robot.symbols
    return {
        "joints": [
            motion.name
            for motion in robot.motions
            if motion.name in robot.independent_velocities
        ],
        "links": [body.name for body in robot.bodies],
        "lengths": [
            [name, known[name].value if name in known else None]
            for name in lengths(robot)
        ],
    }


def shown(base: BaseModel) -> dict[str, Any]:
    """A set of base parameters: counts, classes of all standard parameters, closed forms, evidence, a picture."""
    robot = base.mechanism
    owner = {column.name: column.body for column in robot.columns}
    return {
        "headline": headline(base),
        "rank": base.rank,
        "standard": len(base.parameters),
        "outputs": [output.name for output in robot.outputs],
        "kinds": list(PARAMETERS),
        "classes": {name: CLASSES[kind] for name, kind in base.classification.items()},
        "bodies": [
            {
                "index": b.index,
                "label": b.label,
                "name": b.name,
                "cells": b.cells,
                "level": b.level,
                "words": b.words,
            }
            for b in seen_bodies(base)
        ],
        "forms": [
            {
                "name": form.name,
                "text": str(form),
                "latex": form.latex,
                "unit": form.unit,
                "body": owner[form.name],
            }
            for form in base.expressions
        ],
        "facts": facts(base),
        "picture": picture(robot),
    }


def picture(robot: Mechanism) -> dict[str, Any] | None:
    """Where frames and joint axes are, m; None where lengths have no values or loops do not close."""
    pose = drawable_pose(robot)
    if pose is None:
        return None
    moved = [
        body.joint.motions[0].kind if body.joint.motions else None
        for body in robot.bodies
    ]
    return {
        "parents": [body.parent for body in robot.bodies],
        "origins": pose.origins.tolist(),
        "axes": pose.axes.tolist(),
        "joints": [
            "fixed" if kind is None else _DRAWN.get(kind, "turn") for kind in moved
        ],
        "up": pose.up.tolist(),
    }


def written(base: BaseModel, file: str) -> dict[str, Any]:
    """A download: ``set.json``, ``set.tex`` or the C files, by name."""
    if file == "json":
        return {"files": {"set.json": to_json(base)}}
    if file == "latex":
        return {"files": {"set.tex": to_latex(base, full=True)}}
    from echelon.codegen.source import generate

    return {"files": generate(base, "c")}
