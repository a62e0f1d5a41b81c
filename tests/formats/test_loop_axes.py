"""Loops in general frames: drawn mechanisms turned as a whole, with links turned at random, rounded to some digits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
import yaml

import echelon as ec
from echelon.exact.expressions import Angle
from echelon.exact.polynomial import as_polynomial
from echelon.inertia import rotation_of
from echelon.mechanism.closed_pose import follow
from echelon.mechanism.joint import shift, turn
from echelon.mechanism.stated import known_values, placement_matrix
from echelon.regressor.loops import exact_pose
from echelon.results.saved import from_json, to_json
from support.published_loops import LOOPS
from support.selection import slow_unless
from support.zoo import ZOO
from support.zoo.mjcf_text import INERTIA

AXES = dict(zip("xyz", np.eye(3), strict=True))


def vector(numbers: str | Sequence[str]) -> np.ndarray:
    return AXES[numbers] if isinstance(numbers, str) else np.array([float(Fraction(x)) for x in numbers])


def mjcf(text: str, digits: int, seed: int, ref: float = 0.0) -> str:
    """A drawn mechanism; a revolute joint closes as two points on its axis.  Hinges stand at an angle there."""
    robot, rng = yaml.load(text, yaml.BaseLoader), np.random.default_rng(seed)
    turns = {
        b["name"]: q / np.linalg.norm(q) for b in [{"name": "all"}, *robot["bodies"]] for q in [rng.normal(size=4)]
    }
    whole, at, frames, nested = rotation_of(turns["all"]), {"base": np.zeros(3)}, {"base": np.eye(3)}, {}

    def shown(numbers: np.ndarray) -> str:
        return " ".join(f"{x:.{digits}g}" for x in numbers)

    def body(entry: dict) -> str:
        name, parent, joint = entry["name"], entry["parent"], entry["joint"]
        frames[name], at[name] = rotation_of(turns[name]), at[parent] + whole @ vector(joint["origin"]["xyz"])
        apart = np.array([1.0, 0, 0, 0]) if parent == "base" else turns[parent] * (1, -1, -1, -1)
        w, x, y, z = apart
        product = np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]]) @ turns[name]
        place = frames[parent].T @ (at[name] - at[parent])
        axes = [shown(frames[name].T @ whole @ vector(joint[k])) for k in ("axis", "axis2") if k in joint]
        kind = "slide" if joint["type"] == "prismatic" else "hinge"
        at_ref = f' ref="{ref}"' if ref and kind == "hinge" else ""
        joints = "".join(f'<joint name="{name}{k}" type="{kind}" axis="{a}"{at_ref}/>' for k, a in enumerate(axes))
        joints = joints or f'<joint name="{name}" type="ball"/>'
        inner = "".join(body(other) for other in robot["bodies"] if other["parent"] == name)
        return f'<body name="{name}" pos="{shown(place)}" quat="{shown(product)}">{joints}{INERTIA}{inner}</body>'

    bodies = "".join(body(entry) for entry in robot["bodies"] if entry["parent"] == "base")
    for loop in robot["loops"]:
        first, second = loop["connects"]
        points = [at[first] + whole @ vector(loop["at"]["xyz"])]
        points += [points[0] + whole @ vector(loop["axis"]) / 10] if "axis" in loop else []
        anchors = (shown(frames[first].T @ (point - at[first])) for point in points)
        nested |= {f'<connect body1="{first}" body2="{second}" anchor="{anchor}"/>': None for anchor in anchors}
    gravity = shown(whole @ vector(robot["gravity"]))
    world, equality = f"<worldbody>{bodies}</worldbody>", f"<equality>{''.join(nested)}</equality>"
    radians = '<compiler angle="radian"/>'
    return f'<mujoco>{radians}<option gravity="{gravity}"/>{world}{equality}</mujoco>'


CASES = [
    ("Peaucellier", 6),
    ("Peaucellier", 17),
    ("Sarrus, oblique", 6),
    ("Jansen", 17),
    ("Delta, crosses", 6),
    ("Delta, crosses", 17),
    ("scissor lift", 6),
    ("3-UPU", 8),
    ("3-UPU, general", 6),
    ("Gough-Stewart, 3-3", 6),
]


@pytest.mark.parametrize(("name", "digits"), slow_unless(lambda case: case == ("Peaucellier", 6), CASES))
def test_ranks_do_not_depend_on_rounded_frames(name: str, digits: int, tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(mjcf(ZOO[name].text, digits, 1), encoding="utf-8")
    mechanism = ec.load(file)
    assert (mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank) == (ZOO[name].freedom, ZOO[name].rank)


def test_an_axis_in_a_coordinate_plane_has_one_symbol() -> None:
    """The other angle is exact; a symbol of value zero could be a denominator."""
    rod = f'<body name="rod" pos="0.1 0.1 0.4"><freejoint name="rod"/>{INERTIA}</body>'
    turning = f'<body name="b" pos="0.5 0 0"><joint name="b" axis="1 0.2 0"/>{INERTIA}</body>'
    loop = '<equality><connect body1="rod" body2="b" anchor="0.3 0 0.1"/></equality>'
    robot = ec.load(f"<mujoco><worldbody>{turning}{rod}</worldbody>{loop}</mujoco>")
    assert [symbol.value for symbol in robot.symbols.values()] == [pytest.approx(np.arctan(0.2))]


def found(text: str) -> tuple[int, int]:
    mechanism = ec.load(text)
    return mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank


def test_zero_of_the_coordinates_does_not_matter() -> None:
    assert found(mjcf(ZOO["Peaucellier"].text, 6, 1, ref=0.4)) == (1, 14)


def test_points_of_a_symmetric_platform_may_be_rounded() -> None:
    """Rods are equally long to six decimals; all frames are turned by multiples of 15 degrees."""
    sites, legs, equality = "", "", ""
    for k in range(3):
        c, s = np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3)
        rods = ""
        for side, y in (("l", 0.03), ("r", -0.03)):
            sites += f'<site name="on{k}{side}" pos="{0.04 * c - y * s:.6f} {0.04 * s + y * c:.6f} 0"/>'
            rods += f"""<body name="rod{k}{side}" pos="-0.02 {y} 0"><joint name="rod{k}{side}" type="ball"/>{INERTIA}
              <site name="end{k}{side}" pos="-0.14 0 -0.2"/></body>"""
            equality += f'<connect site1="end{k}{side}" site2="on{k}{side}"/>'
        legs += f"""<frame euler="0 0 {120 * k}"><body name="car{k}" pos="0.2 0 0.3">
          <joint name="car{k}" type="slide" axis="0 0 1"/>{INERTIA}{rods}</body></frame>"""
    platform = f'<body name="platform" pos="0 0 0.1"><freejoint name="platform"/>{INERTIA}{sites}</body>'
    world, equality = f"<worldbody>{platform}{legs}</worldbody>", f"<equality>{equality}</equality>"
    assert found(f"<mujoco>{world}{equality}</mujoco>") == (9, 49)


CARDAN = """
echelon: 1
bodies:
  - {name: in, joint: {type: revolute, axis: x}}
  - {name: yoke, parent: in, joint: {type: universal, axis: x, axis2: y, origin: {xyz: [0.1, 0, 0], rpy: [1.316428,
      1.176005, 1.570796]}}}
  - {name: spline, parent: yoke, joint: {type: prismatic, axis: [0.967823, 0.232277, 0.096782], origin: {xyz: [0, 0,
      0.516624], rpy: [1.176005, -1.316428, -1.570796]}}}
  - {name: out, joint: {type: revolute, axis: x, origin: {xyz: [0.7, 0.12, 0.05]}}}
