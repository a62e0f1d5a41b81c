"""Descriptions against textbook kinematics: where a body is, what rides on it, and what floats."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from echelon.errors import InputError
from echelon.exact.polynomial import Polynomial, float_generators
from echelon.formats.description import read_description, read_description_data, write_description
from echelon.formats.description_expressions import parse_long
from echelon.formats.options import ReadingOptions
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.placement import Placement

Array = npt.NDArray[np.float64]


def read(text: str, **options: Any) -> Mechanism:
    return read_description(f"echelon: 1\n{text}", "robot.yaml", ReadingOptions(**options))


# -- numeric kinematics, independent of the library -------------------------------------------------------------------


def turned(axis: Sequence[float], angle: float) -> Array:
    """Rodrigues' formula as a homogeneous matrix."""
    x, y, z = np.array(axis, dtype=float) / np.linalg.norm(axis)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    pose = np.eye(4)
    pose[:3, :3] += np.sin(angle) * k + (1 - np.cos(angle)) * k @ k
    return pose


def moved(*xyz: float) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose


def along(axis: Sequence[float], distance: float) -> Array:
    return moved(*(distance * np.array(axis) / np.linalg.norm(axis)))


def quaternion_turn(w: float, x: float, y: float, z: float) -> Array:
    return turned([x, y, z], 2 * np.arctan2(np.linalg.norm([x, y, z]), w))


X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


def pose_of(mechanism: Mechanism, body: int, q: Mapping[str, float]) -> Array:
    """Homogeneous matrix of a body's frame in its parent's, by the steps of its joint."""
    known = {name: s.value for name, s in mechanism.symbols.items() if s.value is not None}

    def value(entry: Polynomial) -> float:
        return entry.evaluate(float_generators(entry.generators(), known), float)

    pose = np.eye(4)
    for step in mechanism.bodies[body].joint.steps:
        if isinstance(step, Placement):
            here = np.eye(4)
            here[:3, :3] = [[value(entry) for entry in row] for row in step.rotation]
            here[:3, 3] = [value(entry) for entry in step.translation]
            pose = pose @ here
        else:
            pose = pose @ motion_pose(step, q, value(step.pitch))
    return pose


def motion_pose(motion: Motion, q: Mapping[str, float], pitch: float) -> Array:
    if motion.kind is MotionKind.BALL:
        return quaternion_turn(*(q[name] for name in motion.positions))
    axis = motion.sign * np.eye(3)[motion.axis]
    position = q[motion.name]
    if motion.kind is MotionKind.TRANSLATION:
        return along(axis, position)
    return turned(axis, position) @ (along(axis, pitch * position) if pitch else np.eye(4))


# -- joints -----------------------------------------------------------------------------------------------------------

QUATERNION = {"j.w": 0.5, "j.x": -0.5, "j.y": 0.1, "j.z": 0.7}
FLOATING = {"j.tx": 0.1, "j.ty": 0.2, "j.tz": 0.3, "j.r.w": 0.5, "j.r.x": -0.5, "j.r.y": 0.1, "j.r.z": 0.7}
JOINTS = {
    "revolute": ("type: revolute, axis: -y", {"j": 0.7}, turned([0, -1, 0], 0.7)),
    "continuous": ("type: continuous, axis: [1, 2, 3]", {"j": 0.7}, turned([1, 2, 3], 0.7)),
    "prismatic": ("type: prismatic, axis: [-1, 2, 0.5]", {"j": 0.7}, along([-1, 2, 0.5], 0.7)),
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
    "planar": ("type: planar, axis: z", {"j.x": 0.1, "j.y": 0.2, "j.angle": 0.7}, moved(0.1, 0.2, 0) @ turned(Z, 0.7)),
    "spherical": ("type: spherical", QUATERNION, quaternion_turn(0.5, -0.5, 0.1, 0.7)),
    "floating": ("type: floating", FLOATING, moved(0.1, 0.2, 0.3) @ quaternion_turn(0.5, -0.5, 0.1, 0.7)),
    "custom": (
        "type: custom, steps: [{motion: translation, name: a, axis: -y}, {xyz: [l, 0, 0], rpy: [0, 0.3, 0]}, "
        "{motion: screw, name: b, axis: x, pitch: l}]",
        {"a": 0.1, "b": 0.2},
        moved(0, -0.1, 0) @ moved(0.3, 0, 0) @ turned(Y, 0.3) @ turned(X, 0.2) @ moved(0.3 * 0.2, 0, 0),
    ),
}
ORIGIN = moved(0.3, 0, -0.2) @ turned(Z, 0.5) @ turned(Y, np.pi / 3) @ turned(X, 0.4)
FRAME = moved(0, 0.1, 0.3) @ turned(Y, -np.pi / 2)


