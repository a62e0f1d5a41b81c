"""A robot file with what a description adds to it: labels, loops, drives, effects and outputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from echelon.formats.bodies import BASE
from echelon.formats.builder import Built, Rider
from echelon.formats.description.description_builder import cut_off
from echelon.formats.description.document import Document, Expressions, coordinate_axis, declared_symbols
from echelon.formats.description.stated_setup import Additions
from echelon.formats.literal import StatedJoint
from echelon.formats.snapping import ReadingOptions
from echelon.hints import nearest_of
from echelon.inputs import step_into
from echelon.mechanism.joint import GROUND, Placement
from echelon.mechanism.mechanism import Mechanism, Snap

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import RobotDescription


def add_to_file(
    document: Document, robot: RobotDescription, options: ReadingOptions, base: Callable[[ReadingOptions], Built]
) -> Built:
    """A robot file with what a description adds to it."""
    assert robot.robot is not None
    for key in ("gravity", "floating_base", "couplings"):
        if key in robot.model_fields_set:
            raise document.error(key, "belongs to the geometry, which is that of the robot file")
    joints = []
    for name, entry in robot.robot.joints.items():
        axes = tuple(coordinate_axis(axis) for axis in (entry.axis, entry.axis2) if axis is not None)
        joints.append(StatedJoint(name, entry.type, axes, partial(document.error, f"robot.joints.{name}")))
    options = replace(options, separate=cut_off(robot), joints=tuple(joints), looped=bool(robot.loops))
    # the loops of a geometry in numbers close at these numbers only
    stated = base(replace(options, symbolic=False) if robot.loops else options)
    mechanism = stated.mechanism
    symbols, bare = declared_symbols(robot, document)
    known = {n: s for n, s in symbols.items() if n not in bare}
    expressions = Expressions(document, options, (), {**mechanism.symbols, **symbols})
    mechanism, notes = _labelled(replace(mechanism, symbols={**mechanism.symbols, **known}), robot, document)
    find = _FileParts(mechanism, stated.riders, expressions)
    mechanism = Additions(mechanism, robot, expressions, find).added()
    snaps = tuple(dict.fromkeys((*stated.snaps, *find.snaps, *expressions.snapping.snaps)))
    return Built(mechanism, snaps, (*stated.notes, *notes))


def _labelled(mechanism: Mechanism, robot: RobotDescription, document: Document) -> tuple[Mechanism, list[str]]:
    """A robot file's mechanism with the labels that a description gives to its bodies, and remarks."""
    names = [body.name for body in mechanism.bodies]
    for name in robot.labels:
        if name not in names:
            raise document.error(step_into("labels", name), f"there is no body '{name}'{nearest_of(name, names)}")
    bodies = [replace(body, label=robot.labels.get(body.name, body.label)) for body in mechanism.bodies]
    notes = []
    for label in dict.fromkeys(robot.labels.values()):
        sharing = [k for k, body in enumerate(bodies) if body.label == label]
        stated = [values for k in sharing if (values := bodies[k].inertial) is not None]
        if len(set(stated)) > 1:  # files round; the mean of bodies is one that can exist
            mean = tuple(float(value) for value in np.mean(stated, axis=0))
            for k in sharing:
                bodies[k] = replace(bodies[k], inertial=mean)
            notes.append(f"bodies of label '{label}' get the mean of their stated inertial values")
    return replace(mechanism, bodies=tuple(bodies)), notes


class _FileParts:
    """Finds bodies of a robot file, and what is fixed to them."""

    def __init__(
        self, mechanism: Mechanism, riders: Mapping[str, Callable[[], Rider]], expressions: Expressions
    ) -> None:
        self.names = {body.name: k for k, body in enumerate(mechanism.bodies)}
        self._joints = {body.joint.name: k for k, body in enumerate(mechanism.bodies)}
        self.riders, self.expressions, self.snaps = riders, expressions, list[Snap]()

    def __call__(self, name: str | None, path: str) -> tuple[int, Placement]:
        if name in self.names:
            return self.names[name], Placement()
        if name is not None and name in self.riders:
            rider, known = self.riders[name](), self.expressions.snapping.symbols
            for symbol in rider.symbols:
                if known.setdefault(symbol.name, symbol) != symbol:
                    problem = f"the robot file has an angle '{symbol.name}': rename the symbol"
                    raise self.expressions.error(path, problem)
            self.snaps += rider.snaps
            return rider.body, rider.placement
        if name != BASE and name in self._joints:  # a joint marks the frame that it moves
            return self._joints[name], Placement()
        if name is not None:
            self.expressions.check(name, [BASE, *self.names, *self.riders], path, "body or frame")
        return GROUND, Placement()