loops:
  - {joint: universal, connects: [spline, out], at: {rpy: [-0.254368, 1.176005, 1.570796]}, on_second: {xyz: [
      -0.1, 0, 0], rpy: [-0.254368, 1.176005, 1.570796]}}
"""


def test_numbers_of_descriptions_may_be_rounded() -> None:
    """A shaft with two universal joints between parallel shafts; with names, lengths and angles are as they are."""
    assert found(CARDAN) == (1, 6)


SPHERICAL = """
echelon: 1
bodies:
  - {name: a, joint: {type: revolute, axis: [-0.910792, -0.112744, 0.397173],
      origin: {xyz: [0.1, 0.2, 0.3], rpy: [-0.276589, 1.145199, -2.802113]}}}
  - {name: b, parent: a, joint: {type: revolute, axis: [0.418317, -0.105901, -0.902107],
      origin: {rpy: [0.568528, 0.006882, -2.881950]}}}
  - {name: c, parent: b, joint: {type: revolute, axis: [-0.044693, 0.387251, 0.920891],
      origin: {rpy: [1.119728, 0.431289, 0.565322]}}}
loops:
  - {joint: revolute, connects: [c, base], at: {rpy: [-0.127290, -0.161825, -1.868360]},
      on_second: {xyz: [0.1, 0.2, 0.3], rpy: [0.375674, 0.531808, 0.197396]}}
