"""Loops of files: frames against forward kinematics and MuJoCo, coordinates, round trips, and every mistake."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
import yaml

import echelon as ec
from echelon.formats.robot_file import RobotFile
from echelon.formats.schema.robot_schema import json_schema
from echelon.formats.snapping import ReadingOptions
from echelon.formats.writers.description_writer import write_description
from echelon.robot.closure import ClosureKind
from echelon.robot.joint import GROUND
from echelon.robot.mechanism import Mechanism
from support.descriptions import read_description
from support.loop_frames import frames, matrix, position, residual
from support.paths import ROOT
from support.selection import one_in, slow_unless
from support.textbook_poses import Array, turned

EXAMPLES = sorted((ROOT / "examples/loops").iterdir())


def read(text: str, name: str = "robot.yaml", **options: Any) -> Mechanism:
    return RobotFile.of(text.encode(), name).mechanism(ReadingOptions(**options))


# -- numbers -----------------------------------------------------------------------------------------------------------


def closed(mechanism: Mechanism) -> dict[str, float]:
    """A closed position near the stated one, by Newton's method."""
    names = list(mechanism.positions)
    x = np.array(
        [position(mechanism, dict(mechanism.assembly))[name] for name in names]
    )

    def value(x: Array) -> Array:
        return residual(mechanism, dict(zip(names, x, strict=True)))

    for _ in range(20):
        step = 1e-6 * np.eye(len(x))
        jacobian = np.array([(value(x + d) - value(x - d)) / 2e-6 for d in step]).T
        x = x - np.linalg.lstsq(jacobian, value(x), rcond=1e-9)[0]
    return dict(zip(names, x, strict=True))


@pytest.fixture
def unclosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Frames are read; whether they can meet is not asked."""
    monkeypatch.setattr("echelon.loops.close", lambda mechanism, *_, **__: mechanism)


# -- descriptions: frames ----------------------------------------------------------------------------------------------

PAIR = """
echelon: 1
symbols: {a: 0.7, l: 0.2}
bodies:
  - {name: one, joint: {type: floating, origin: {xyz: [0.1, l, 0.3], rpy: [0.3, a, 1]}}}
  - {name: arm, parent: one, joint: {type: revolute, axis: [1, 2, 3], origin: {xyz: [l, 0, 1], rpy: [pi/2, 0, a]}}}
  - {name: two, joint: {type: floating, origin: {xyz: [0.5, 0, 0.2], rpy: [0, 2*a, 0.5]}}}
loops:
"""


@pytest.mark.parametrize("kind", one_in(3, ClosureKind))
def test_the_second_frame_is_where_the_first_one_is_at_zero(kind: ClosureKind) -> None:
    loop = f"  - {{joint: {kind.value}, connects: [arm, two], at: {{xyz: [0.1, 0.2, l], rpy: [a, 0.2, 0]}}}}\n"
    mechanism = read(PAIR + loop)
    (closure,) = mechanism.closures
    assert (closure.name, closure.kind, closure.first, closure.second) == (
        "loop1",
        kind,
        1,
        2,
    )
    first, second = frames(mechanism, 0, {})
    np.testing.assert_allclose(first[:3, 3], second[:3, 3], atol=1e-13)
    if kind.directions:
        np.testing.assert_allclose(first, second, atol=1e-13)
    np.testing.assert_allclose(residual(mechanism, {}), 0, atol=1e-13)
    assert mechanism.degrees_of_freedom == 13 - (6 - kind.freedoms)


@pytest.mark.parametrize(
    ("word", "kind"),
    [("points", ClosureKind.SPHERICAL), ("axes", ClosureKind.CYLINDRICAL)],
)
def test_other_words(word: str, kind: ClosureKind) -> None:
    assert (
        read(PAIR + f"  - {{joint: {word}, connects: [arm, two]}}\n").closures[0].kind
        is kind
    )


@pytest.mark.usefixtures("unclosed")
def test_both_frames_as_stated() -> None:
    loop = "  - {joint: universal, connects: [two, arm], at: {xyz: [l, 0, 1]}, on_second: {rpy: [0, 0, pi/6]}}\n"
    (closure,) = read(PAIR + loop).closures
    assert (closure.first, closure.second) == (2, 1)
    assert [str(e) for e in closure.first_frame.translation] == ["l", "0", "1"]
    assert [str(e) for e in closure.second_frame.rotation[0]] == [
        "sqrt(3)/2",
        "-1/2",
        "0",
    ]


@pytest.mark.usefixtures("unclosed")
@pytest.mark.parametrize("axis", ["x", "-x", "y", "-y", "z", "-z", "[1, -2, 0.5]"])
@pytest.mark.parametrize("second", ["", ", on_second: {rpy: [0, 0, 0.4]}"])
def test_the_axis_is_z_of_both_frames(axis: str, second: str) -> None:
    mechanism = read(
        PAIR
        + f"  - {{joint: revolute, connects: [one, two], at: {{rpy: [0.2, 0, 0]}}, axis: {axis}{second}}}\n"
    )
    direction = (
        np.array(yaml.safe_load(axis))
        if "[" in axis
        else np.eye(3)["xyz".index(axis[-1])]
    )
    direction = (
        direction / np.linalg.norm(direction) * (-1 if axis.startswith("-") else 1)
    )
    z = matrix(mechanism, mechanism.closures[0].first_frame)[:3, 2]
    np.testing.assert_allclose(
        z, turned([1, 0, 0], 0.2)[:3, :3] @ direction, atol=1e-12
    )
    if second:
        z = matrix(mechanism, mechanism.closures[0].second_frame)[:3, 2]
        np.testing.assert_allclose(
            z, turned([0, 0, 1], 0.4)[:3, :3] @ direction, atol=1e-12
        )


FIXED = """
echelon: 1
{floating}
bodies:
  - {{name: post, joint: {{type: fixed, origin: {{xyz: [0, 0, 1]}}}}}}
  - {{name: arm, parent: post, joint: {{type: universal, axis: x, axis2: y}}}}
  - {{name: tool, parent: arm, joint: {{type: fixed, origin: {{xyz: [0.5, 0, 0], rpy: [0, 0, pi/2]}}}}}}
  - {{name: slide, joint: {{type: planar, axis: z}}}}
