"""The shapes that a task checks: those of the robot's file, of the set-up, and of inertias; and what has none.

A link without a shape may touch anything and nobody notices, so links without one are named wherever a motion is called
safe.  Shapes of a set-up stand in for those of the file that cannot be read.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

from echelon.excite.problem.inertia_boxes import InertiaBox, inertia_boxes
from echelon.excite.problem.robot_shapes import (
    STAND_IN,
    FileShapes,
    LostShape,
    entry_shapes,
    link_places,
    read_geometry,
)
from echelon.excite.problem.shapes import WORLD, Shape, ShapeKind, box_lengths
from echelon.formats import ExcitationEntry, RobotFile
from echelon.identification import Finding, Setup, listed, note, warning
from echelon.robot import GROUND, Mechanism
from echelon.shared import InputError


@dataclass(frozen=True)
class TaskShapes:
    """Shapes of a robot and of obstacles."""

    shapes: tuple[Shape, ...]
    excluded: tuple[tuple[str, str], ...]  # pairs of bodies that are not checked
    findings: tuple[Finding, ...]
    shapeless: tuple[str, ...]  # links of the robot that no shape stands for


def task_shapes(
    setup: Setup, entry: ExcitationEntry, mechanism: Mechanism
) -> TaskShapes:
    """The shapes of a task; an InputError if links have none and the set-up does not say that this is right."""
    section, file = entry.collisions, _robot_file(setup)
    links = {} if file is None else link_places(mechanism, file)

    def stated(key: str, entries: Sequence[Mapping[str, Any]]) -> tuple[Shape, ...]:
        def refused(place: int, problem: str) -> InputError:
            return setup.error(f"excitation.collisions.{key}[{place}]", problem)

        folder = Path(setup.source).parent
        return entry_shapes(mechanism, entries, folder, refused, links)

    geometry = FileShapes(())
    if file is not None:
        geometry = read_geometry(mechanism, file, tolerant=True)
    of_setup = stated("shapes", section.shapes)
    lost = geometry.lost
    # a shape of another link on the same body, such as a flange's, does not stand for a lost one
    covered = {(shape.body, shape.link) for shape in of_setup}
    lacking = [
        one
        for one in lost
        if (one.body, one.link) not in covered and (one.body, "") not in covered
    ]
    if lacking and section.unreadable == "refuse":
        raise InputError(_unreadable(lacking), element="collisions")
    own = (*geometry.shapes, *of_setup)
    texts: list[str] = []
    if lacking and section.unreadable == "boxes":
        shaped = _bodies(own) - {one.body for one in lacking}
        boxes = inertia_boxes(mechanism, shaped)
        own = (*own, *(box.shape for box in boxes))
        if boxes:
            texts += _about_boxes(boxes)
        boxed = {box.shape.body for box in boxes}
        lacking = [one for one in lacking if one.body not in boxed]
    shapeless, count = _shapeless(mechanism, own, lacking)
    if shapeless:
        texts.append(_without_shapes(shapeless, count, lacking))
    replaced = [one.link for one in lost if one not in lacking]
    around = stated(
        "obstacles", [{"body": WORLD[0], **obstacle} for obstacle in section.obstacles]
    )
    excluded = [*geometry.excluded, *section.exclude]
    if not section.self:
        excluded += combinations([body.name for body in mechanism.bodies], 2)
    return TaskShapes(
        (*own, *(replace(shape, obstacle=True) for shape in around)),
        tuple(excluded),
        (
            *(warning("collisions", setup.source, text) for text in texts),
            *(
                note("collisions", setup.source, text)
                for text in _notes(replaced, (*of_setup, *around))
            ),
        ),
        shapeless,
    )


def _robot_file(setup: Setup) -> RobotFile | None:
    """The file that has the robot's links and shapes; descriptions have none."""
    file = setup.robot_file
    return None if file is None or file.is_description else file


def _bodies(shapes: Sequence[Shape]) -> frozenset[int]:
    return frozenset(shape.body for shape in shapes)


def _unreadable(lost: Sequence[LostShape]) -> str:
    """A sentence about shapes of a file that cannot be read, with the ways out."""
    first = lost[0].problem.removesuffix(f"; {STAND_IN}")
    others = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
    ways = "unreadable: boxes (boxes of the inertias replace the links), or none (not checked)"
    names = ", ".join(dict.fromkeys(one.link for one in lost))
    return (
        f"{first}{others}; convert meshes of other formats, add shapes of {names} under collisions, or write there "
        f"{ways}"
    )


def _about_boxes(boxes: Sequence[InertiaBox]) -> list[str]:
    """Warnings about boxes of inertias."""
    measures = ", ".join(map(str, boxes))
    texts = [
        "boxes of the inertias replace unreadable links, and the distances are those of the boxes, whose full lengths "
        f"are: {measures}"
    ]
    doubts = [f"{box} {box.doubt}" for box in boxes if box.doubt]
    if doubts:
        texts.append(
            f"boxes of inertias that can hardly be their links: {'; '.join(doubts)}; state shapes of these links under "
            "collisions"
        )
    return texts


def _shapeless(
    mechanism: Mechanism, own: Sequence[Shape], lacking: Sequence[LostShape]
) -> tuple[tuple[str, ...], int]:
    """Links of the robot that no shape stands for, and how many links should have one."""
    bodies = mechanism.bodies
    shaped = {
        shape.link or (WORLD[0] if shape.body == GROUND else bodies[shape.body].name)
        for shape in own
    }
    known = _bodies(own) | {one.body for one in lacking}
    # a body without mass, as between the axes of a universal joint, is no part
    bare = [
        body.name
        for index, body in enumerate(bodies)
        if index not in known and (body.inertial is None or body.inertial[-1] > 0)
    ]
    names = tuple(dict.fromkeys([*(one.link for one in lacking), *bare]))
    return names, len(shaped | set(names))


def _without_shapes(
    shapeless: Sequence[str], count: int, lost: Sequence[LostShape]
) -> str:
    number = len(shapeless)
    verb = (
        "has no shape, so its distances are"
        if number == 1
        else "have no shape, so their distances are"
    )
    why = f" ({lost[0].problem.removesuffix(f'; {STAND_IN}')})" if lost else ""
    return f"{number} of {count} links {verb} not checked: {', '.join(shapeless)}{why}; add shapes under collisions"


def _notes(replaced: Sequence[str], stated: Sequence[Shape]) -> list[str]:
    """Notes about shapes that stand for meshes, and about the boxes of a set-up."""
    found = []
    if replaced:
        found.append(
            f"shapes of the file that cannot be read are left out, and other shapes stand for their links: {listed(replaced)}"
        )
    boxes = [shape for shape in stated if shape.kind is ShapeKind.BOX]
    if boxes:
        measures = ", ".join(f"'{box.name}' {box_lengths(box)}" for box in boxes)
        found.append(f"full lengths of the boxes that the set-up states: {measures}")
    return found