"""
DOUBLE_CARDAN = """
echelon: 1
bodies:
  - {name: in, joint: {type: revolute, axis: [-0.962215, 0.242722, -0.123404],
      origin: {xyz: [-0.18, 0, -0.24], rpy: [-0.276589, 1.145199, -2.802113]}}}
  - {name: cross1, parent: in, joint: {type: revolute, axis: [0.348264, 0.347150, -0.870746],
      origin: {xyz: [-0.288665, 0.072816, -0.037021], rpy: [0.568528, 0.006882, -2.881950]}}}
  - {name: mid, parent: cross1, joint: {type: revolute, axis: [-0.154636, -0.735679, 0.659442],
      origin: {rpy: [1.119728, 0.431289, 0.565322]}}}
  - {name: cross2, parent: mid, joint: {type: revolute, axis: [-0.019097, 0.895832, 0.443982],
      origin: {xyz: [0.289800, 0.236495, 0.331792], rpy: [0.297829, 0.314848, -3.086813]}}}
  - {name: out, parent: cross2, joint: {type: revolute, axis: [0.571403, 0.603266, 0.556389],
      origin: {rpy: [2.983873, 0.633064, -2.337472]}}}
loops:
  - {joint: revolute, connects: [out, base], at: {xyz: [-0.072273, 0.231421, -0.176695],
      rpy: [2.384644, -0.626255, 2.888976]}, on_second: {xyz: [0.18, 0, 0.74], rpy: [0, 0.643501, 0]}}
"""


@pytest.mark.parametrize(("text", "rank"), [(SPHERICAL, 9), (DOUBLE_CARDAN, 9)])
def test_angles_of_general_frames_are_not_near_multiples_of_15_degrees_by_intent(text: str, rank: int) -> None:
    """The first axes are along gravity, which is a relation, too."""
    assert found(text) == (1, rank)


PARALLELOGRAM = """<robot name="bars"><link name="floor"/><link name="crank"/><link name="bar"/><link name="rocker"/>
<link name="one"/><link name="two"/>
<joint name="crank" type="continuous"><parent link="floor"/><child link="crank"/><axis xyz="0 0 1"/>
  <origin xyz="0.1 -0.2 0.3" rpy="0.647633 0.271271 0.199993"/></joint>
<joint name="bar" type="continuous"><parent link="crank"/><child link="bar"/><axis xyz="0 0 1"/>
  <origin xyz="0.1 0.2 0"/></joint>
<joint name="rocker" type="continuous"><parent link="floor"/><child link="rocker"/><axis xyz="0 0 1"/>
  <origin xyz="0.572114 -0.063615 0.195084" rpy="0.647633 0.271271 0.199993"/></joint>
