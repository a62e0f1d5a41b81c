"""Loops and couplings in URDF files, against the same mechanisms in a description, in MJCF, and known counts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import echelon as ec
from echelon.formats.robot_file import open_robot
from echelon.formats.snapping import ReadingOptions
from echelon.shared.errors import InputError
from support.selection import slow_unless

INERTIA = "<inertia ixx='0.01' iyy='0.02' izz='0.02' ixy='0' ixz='0' iyz='0'/>"


def link(name: str) -> str:
    return f"<link name='{name}'><inertial><origin xyz='0.1 0.02 0'/><mass value='1'/>{INERTIA}</inertial></link>"


def joint(
    name: str,
    parent: str,
    child: str,
    place: str = "0 0 0",
    more: str = "",
    axis: str = "0 0 1",
) -> str:
    ends = f"<parent link='{parent}'/><child link='{child}'/><origin xyz='{place}'/><axis xyz='{axis}'/>"
    return f"<joint name='{name}' type='continuous'{more}>{ends}</joint>"


def four_bar(loop: str, axis: str = "0 0 1") -> str:
    """A four-bar linkage with an open loop, and what closes it; a horizontal axis lets gravity act in its plane."""
    free, bound = " independent='true'", " independent='false'"
    links = "<link name='base'/>" + "".join(map(link, ("crank", "coupler", "rocker")))
    reach = {"0 0 1": ("0 0.3 0", "0.7 0 0"), "0 1 0": ("0.3 0 0", "0 0 0.7")}[axis]
    joints = (
        joint("j1", "base", "crank", more=free, axis=axis),
        joint("j2", "crank", "coupler", reach[0], bound, axis),
        joint("j3", "base", "rocker", reach[1], bound, axis),
    )
    return f"<robot name='four_bar'>{links}{''.join(joints)}{loop}</robot>"


ENDS = "<predecessor link='coupler'><origin xyz='0.6 0.2 0'/></predecessor>"
ENDS += "<successor link='rocker'><origin xyz='-0.1 0.5 0'/></successor>"
LOOP = f"<loop name='pin' type='revolute'>{ENDS}<axis xyz='0 0 1'/></loop>"
BALL = """<drake:ball_constraint>
  <drake:ball_constraint_body_A name='coupler'/><drake:ball_constraint_p_AP value='0.6 0.2 0'/>
  <drake:ball_constraint_body_B name='rocker'/><drake:ball_constraint_p_BQ value='-0.1 0.5 0'/>
  </drake:ball_constraint>"""
GAZEBO = """<gazebo><joint name='pin' type='revolute'><parent>coupler</parent><child>rocker</child>
  <pose>-0.1 0.5 0 0 0 0.4</pose><axis><xyz>0 0 1</xyz></axis></joint></gazebo>"""
SIMULATOR = """<loop_joint name='pin' type='spherical'><link1 link='coupler' xyz='0.6 0.2 0' rpy='0 0 0'/>
  <link2 link='rocker' xyz='-0.1 0.5 0' rpy='0 0 0'/></loop_joint>"""
DIALECTS = {
    "URDF+": LOOP,
    "URDF+, any length of axis": LOOP.replace("0 0 1", "0 0 -3"),
    "URDF+, cylindrical": LOOP.replace("revolute", "cylindrical"),
    "Drake": BALL,
    "Gazebo": GAZEBO,
    "Gazebo, a ball": GAZEBO.replace("'revolute'", "'ball'"),
    "simulators": SIMULATOR,
}


@pytest.mark.parametrize(
    "dialect", slow_unless(lambda dialect: "," not in dialect, DIALECTS)
)
def test_a_loop_of_each_dialect_gives_the_set_of_the_description_beside_the_tree(
    dialect: str, tmp_path: Path
) -> None:
    (tmp_path / "tree.urdf").write_text(re.sub(r" independent='\w+'", "", four_bar("")))
    (tmp_path / "robot.yaml").write_text("""
echelon: 1
robot: {file: tree.urdf, driven: [j1]}
loops:
  - {joint: revolute, connects: [coupler, rocker], at: {xyz: [0.6, 0.2, 0]}, on_second: {xyz: [-0.1, 0.5, 0]}, axis: z}
