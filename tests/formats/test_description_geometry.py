"""Joints and tables of descriptions against textbook kinematics."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.descriptions import read_description
from support.textbook_poses import (
    X,
    Y,
    Z,
    along,
    moved,
    pose_of,
    quaternion_turn,
    turned,
)


def read(text: str, **options: Any) -> Mechanism:
    return read_description(
        f"echelon: 1\n{text}", "robot.yaml", ReadingOptions(**options)
    )


# -- joints -----------------------------------------------------------------------------------------------------------

QUATERNION = {"j.w": 0.5, "j.x": -0.5, "j.y": 0.1, "j.z": 0.7}
FLOATING = {
    "j.tx": 0.1,
    "j.ty": 0.2,
    "j.tz": 0.3,
    "j.r.w": 0.5,
    "j.r.x": -0.5,
    "j.r.y": 0.1,
    "j.r.z": 0.7,
}
JOINTS = {
    "revolute": ("type: revolute, axis: -y", {"j": 0.7}, turned([0, -1, 0], 0.7)),
    "continuous": (
        "type: continuous, axis: [1, 2, 3]",
        {"j": 0.7},
        turned([1, 2, 3], 0.7),
    ),
    "prismatic": (
        "type: prismatic, axis: [-1, 2, 0.5]",
        {"j": 0.7},
        along([-1, 2, 0.5], 0.7),
    ),
    "prismatic down": ("type: prismatic, axis: -z", {"j": 0.7}, along([0, 0, -1], 0.7)),
    "helical": (
        "type: helical, axis: -x, pitch: 0.2",
        {"j": 0.7},
        turned([-1, 0, 0], 0.7) @ along([-1, 0, 0], 0.2 * 0.7),
    ),
    "helical oblique": (
        "type: helical, axis: [1, 1, 1], pitch: -0.2",
        {"j": 0.7},
        turned([1, 1, 1], 0.7) @ along([1, 1, 1], -0.2 * 0.7),
    ),
    "cylindrical": (
        "type: cylindrical, axis: [0, -3, 4]",
        {"j.slide": 0.4, "j.turn": 0.7},
        along([0, -3, 4], 0.4) @ turned([0, -3, 4], 0.7),
    ),
    "universal": (
        "type: universal, axis: -x, axis2: z",
        {"j.1": 0.4, "j.2": 0.7},
        turned([-1, 0, 0], 0.4) @ turned(Z, 0.7),
    ),
    "planar": (
        "type: planar, axis: z",
        {"j.x": 0.1, "j.y": 0.2, "j.angle": 0.7},
        moved(0.1, 0.2, 0) @ turned(Z, 0.7),
    ),
    "spherical": ("type: spherical", QUATERNION, quaternion_turn(0.5, -0.5, 0.1, 0.7)),
    "floating": (
        "type: floating",
        FLOATING,
        moved(0.1, 0.2, 0.3) @ quaternion_turn(0.5, -0.5, 0.1, 0.7),
    ),
    "custom": (
        "type: custom, steps: [{motion: translation, name: a, axis: -y}, {xyz: [l, 0, 0], rpy: [0, 0.3, 0]}, "
        "{motion: screw, name: b, axis: x, pitch: l}]",
        {"a": 0.1, "b": 0.2},
        moved(0, -0.1, 0)
        @ moved(0.3, 0, 0)
        @ turned(Y, 0.3)
        @ turned(X, 0.2)
        @ moved(0.3 * 0.2, 0, 0),
    ),
}
ORIGIN = moved(0.3, 0, -0.2) @ turned(Z, 0.5) @ turned(Y, np.pi / 3) @ turned(X, 0.4)
FRAME = moved(0, 0.1, 0.3) @ turned(Y, -np.pi / 2)


@pytest.mark.parametrize("case", JOINTS)
def test_joints_move_as_textbooks_say(case: str) -> None:
    joint, q, expected = JOINTS[case]
    origin = (
        ""
        if "custom" in joint
        else "origin: {xyz: [l, 0, -0.2], rpy: [beta, pi/3, 0.5]}, "
    )
    mechanism = read(
        "symbols: {l: 0.3, beta: 0.4}\nbodies:\n"
        f"  - {{name: b, joint: {{name: j, {origin}{joint}}}, frame: {{xyz: [0, 0.1, l], rpy: [0, -pi/2, 0]}}}}"
    )
    before = ORIGIN if origin else np.eye(4)
    np.testing.assert_allclose(
        pose_of(mechanism, 0, q), before @ expected @ FRAME, atol=1e-12
    )
    again = read_description(
        json.dumps(write_description(mechanism)), "saved", ReadingOptions()
    )
    assert again == mechanism


PLANES = {
    "-z": (0, 0, -1),
    "x": X,
    "-y": (0, -1, 0),
    "[1, 1, 1]": (1, 1, 1),
    "[3, -4, 0]": (3, -4, 0),
}


@pytest.mark.parametrize("axis", PLANES)
def test_planar_joints_stay_in_their_plane(axis: str) -> None:
    mechanism = read(
        f"bodies: [{{name: b, joint: {{name: j, type: planar, axis: {axis}}}}}]"
    )
    normal = np.array(PLANES[axis], dtype=float) / np.linalg.norm(PLANES[axis])
    motions = mechanism.bodies[0].joint.motions
    q = dict(zip((m.name for m in motions), (0.1, 0.2, 0.7), strict=True))
    pose = pose_of(mechanism, 0, q)
    assert pose[:3, 3] @ normal == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(pose[:3, 3]) == pytest.approx(np.hypot(0.1, 0.2))
    np.testing.assert_allclose(pose[:3, :3], turned(normal, 0.7)[:3, :3], atol=1e-12)


def test_a_coupling_with_an_offset_starts_there() -> None:
    rows = "modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2}, {joint: prismatic}]\n"
    coupled = read(
        rows + "couplings: [{j2: 2*j1 + 0.4}, {j3: l*j2 - 0.1}]\nsymbols: {l: 0.3}"
    )
    # chains are followed to independent coordinates, and what is constant on the way is geometry
    assert [
        (c.coordinate, [(n, str(r)) for n, r in c.terms]) for c in coupled.couplings
    ] == [
        ("j2", [("j1", "2")]),
        ("j3", [("j1", "2*l")]),
    ]
    free = read(rows)
    for body, name, constant in ((1, "j2", 0.4), (2, "j3", 0.3 * 0.4 - 0.1)):
        full = pose_of(free, body, {name: 0.8 + constant})
        np.testing.assert_allclose(
            pose_of(coupled, body, {name: 0.8}), full, atol=1e-12
        )


# -- tables -----------------------------------------------------------------------------------------------------------

ROW = "joint: {joint}, alpha: 0.4, a: 0.2, theta: -pi/3, d: l"


@pytest.mark.parametrize("joint", ["revolute", "prismatic"])
def test_modified_rows_are_khalil_kleinfinger(joint: str) -> None:
    mechanism = read(
        f"symbols: {{l: 0.3}}\nmodified_dh: [{{{ROW.format(joint=joint)}, gamma: 0.6, b: 0.7}}]"
    )
    theta, d = (
        (-np.pi / 3 + 0.5, 0.3) if joint == "revolute" else (-np.pi / 3, 0.3 + 0.5)
    )
    khalil = (
        turned(Z, 0.6)
        @ moved(0, 0, 0.7)
        @ turned(X, 0.4)
        @ moved(0.2, 0, 0)
        @ turned(Z, theta)
        @ moved(0, 0, d)
    )
    np.testing.assert_allclose(pose_of(mechanism, 0, {"j1": 0.5}), khalil, atol=1e-12)


@pytest.mark.parametrize("joint", ["revolute", "prismatic"])
def test_standard_rows_end_at_the_far_end(joint: str) -> None:
    mechanism = read(
        f"symbols: {{l: 0.3}}\nstandard_dh: [{{{ROW.format(joint=joint)}}}]"
    )
    theta, d = (
        (-np.pi / 3 + 0.5, 0.3) if joint == "revolute" else (-np.pi / 3, 0.3 + 0.5)
    )
    classical = turned(Z, theta) @ moved(0, 0, d) @ moved(0.2, 0, 0) @ turned(X, 0.4)
    np.testing.assert_allclose(
        pose_of(mechanism, 0, {"j1": 0.5}), classical, atol=1e-12
    )


def test_a_table_may_be_a_tree() -> None:
    rows = (
        "",
        ", name: left",
        ", parent: 1, name: right",
        ", parent: left",
        ", parent: base",
        ", parent: 0",
    )
    mechanism = read(
        "modified_dh:\n" + "".join(f"  - {{joint: revolute{row}}}\n" for row in rows)
    )
    assert [body.parent for body in mechanism.bodies] == [-1, 0, 0, 1, -1, -1]
    assert mechanism.velocities == ("j1", "left", "right", "j4", "j5", "j6")


# -- the literal reading ----------------------------------------------------------------------------------------------


def test_literal_reading_of_some_or_all_angles() -> None:
    mechanism = read(
        "modified_dh: [{joint: revolute, alpha: 1.5708}, {joint: revolute, theta: -0.785, alpha: pi/3}]"
    )
    assert mechanism.reading is not None
    elements = [snap.element for snap in mechanism.reading.snaps]
    assert elements == ["modified_dh[0].alpha", "modified_dh[1].theta"]
    assert not mechanism.symbols
    assert set(mechanism.reading.literal().symbols) == {"alpha1", "theta2"}
    assert set(mechanism.reading.literal(elements[1:]).symbols) == {"theta2"}


@pytest.mark.parametrize("angle", ["pi/2000", "pi/7", "pi/2 + pi/2000", "2*beta"])
def test_exact_angles_are_never_snapped(angle: str) -> None:
    mechanism = read(
        f"symbols: {{beta: 0.0001}}\nmodified_dh: [{{joint: revolute, alpha: {angle}}}]"
    )
    assert mechanism.reading is not None
    assert not mechanism.reading.snaps
    values = {
        "pi/2000": np.pi / 2000,
        "pi/7": np.pi / 7,
        "pi/2 + pi/2000": np.pi / 2 + np.pi / 2000,
        "2*beta": 0.0002,
    }
    np.testing.assert_allclose(
        pose_of(mechanism, 0, {"j1": 0.0}), turned(X, values[angle]), atol=1e-15
    )


@pytest.mark.parametrize(
    ("rows", "exact"),
    [
        ("[[cos(a), 0, sin(a)], [0, 1, 0], [-sin(a), 0, cos(a)]]", True),
        ("[[sqrt(3)/2, -1/2, 0], [1/2, sqrt(3)/2, 0], [0, 0, 1]]", True),
        ("[[0.866, -0.5, 0], [0.5, 0.866, 0], [0, 0, 1]]", False),
        ("[[1, 0, 0], [0, 1, 0], [0, 0, -1]]", False),
        ("[[1, 0, 0], [0, cos(a), -sin(b)], [0, sin(b), cos(a)]]", False),
    ],
)
def test_rotations_by_rows_are_exact_rotations(rows: str, exact: bool) -> None:
    joint = "joint: {type: revolute, axis: z, origin: {rotation: " + rows + "}}"
    text = f"symbols: {{a: 0.3, b: 0.3}}\nbodies: [{{name: j, {joint}}}]"
    if exact:
        read(text)
    else:
        with pytest.raises(InputError, match="not exactly a rotation matrix"):
            read(text)


@pytest.mark.parametrize(
    ("angle", "value"),
    [("63/50", 1.26), ("pi/7", np.pi / 7), ("pi/2 + 0.3", np.pi / 2 + 0.3)],
)
def test_cosines_of_numbers_are_numbers(angle: str, value: float) -> None:
    """As lengths of sides they are those that decimals say."""
    text = (
        "echelon: 1\ngravity: [0, -9.81, 0]\nbodies:\n  - {{name: a, joint: {{type: revolute, axis: z}}}}\n"
        "  - {{name: b, parent: a, joint: {{type: revolute, axis: z, origin: {{xyz: ['{}', 0, 0]}}}}}}\n"
    )
    exact, decimal = (
        ec.base_parameters(ec.load(text.format(x)))
        for x in (f"0.3*cos({angle})", repr(float(0.3 * np.cos(value))))
    )
    np.testing.assert_allclose(exact.B_float(), decimal.B_float(), atol=1e-15)