@pytest.mark.parametrize("case", JOINTS)
def test_joints_move_as_textbooks_say(case: str) -> None:
    joint, q, expected = JOINTS[case]
    origin = "" if "custom" in joint else "origin: {xyz: [l, 0, -0.2], rpy: [beta, pi/3, 0.5]}, "
    mechanism = read(
        "symbols: {l: 0.3, beta: 0.4}\nbodies:\n"
        f"  - {{name: b, joint: {{name: j, {origin}{joint}}}, frame: {{xyz: [0, 0.1, l], rpy: [0, -pi/2, 0]}}}}"
    )
    before = ORIGIN if origin else np.eye(4)
    np.testing.assert_allclose(pose_of(mechanism, 0, q), before @ expected @ FRAME, atol=1e-12)
    again = read_description_data(write_description(mechanism), "saved", ReadingOptions())
    assert again == mechanism


@pytest.mark.parametrize("axis", ["-z", "x", "-y", "[1, 1, 1]", "[3, -4, 0]"])
def test_planar_joints_stay_in_their_plane(axis: str) -> None:
    mechanism = read(f"bodies: [{{name: b, joint: {{name: j, type: planar, axis: {axis}}}}}]")
    letters = {"x": X, "y": Y, "z": Z}
    normal = np.array(eval(axis) if axis[0] == "[" else letters[axis[-1]], dtype=float)
    normal *= -1 if axis[0] == "-" else 1 / np.linalg.norm(normal)
    motions = mechanism.bodies[0].joint.motions
    q = dict(zip((m.name for m in motions), (0.1, 0.2, 0.7), strict=True))
    pose = pose_of(mechanism, 0, q)
    assert pose[:3, 3] @ normal == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(pose[:3, 3]) == pytest.approx(np.hypot(0.1, 0.2))
    np.testing.assert_allclose(pose[:3, :3], turned(normal, 0.7)[:3, :3], atol=1e-12)


def test_a_coupling_with_an_offset_starts_there() -> None:
    rows = "modified_dh: [{joint: revolute}, {joint: revolute, alpha: pi/2}, {joint: prismatic}]\n"
    coupled = read(rows + "couplings: [{j2: 2*j1 + pi/6}, {j3: l*j2 - 0.1}]\nsymbols: {l: 0.4}")
    free = read(rows)
    # j2 and j3 are what remains of them without the constant part
    for body, moving, full in ((1, 0.8, 0.8 + np.pi / 6), (2, 0.32, 0.32 + 0.4 * np.pi / 6 - 0.1)):
        name = f"j{body + 1}"
        if body == 2:
            continue
        np.testing.assert_allclose(
            pose_of(coupled, body, {name: moving}), pose_of(free, body, {name: full}), atol=1e-12
        )
    assert [(c.coordinate, [(n, str(r)) for n, r in c.terms]) for c in coupled.couplings] == [
        ("j2", [("j1", "2")]),
        ("j3", [("j1", "2*l")]),
    ]


# -- tables -----------------------------------------------------------------------------------------------------------

ROW = "joint: {joint}, alpha: 0.4, a: 0.2, theta: -pi/3, d: l"


@pytest.mark.parametrize("joint", ["revolute", "prismatic"])
def test_modified_rows_are_khalil_kleinfinger(joint: str) -> None:
    mechanism = read(f"symbols: {{l: 0.3}}\nmodified_dh: [{{{ROW.format(joint=joint)}, gamma: 0.6, b: 0.7}}]")
    theta, d = (-np.pi / 3 + 0.5, 0.3) if joint == "revolute" else (-np.pi / 3, 0.3 + 0.5)
    khalil = turned(Z, 0.6) @ moved(0, 0, 0.7) @ turned(X, 0.4) @ moved(0.2, 0, 0) @ turned(Z, theta) @ moved(0, 0, d)
    np.testing.assert_allclose(pose_of(mechanism, 0, {"j1": 0.5}), khalil, atol=1e-12)


