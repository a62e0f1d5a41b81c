"""A robot file with a calibrated geometry: origins of joints change, and nothing else in the file.

What is fixed to a body sits elsewhere on it than the file says, by a small change of frame.  So the origins of the
joints that a body carries change.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from echelon.formats.literal import (
    LiteralPlacement,
    LiteralStep,
    numeric_placement,
    numeric_placements,
    roll_pitch_yaw,
)
from echelon.formats.robot_file import RobotFile
from echelon.formats.urdf.urdf_reader import UrdfReader
from echelon.formats.writers.description_writer import write_description
from echelon.formats.writers.identified_values import number_text
from echelon.formats.writers.robot_writer import WrittenRobot
from echelon.formats.writers.xml_editor import XmlEditor, comment, decoded
from echelon.robot import Mechanism, rotation_quaternion
from echelon.shared import Floats

_ORIENTATIONS = ("euler", "axisangle", "xyaxes", "zaxis")


def calibrated_robot(
    mechanism: Mechanism,
    moves: Mapping[str, Floats],
    file: RobotFile | None,
    remarks: Sequence[str] = (),
    mounts: Mapping[str, Floats] | None = None,
) -> WrittenRobot:
    """The robot's file with other origins, or a description of the calibrated mechanism.

    Parameters
    ----------
    mechanism : Mechanism
        The calibrated robot.
    moves : mapping of str to array of shape (4, 4)
        By a body's name, where what is fixed to it sits now, in its frame.
    file : RobotFile, optional
        The file that it was read from.
    remarks : sequence of str
        Lines at the head.
    mounts : mapping of str to array of shape (4, 4), optional
        By a body's name, how its joint is moved on the body that carries it, in that body's frame.
    """
    mounts = mounts or {}
    carriers = {body.name for body in mechanism.bodies}
    if (
        file is None
        or file.is_description
        or file.root.tag == "sdf"
        or mechanism.closures
    ):
        return _description(mechanism, remarks)
    text = decoded(file.data, file.source)
    if file.root.tag == "mujoco":
        from echelon.formats.writers.mjcf_writer import NamedModel

        model = NamedModel(text, file.mjcf)
        if not model.is_complete:  # it multiplies or attaches bodies
            return _description(mechanism, remarks)
        _move_bodies(model.editor, model.bodies, model.spec, moves, mounts, carriers)
        model.editor.insert_first(model.editor.root, comment(remarks))
        return WrittenRobot("calibrated.xml", model.editor.result(), tuple(remarks))
    editor = XmlEditor(text, file.source)
    tree = UrdfReader(file.root, file.source).read(True).links
    links = {link.joint: link for link in tree}
    for joint in editor.root.findall("joint"):
        parent = joint.find("parent")
        link = links[str(joint.get("name"))]
        moved = moves.get("" if parent is None else str(parent.get("link")), np.eye(4))
        if link.name in mounts:
            carried, above = np.eye(4), link.parent
            while above > 0 and tree[above].name not in carriers:
                carried = _placed(tree[above].steps) @ carried
                above = tree[above].parent
            moved = moved @ np.linalg.solve(carried, mounts[link.name] @ carried)
        if np.array_equal(moved, np.eye(4)):
            continue
        origin = joint.find("origin")
        steps = link.steps
        first = steps[0] if steps and origin is not None else None
        placed = isinstance(first, LiteralPlacement)
        nominal = numeric_placement(first) if placed else np.eye(4)  # type: ignore[arg-type]
        frame = moved @ nominal
        place = {
            "xyz": number_text(*frame[:3, 3]),
            "rpy": number_text(*roll_pitch_yaw(frame[:3, :3])),
        }
        text = f'<origin xyz="{place["xyz"]}" rpy="{place["rpy"]}"/>'
        if origin is None:
            editor.insert_first(joint, [text])
        elif set(origin.keys()) <= place.keys():
            editor.set_attributes(origin, place)
        else:  # another notation of the orientation would contradict this one
            editor.replace(origin, text)
    editor.insert_first(editor.root, comment(remarks))
    return WrittenRobot("calibrated.urdf", editor.result(), tuple(remarks))


def _move_bodies(
    editor: XmlEditor,
    names: Mapping[Any, str],
    spec: Any,
    moves: Mapping[str, Floats],
    mounts: Mapping[str, Floats],
    carriers: Collection[str],
) -> None:
    """Change the places of bodies on the bodies that carry them."""
    model = spec.compile()
    above = {child: parent for parent in names for child in parent.findall("body")}
    for child, name in names.items():
        parent = above.get(child)
        moved = np.eye(4) if parent is None else moves.get(names[parent], np.eye(4))
        if name in mounts:
            carried = np.eye(4)
            while parent is not None and names[parent] not in carriers:
                carried = _place_of(model.body(names[parent])) @ carried
                parent = above.get(parent)
            moved = moved @ np.linalg.solve(carried, mounts[name] @ carried)
        if not np.array_equal(moved, np.eye(4)):
            frame = moved @ _place_of(model.body(name))
            quaternion = rotation_quaternion(frame[:3, :3])
            place = {
                "pos": number_text(*frame[:3, 3]),
                "quat": number_text(*quaternion),
            }
            editor.set_attributes(child, place, _ORIENTATIONS)


def _place_of(body: Any) -> Floats:
    """The frame of a compiled body on the one that carries it, shape (4, 4)."""
    from echelon.formats.mjcf.mjcf_numbers import quaternion_matrix

    found = np.eye(4)
    found[:3, 3] = body.pos
    found[:3, :3] = np.array(quaternion_matrix(tuple(body.quat)), dtype=float)
    return found


def _placed(steps: Sequence[LiteralStep]) -> Floats:
    """The frame of a fixed link on the one that carries it, shape (4, 4)."""
    found: Floats = numeric_placements(
        step for step in steps if isinstance(step, LiteralPlacement)
    )
    return found


def _description(mechanism: Mechanism, remarks: Sequence[str]) -> WrittenRobot:
    import yaml

    text = yaml.safe_dump(
        write_description(mechanism),
        sort_keys=False,
        allow_unicode=True,
        width=120,
        default_flow_style=None,
    )
    head = "".join(f"# {' '.join(remark.split())}\n" for remark in remarks)
    return WrittenRobot("calibrated.yaml", head + str(text), tuple(remarks))
