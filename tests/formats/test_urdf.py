"""The URDF reader: what it reads, and the one clear error for everything it cannot."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.algebra.exact.polynomial import float_generators
from echelon.robot.joint import MotionKind, Placement

INERTIAL = (
    "<inertial><origin xyz='0.1 0 0' rpy='0 0 0'/><mass value='2'/>"
    "<inertia ixx='1' ixy='0' ixz='0' iyy='2' iyz='0' izz='3'/></inertial>"
)


def link(name: str, content: str = "") -> str:
    return f"<link name='{name}'>{content}</link>"


def joint(
    name: str, parent: str, child: str, content: str = "", kind: str = "revolute"
) -> str:
    return f"<joint name='{name}' type='{kind}'><parent link='{parent}'/><child link='{child}'/>{content}</joint>"


def origin(xyz: str = "0 0 0", rpy: str = "0 0 0") -> str:
    return f"<origin xyz='{xyz}' rpy='{rpy}'/>"


def robot(*parts: str) -> str:
    return f"<robot name='r'>{''.join(parts)}</robot>"


def arm(content: str = "", kind: str = "revolute") -> str:
    """Base, shoulder that turns about z, and a second joint with the given content."""
    return robot(
        link("base"), link("a"), link("b"), joint("j1", "base", "a", "<axis xyz='0 0 1'/>"),
        joint("j2", "a", "b", content, kind),
    )  # fmt: skip


@pytest.fixture
def read(tmp_path: Path):  # type: ignore[no-untyped-def]
    def load(text: str | bytes, **options: object) -> ec.Mechanism:
        file = tmp_path / "robot.urdf"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return ec.load(file, **options)  # type: ignore[arg-type]

    return load


def placement(mechanism: ec.Mechanism, body: int) -> Placement:
    first = mechanism.bodies[body].joint.steps[0]
    assert isinstance(first, Placement)
    return first


# -- what is read ----------------------------------------------------------------------------------


def test_numbers_stay_exact_and_equal_magnitudes_share_a_symbol(read) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm(origin("0.333 -0.333 1e-1")))
    assert [str(x) for x in placement(mechanism, 1).translation] == [
        "px2",
        "-px2",
        "pz2",
    ]
    assert (mechanism.symbols["px2"].exact, mechanism.symbols["pz2"].exact) == (
        "0.333",
        "0.1",
    )
    assert [s.meaning for s in mechanism.symbols.values()] == [
        "joint 'j2' x",
        "joint 'j2' z",
    ]
    numeric = read(arm(origin("0.333 -0.333 1e-1")), symbolic=False)
    assert [x.number for x in placement(numeric, 1).translation] == [
        Fraction(333, 1000), Fraction(-333, 1000), Fraction(1, 10),
    ]  # fmt: skip


@pytest.mark.parametrize("text", ["1.5708", "1.57", "1.570796326794897", "-4.712389"])
def test_rounded_right_angle(read, text: str) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm(origin(rpy=f"{text} 0 0")))
    assert [str(x) for x in placement(mechanism, 1).rotation[1]] == ["0", "0", "-1"]
    assert mechanism.reading is not None
    assert all(snap.intended in ("90°", "-270°") for snap in mechanism.reading.snaps)


def test_snapping_can_be_switched_off(read) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm(origin("1 1e-9 0", "1.5708 0 0")), snap_tolerance=0)
    assert mechanism.reading is not None
    assert mechanism.reading.snaps == ()
    assert set(mechanism.symbols) == {"px2", "py2", "roll2"}
    snapped = read(arm(origin("1 1e-9 0", "1.5708 0 0")))
    assert {snap.element for snap in snapped.reading.snaps} == {
        "joint 'j2' origin roll",
        "joint 'j2' y",
    }
    assert set(snapped.reading.literal().symbols) == {
        "px2",
        "roll2",
    }  # 1e-9 of the size is rounding, 1.5708 is not


@pytest.mark.parametrize(
    ("axis", "expected"),
    [
        ("0 0 2", (2, 1)),
        ("0 -0.5 0", (1, -1)),
        ("1 1e-8 0", (0, 1)),
        ("0 -1 4e-8", (1, -1)),
    ],
)
def test_axis_is_normalised_and_snapped(
    read, axis: str, expected: tuple[int, int]
) -> None:  # type: ignore[no-untyped-def]
    (motion,) = read(arm(f"<axis xyz='{axis}'/>")).bodies[1].joint.motions
    assert (motion.axis, motion.sign) == expected


def test_diagonal_axis_is_exact(read) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm("<axis xyz='1 1 0'/>"))
    assert not mechanism.symbols
    assert str(placement(mechanism, 1).rotation[0][2]) == "sqrt(2)/2"


def test_default_axis_is_x(read) -> None:  # type: ignore[no-untyped-def]
    (motion,) = read(arm()).bodies[1].joint.motions
    assert (motion.axis, motion.sign) == (0, 1)


@pytest.mark.parametrize(
    ("kind", "count"),
    [("continuous", 1), ("prismatic", 1), ("planar", 3), ("floating", 6)],
)
def test_joint_types(read, kind: str, count: int) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm(kind=kind))
    assert mechanism.degrees_of_freedom == 1 + count
    assert mechanism.bodies[1].joint.kind == kind


def test_fixed_links_are_lumped_or_kept(read) -> None:  # type: ignore[no-untyped-def]
    text = robot(
        link("base"), link("a", INERTIAL), link("tool", INERTIAL), link("b"),
        joint("j1", "base", "a", "<axis xyz='0 0 1'/>"),
        joint("f", "a", "tool", origin("0 0 1", "0 0 1.57079632679"), "fixed"),
        joint("j2", "tool", "b", origin("0 1 0")),
    )  # fmt: skip
    lumped = read(text)
    assert [b.name for b in lumped.bodies] == ["a", "b"]
    # b sits at Rz(90°)·(0, 1, 0) + (0, 0, 1)
    assert [str(x) for x in placement(lumped, 1).translation] == ["-px2", "0", "px2"]
    # the tool's x axis is a's y axis; both have mass 2 and Ixx 1, Iyy 2, Izz 3 about centres 0.1 along their x
    expected = [
        1 + 2 + 2 * 1 + 2 * 0.01,
        0,
        0,
        2 + 0.02 + 1 + 2,
        -2 * 0.1,
        3 + 0.02 + 3 + 0.02,
        0.2,
        0.2,
        2,
        4,
    ]
    np.testing.assert_allclose(lumped.bodies[0].inertial, expected, atol=1e-9)
    assert lumped.bodies[1].inertial is None
    kept = read(text, keep_fixed_links=True)
    assert [b.name for b in kept.bodies] == ["base", "a", "tool", "b"]
    assert ec.base_structure(kept).rank == ec.base_structure(lumped).rank


def test_inertia_turns_with_its_frame(read) -> None:  # type: ignore[no-untyped-def]
    """Centre of mass (0.1, 0.2, 0), mass 2, and the principal axes 1, 2, 3 turned by roll 90°, then yaw 90°."""
    frame = INERTIAL.replace(
        "xyz='0.1 0 0' rpy='0 0 0'",
        "xyz='0.1 0.2 0' rpy='1.5707963267948966 0 1.5707963267948966'",
    )
    (body,) = read(
        robot(link("base"), link("a", frame), joint("j", "base", "a"))
    ).bodies
    # x of the inertial frame is y of the link, y is z, z is x
    central, moment, mass = (3, 0, 0, 1, 0, 2), (0.2, 0.4, 0), 2
    steiner = (2 * 0.04, -2 * 0.02, 0, 2 * 0.01, 0, 2 * 0.05)
    expected = [*(c + s for c, s in zip(central, steiner, strict=True)), *moment, mass]
    np.testing.assert_allclose(body.inertial, expected, atol=1e-14)


@pytest.mark.parametrize(
    ("axis", "slides", "sign"),
    [("0 0 1", "xy", 1), ("1 0 0", "yz", 1), ("0 1 0", "zx", 1), ("0 0 -2", "xy", -1)],
)
def test_planar_joint_slides_across_its_axis_and_turns_about_it(
    read, axis: str, slides: str, sign: int
) -> None:  # type: ignore[no-untyped-def]
    joint = read(arm(f"<axis xyz='{axis}'/>", "planar")).bodies[1].joint
    assert [m.kind for m in joint.motions] == [
        MotionKind.TRANSLATION,
        MotionKind.TRANSLATION,
        MotionKind.ROTATION,
    ]
    assert [m.name for m in joint.motions] == [
        f"j2.{slides[0]}",
        f"j2.{slides[1]}",
        "j2.angle",
    ]
    normal = 3 - sum("xyz".index(c) for c in slides)
    mounting = (
        joint.steps[0].rotation
        if isinstance(joint.steps[0], Placement)
        else Placement().rotation
    )
    assert joint.motions[2].axis == normal
    assert mounting[normal][normal].number == sign


def test_axis_in_a_general_direction_keeps_its_value(read) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm("<axis xyz='1 2 -2'/>"), snap_tolerance=0)
    values = {name: symbol.value for name, symbol in mechanism.symbols.items()}
    column = [placement(mechanism, 1).rotation[row][2] for row in range(3)]
    found = [
        x.evaluate(float_generators(x.generators(), values), float) for x in column
    ]
    np.testing.assert_allclose(found, np.array([1, 2, -2]) / 3, rtol=1e-15)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-8-sig"])
def test_other_encodings_of_xml(read, encoding: str) -> None:  # type: ignore[no-untyped-def]
    text = robot(link("bäse"), link("a"), joint("j", "bäse", "a"))
    assert read(text.encode(encoding)).bodies == read(text).bodies


def test_floating_base(read) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm(), floating=True)
    assert [b.label for b in mechanism.bodies] == ["0", "1", "2"]
    assert mechanism.velocities[:6] == (
        "base.tx",
        "base.ty",
        "base.tz",
        "base.r.x",
        "base.r.y",
        "base.r.z",
    )
    assert mechanism.bodies[0].joint.motions[3].kind is MotionKind.BALL
    assert ec.base_structure(mechanism).rank == 24


def test_mimics_follow_their_leader(read) -> None:  # type: ignore[no-untyped-def]
    text = robot(
        *(link(n) for n in "abcd"), joint("p", "a", "b"),
        joint("q", "b", "c", "<mimic joint='p' multiplier='-2' offset='0.5'/>"),
        joint("r", "c", "d", "<mimic joint='q' multiplier='0.5'/>"),
    )  # fmt: skip
    mechanism = read(text)
    assert mechanism.velocities == ("p",)
    assert {
        c.coordinate: [(n, str(r)) for n, r in c.terms] for c in mechanism.couplings
    } == {
        "q": [("p", "-2")],
        "r": [("p", "-1")],
    }
    assert {s.name: s.exact for s in mechanism.symbols.values()} == {
        "offset2": "0.5",
        "offset3": "0.25",
    }
    assert read(text, independent_mimics=True).velocities == ("p", "q", "r")


def test_a_mimic_that_says_no_more_moves_alike(read) -> None:  # type: ignore[no-untyped-def]
    (coupling,) = read(arm("<mimic joint='j1'/>")).couplings
    assert [(name, str(ratio)) for name, ratio in coupling.terms] == [("j1", "1")]


def test_mimic_on_a_fixed_joint_is_ignored_with_a_note(read) -> None:  # type: ignore[no-untyped-def]
    mechanism = read(arm("<mimic joint='j1'/>", "fixed"))
    assert any("j2" in note and "fixed" in note for note in mechanism.reading.notes)


def test_massless_link(read) -> None:  # type: ignore[no-untyped-def]
    assert len(read(arm(), massless=("a",)).parameters) == 10
    with pytest.raises(ec.InputError, match="no link 'ghost'"):
        read(arm(), massless=("ghost",))


@pytest.mark.parametrize(
    ("gravity", "expected"),
    [
        ("file", "[0, 0, -981/100]"),
        ("generic", "[gx, gy, gz]"),
        (("0", "-g", 0), "[0, -g, 0]"),
        ("1,2,3", "[1, 2, 3]"),
    ],
)
def test_gravity(read, gravity: object, expected: str) -> None:  # type: ignore[no-untyped-def]
    assert str(list(read(arm(), gravity=gravity).gravity)) == expected


@pytest.mark.parametrize("gravity", [None, "none", (0, 0, 0)])
def test_no_gravity(read, gravity: object) -> None:  # type: ignore[no-untyped-def]
    assert read(arm(), gravity=gravity).gravity is None


def test_order_of_elements_does_not_matter(read) -> None:  # type: ignore[no-untyped-def]
    parts = [
        link("base"),
        link("a"),
        link("b"),
        joint("j1", "base", "a"),
        joint("j2", "a", "b", origin("0 1 0")),
    ]
    assert read(robot(*parts)).bodies == read(robot(*reversed(parts))).bodies


# -- what is refused -------------------------------------------------------------------------------

A, B, C = link("a"), link("b"), link("c")
BOMB = '<!DOCTYPE r [<!ENTITY x "boom"><!ENTITY y "&x;&x;&x;">]><robot name="&y;"><link name="a"/></robot>'
EXTERNAL = '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="r"><link name="&x;"/></robot>'

REFUSED = {
    "malformed": ("<robot><link name='a'></robot>", "not well-formed"),
    "bomb": (BOMB, "entities are not accepted"),
    "external": (EXTERNAL, "entities are not accepted"),
    "empty file": ("", "empty"),
    "garbage": (b"\x00\xff\xfe<robot", "not well-formed"),
    "wrong encoding": ('<?xml version="1.0" encoding="UTF-16"?><robot/>', "encoding"),
    "unknown encoding": ('<?xml version="1.0" encoding="klingon"?><robot/>', "unknown encoding: klingon"),
    "broken characters": (b"<robot name='\xe9'/>", "not well-formed"),
    "wrong root": ("<page/>", "<page>"),
    "xacro": ("<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:include filename='x'/></robot>", "xacro"),
    "empty robot": (robot(), "no links"),
    "unnamed": (robot("<link/>"), "no name"),
    "unknown type": (arm(kind="screw"), "joint 'j2': unknown joint type 'screw'"),
    "not a number": (arm(origin("0 x 0")), "joint 'j2' origin xyz: 'x'"),
    "nan": (arm(origin("0 nan 0")), "'nan'"),
    "infinite": (arm(origin(rpy="inf 0 0")), "joint 'j2' origin rpy: 'inf'"),
    "overflow": (arm(origin("1e999 0 0")), "joint 'j2' origin xyz: '1e999' is beyond the range"),
    "axis overflow": (arm("<axis xyz='0 0 1e999'/>"), "joint 'j2' axis: '1e999'"),
    "mass overflow": (robot(link("a", INERTIAL.replace("'2'", "'1e999'", 1))), "link 'a' inertial mass: '1e999'"),
    "not a mass": (robot(link("a", INERTIAL.replace("'2'", "'nan'", 1))), "link 'a' inertial mass: 'nan'"),
    "expression": (arm(origin("${length} 0 0")), "joint 'j2' origin xyz: '${length}'"),
    "underscore": (arm(origin("1_0 0 0")), "'1_0'"),
    "two numbers": (arm(origin("0 0")), "needs three numbers"),
    "no type": (arm().replace(" type='revolute'", ""), "joint 'j1': the attribute 'type' is missing"),
    "zero axis": (arm("<axis xyz='0 0 0'/>"), "joint 'j2': the axis is zero"),
    "unknown parent": (robot(A, B, joint("j", "z", "b")), "joint 'j': parent link 'z' does not exist"),
    "unknown child": (robot(A, joint("j", "a", "z")), "child link 'z' does not exist"),
    "no child": (robot(A, "<joint name='j' type='fixed'><parent link='a'/></joint>"), "joint 'j': needs <child"),
    "own parent": (robot(A, B, joint("i", "a", "b"), joint("j", "a", "a")), "its own parent"),
    "two parents": (robot(A, B, C, joint("i", "a", "c"), joint("j", "b", "c")), "already has joint 'i'"),
    "cycle": (robot(A, B, joint("i", "a", "b"), joint("j", "b", "a")), "cycle"),
    "cycle beside a root": (robot(A, B, C, joint("i", "b", "c"), joint("j", "c", "b")), "'b', 'c' form a cycle"),
    "two roots": (robot(A, B), "2 root links, 'a', 'b'"),
    "link twice": (robot(A, A), "link 'a': this name occurs twice"),
    "joint twice": (robot(A, B, C, joint("j", "a", "b"), joint("j", "b", "c")), "joint 'j': this name occurs twice"),
    "mimic itself": (arm("<mimic joint='j2'/>"), "mimics itself"),
    "mimic nobody": (arm("<mimic multiplier='2'/>"), "joint 'j2' mimic: needs joint="),
    "mimic of a fixed joint": (
        robot(A, B, C, joint("f", "a", "b", kind="fixed"), joint("j", "b", "c", "<mimic joint='f'/>")),
        "joint 'j' mimic: joint 'f' is fixed",
    ),
    "mimic offset": (arm("<mimic joint='j1' offset='inf'/>"), "joint 'j2' mimic: 'inf'"),
    "mimic missing": (arm("<mimic joint='jx'/>"), "'jx', which does not exist"),
    "mimic multiplier": (arm("<mimic joint='j1' multiplier='two'/>"), "'two'"),
    "mimic circle": (
        robot(A, B, C, joint("i", "a", "b", "<mimic joint='j'/>"), joint("j", "b", "c", "<mimic joint='i'/>")),
        "circle",
    ),
    "no mass": (robot(link("a", "<inertial/>")), "link 'a' inertial mass: the attribute 'value' is missing"),
    "inertia": (
        robot(link("a", "<inertial><mass value='1'/><inertia ixx='1'/></inertial>")), "'ixy' is missing",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(read, case: str) -> None:  # type: ignore[no-untyped-def]
    text, message = REFUSED[case]
    with pytest.raises(ec.InputError) as caught:
        read(text)
    assert message in str(caught.value)
    assert Path(caught.value.source or "").name == "robot.urdf"
    assert len(str(caught.value).splitlines()) == 1


def test_missing_file_and_directory(tmp_path: Path) -> None:
    with pytest.raises(ec.InputError, match="no such file"):
        ec.load(tmp_path / "none.urdf")
    with pytest.raises(
        ec.InputError, match=f"{tmp_path.name}: cannot be read: Is a directory"
    ):
        ec.load(tmp_path)
    (tmp_path / "robot.stl").write_text("solid")
    with pytest.raises(ec.InputError, match="unknown format"):
        ec.load(tmp_path / "robot.stl")


@pytest.mark.parametrize("tolerance", [-1, 0.5, float("nan")])
def test_tolerance_is_checked(read, tolerance: float) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ec.InputError, match="tolerance"):
        read(arm(), snap_tolerance=tolerance)


@pytest.mark.parametrize("gravity", ["1,2", "sideways", ("a/b", 0, 0)])
def test_gravity_is_checked(read, gravity: object) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ec.InputError, match="gravity"):
        read(arm(), gravity=gravity)