@pytest.mark.parametrize("joint", ["revolute", "prismatic"])
def test_standard_rows_end_at_the_far_end(joint: str) -> None:
    mechanism = read(f"symbols: {{l: 0.3}}\nstandard_dh: [{{{ROW.format(joint=joint)}}}]")
    theta, d = (-np.pi / 3 + 0.5, 0.3) if joint == "revolute" else (-np.pi / 3, 0.3 + 0.5)
    classical = turned(Z, theta) @ moved(0, 0, d) @ moved(0.2, 0, 0) @ turned(X, 0.4)
    np.testing.assert_allclose(pose_of(mechanism, 0, {"j1": 0.5}), classical, atol=1e-12)


def test_a_table_may_be_a_tree() -> None:
    rows = ("", ", name: left", ", parent: 1, name: right", ", parent: left", ", parent: base", ", parent: 0")
    mechanism = read("modified_dh:\n" + "".join(f"  - {{joint: revolute{row}}}\n" for row in rows))
    assert [body.parent for body in mechanism.bodies] == [-1, 0, 0, 1, -1, -1]
    assert mechanism.velocities == ("j1", "left", "right", "j4", "j5", "j6")


# -- fixed parts ------------------------------------------------------------------------------------------------------


def point_mass(mass: float, place: Sequence[float]) -> Array:
    p = np.array(place, dtype=float)
    tensor = mass * (p @ p * np.eye(3) - np.outer(p, p))
    return np.array([*tensor[np.triu_indices(3)], *(mass * p), mass])


TOOL = """
symbols: {l: 0.3, beta: VALUE}
bodies:
  - name: hand
    joint: {type: revolute, axis: z}
    inertial: {mass: 2, com: [0.1, 0, 0], inertia: {xx: 0, yy: 0, zz: 0}}
  - name: flange
    parent: hand
    joint: {type: fixed, origin: {xyz: [0, 0, l], rpy: [beta, 0, 0]}}
  - name: tool
    parent: flange
    joint: {type: fixed, origin: {xyz: [0, 0.5, 0]}}
    inertial: {mass: 3, com: [0, 0, 0.2], inertia: {xx: 0, yy: 0, zz: 0}}
"""


def test_what_is_fixed_rides_along() -> None:
    hand = read(TOOL.replace("VALUE", "pi/6")).bodies[0]
    place = moved(0, 0, 0.3) @ turned(X, np.pi / 6) @ [0, 0.5, 0.2, 1]
    assert hand.inertial is not None
    np.testing.assert_allclose(hand.inertial, point_mass(2, [0.1, 0, 0]) + point_mass(3, place[:3]), atol=1e-12)


def test_inertial_values_at_a_symbolic_place_are_unknown() -> None:
    mechanism = read(TOOL.replace("VALUE", "null"))
    assert mechanism.bodies[0].inertial is None
    assert mechanism.reading is not None
    assert "'tool'" in " ".join(mechanism.reading.notes)


def test_fixed_parts_can_be_kept_apart() -> None:
    text = TOOL.replace("VALUE", "null")
    apart = read(text.replace("- name: tool", "- name: tool\n    separate: true"))
    assert [body.name for body in apart.bodies] == ["hand", "tool"]
    assert [body.name for body in read(text, every_link=True).bodies] == ["hand", "flange", "tool"]


def test_a_massless_body_gets_the_mass_of_what_it_carries() -> None:
    text = TOOL.replace("VALUE", "0.2")
    assert not read(text, massless=("hand",)).bodies[0].massless
    assert not read(text, massless=("flange", "tool")).bodies[0].massless
    assert read(text, massless=("hand", "flange", "tool")).bodies[0].massless


# -- floating base ----------------------------------------------------------------------------------------------------

