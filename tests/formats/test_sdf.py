"""SDF models: poses against a forward kinematics of their own, joints that close loops, and what is refused."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

import echelon as ec
from echelon.base.derive import base_structure
from echelon.base.saved.saved import from_json, to_json
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.robot.closure import ClosureKind
from echelon.robot.joint import GROUND
from echelon.robot.mechanism import Mechanism
from support.loop_frames import residual
from support.selection import slow_unless
from support.textbook_poses import Array, along, moved, pose_of, turned

LITERAL = ReadingOptions(snap_tolerance=0)
ARM_MODEL = """<model name="arm"><link name="a"/>
  <joint name="j" type="revolute"><parent>world</parent><child>a</child><axis><xyz>0 1 0</xyz></axis></joint></model>"""


def read(text: str, options: ReadingOptions = LITERAL) -> Mechanism:
    return RobotFile.of(text.encode(), "robot.sdf").mechanism(options)


def notes(robot: Mechanism) -> str:
    assert robot.reading is not None
    return "; ".join(robot.reading.notes)


def model(content: str, pose: str = "0 0 0 0 0 0", version: str = "1.9") -> str:
    return f'<sdf version="{version}"><model name="m"><pose>{pose}</pose>{content}</model></sdf>'


# -- random trees ------------------------------------------------------------------------------------------------------


def euler(x: float, y: float, z: float, roll: float, pitch: float, yaw: float) -> Array:
    turn = turned([0, 0, 1], yaw) @ turned([0, 1, 0], pitch) @ turned([1, 0, 0], roll)
    return moved(x, y, z) @ turn


class RandomModel:
    """Links, joints and frames whose poses refer to one another at random; everything again as matrices."""

    def __init__(self, seed: int, links: int = 4) -> None:
        self.rng = np.random.default_rng(seed)
        model_pose, stated = self._pose()
        self.world: dict[str, Array] = {
            "__model__": model_pose
        }  # where frames are while all coordinates are zero
        self.joints: list[
            tuple[str, str, str, str, Array]
        ] = []  # name, kind, parent, child, axis in the joint's frame
        content = self._frame("f0", "frame", "")
        for k in range(links):
            content += self._frame(
                f"l{k}", "link", "<inertial><mass>1</mass></inertial>"
            )
            content += self._frame(f"f{k + 1}", "frame", "", f' attached_to="l{k}"')
            content += self._joint(k)
        self.text = model(content, stated)

    def _pose(self) -> tuple[Array, str]:
        angles = self.rng.integers(-1, 3, 3) * np.pi / 2
        angles[self.rng.integers(3)] = round(self.rng.uniform(-3, 3), 2)
        numbers = [
            *(round(float(v), 3) for v in self.rng.uniform(-1, 1, 3)),
            *map(float, angles),
        ]
        return euler(*numbers), " ".join(map(repr, numbers))

    def _frame(self, name: str, tag: str, content: str, attributes: str = "") -> str:
        placed, stated = self._pose()
        base = str(self.rng.choice(list(self.world)))
        self.world[name] = self.world[base] @ placed
        pose = f'<pose relative_to="{base}">{stated}</pose>'
        return f'<{tag} name="{name}"{attributes}>{pose}{content}</{tag}>'

    def _joint(self, k: int) -> str:
        """A joint of link k with an earlier one, or the other way round; both ends may be frames."""
        earlier = "world" if not k else f"l{self.rng.integers(k)}"
        ends = [earlier, f"f{k + 1}" if self.rng.random() < 0.5 else f"l{k}"]
        turned_round = k > 0 and self.rng.random() < 0.3
        parent, child = ends[::-1] if turned_round else ends
        kind = str(self.rng.choice(["revolute", "continuous", "prismatic", "fixed"]))
        placed, stated = self._pose()
        expressed = str(self.rng.choice(["", *self.world]))
        axis = self.rng.uniform(-1, 1, 3).round(3)
        name = f"j{k}"
        self.world[name] = self.world[child] @ placed
        turn = (
            np.eye(4)
            if not expressed
            else np.linalg.inv(self.world[name]) @ self.world[expressed]
        )
        self.joints.append((name, kind, parent, child, turn[:3, :3] @ axis))
        where = f' expressed_in="{expressed}"' if expressed else ""
        xyz = f"<axis><xyz{where}>{' '.join(map(str, axis))}</xyz></axis>" * (
            kind != "fixed"
        )
        return (
            f'<joint name="{name}" type="{kind}"><pose>{stated}</pose><parent>{parent}</parent>'
            f"<child>{child}</child>{xyz}</joint>"
        )

    def at(self, q: Mapping[str, float]) -> dict[str, Array]:
        """Where the links are."""
        place = {"world": np.eye(4)}
        for (
            name,
            kind,
            parent,
            child,
            axis,
        ) in self.joints:  # link k is at one end of joint k
            motion = np.eye(4)
            if kind != "fixed":
                motion = (
                    along(axis, q[name])
                    if kind == "prismatic"
                    else turned(axis, q[name])
                )
            parent, child = (
                end.replace("f", "l") if end[0] == "l" else end
                for end in (parent, child)
            )
            parent, child = (
                f"l{int(end[1:]) - 1}" if end[0] == "f" else end
                for end in (parent, child)
            )
            moving, standing, motion = (
                (child, parent, motion)
                if parent in place
                else (parent, child, np.linalg.inv(motion))
            )
            joint, start = self.world[name], self.world.get(standing, np.eye(4))
            place[moving] = (
                place[standing]
                @ np.linalg.inv(start)
                @ joint
                @ motion
                @ np.linalg.inv(joint)
                @ self.world[moving]
            )
        return place


def check_kinematics(
    robot: Mechanism, at: Callable[[Mapping[str, float]], dict[str, Array]], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    q = {name: float(rng.uniform(-2, 2)) for name in robot.positions}
    expected, found = at(q), {GROUND: np.eye(4)}
    for k, body in enumerate(robot.bodies):
        found[k] = found[body.parent] @ pose_of(robot, k, q)
        np.testing.assert_allclose(found[k], expected[body.name], atol=1e-12)


@pytest.mark.parametrize("seed", slow_unless([0, 2, 4, 6], range(10)))
def test_links_are_where_their_poses_say(seed: int) -> None:
    known = RandomModel(seed)
    check_kinematics(
        read(known.text, ReadingOptions(snap_tolerance=0, keep_fixed_links=True)),
        known.at,
        seed,
    )


def test_every_number_is_one_symbol() -> None:
    """A rotation and its inverse cancel, also where all numbers have symbols of their own."""
    seed = 3
    known = RandomModel(seed)
    robot = read(known.text, ReadingOptions(snap_tolerance=0, separate_symbols=True))
    check_kinematics(robot, known.at, seed)


def test_it_is_the_robot_that_a_urdf_says() -> None:
    urdf = """<robot name="r"><link name="a"/><link name="b"/><link name="c"/>
      <joint name="q1" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
        <origin xyz="0 0 0.3"/></joint>
      <joint name="q2" type="revolute"><parent link="b"/><child link="c"/><axis xyz="0 0 1"/>
        <origin xyz="0.2 0 0" rpy="1.5708 0 0"/></joint></robot>"""
    sdf = model("""<link name="a"/><link name="b"><pose>0 0 0.3 0 0 0</pose></link>
      <link name="c"><pose rotation_format="quat_xyzw">0.2 0 0.3 0.70710678 0 0 0.70710678</pose></link>
      <joint name="q1" type="revolute"><parent>a</parent><child>b</child><axis/></joint>
      <joint name="q2" type="revolute"><parent>b</parent><child>c</child><axis><xyz>0 0 1</xyz></axis></joint>""")
    one, two = (
        ec.base_parameters(
            RobotFile.of(t.encode(), f"r.{s}").mechanism(ReadingOptions())
        )
        for t, s in ((urdf, "urdf"), (sdf, "sdf"))
    )
    assert one.expressions == two.expressions
    degrees = sdf.replace(
        'rotation_format="quat_xyzw">0.2 0 0.3 0.70710678 0 0 0.70710678',
        'degrees="true">0.2 0 0.3 90 0 0',
    )
    assert (
        ec.base_parameters(read(degrees, ReadingOptions())).expressions
        == two.expressions
    )
    assert "nothing holds link 'a' in the world; it is read as fixed" in notes(
        read(sdf)
    )
    assert read(sdf, ReadingOptions(floating=True)).bodies[0].name == "a"


# -- axes in other frames ----------------------------------------------------------------------------------------------

AXES = ((1, 0, 0), (0, 0, -1), (0, 0.6, 0.8), (0, 1, 0), (0.5, 0, -0.5), (0, 1, 0))


def oblique_chain(digits: int, how: str, kinds: tuple[str, ...]) -> str:
    """Links at general poses, with axes in their own frames, or rounded in the frame of the model."""
    rng = np.random.default_rng(digits)
    content, previous = "", "world"
    for k, (kind, axis) in enumerate(zip(kinds, AXES, strict=False)):
        x, y, z, *angles = (round(float(v), 1) for v in rng.uniform(-1, 1, 6))
        if how.startswith("in the model"):
            turn = euler(0, 0, 0, *angles)[:3, :3]
            direction = " ".join(f"{v:.{digits}f}" for v in turn @ axis)
        else:
            direction = " ".join(map(str, axis))
        attribute = (
            ' expressed_in="__model__"'
            if how == "in the model's frame"
            else f' expressed_in="l{k}"'
        )
        old = "in the model, the old way"
        xyz = f"<xyz{'' if how == old else attribute}>{direction}</xyz>"
        flag = (
            "<use_parent_model_frame>true</use_parent_model_frame>"
            if how == old
            else ""
        )
        content += (
            f'<link name="l{k}"><pose>{x} {y} {z} {" ".join(map(str, angles))}</pose></link>'
            f'<joint name="j{k}" type="{kind}"><pose>0 0 0 0.2 0 0.4</pose><parent>{previous}</parent>'
            f"<child>l{k}</child><axis>{xyz}{flag}</axis></joint>"
        )
        previous = f"l{k}"
    return model(content)


@pytest.mark.parametrize(
    ("digits", "kinds"),
    [
        (5, ("revolute", "revolute")),
        (6, ("revolute", "prismatic", "revolute")),
        (7, ("prismatic", "prismatic", "revolute")),
        (9, ("revolute",) * 6),
    ],
)
def test_axes_that_are_rounded_in_the_frame_of_the_model_are_those_of_the_links(
    digits: int, kinds: tuple[str, ...]
) -> None:
    ways = ("in the link's frame", "in the model's frame", "in the model, the old way")
    own, *others = (
        read(oblique_chain(digits, how, kinds), ReadingOptions()) for how in ways
    )
    wanted = base_structure(own)
    for other in others:
        assert base_structure(other).pivots == wanted.pivots
        assert other.reading is not None
        assert other.reading.snaps
        q = dict.fromkeys(own.positions, 0.7)
        for k in range(len(own.bodies)):
            np.testing.assert_allclose(
                pose_of(own, k, q), pose_of(other, k, q), atol=1e-4
            )


def test_an_axis_along_the_model_stays_as_it_is_stated() -> None:
    text = model(
        """<link name="a"><pose>0 0 0 0.3 0.5 0.7</pose></link><link name="b"><pose>0.3 0 0 0.2 0.9 0.4</pose></link>
      <joint name="p" type="revolute"><parent>world</parent><child>a</child>
        <axis><xyz expressed_in="__model__">0 0 1</xyz></axis></joint>
      <joint name="q" type="revolute"><parent>a</parent><child>b</child>
        <axis><xyz expressed_in="__model__">0 0 1</xyz></axis></joint>"""
    )
    for options in (
        LITERAL,
        ReadingOptions(),
    ):  # both along gravity, so that no sum of angles is seen apart
        assert base_structure(read(text, options)).rank == 4


def oblique_bar(axis: str) -> str:
    """A planar four-bar in an oblique plane."""
    turn = euler(0, 0, 0, 0.3, 0.5, 0.7)[:3, :3]
    joint = f"<axis><xyz{axis}</xyz></axis>"
    places = {
        name: " ".join(f"{v:.6f}" for v in turn @ p) for name, p in BAR_POINTS.items()
    }
    links = "".join(
        f'<link name="{n}"><pose>{places[p]} 0.3 0.5 0.7</pose></link>'
        for n, p in ("ga", "aa", "bb", "cc")
    )
    joints = "".join(
        f'<joint name="{p}{c}" type="revolute"><parent>{p}</parent><child>{c}</child>{joint}</joint>'
        for p, c in ("ga", "ab", "bc")
    )
    return model(
        f"""{links}{joints}<joint name="w" type="fixed"><parent>world</parent><child>g</child></joint>
      <joint name="close" type="revolute"><pose relative_to="__model__">{places["d"]} 0.3 0.5 0.7</pose>
        <parent>g</parent><child>c</child>{joint}</joint>"""
    )


BAR_POINTS = {"a": (0, 0, 0), "b": (0.1, 0.3, 0), "c": (0.5, 0.35, 0), "d": (0.4, 0, 0)}


@pytest.mark.slow
def test_a_loop_with_axes_in_the_frame_of_the_model_is_that_with_axes_of_links() -> (
    None
):
    normal = " ".join(f"{v:.6f}" for v in euler(0, 0, 0, 0.3, 0.5, 0.7)[:3, 2])
    one, two = (
        ec.base_parameters(read(oblique_bar(axis), ReadingOptions()))
        for axis in (">0 0 1", f' expressed_in="__model__">{normal}')
    )
    assert (two.pivots, two.rank) == (one.pivots, 8)
    np.testing.assert_allclose(two.B_float(), one.B_float(), atol=1e-4)


# -- screws and models -------------------------------------------------------------------------------------------------

SCREW = model(
    """<link name="base"/><link name="nut"><pose>0.1 0.2 0.3 0.4 0 0</pose></link>
  <joint name="w" type="fixed"><parent>world</parent><child>base</child></joint>
  <joint name="s" type="screw"><parent>base</parent><child>nut</child>PITCH<axis><xyz>0 0.6 0.8</xyz></axis></joint>"""
)
PITCHES = {
    "metres per turn": (
        "<screw_thread_pitch>0.01</screw_thread_pitch>",
        0.01 / (2 * np.pi),
    ),
    "a left-handed thread": (
        "<screw_thread_pitch>-0.01</screw_thread_pitch>",
        -0.01 / (2 * np.pi),
    ),
    "the old word, radians per metre": ("<thread_pitch>-600</thread_pitch>", 1 / 600),
    "both": (
        "<thread_pitch>1</thread_pitch><screw_thread_pitch>0.02</screw_thread_pitch>",
        0.01 / np.pi,
    ),
    "none": ("", 1 / (2 * np.pi)),
}


@pytest.mark.parametrize("case", PITCHES)
@pytest.mark.parametrize("backwards", [False, True])
def test_a_screw_travels_by_its_pitch(case: str, backwards: bool) -> None:
    stated, pitch = PITCHES[case]
    text = SCREW.replace("PITCH", stated)
    if backwards:
        text = text.replace(
            "<parent>base</parent><child>nut</child>PITCH",
            "<parent>nut</parent><child>base</child>",
        )
    robot = read(text, ReadingOptions())
    q, axis = 0.7, np.array([0, 0.6, 0.8])
    placed = euler(0.1, 0.2, 0.3, 0.4, 0, 0)
    expected = placed @ along(axis, pitch * q) @ turned(axis, q)
    np.testing.assert_allclose(pose_of(robot, 0, {"s": q}), expected, atol=1e-12)
    assert ("1 m per turn" in notes(robot)) == (case == "none")


def test_a_screw_shows_what_that_of_a_description_does() -> None:
    described = (
        "echelon: 1\nname: m\nsymbols: {p: 0.01/(2*pi)}\nbodies: [{name: nut, JOINT}]\n"
    )
    described = described.replace("JOINT", "joint: {type: helical, axis: z, pitch: p}")
    text = (
        SCREW.replace("PITCH", PITCHES["metres per turn"][0])
        .replace("0 0.6 0.8", "0 0 1")
        .replace("0.4 0 0", "0 0 0")
    )
    one = ec.base_parameters(read(text, ReadingOptions()))
    two = ec.base_parameters(RobotFile.of(described.encode(), "m.yaml").mechanism())
    assert one.pivots == two.pivots == ("ZZ1", "M1")
    saved = from_json(to_json(one))
    assert ec.verify(saved).rank == 2
    np.testing.assert_allclose(
        pose_of(saved.mechanism, 0, {"s": 2.0})[2, 3], 0.3 + 0.02 / (2 * np.pi)
    )


WORLD = """<sdf version="1.9"><world name="w">{arm}{lift}
  <model name="floor"><static>1</static><link name="g"/>
  <joint name="j" type="fixed"><parent>world</parent><child>g</child></joint></model></world></sdf>""".format(
    arm=ARM_MODEL,
    lift=SCREW.replace("PITCH", "")
    .split('<sdf version="1.9">')[1]
    .replace('name="m"', 'name="lift"')[:-6],
)


def test_one_of_several_models_is_chosen_by_its_name() -> None:
    assert ec.load(WORLD, model="arm").positions == ("j",)
    assert ec.load(WORLD, model="lift").positions == ("s",)
    reading = ec.load(WORLD, model="lift", independent_mimics=True).reading
    assert reading is not None
    assert reading.literal().positions == ("s",)  # it remembers which
    with pytest.raises(
        ec.InputError, match=r"several models have joints, 'arm', 'lift': .*--model arm"
    ):
        ec.load(WORLD)
    with pytest.raises(
        ec.InputError,
        match=r"there is no model 'lfit' with joints; did you mean 'lift'",
    ):
        ec.load(WORLD, model="lfit")
    with pytest.raises(ec.InputError, match="only SDF files hold several models"):
        ec.load("echelon: 1\nname: m\nbodies: [{name: a}]\n", model="m")


# -- loops -------------------------------------------------------------------------------------------------------------

BAR = model(
    """<link name="crank"/><link name="coupler"><pose relative_to="crank">0.2 0 0 0 0 0.3</pose></link>
  <link name="rocker"><pose>0.6 0 0 0 0 0</pose></link>
  <joint name="a" type="revolute"><parent>world</parent><child>crank</child><axis><xyz>0 0 1</xyz></axis></joint>
  <joint name="b" type="revolute"><parent>crank</parent><child>coupler</child><axis><xyz>0 0 1</xyz></axis></joint>
  <joint name="c" type="revolute"><parent>world</parent><child>rocker</child><axis><xyz>0 0 1</xyz></axis></joint>
  <joint name="d" type="revolute"><parent>rocker</parent><child>coupler</child><pose>0.35 0 0 0 0 0</pose>
    <axis><xyz>0 0 2</xyz></axis></joint>""",
    "0 0 1 1.5707963 0 0",
)


def test_the_last_joint_of_a_loop_closes_it() -> None:
    robot = read(BAR, ReadingOptions())
    (closure,) = robot.closures
    assert (closure.name, closure.kind) == ("d", ClosureKind.REVOLUTE)
    assert [robot.bodies[k].name for k in (closure.first, closure.second)] == [
        "rocker",
        "coupler",
    ]
    assert ec.base_parameters(robot).rank == 8


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "ball", "fixed"])
def test_closing_joints_meet_at_zero(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("echelon.loops.close", lambda mechanism, *_, **__: mechanism)
    text = BAR.replace('name="d" type="revolute"', f'name="d" type="{kind}"').replace(
        "0 0 2", "0.3 -0.4 0.5"
    )
    robot = read(text)
    zero = dict.fromkeys(robot.positions, 0.0)
    np.testing.assert_allclose(residual(robot, zero), 0, atol=1e-14)


def test_a_joint_that_cannot_close_a_loop_carries() -> None:
    """The order of the file decides only between those that can."""
    text = BAR.replace('name="d" type="revolute"', 'name="d" type="universal"').replace(
        "</xyz></axis></joint></model>",
        "</xyz></axis><axis2><xyz>0 1 0</xyz></axis2></joint></model>",
    )
    robot = read(text)
    assert [c.name for c in robot.closures] == ["c"]
    assert {"d.1", "d.2"} <= set(robot.velocities)


def test_mimics_and_old_axes() -> None:
    text = (
        BAR.replace(
            '<xyz>0 0 1</xyz></axis></joint>\n  <joint name="c"',
            "<xyz>0 0 1</xyz>"
            '<mimic joint="a"><multiplier>2</multiplier><offset>0.5</offset><reference>0.1</reference></mimic>'
            '</axis></joint>\n  <joint name="c"',
        ).split('<joint name="c"')[0]
        + '<joint name="c" type="fixed"><parent>world</parent><child>rocker</child></joint></model></sdf>'
    )
    robot = read(text)
    assert [(c.coordinate, str(c.terms[0][1])) for c in robot.couplings] == [("b", "2")]
    assert not read(
        text, ReadingOptions(snap_tolerance=0, independent_mimics=True)
    ).couplings
    old = BAR.replace('version="1.9"', 'version="1.4"')
    axes = [
        pose_of(
            read(
                old.replace("<xyz>0 0 1</xyz>", "<xyz>1 0 0</xyz>"),
            ),
            1,
            {"b": q},
        )
        for q in (0.0, 0.4)
    ]
    turn = (
        np.linalg.inv(axes[0]) @ axes[1]
    )  # about x of the model, seen from the coupler
    np.testing.assert_allclose(
        turn, turned([np.cos(0.3), -np.sin(0.3), 0], 0.4), atol=1e-12
    )


ARM = model(
    """<link name="a"/><link name="b"><gravity>false</gravity><inertial auto="true"><mass>2</mass></inertial></link>
    <joint name="j" type="revolute"><parent>a</parent><child>b</child><axis/></joint>"""
)


def test_what_gravity_and_inertias_are_taken_from() -> None:
    robot = read(ARM)
    assert (
        "switches it off for 'b'; inertias of 'b' are unknown: the file leaves them to collisions"
        in notes(robot)
    )
    assert robot.bodies[0].inertial is None
    assert str(robot.gravity) == "(0, 0, -981/100)"
    assert (
        read(
            ARM.replace(
                '<link name="a"/>', '<link name="a"><gravity>0</gravity></link>'
            )
        ).gravity
        is None
    )
    world = ARM.replace('<model name="m">', '<world name="w"><model name="m">').replace(
        "</sdf>", "</world></sdf>"
    )
    assert str(read(world).gravity) == "(0, 0, -49/5)"  # that of the specification
    static = world.replace("<pose>0 0 0 0 0 0</pose>", "<static>true</static>")
    with pytest.raises(ec.InputError, match="needs one model with joints, found none"):
        read(static)


# -- refusals ----------------------------------------------------------------------------------------------------------

REFUSED = {
    "no model": (
        "<sdf version='1.9'><world name='w'/></sdf>",
        "needs one model with joints, found none",
    ),
    "a nested model": (
        BAR.replace("</model>", '<model name="n"/></model>'),
        "has <model>, which is not read",
    ),
    "an included model": (
        BAR.replace("</model>", "<include/></model>"),
        "has <include>, which is not read",
    ),
    "a circle of poses": (
        BAR.replace(
            '<link name="crank"/>',
            '<link name="crank"><pose relative_to="coupler"/></link>',
        ),
        "refer to each other in a circle",
    ),
    "an unknown frame": (
        BAR.replace('relative_to="crank"', 'relative_to="cramk"'),
        "'cramk'; did you mean 'crank'",
    ),
    "an unknown end": (
        BAR.replace("<child>rocker", "<child>roker"),
        "'roker'; did you mean 'rocker'",
    ),
    "an unknown type": (
        BAR.replace('name="d" type="revolute"', 'name="d" type="gearbox"'),
        "joint 'd': .*'gearbox'",
    ),
    "no axis": (
        BAR.replace("<axis><xyz>0 0 2</xyz></axis>", ""),
        "joint 'd': needs <axis>",
    ),
    "a zero axis": (
        BAR.replace("0 0 2", "0 0 0"),
        "joint 'd' axis xyz: the axis is zero",
    ),
    "a short pose": (
        BAR.replace("0.6 0 0 0 0 0", "0.6 0"),
        "link 'rocker' pose: needs 6 numbers, found '0.6 0'",
    ),
    "a name twice": (
        BAR.replace('name="rocker"', 'name="crank"'),
        "link 'crank': this name occurs twice",
    ),
    "a lonely link": (
        BAR.replace('<link name="crank"/>', '<link name="crank"/><link name="x"/>'),
        "link 'x': no joint",
    ),
    "no number": (BAR.replace("0.6 0 0", "0.6 inf 0"), "link 'rocker' pose"),
    "itself": (
        BAR.replace("<parent>rocker", "<parent>coupler"),
        "joint 'd': connects link 'coupler' with itself",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_the_element(case: str) -> None:
    text, message = REFUSED[case]
    with pytest.raises(ec.InputError, match=message) as error:
        read(text)
    assert error.value.source == "robot.sdf"
