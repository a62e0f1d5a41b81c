"""Joints that a robot file cannot state: balls and universal joints that stand as revolute ones in a URDF."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from echelon.formats.literal import LiteralLink, LiteralMotion, LiteralStep, LiteralTree, Triple
from echelon.formats.options import StatedJoint
from echelon.hints import nearest_of
from echelon.mechanism.joint import MotionKind


def with_joints(tree: LiteralTree, joints: Sequence[StatedJoint]) -> LiteralTree:
    """A tree some of whose joints are of other types.

    The frame in which the file states a joint stays; a ball, or the axes of a universal joint, take the place of its
    axis.
    """
    coupled = {name: c.element for c in tree.couplings for name in (c.coordinate, *c.terms)}
    for joint in joints:
        moving = [step.name for link in tree.links for step in link.steps if isinstance(step, LiteralMotion)]
        names = dict.fromkeys([*(link.joint for link in tree.links if link.joint), *moving])
        if joint.name not in names:
            raise joint.error(f"the robot file has no joint '{joint.name}'{nearest_of(joint.name, list(names))}")
        if joint.name in coupled:
            raise joint.error(f"it has one axis, because of {coupled[joint.name]}: take that out")
        tree = replace(tree, links=tuple(_changed(link, joint) for link in tree.links))
    return tree


def _changed(link: LiteralLink, joint: StatedJoint) -> LiteralLink:
    stated = any(isinstance(step, LiteralMotion) and step.name == joint.name for step in link.steps)
    if not stated and link.joint != joint.name:
        return link
    # a joint of its own keeps its name; a fixed one has no motion that could be replaced
    steps = link.steps if stated else (*link.steps, LiteralMotion(f"joint '{joint.name}'", joint.name, "fixed"))
    kind = joint.kind if link.joint == joint.name else link.kind
    return replace(link, kind=kind, steps=tuple(_steps(steps, joint)))


def _steps(steps: Sequence[LiteralStep], joint: StatedJoint) -> Iterator[LiteralStep]:
    for step in steps:
        if not isinstance(step, LiteralMotion) or step.name != joint.name:
            yield step
        elif joint.kind == "spherical":
            yield LiteralMotion(step.element, joint.name, MotionKind.BALL)
        else:
            for number, (axis, sign) in enumerate(joint.axes, 1):
                x, y, z = (sign if k == axis else 0 for k in range(3))
                direction: Triple = (x, y, z)
                yield LiteralMotion(step.element, f"{joint.name}.{number}", MotionKind.ROTATION, direction)