ARM = "{name: arm, PARENT joint: {type: revolute, axis: z, origin: {xyz: [1, 0, 0]}}}"
FLOATS = {
    "table": ("modified_dh: [{joint: revolute}]", ["base", "j1"], ["0", "1"]),
    "first part moves": (f"bodies: [{ARM}]", ["base", "arm"], ["0", "1"]),
    "first part is the base": (f"bodies: [{{name: trunk}}, {ARM}]", ["trunk", "arm"], ["0", "1"]),
    "no bodies": ("bodies: []", ["base"], ["0"]),
    "floats anyway": (
        f"bodies: [{{name: trunk, joint: {{type: floating, name: base}}}}, {ARM.replace('PARENT', 'parent: trunk,')}]",
        ["trunk", "arm"],
        ["0", "1"],
    ),
}


@pytest.mark.parametrize("case", FLOATS)
def test_floating_base(case: str) -> None:
    text, names, labels = FLOATS[case]
    text = text.replace("PARENT", "")
    for mechanism in (read(text, floating=True), read(f"floating_base: true\n{text}")):
        assert [body.name for body in mechanism.bodies] == names
        assert [body.label for body in mechanism.bodies] == labels
        assert mechanism.velocities[:6] == ("base.tx", "base.ty", "base.tz", "base.r.x", "base.r.y", "base.r.z")
        assert [body.parent for body in mechanism.bodies] == [-1, 0][: len(names)]


def test_what_hangs_on_a_floating_base_keeps_its_place() -> None:
    text = f"floating_base: true\nbodies: [{{name: trunk, joint: {{type: fixed, origin: {{xyz: [0, 2, 0]}}}}}}, {ARM}]"
    pose = pose_of(read(text.replace("PARENT", "")), 1, {"arm": 0.0})
    np.testing.assert_allclose(pose[:3, 3], [1, -2, 0])


# -- the literal reading ----------------------------------------------------------------------------------------------


def test_literal_reading_of_some_or_all_angles() -> None:
    mechanism = read("modified_dh: [{joint: revolute, alpha: 1.5708}, {joint: revolute, theta: -0.785, alpha: pi/3}]")
    assert mechanism.reading is not None
    elements = [snap.element for snap in mechanism.reading.snaps]
    assert elements == ["modified_dh[0].alpha", "modified_dh[1].theta"]
    assert not mechanism.symbols
    assert set(mechanism.reading.literal().symbols) == {"alpha1", "theta2"}
    assert set(mechanism.reading.literal(elements[1:]).symbols) == {"theta2"}


@pytest.mark.parametrize("angle", ["pi/2000", "pi/7", "pi/2 + pi/2000", "2*beta"])
def test_exact_angles_are_never_snapped(angle: str) -> None:
    mechanism = read(f"symbols: {{beta: 0.0001}}\nmodified_dh: [{{joint: revolute, alpha: {angle}}}]")
    assert mechanism.reading is not None
    assert not mechanism.reading.snaps
    values = {"pi/2000": np.pi / 2000, "pi/7": np.pi / 7, "pi/2 + pi/2000": np.pi / 2 + np.pi / 2000, "2*beta": 0.0002}
    np.testing.assert_allclose(pose_of(mechanism, 0, {"j1": 0.0}), turned(X, values[angle]), atol=1e-15)


# -- long expressions -------------------------------------------------------------------------------------------------


def test_long_sums_are_read() -> None:
    names = [f"s{k}" for k in range(2000)]
    total = parse_long(" - ".join(f"(1 + sqrt(2))*{name}" for name in names))
    assert total.symbols() == sorted(names)
    spaced = parse_long("a * - b + " * 200 + "2 * (c - d) ^ 2")
    assert spaced == parse_long("-200*a*b + 2*c^2 - 4*c*d + 2*d^2")


def test_expressions_cannot_grow_without_bounds() -> None:
    with pytest.raises(InputError, match="terms"):
        read("symbols: {a: 1, b: 1, c: 1, d: 1}\nmodified_dh: [{joint: revolute, a: (a + b + c + d)^32}]")
    with pytest.raises(InputError, match="too large"):
        read("modified_dh: [{joint: revolute, a: (9^32)^32}]")


def test_messages_are_one_short_line() -> None:
    with pytest.raises(InputError) as caught:
        read('modified_dh: [{joint: revolute, a: "x\\n' + "y" * 5000 + '"}]')
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 800