<joint name="f1" type="fixed"><parent link="bar"/><child link="one"/><origin xyz="0.5 0.05 0"/></joint>
<joint name="f2" type="fixed"><parent link="rocker"/><child link="two"/><origin xyz="0.1 0.2 0"/></joint></robot>"""


def test_loops_in_general_frames_that_are_open_by_rounding_alone_are_restored(tmp_path: Path) -> None:
    """Sides of a parallelogram are equal but for the place where it closes."""
    (tmp_path / "bars.urdf").write_text(PARALLELOGRAM)
    file = tmp_path / "loop.yaml"
    file.write_text("echelon: 1\nrobot: bars.urdf\nloops: [{joint: revolute, connects: [one, two]}]\n")
    assert ec.base_structure(ec.load(file)).rank == 3


def tilted_delta() -> str:
    """Rods between a cross and a ball, in six decimals."""
    whole, loops, at = rotation_of(np.array([0.8, 0.2, 0.4, 0.4])), "", {"base": np.zeros(3)}
    text = "echelon: 1\nbodies:\n"

    def shown(numbers: np.ndarray) -> str:
        return f"[{', '.join(f'{x:.6f}' for x in numbers)}]"

    def body(name: str, parent: str, place: np.ndarray, axis: np.ndarray | None) -> str:
        at[name], along = place, "type: spherical" if axis is None else f"type: revolute, axis: {shown(axis)}"
        origin, light = shown(place - at[parent]), ", massless: true" * name.startswith("cross")
        return f"  - {{name: {name}, parent: {parent}, joint: {{{along}, origin: {{xyz: {origin}}}}}{light}}}\n"

    for k, angle in enumerate(2 * np.pi * np.arange(3) / 3):
        out, along, up = (
            whole @ v for v in ((np.cos(angle), np.sin(angle), 0), (-np.sin(angle), np.cos(angle), 0), AXES["z"])
        )
        text += body(f"arm{k}", "base", 0.2 * out, along)
        for name, side in ((f"{k}a", 0.05 * along), (f"{k}b", -0.05 * along)):
            low, high = 0.45 * out - 0.1 * up + side, 0.1 * out - 0.6 * up + side
            across = np.cross(along, high - low)
            text += body(f"cross{name}", f"arm{k}", low, along)
            text += body(f"rod{name}", f"cross{name}", low, across / np.linalg.norm(across))
            if "top" in at:
                frames = f"at: {{xyz: {shown(high - low)}}}, on_second: {{xyz: {shown(high - at['top'])}}}"
                loops += f"  - {{joint: spherical, connects: [rod{name}, top], {frames}}}\n"
            else:
                text += body("top", f"rod{name}", high, None)
    return f"{text}loops:\n{loops}"


CROSSED = """
echelon: 1
bodies:
  - {name: crank, joint: {type: revolute, axis: [-0.7525, 0.5485, 0.3645],
      origin: {xyz: [0.1, -0.2, 0.3], rpy: [-0.2766, 1.1452, -2.8021]}}}
  - {name: bar, parent: crank, joint: {type: revolute, axis: [0.5840, -0.4111, 0.7000],
      origin: {xyz: [-0.2058, -0.2224, -0.0903], rpy: [0.5685, 0.0069, -2.8820]}}}
  - {name: rocker, joint: {type: revolute, axis: [-0.0447, 0.3873, 0.9209],
      origin: {xyz: [0.5721, 0.1398, 0.3404], rpy: [0.6193, -0.6182, 1.7617]}}}
loops:
  - {joint: revolute, connects: [bar, rocker], at: {xyz: [-0.2449, -0.5195, -0.1007], rpy: [-0.5932, 0.5658, -1.5124]},
      on_second: {xyz: [-0.3130, 0.0339, -0.0295], rpy: [0.1063, -0.3868, -1.7315]}}
"""


def test_links_stay_crossed_where_rounding_opens_their_loop() -> None:
    """Equal opposite sides in four decimals: the nearest pose is taken, not the one far away that closes best."""
    assert found(CROSSED) == (1, 8)


@pytest.mark.slow
def test_parallel_rods_of_a_tilted_delta_are_restored() -> None:
    """Its arms are in no coordinate plane; a rod ends in a cross, whose centre is on the other side of the joint."""
    assert found(tilted_delta()) == (3, 34)


@pytest.mark.slow
def test_restored_loops_that_are_open_at_zero_are_read_again() -> None:
    turned = CARDAN.replace("[0.7, 0.12, 0.05]}", "[0.7, 0.12, 0.05], rpy: [0.400037, 0, 0]}")
    base = ec.base_parameters(ec.load(turned))
    assert (base.rank, ec.verify(from_json(to_json(base))).rank) == (6, 6)


@pytest.mark.parametrize("apart", [0, Fraction(1, 10**7)])
def test_second_axes_of_universal_joints_stay_when_frames_follow(apart: Fraction) -> None:
    """The first frame may be turned about the first axis; the second one follows with its place only."""
    mechanism = ec.load(CARDAN)
    (closure,) = mechanism.closures
    first = closure.first_frame @ turn(0, Angle(Fraction(1, 6)))
    second = closure.second_frame @ shift(as_polynomial(apart), 0, 0)
    stated = replace(mechanism, closures=(replace(closure, first_frame=first, second_frame=second),))
    (followed,) = follow(stated, exact_pose.rational_pose(stated, np.zeros(len(stated.positions)))).closures
    placed, wanted = (
        reduce(np.matmul, (placement_matrix(step, known_values(mechanism)) for step in c.placements[1:]))
        for c in (followed, closure)
    )
    np.testing.assert_allclose(placed[:3, [1, 3]], wanted[:3, [1, 3]], atol=1e-9)


def test_a_rank_that_fades_below_rounding_raises_a_doubt() -> None:
    """A Peaucellier linkage has 14 base parameters; rounded, and closed by pairs of points, 15 show, some faintly."""
    mechanism = ec.load(LOOPS / "peaucellier_pairs.xml")
    assert mechanism.degrees_of_freedom == 1
    with pytest.warns(ec.DoubtWarning, match="perhaps fewer than 15"):
        ec.base_structure(mechanism)