loops: [{{joint: spherical, connects: [{first}, {second}], at: {{xyz: [0.1, 0, 0]}}}}]
"""


def test_fixed_parts_ride_on_their_bodies() -> None:
    mechanism = read(FIXED.format(floating="", first="tool", second="slide"))
    (closure,) = mechanism.closures
    assert (closure.first, closure.second) == (0, 1)
    assert [str(e) for e in closure.first_frame.translation] == ["1/2", "1/10", "0"]
    assert [str(e) for e in closure.second_frame.translation] == ["1/2", "1/10", "1"]
    (closure,) = read(
        FIXED.format(floating="", first="tool", second="slide"), keep_fixed_links=True
    ).closures
    assert (closure.first, closure.second) == (2, 3)
    assert [str(e) for e in closure.first_frame.translation] == ["1/10", "0", "0"]


def test_what_stands_on_the_base_is_the_base() -> None:
    (closure,) = read(FIXED.format(floating="", first="post", second="slide")).closures
    assert (closure.first, closure.second) == (GROUND, 1)
    assert [str(e) for e in closure.first_frame.translation] == ["1/10", "0", "1"]


@pytest.mark.parametrize(
    ("name", "body", "z"), [("base", 0, "-1"), ("null", GROUND, "0"), ("post", 0, "0")]
)
def test_a_floating_base_is_not_the_world(name: str, body: int, z: str) -> None:
    (closure,) = read(
        FIXED.format(floating="floating_base: true", first=name, second="slide")
    ).closures
    assert (closure.first, str(closure.first_frame.translation[2])) == (body, z)


# -- descriptions: coordinates -----------------------------------------------------------------------------------------

BAR = (ROOT / "examples/loops/four_bar.yaml").read_text()
UNCHOSEN = BAR.replace("independent: [crank]\n", "")


def test_assembly_may_be_stated_by_expressions() -> None:
    stated = "assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206}"
    mechanism = read(
        BAR.replace(stated, "assembly: {crank: pi/3, rocker: -sqrt(2)*0.1}")
    )
    assert dict(mechanism.assembly) == {
        "crank": pytest.approx(np.pi / 3),
        "rocker": pytest.approx(-(2**0.5) / 10),
    }


def test_driven_coordinates_are_preferred() -> None:
    assert read(UNCHOSEN + "actuators: {motor: 30*rocker}\n").independent == ("rocker",)
    assert read(
        UNCHOSEN + "actuators: {motor: {terms: {coupler: 1}}}\n"
    ).independent == ("coupler",)
    assert read(BAR.replace("[crank]", "[coupler]")).independent == ("coupler",)


def test_only_independent_coordinates_have_drives_and_sensors() -> None:
    assert [o.name for o in read(BAR).outputs] == ["crank"]
    assert [o.name for o in read(BAR + "outputs: [{joint: all}]\n").outputs] == [
        "crank"
    ]
    with pytest.raises(
        ec.InputError,
        match=r"outputs\[0\].joint: there is no independent joint coordinate 'rocker'",
    ):
        read(BAR + "outputs: [{joint: rocker}]\n")
    with pytest.raises(
        ec.InputError,
        match=r"actuators.m: 'rocker' depends on others .* list it in 'independent'",
    ):
        read(BAR + "actuators: {m: 3*rocker}\n")


def test_effects_act_at_all_joints() -> None:
    effects = read(
        BAR
        + "effects: [{type: viscous, at: all, side: joint}, {type: spring, at: rocker}]\n"
    ).effects
    assert [e.actions[0].at for e in effects[:3]] == ["crank", "coupler", "rocker"]
    assert {e.actions[0].at for e in effects[3:]} == {"rocker"}
    effects = read(BAR + "effects: [{type: viscous, at: all}]\n").effects
    assert [e.actions[0].at for e in effects] == ["crank"]


def test_rotors_may_be_geared_to_any_joint() -> None:
    mechanism = read(BAR + "rotors: [{name: fan, on: base, drives: 20*rocker}]\n")
    assert mechanism.couplings[0].terms[0][0] == "rocker"
    assert mechanism.independent == ("crank",)


# -- robot files -------------------------------------------------------------------------------------------------------

URDF = """<robot name="bars"><link name="world"/><link name="crank"/><link name="coupler"/><link name="rocker"/>
<joint name="q1" type="continuous"><parent link="world"/><child link="crank"/><axis xyz="0 0 1"/></joint>
<joint name="q2" type="continuous"><parent link="crank"/><child link="coupler"/><origin xyz="0.15 0 0"/>
<axis xyz="0 0 1"/></joint>
<joint name="q3" type="continuous"><parent link="world"/><child link="rocker"/><origin xyz="0.4 0 0"/>
<axis xyz="0 0 1"/></joint></robot>"""
ADDED = """
echelon: 1
robot: {file: bars.urdf}
loops: [{joint: revolute, connects: [coupler, rocker], at: {xyz: [0.35, 0, 0]}, on_second: {xyz: [0.3, 0, 0]}}]
assembly: {q1: 1, q2: -0.4816, q3: 1.6206}
actuators: {motor: 20*q3}
"""


def added(tmp_path: Path, text: str, file: str = URDF) -> Mechanism:
    (tmp_path / "bars.urdf").write_text(file)
    (tmp_path / "loops.yaml").write_text(text)
    return ec.load(tmp_path / "loops.yaml")


def test_loops_of_a_robot_file(tmp_path: Path) -> None:
    mechanism = added(tmp_path, ADDED)
    assert [b.name for b in mechanism.bodies] == ["crank", "coupler", "rocker"]
    assert mechanism.independent == ("q3",)
    assert not mechanism.symbols  # any other lengths would not close
    assert np.abs(residual(mechanism, closed(mechanism))).max() < 1e-12
    closed_at_base = ADDED.replace("[coupler, rocker]", "[base, coupler]").replace(
        "[0.3, 0, 0]", "[0.25, 0, 0]"
    )
    ground = added(tmp_path, closed_at_base.split("assembly")[0])
    assert (ground.closures[0].first, ground.closures[0].second) == (GROUND, 1)
    with pytest.raises(
        ec.InputError,
        match=r"connects\[1\]: there is no body or frame 'rokker'; did you mean 'rocker'",
    ):
        added(tmp_path, ADDED.replace(", rocker]", ", rokker]"))


PIN = """<link name="pin"/><link name="eye"/><link name="post"/>
<joint name="f1" type="fixed"><parent link="coupler"/><child link="pin"/><origin xyz="0.35 0 0" rpy="0 0 0.3"/></joint>
<joint name="f2" type="fixed"><parent link="rocker"/><child link="eye"/><origin xyz="0.1 0 0"/></joint>
<joint name="f3" type="fixed"><parent link="eye"/><child link="post"/><origin xyz="0.2 0 0" rpy="0 0 1.5708"/></joint>
</robot>"""


def test_loops_may_connect_fixed_links_of_a_robot_file(tmp_path: Path) -> None:
    """They are where their parents carry them: the same loop as between the moving links."""
    file = URDF.replace("</robot>", PIN)
    text = (
        ADDED.split("loops:")[0]
        + "loops: [{joint: revolute, connects: [pin, post], on_second: {}}]\n"
    )
    text += "assembly:" + ADDED.split("assembly:")[1]
    mechanism, same = added(tmp_path, text, file), added(tmp_path, ADDED)
    assert mechanism.bodies == same.bodies
    (closure,), (expected,) = mechanism.closures, same.closures
    assert (closure.first, closure.second) == (expected.first, expected.second)
    assert closure.first_frame.translation == expected.first_frame.translation
    assert closure.second_frame.translation == expected.second_frame.translation
    assert set(mechanism.symbols) == {"yaw_pin"}  # 0.3 rad has no exact sine
    assert mechanism.reading is not None
    assert [snap.element for snap in mechanism.reading.snaps] == [
        "joint 'f3' origin yaw"
    ]
    assert ec.base_parameters(mechanism).rank == ec.base_parameters(same).rank
    assert not mechanism.reading.literal().reading.snaps  # type: ignore[union-attr]
    with pytest.raises(
        ec.InputError, match="'pin' and 'coupler' do not move against each other"
    ):
        added(tmp_path, text.replace("post", "coupler"), file)


# -- examples and round trips ------------------------------------------------------------------------------------------


LARGE = (
    "bennett.yaml",
    "biped.xml",
    "delta.yaml",
    "gough_stewart.yaml",
    "sr400.yaml",
    "three_rps.yaml",
)


@pytest.mark.parametrize(
    "file",
    slow_unless(lambda f: f.name not in LARGE, EXAMPLES),
    ids=lambda file: file.name,
)
def test_examples_close_and_are_read_again(file: Path) -> None:
    mechanism = ec.load(file)
    q = closed(mechanism)
    assert np.abs(residual(mechanism, q)).max() < 1e-12
    start = position(mechanism, dict(mechanism.assembly))
    assert max(abs(q[name] - start[name]) for name in q) < 0.02
    if file.suffix == ".yaml":
        jsonschema.Draft202012Validator(json_schema()).validate(
            yaml.safe_load(file.read_text())
        )
        assert file.read_text().startswith("# ")
    check_round_trip(mechanism)


@pytest.mark.slow
def test_saved_sets_keep_their_loops(tmp_path: Path) -> None:
    base = ec.base_parameters(read(BAR))
    ec.save_base(base, tmp_path / "base.json")
    again = ec.load_base(tmp_path / "base.json")
    assert again.mechanism == base.mechanism
    assert again.mechanism.closures


@pytest.mark.parametrize("kind", ClosureKind)
def test_round_trip_of_all_kinds(kind: ClosureKind) -> None:
    check_round_trip(
        read(
            PAIR
            + f"  - {{joint: {kind.value}, connects: [two, base], at: {{rpy: [a, 0.2, 0]}}}}\n"
        )
    )


def check_round_trip(mechanism: Mechanism) -> None:
    text = json.dumps(write_description(mechanism))
    again = read_description(text, "robot.json", ReadingOptions(keep_fixed_links=True))
    assert again.closures == mechanism.closures
    assert (again.independent, again.assembly) == (
        mechanism.independent,
        mechanism.assembly,
    )
    assert (again.bodies, again.symbols) == (mechanism.bodies, mechanism.symbols)
    assert json.dumps(write_description(again)) == text
    jsonschema.Draft202012Validator(json_schema()).validate(json.loads(text))


def test_the_world_beside_a_body_named_base() -> None:
    mechanism = read(
        FIXED.format(
            floating="floating_base: true", first="null", second="slide"
        ).replace("post", "base")
    )
    assert write_description(mechanism)["loops"][0]["connects"] == [None, "slide"]
    check_round_trip(mechanism)


# -- mistakes ----------------------------------------------------------------------------------------------------------


def bar(old: str, new: str) -> str:
    assert old in BAR
    return BAR.replace(old, new)


MISTAKES = {
    "unknown body": (
        bar("[coupler, rocker]", "[coupler, roker]"),
        r"loops\[0\].connects\[1\]: .*'roker'; did you mean 'rocker'",
    ),
    "itself": (
        bar("[coupler, rocker]", "[crank, crank]"),
        r"loops\[0\].connects: 'crank' and 'crank' do not move against",
    ),
    "same body": (
        bar("[coupler, rocker]", "[base, null]"),
        "'base' and the world do not move against each other",
    ),
    "one body": (bar("[coupler, rocker]", "[coupler]"), "two names of bodies such as"),
    "unknown kind": (
        bar("joint: revolute\n    connects", "joint: hinge\n    connects"),
        r"loops\[0\].joint: 'hinge' is not valid",
    ),
    "near kind": (
        bar("joint: revolute\n    connects", "joint: sperical\n    connects"),
        "did you mean 'spherical'",
    ),
    "axis of a point": (
        bar(
            "joint: revolute\n    connects",
            "axis: z\n    joint: spherical\n    connects",
        ),
        r"loops\[0\]: a spherical joint has no axis",
    ),
    "axis of a universal joint": (
        bar(
            "joint: revolute\n    connects",
            "axis: z\n    joint: universal\n    connects",
        ),
        r"loops\[0\]: a universal joint has two axes",
    ),
    "axis zero": (
        bar("    connects", "    axis: [0, 0, 0]\n    connects"),
        r"loops\[0\].axis: the axis is zero",
    ),
    "unknown key": (bar("connects", "conects"), "unknown key; did you mean 'connects'"),
    "undeclared symbol": (
        bar("{xyz: [l3, 0, 0]}", "{xyz: [l5, 0, 0]}"),
        r"loops\[0\].at.xyz\[0\]: the symbol 'l5'",
    ),
    "two loops of one name": (
        bar(
            "independent",
            "  - {name: pin, joint: points, connects: [crank, rocker]}\nindependent",
        ),
        r"loops\[1\].name: another loop has the name 'pin'",
    ),
    "unknown independent": (
        bar("[crank]", "[krank]"),
        r"independent\[0\]: .*'krank'; did you mean 'crank'",
    ),
    "too many independent": (bar("[crank]", "[crank, rocker]"), "independent"),
    "no independent": (bar("[crank]", "[]"), "independent"),
    "unknown assembly": (
        bar("{crank: 1,", "{krank: 1,"),
        r"assembly.krank: .*'krank'; did you mean 'crank'",
    ),
    "symbolic assembly": (
        bar("{crank: 1,", "{crank: l1,"),
        "assembly.crank: 'l1' must be a number here",
    ),
    "independent without loops": (
        "echelon: 1\nindependent: [j1]\nmodified_dh: [{joint: revolute}]\n",
        "independent: there are no loops",
    ),
    "assembly without loops": (
        "echelon: 1\nassembly: {j1: 1}\nmodified_dh: [{joint: revolute}]\n",
        "assembly: there are no loops",
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mistakes_name_file_and_element(name: str) -> None:
    text, message = MISTAKES[name]
    with pytest.raises(ec.InputError, match=message) as caught:
        read(text)
    assert caught.value.source == "robot.yaml"


def test_too_many_angles_between_two_frames() -> None:
    angles = [f"a{k}" for k in range(20)]
    rows = "\n".join(f"  - {{joint: revolute, alpha: {a}, a: 0.1}}" for a in angles)
    text = f"echelon: 1\nsymbols: {{{', '.join(f'{a}: null' for a in angles)}}}\nmodified_dh:\n{rows}\n"
    with pytest.raises(
        ec.InputError, match=r"loops\[0\]: between the two bodies lie 20 angles"
    ):
        read(text + "loops: [{joint: points, connects: [j20, base]}]\n")


@pytest.mark.parametrize(
    ("kind", "raised"), [("revolute", 0.03), ("revolute", 1e-3), ("spherical", 1e-3)]
)
def test_a_pin_beside_its_plane_is_refused(kind: str, raised: float) -> None:
    """Its height is a redundant constraint, which no motion can meet; the refusal says by how much it is missed."""
    text = (ROOT / "examples/loops/four_bar.yaml").read_text()
    pin = "on_second: {xyz: [l4, 0, 0]}"
    assert pin in text
    beside = text.replace(
        "joint: revolute\n    connects", f"joint: {kind}\n    connects"
    )
    beside = beside.replace(pin, f"on_second: {{xyz: [l4, 0, {raised}]}}")
    with pytest.raises(
        ec.InputError,
        match=f"do not close near the assembly pose: closure 'pin' is off by {raised:.3g} m",
    ):
        ec.load(beside)