""")
    robots = [
        ec.load(robot)
        for robot in (tmp_path / "robot.yaml", four_bar(DIALECTS[dialect]))
    ]
    assert robots[1].independent_velocities == ("j1",)
    stated, found = map(ec.base_parameters, robots)
    assert found.rank == 4
    assert found.expressions == stated.expressions


def test_gravity_in_the_plane_of_a_loop_shows_eight_parameters() -> None:
    turned = (
        LOOP.replace("0.6 0.2 0", "0.2 0 0.6")
        .replace("-0.1 0.5 0", "0.5 0 -0.1")
        .replace("0 0 1", "0 1 0")
    )
    structure = ec.base_structure(ec.load(four_bar(turned, "0 1 0")))
    assert structure.rank == 8


def test_the_frames_of_a_loop_may_be_turned() -> None:
    """With x along the pin, in frames that are turned on both links."""
    turned = LOOP.replace(
        "xyz='0.6 0.2 0'", "xyz='0.6 0.2 0' rpy='0 -1.5707963267948966 0'"
    )
    turned = turned.replace(
        "xyz='-0.1 0.5 0'", "xyz='-0.1 0.5 0' rpy='0 -1.5707963267948966 0'"
    )
    turned = turned.replace("<axis xyz='0 0 1'/>", "")  # x, as everywhere in URDF
    assert ec.base_structure(ec.load(four_bar(turned))).rank == 4


def test_the_joint_that_is_said_to_be_independent_is() -> None:
    text = four_bar(LOOP).replace(
        "name='j1' type='continuous' independent='true'", "name='j1' type='continuous'"
    )
    text = text.replace(
        "name='j3' type='continuous' independent='false'",
        "name='j3' type='continuous' independent='True'",
    )
    assert ec.load(text).independent_velocities == ("j3",)


ROTOR = "<coupling name='gear'><predecessor link='arm'/><successor link='rotor'/><ratio value='6'/></coupling>"
GEARED = f"""<robot name='geared'><link name='base'/>{link("arm")}{link("rotor")}{joint("j", "base", "arm")}
  {joint("r", "base", "rotor", more=" independent='false'")}{ROTOR}</robot>"""


def test_a_rotor_counts_with_the_square_of_its_ratio() -> None:
    base = ec.base_parameters(ec.load(GEARED))
    assert [str(expression) for expression in base.expressions] == ["ZZ1 + 36·ZZ2"]


def test_a_coupling_sums_the_joints_on_its_ways() -> None:
    """A belt along an arm: half the angles of both links are that of the rotor on the base."""
    belt = ROTOR.replace("arm", "hand").replace("'6'", "'0.5'")
    text = GEARED.replace(
        ROTOR, f"{link('hand')}{joint('k', 'arm', 'hand', '1 0 0')}{belt}"
    )
    (coupling,) = ec.load(text).couplings
    assert (coupling.coordinate, {name: str(f) for name, f in coupling.terms}) == (
        "r",
        {"j": "1/2", "k": "1/2"},
    )
    reverse = text.replace(
        "name='r' type='continuous' independent='false'", "name='r' type='continuous'"
    )
    reverse = reverse.replace(
        "name='k' type='continuous'", "name='k' type='continuous' independent='false'"
    )
    (coupling,) = ec.load(reverse).couplings
    assert (coupling.coordinate, {name: str(f) for name, f in coupling.terms}) == (
        "k",
        {"j": "-1", "r": "2"},
    )


def test_couplings_are_ignored_on_request_as_mimics_are() -> None:
    assert ec.load(GEARED, independent_mimics=True).degrees_of_freedom == 2


BESIDE = r"state .* in a YAML file beside it:  robot: {file: text}  and  loops: \[{joint: revolute"
REFUSED = {
    "universal loop": (
        LOOP.replace("'revolute'", "'universal'"),
        rf"loop 'pin': its type is 'universal' .*{BESIDE}",
    ),
    "axis of simulators": (
        SIMULATOR.replace("spherical", "revolute"),
        rf"loop_joint 'pin': its type .*{BESIDE}",
    ),
    "no type": (
        LOOP.replace(" type='revolute'", ""),
        "loop 'pin': the attribute 'type' is missing",
    ),
    "unknown link": (
        LOOP.replace("link='rocker'", "link='rokcer'"),
        "successor link 'rokcer' .* mean 'rocker'",
    ),
    "no link": (
        LOOP.replace(" link='rocker'", ""),
        "<successor> with the name of a link is missing",
    ),
    "no point": (
        BALL.replace("value='0.6 0.2 0'", ""),
        "drake:ball_constraint 'loop1' p_AP: the point is missing",
    ),
    "zero axis": (LOOP.replace("0 0 1", "0 0 0"), "loop 'pin': the axis is zero"),
    "pose elsewhere": (
        GAZEBO.replace("<pose>", "<pose relative_to='base'>"),
        "pose is stated in 'base'",
    ),
    "axis elsewhere": (
        GAZEBO.replace("<xyz>", "<xyz expressed_in='base'>"),
        "the attribute 'expressed_in' is not read",
    ),
    "short pose": (
        GAZEBO.replace("0 0 0.4", "0"),
        "gazebo joint 'pin' pose: needs six numbers",
    ),
    "screw": (
        GAZEBO.replace("revolute", "screw"),
        "gazebo joint 'pin': its type is 'screw'",
    ),
    "the world": (
        GAZEBO.replace("<parent>coupler", "<parent>world"),
        "the world is not a link of a URDF",
    ),
    "nothing says how": (
        "",
        "joint 'j2': the file states that it depends on others .* no loop or coupling for it",
    ),
    "no truth": (
        LOOP.replace("<loop", "<joint name='j1' independent='perhaps'/><loop"),
        "this name occurs twice",
    ),
    **{
        name: (
            f"<{name}/>",
            rf"<{name}> is not read, and may change how the robot moves.*{BESIDE}.*--ignore {name}",
        )
        for name in (
            "constraint",
            "loop_constraint",
            "drake:linear_bushing_rpy",
            "drake:tendon_constraint",
        )
    },
    "drake:joint": (
        "<drake:joint/>",
        "<drake:joint> is not read.*joints: {NAME: {type: spherical}}",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_loops_that_are_not_read_are_refused_with_what_to_write(case: str) -> None:
    loop, problem = REFUSED[case]
    with pytest.raises(InputError, match=problem):
        ec.load(four_bar(loop))


def test_statements_of_independence_are_checked() -> None:
    with pytest.raises(
        InputError,
        match=r"joint 'j2': .* it is independent, but loops determine it from others",
    ):
        ec.load(four_bar(LOOP).replace("independent='false'", "independent='true'"))
    with pytest.raises(
        InputError, match="joint 'j1': independent='perhaps' is neither true nor false"
    ):
        ec.load(four_bar(LOOP).replace("independent='true'", "independent='perhaps'"))


BAD_COUPLINGS = {
    "no ratio": (
        ROTOR.replace("<ratio value='6'/>", ""),
        "coupling 'gear': needs <ratio value",
    ),
    "unknown link": (
        ROTOR.replace("'rotor'", "'rotro'"),
        "successor link 'rotro' does not exist; did you mean 'rotor'",
    ),
    "no motion between": (
        ROTOR.replace("'rotor'", "'arm'"),
        "no joint moves its links against each other",
    ),
    "held": (
        ROTOR.replace("'6'", "'0'"),
        "joint 'r': the couplings hold it where it is",
    ),
}


@pytest.mark.parametrize("case", BAD_COUPLINGS)
def test_couplings_that_make_no_sense_are_refused(case: str) -> None:
    coupling, problem = BAD_COUPLINGS[case]
    with pytest.raises(InputError, match=problem):
        ec.load(GEARED.replace(ROTOR, coupling))


def test_a_joint_of_gazebo_that_holds_the_base_changes_nothing() -> None:
    held = "<gazebo><joint name='w' type='fixed'><parent>world</parent><child>base</child></joint></gazebo>"
    assert ec.load(four_bar(LOOP + held)).closures == ec.load(four_bar(LOOP)).closures


# -- rings -------------------------------------------------------------------------------------------------------------

RING = ["<link name='a'/>", "<link name='b'/>", "<link name='c'/>"]
RING += [joint("1", "a", "b"), joint("2", "b", "c", "0.1 0 0"), joint("3", "c", "a")]


@pytest.mark.parametrize("more", ["", "<link name='root'/>"])
def test_a_ring_is_refused_with_the_loop_to_write(more: str) -> None:
    said = r"joint '3' closes it: take this joint out, and state it as a loop: .*connects: \[c, a\]"
    with pytest.raises(InputError, match=said):
        ec.load(f"<robot name='ring'>{more}{''.join(RING)}</robot>")


@pytest.mark.parametrize(
    ("kind", "loop"),
    [("ball", "spherical"), ("fixed", "weld"), ("prismatic", "prismatic")],
)
def test_a_second_parent_is_refused_with_the_loop_to_write(
    kind: str, loop: str
) -> None:
    second = joint("3", "a", "c").replace("continuous", kind)
    with pytest.raises(
        InputError,
        match=rf"joint '3': link 'c' already has joint '2'.*joint: {loop}, connects: \[a, c\]",
    ):
        ec.load(f"<robot name='two'>{''.join(RING[:5])}{second}</robot>")


# -- floating bases ----------------------------------------------------------------------------------------------------

FREE = f"""<robot name='free'><link name='world'/>{link("trunk")}
  <joint name='root' type='floating'><parent link='world'/><child link='trunk'/></joint></robot>"""
FREE_MJCF = "<mujoco><worldbody><body name='trunk'><freejoint name='root'/><geom size='1'/></body></worldbody></mujoco>"


@pytest.mark.parametrize("text", [FREE, FREE_MJCF])
def test_a_base_that_floats_already_is_not_set_free_again(text: str) -> None:
    assert open_robot(text).mechanism().degrees_of_freedom == 6
    with pytest.raises(
        InputError,
        match=r"body 'trunk': its joint 'root' lets it float already.*leave out --floating",
    ):
        open_robot(text).mechanism(ReadingOptions(floating=True))


def test_a_base_of_its_own_floats_beside_a_body_that_does() -> None:
    text = FREE.replace("<link name='world'/>", link("world"))
    assert ec.load(text, floating=True).degrees_of_freedom == 12
