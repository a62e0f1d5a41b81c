"""Linkages for `loop_oracle` from files: MJCF as MuJoCo compiles it, URDF with a YAML file of frames that coincide.

Numbers are taken as intended: angles next to a multiple of 15 degrees are that multiple, other numbers lose what stands
after their twelfth decimal.  With ``literal=True`` they are taken as they stand.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import yaml
from flint import arb, arb_mat

from support.loop_linkage import (
    ONE,
    Body,
    Linkage,
    Loop,
    function,
    matrix,
    number,
    sliding,
    turning,
)

NEAR = 1e-9
AXES = tuple(tuple(arb(int(i == j)) for j in range(3)) for i in range(3))
NEUTRAL = matrix(AXES)
FREE = (*(sliding(axis) for axis in AXES), *(turning(axis) for axis in AXES))
REPLACED = {
    "SPHERICAL": tuple(turning(axis) for axis in AXES),
    "CARDAN": tuple(turning(axis) for axis in AXES[:2]),
    "UJOINT_ZY": (turning(AXES[2]), turning(AXES[1])),
    "UJOINT_YZ": (turning(AXES[1]), turning(AXES[2])),
    "FIXED": (),
}


@dataclass(frozen=True)
class Numbers:
    """How the numbers of a file are taken."""

    literal: bool = False

    def length(self, value: str | float) -> arb:
        return number(value) if self.literal else number(f"{float(value):.12f}")

    def angle(self, value: str | float) -> arb:
        steps = round(float(number(value) * 12 / arb.pi()))
        exact = (arb.pi() * steps / 12).mid()
        return (
            exact
            if not self.literal and abs(float(number(value) - exact)) < NEAR
            else self.length(value)
        )

    def share(self, value: str | float) -> arb:
        """A component of an axis or a unit quaternion, such as 0.7071067811865476."""
        for square in range(5):
            exact = (arb(square) / 4).sqrt().mid()
            if not self.literal and abs(abs(float(value)) - float(exact)) < NEAR:
                return exact if float(value) > 0 else -exact
        return number(value)

    def vector(self, values: Iterable[str | float]) -> tuple[arb, ...]:
        return tuple(self.length(value) for value in values)

    def direction(self, values: Iterable[str | float]) -> tuple[arb, ...]:
        return tuple(self.share(value) for value in values)


def placed(turn: Sequence[Sequence[object]], shift: Sequence[object]):
    return matrix(
        [*([*row, end] for row, end in zip(turn, shift, strict=True)), [0, 0, 0, 1]]
    )


def rotation(quaternion: Sequence[arb]) -> list[list[arb]]:
    """Of a quaternion w, x, y, z of any length."""
    w, x, y, z = quaternion
    size = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return [[(entry / size).mid() for entry in row] for row in rows]


def turned(roll: arb, pitch: arb, yaw: arb) -> list[list[arb]]:
    """The rotation of the roll, pitch and yaw of URDF."""
    half = [(angle / 2).sin_cos() for angle in (roll, pitch, yaw)]
    (sr, cr), (sp, cp), (sy, cy) = half
    return rotation(
        (
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        )
    )


def origin(element: ET.Element | None, numbers: Numbers):
    if element is None:
        return ONE
    xyz, rpy = ((element.get(key) or "0 0 0").split() for key in ("xyz", "rpy"))
    return placed(turned(*(numbers.angle(value) for value in rpy)), numbers.vector(xyz))


def motion(kind: str, along: tuple[arb, ...]) -> tuple[arb_mat, ...]:
    """The twists of a joint of URDF."""
    if kind == "fixed":
        return ()
    if kind == "floating":
        return FREE
    return (sliding(along),) if kind == "prismatic" else (turning(along),)


def urdf(
    file: Path, floating: bool = False, literal: bool = False, loops: Path | None = None
) -> Linkage:
    """A URDF file, with the loops of the YAML file beside it if there is one."""
    numbers = Numbers(literal)
    beside = loops or file.with_suffix(".yaml")
    closing = yaml.safe_load(beside.read_text()) if beside.exists() else {}
    kinds = dict(
        zip(closing.get("joint_name", ()), closing.get("joint_type", ()), strict=True)
    )
    joints = ET.parse(file).getroot().findall("joint")
    children = {joint.find("child").get("link") for joint in joints}
    root = next(
        link.get("name")
        for link in ET.parse(file).getroot().findall("link")
        if link.get("name") not in children
    )
    bodies = [Body(root, -1, ONE, FREE if floating else ())]
    known, first, mimics = {root: 0}, {}, {}
    while waiting := [
        joint for joint in joints if joint.find("child").get("link") not in known
    ]:
        for joint in waiting:
            parent, name = (
                known.get(joint.find("parent").get("link")),
                joint.get("name"),
            )
            if parent is None:
                continue
            axis = joint.find("axis")
            along = numbers.direction(
                (axis.get("xyz") if axis is not None else "1 0 0").split()
            )
            motions = motion(joint.get("type"), along)
            motions = REPLACED[kinds[name]] if name in kinds else motions
            first[name] = sum(len(body.motions) for body in bodies)
            known[joint.find("child").get("link")] = known[name] = len(bodies)
            bodies.append(
                Body(
                    joint.find("child").get("link"),
                    parent,
                    origin(joint.find("origin"), numbers),
                    motions,
                )
            )
            if joint.find("mimic") is not None:
                mimics[name] = joint.find("mimic")
    names = zip(closing.get("closed_loop", ()), closing.get("type", ()), strict=True)
    pairs = tuple(
        Loop({"6d": "weld", "3d": "point"}[kind.lower()], known[a], known[b], ONE, ONE)
        for (a, b), kind in names
    )
    ties = tuple(
        {first[name]: 1, first[mimic.get("joint")]: -float(mimic.get("multiplier", 1))}
        for name, mimic in mimics.items()
    )
    return Linkage(
        tuple(bodies), pairs, (0.0,) * sum(len(body.motions) for body in bodies), ties
    )


def mjcf(file: Path, literal: bool = False) -> Linkage:
    """An MJCF file with equality constraints, at its first keyframe or its reference pose."""
    numbers, model = Numbers(literal), mujoco.MjModel.from_xml_path(str(file))
    bodies, start, first = [], [], {}
    reference = model.key_qpos[0] if model.nkey else model.qpos0
    for i in range(1, model.nbody):
        motions: list = []
        for j in range(
            model.body_jntadr[i], model.body_jntadr[i] + model.body_jntnum[i]
        ):
            first[j] = len(start)
            axis, point = (
                numbers.direction(model.jnt_axis[j]),
                numbers.vector(model.jnt_pos[j]),
            )
            kind, at = model.jnt_type[j], model.jnt_qposadr[j]
            new = {
                mujoco.mjtJoint.mjJNT_HINGE: (turning(axis, point),),
                mujoco.mjtJoint.mjJNT_SLIDE: (sliding(axis),),
                mujoco.mjtJoint.mjJNT_BALL: tuple(
                    turning(axis, point) for axis in AXES
                ),
                mujoco.mjtJoint.mjJNT_FREE: FREE,
            }[mujoco.mjtJoint(kind)]
            motions += new
            start += (
                [float(reference[at] - model.qpos0[at])]
                if len(new) == 1
                else [0.0] * len(new)
            )
            if len(new) == 3:
                start[-3:] = euler(reference[at : at + 4])
        pose = placed(
            rotation(numbers.direction(model.body_quat[i])),
            numbers.vector(model.body_pos[i]),
        )
        bodies.append(
            Body(
                model.body(i).name,
                int(model.body_parentid[i]) - 1,
                pose,
                tuple(motions),
            )
        )
    tree = Linkage(tuple(bodies), (), tuple(start))
    poses = tree.state([arb(0)] * len(start), [arb(0)] * len(start)).poses
    loops, ties = [], []
    for e in range(model.neq):
        if not model.eq_active0[e]:
            continue
        kind, one, two, data = (
            model.eq_type[e],
            int(model.eq_obj1id[e]),
            int(model.eq_obj2id[e]),
            model.eq_data[e],
        )
        if kind == mujoco.mjtEq.mjEQ_JOINT:
            powers = tuple(float(c) for c in data[1:5]) if two >= 0 else ()
            leader = number(start[first[two]]) if two >= 0 else number(0)
            start[first[one]] = float(data[0]) + float(function(powers, leader)[0])
            ties.append(
                {first[one]: 1}
                | ({first[two]: tuple(-c for c in powers)} if powers else {})
            )
            continue
        if kind == mujoco.mjtEq.mjEQ_TENDON:
            ties.append(tendon(model, one, first, 1.0))
            if two >= 0:
                for j, c in tendon(model, two, first, -float(data[1])).items():
                    ties[-1][j] = ties[-1].get(j, 0.0) + c
            continue
        name = {mujoco.mjtEq.mjEQ_CONNECT: "point", mujoco.mjtEq.mjEQ_WELD: "weld"}[
            mujoco.mjtEq(kind)
        ]
        if model.eq_objtype[e] == mujoco.mjtObj.mjOBJ_SITE:
            at, on = (
                placed(
                    rotation(numbers.direction(model.site_quat[s])),
                    numbers.vector(model.site_pos[s]),
                )
                for s in (one, two)
            )
            one, two = int(model.site_bodyid[one]), int(model.site_bodyid[two])
        else:
            at, on = frames(name, data, poses[one - 1].inv() * poses[two - 1], numbers)
        loops.append(Loop(name, one - 1, two - 1, at, on))
    return Linkage(
        tuple(bodies),
        tuple(loops),
        tuple(start),
        tuple(ties),
        tuple(float(g) for g in model.opt.gravity),
    )


def frames(kind: str, data: np.ndarray, apart, numbers: Numbers):
    """The two frames of an equality between bodies: the second one where the first one is at the reference pose."""
    if kind == "point":
        at, on = (
            placed(NEUTRAL.tolist(), numbers.vector(data[:3])),
            placed(NEUTRAL.tolist(), numbers.vector(data[3:6])),
        )
        follows = apart.inv() * at
        near = all(abs(float(follows[i, 3] - on[i, 3])) < NEAR for i in range(3))
        return at, follows if near else on
    on = placed(NEUTRAL.tolist(), numbers.vector(data[:3]))
    at = placed(rotation(numbers.direction(data[6:10])), numbers.vector(data[3:6])) * on
    follows = apart * on
    near = all(
        abs(float(a - b)) < NEAR
        for a, b in zip(follows.entries(), at.entries(), strict=True)
    )
    return (follows if near else at), on


def tendon(model, index: int, first: dict[int, int], factor: float) -> dict[int, float]:
    start = model.tendon_adr[index]
    wraps = range(start, start + model.tendon_num[index])
    if any(model.wrap_type[w] != mujoco.mjtWrap.mjWRAP_JOINT for w in wraps):
        raise NotImplementedError("a tendon that is not a sum of coordinates")
    return {
        first[int(model.wrap_objid[w])]: factor * float(model.wrap_prm[w])
        for w in wraps
    }


def euler(quaternion: np.ndarray) -> list[float]:
    """Turns about x, then the new y, then the new z."""
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, quaternion)
    turn = turn.reshape(3, 3)
    return [
        float(np.arctan2(-turn[1, 2], turn[2, 2])),
        float(np.arcsin(turn[0, 2])),
        float(np.arctan2(-turn[0, 1], turn[0, 0])),
    ]
