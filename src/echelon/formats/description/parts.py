"""The three forms of a description as one: parts, each with a parent and a joint, parents first."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from echelon.conventions import PARAMETERS
from echelon.exact.numbers import is_whole
from echelon.formats.bodies import BASE, Part
from echelon.formats.description.stated_expressions import Expressions
from echelon.formats.description.stated_joints import Joints, joint_name
from echelon.formats.literal import central_inertial
from echelon.hints import nearest
from echelon.mechanism.joint import ALL

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import BodyEntry, Inertial, ModifiedRow, RobotDescription, StandardRow


def read_parts(robot: RobotDescription, expressions: Expressions) -> list[Part]:
    """All parts, parents before children and otherwise in the order of the document."""
    joints = Joints(expressions)
    for form, rows in (("modified_dh", robot.modified_dh), ("standard_dh", robot.standard_dh)):
        if rows is not None:
            return _sorted(_rows(form, rows, joints), expressions)
    assert robot.bodies is not None
    names = [body.name for body in robot.bodies]
    stated = [_body_part(body, f"bodies[{index}]", names, joints) for index, body in enumerate(robot.bodies)]
    parts = _sorted(stated, expressions)
    for part in parts[1:]:
        if part.kind == "root":
            raise expressions.error(part.elements[0], "needs a joint; only the first body may go without one")
    return parts


# -- tables ---------------------------------------------------------------------------------------------------------


def _rows(form: str, rows: Sequence[ModifiedRow | StandardRow], joints: Joints) -> list[Part]:
    names = [row.name or f"j{number}" for number, row in enumerate(rows, 1)]
    for index, name in enumerate(names):
        if is_whole(name):
            problem = f"'{name}' would be confused with the number of a row: use a name such as j{name}"
            raise joints.expressions.error(f"{form}[{index}].name", problem)
    return [_row_part(row, index, f"{form}[{index}]", names, joints) for index, row in enumerate(rows)]


def _row_part(row: ModifiedRow | StandardRow, index: int, path: str, names: Sequence[str], joints: Joints) -> Part:
    stated = getattr(row, "parent", None)  # rows of the standard convention form a chain
    return Part(
        (path,),
        names[index],
        _antecedent(stated, index, names, f"{path}.parent", joints.expressions),
        joint=names[index],
        kind=row.joint,
        moves=row.joint != "fixed",
        steps=partial(joints.row, row, names[index], path),
        label=row.label,
        default_label=str(index + 1),
        separate=row.separate,
        carried=_carried(row),
        inertial=_inertial(row.inertial, f"{path}.inertial", joints.expressions),
    )


def _antecedent(
    stated: str | None, index: int, names: Sequence[str], path: str, expressions: Expressions
) -> str | None:
    if stated is None:
        return names[index - 1] if index else None
    if stated in names:
        return stated
    if stated in ("0", BASE):
        return None
    if is_whole(stated) and int(stated) <= len(names):
        return names[int(stated) - 1]
    valid = f"0 to {len(names)}" if is_whole(stated) else f"0 to {len(names)}, base or a name"
    raise expressions.error(path, f"there is no row '{stated}': give {valid}{nearest(stated, names)}")


# -- bodies ---------------------------------------------------------------------------------------------------------


def _body_part(body: BodyEntry, path: str, names: Sequence[str], joints: Joints) -> Part:
    parent = body.parent
    if parent is not None and parent not in names:
        joints.expressions.check(parent, [BASE, *names], f"{path}.parent", "body")
        parent = None
    kind, moves = _kind(body)
    return Part(
        (path,),
        body.name,
        parent,
        joint=joint_name(body) if body.joint is not None else "",
        kind=kind,
        moves=moves,
        steps=partial(joints.body, body, path),
        label=body.label,
        separate=body.separate,
        carried=_carried(body),
        inertial=_inertial(body.inertial, f"{path}.inertial", joints.expressions),
    )


def _kind(body: BodyEntry) -> tuple[str, bool]:
    """What a joint is called, and whether it moves."""
    from echelon.formats.schema.schema_geometry import MotionStep

    if body.joint is None:
        return "root", False
    if body.joint.type == "custom":
        return body.joint.kind, any(isinstance(step, MotionStep) for step in body.joint.steps)
    return body.joint.type, body.joint.type != "fixed"


def _carried(entry: ModifiedRow | StandardRow | BodyEntry) -> tuple[int, ...]:
    """Which of the ten parameters a part carries."""
    if entry.massless:
        return ()
    return ALL if entry.parameters is None else tuple(sorted({PARAMETERS.index(kind) for kind in entry.parameters}))


# -- both -----------------------------------------------------------------------------------------------------------


def _inertial(stated: Inertial | None, path: str, expressions: Expressions) -> tuple[float, ...] | None:
    """The ten standard parameters about the body's frame."""
    from echelon.formats.schema.robot_schema import StandardInertial

    if stated is None:
        return None
    if isinstance(stated, StandardInertial):
        return tuple(expressions.real(text, f"{path}.standard[{i}]") for i, text in enumerate(stated.standard))
    mass = expressions.real(stated.mass, f"{path}.mass")
    if mass < 0:
        raise expressions.error(f"{path}.mass", f"'{stated.mass}' is negative")
    centre = [expressions.real(text, f"{path}.com[{i}]") for i, text in enumerate(stated.com)]
    keys = ("xx", "xy", "xz", "yy", "yz", "zz")
    moments = [expressions.real(getattr(stated.inertia, key), f"{path}.inertia.{key}") for key in keys]
    return central_inertial(mass, centre, moments, np.eye(3))


def _sorted(parts: list[Part], expressions: Expressions) -> list[Part]:
    """Parts with parents before children; parts that already stand behind their parents keep their order."""
    by_name: dict[str, Part] = {}
    for part in parts:
        if part.name in by_name:
            taken = by_name[part.name].elements[0]
            raise expressions.error(f"{part.elements[0]}.name", f"the name '{part.name}' is taken by {taken}")
        by_name[part.name] = part
    ordered: dict[str, Part] = {}
    for part in parts:
        chain: dict[str, Part] = {}
        above: Part | None = part
        while above is not None and above.name not in ordered:
            if above.name in chain:
                circle = " -> ".join([*list(chain)[list(chain).index(above.name) :], above.name])
                raise expressions.error(f"{part.elements[0]}.parent", f"the parents form a circle: {circle}")
            chain[above.name] = above
            above = by_name[above.parent] if above.parent is not None else None
        ordered.update(reversed(chain.items()))
    return list(ordered.values())
