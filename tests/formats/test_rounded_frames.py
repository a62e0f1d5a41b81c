"""Loops in general frames: drawn mechanisms turned as a whole, with links turned at random, rounded to some digits."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import yaml

import echelon as ec
from echelon.base.saved.saved import from_json, to_json
from echelon.robot.inertia import rotation_of
from support.published_loops import LOOPS
from support.rounded_exports.verdict import names
from support.selection import one_in, slow_unless
from support.zoo import ZOO
from support.zoo.mjcf_text import INERTIA

AXES = dict(zip("xyz", np.eye(3), strict=True))


def vector(numbers: str | Sequence[str]) -> np.ndarray:
    return (
        AXES[numbers]
        if isinstance(numbers, str)
        else np.array([float(Fraction(x)) for x in numbers])
    )


def mjcf(text: str, digits: int, seed: int, ref: float = 0.0) -> str:
    """A drawn mechanism; a revolute joint closes as two points on its axis.  Hinges stand at an angle there."""
    robot, rng = yaml.load(text, yaml.BaseLoader), np.random.default_rng(seed)
    turns = {
        b["name"]: q / np.linalg.norm(q)
        for b in [{"name": "all"}, *robot["bodies"]]
        for q in [rng.normal(size=4)]
    }
    whole, at, frames, nested = (
        rotation_of(turns["all"]),
        {"base": np.zeros(3)},
        {"base": np.eye(3)},
        {},
    )

    def shown(numbers: np.ndarray) -> str:
        return " ".join(f"{x:.{digits}g}" for x in numbers)

    def body(entry: dict) -> str:
        name, parent, joint = entry["name"], entry["parent"], entry["joint"]
        frames[name], at[name] = (
            rotation_of(turns[name]),
            at[parent] + whole @ vector(joint["origin"]["xyz"]),
        )
        apart = (
            np.array([1.0, 0, 0, 0])
            if parent == "base"
            else turns[parent] * (1, -1, -1, -1)
        )
        w, x, y, z = apart
        product = (
            np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])
            @ turns[name]
        )
        place = frames[parent].T @ (at[name] - at[parent])
        axes = [
            shown(frames[name].T @ whole @ vector(joint[k]))
            for k in ("axis", "axis2")
            if k in joint
        ]
        kind = "slide" if joint["type"] == "prismatic" else "hinge"
        at_ref = f' ref="{ref}"' if ref and kind == "hinge" else ""
        joints = "".join(
            f'<joint name="{name}{k}" type="{kind}" axis="{a}"{at_ref}/>'
            for k, a in enumerate(axes)
        )
        joints = joints or f'<joint name="{name}" type="ball"/>'
        inner = "".join(
            body(other) for other in robot["bodies"] if other["parent"] == name
        )
        return f'<body name="{name}" pos="{shown(place)}" quat="{shown(product)}">{joints}{INERTIA}{inner}</body>'

    bodies = "".join(
        body(entry) for entry in robot["bodies"] if entry["parent"] == "base"
    )
    for loop in robot["loops"]:
        first, second = loop["connects"]
        points = [at[first] + whole @ vector(loop["at"]["xyz"])]
        points += (
            [points[0] + whole @ vector(loop["axis"]) / 10] if "axis" in loop else []
        )
        anchors = (shown(frames[first].T @ (point - at[first])) for point in points)
        nested |= {
            f'<connect body1="{first}" body2="{second}" anchor="{anchor}"/>': None
            for anchor in anchors
        }
    gravity = shown(whole @ vector(robot["gravity"]))
    world, equality = (
        f"<worldbody>{bodies}</worldbody>",
        f"<equality>{''.join(nested)}</equality>",
    )
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


@pytest.mark.slow
@pytest.mark.parametrize(("name", "digits"), CASES)
def test_ranks_do_not_depend_on_rounded_frames(
    name: str, digits: int, tmp_path: Path
) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(mjcf(ZOO[name].text, digits, 1), encoding="utf-8")
    mechanism = ec.load(file)
    assert (mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank) == (
        ZOO[name].freedom,
        ZOO[name].rank,
    )


def test_an_axis_in_a_coordinate_plane_has_one_symbol() -> None:
    """The other angle is exact; a symbol of value zero could be a denominator."""
    rod = f'<body name="rod" pos="0.1 0.1 0.4"><freejoint name="rod"/>{INERTIA}</body>'
    turning = (
        f'<body name="b" pos="0.5 0 0"><joint name="b" axis="1 0.2 0"/>{INERTIA}</body>'
    )
    loop = '<equality><connect body1="rod" body2="b" anchor="0.3 0 0.1"/></equality>'
    robot = ec.load(f"<mujoco><worldbody>{turning}{rod}</worldbody>{loop}</mujoco>")
    assert [symbol.value for symbol in robot.symbols.values()] == [
        pytest.approx(np.arctan(0.2))
    ]


def found(text: str) -> tuple[int, int]:
    """Degrees of freedom and rank, without a doubt."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", ec.DoubtWarning)
        mechanism = ec.load(text)
        return mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank


def is_told(text: str, freedom: int, rank: int) -> bool:
    """Whether the answer is the truth, a doubt that names it, or a refusal."""
    try:
        return found(text) == (freedom, rank)
    except ec.DoubtWarning as doubt:
        return names(str(doubt), rank)
    except ec.EchelonError:
        return True


@pytest.mark.slow
def test_zero_of_the_coordinates_does_not_matter() -> None:
    assert is_told(mjcf(ZOO["Peaucellier"].text, 6, 1, ref=0.4), 1, 14)


@pytest.mark.slow
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
    world, equality = (
        f"<worldbody>{platform}{legs}</worldbody>",
        f"<equality>{equality}</equality>",
    )
    assert is_told(f"<mujoco>{world}{equality}</mujoco>", 9, 49)


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


def test_axes_outside_the_loops_of_descriptions_may_be_rounded() -> None:
    """The first arm turns about the vertical, as the loop's do not; no frame is upright."""
    arm = "axis: [-0.298205, 0.740949, 0.601721], origin: {xyz: [0.109, 0, 0], rpy: [0.888724, 0.302812, -1.502457]}"
    text = f"""
echelon: 1
bodies:
  - {{name: arm, joint: {{type: revolute, {arm}}}}}
  - {{name: crank, joint: {{type: revolute, axis: x, origin: {{xyz: [0, -0.453, 0]}}}}}}
  - {{name: rod, parent: crank, joint: {{type: revolute, axis: x, origin: {{xyz: [0, 0.04, -0.471]}}}}}}
  - {{name: slide, joint: {{type: prismatic, axis: y, origin: {{xyz: [0, 0.3, 0]}}}}}}
loops: [{{joint: revolute, connects: [rod, slide], axis: x, at: {{xyz: [0, 0.2, 0.1]}}}}]
"""
    freedom, rank = found(text.replace(arm, "axis: z"))
    assert is_told(text, freedom, rank)
    assert is_told(text.replace("0.601721", "0.651721"), freedom, rank + 2)


def test_numbers_of_descriptions_may_be_rounded() -> None:
    """A shaft with two universal joints between parallel shafts; with names, lengths and angles are as they are."""
    assert is_told(CARDAN, 1, 6)


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


@pytest.mark.parametrize(
    ("text", "rank"), one_in(2, [(SPHERICAL, 9), (DOUBLE_CARDAN, 9)])
)
def test_angles_of_general_frames_are_not_near_multiples_of_15_degrees_by_intent(
    text: str, rank: int
) -> None:
    """The first axes are along gravity, which is a relation, too."""
    assert found(text) == (1, rank)


TURNTABLE = """
echelon: 1
gravity: [4.1689, -8.7856, -1.2920]
bodies:
  - {name: turn, joint: {type: revolute, axis: [-0.6834, -0.7224, 0.1050], origin: {rpy: [-2.9117, 0.1021, -0.3039]}}}
  - {name: crank, parent: turn, joint: {type: revolute, axis: [0.7474, -0.5357, 0.3929],
      origin: {rpy: [1.4250, -0.6832, -1.8401]}}}
  - {name: coupler, parent: crank, joint: {type: revolute, axis: [-0.1698, -0.8139, 0.5556],
      origin: {xyz: [-0.0845, -0.0608, 0.0779], rpy: [-2.1689, 0.5988, -2.1247]}}}
  - {name: rocker, parent: turn, joint: {type: revolute, axis: [0.2631, 0.9643, 0.0310],
      origin: {xyz: [-0.2893, 0.2758, 0.0148], rpy: [-2.8451, -1.1296, -1.1649]}}}
loops:
  - {joint: revolute, connects: [coupler, rocker],
      at: {xyz: [0.0346, -0.2069, -0.2926], rpy: [0.8222, 0.6159, -0.6982]},
      on_second: {xyz: [-0.2690, 0.0690, 0.1377], rpy: [-1.5190, 0.9282, -0.2249]}}
"""
SARRUS = """
echelon: 1
gravity: [8.816591, -4.180228, -1.014652]
bodies:
  - {name: a0, joint: {type: revolute, axis: [-0.099123, -0.050659, -0.993785],
      origin: {xyz: [-0.334378, -0.152222, -0.043820], rpy: [-2.911719, 0.102080, -0.303928]}}}
  - {name: a1, parent: a0, joint: {type: revolute, axis: [-0.569005, -0.821469, -0.037710],
      origin: {xyz: [-0.199158, -0.050573, 0.022442], rpy: [1.424952, -0.683170, -1.840089]}}}
  - {name: a2, parent: a1, joint: {type: revolute, axis: [0.845549, -0.409908, -0.342084],
      origin: {xyz: [0.168521, -0.115246, -0.032312], rpy: [-2.168940, 0.598834, -2.124654]}}}
  - {name: c0, joint: {type: revolute, axis: [-0.721590, 0.218043, -0.657088],
      origin: {xyz: [0.132368, 0.012032, 0.345303], rpy: [0.609597, 0.934216, 1.119795]}}}
  - {name: c1, parent: c0, joint: {type: revolute, axis: [0.560432, -0.827018, -0.044240],
      origin: {xyz: [-0.024392, 0.185304, 0.088276], rpy: [0.503654, 0.514867, -2.233618]}}}
loops:
  - {joint: revolute, connects: [c1, a2],
      at: {xyz: [-0.128674, -0.079665, -0.140788], rpy: [1.833371, -1.399521, 0.336668]},
      on_second: {xyz: [0.550863, 0.084783, 0.292590], rpy: [2.650754, 0.342153, 0.426153]}}
"""
FOLDED = """
echelon: 1
gravity: [-5.8682, 6.5306, -4.3763]
bodies:
  - {name: crank, joint: {type: revolute, axis: [-0.6834, -0.7224, 0.1050], origin: {rpy: [-2.8417, 0.0272, -0.3130]}}}
  - {name: bar, parent: crank, joint: {type: revolute, axis: [0.0766, 0.7710, -0.6322],
      origin: {xyz: [0.0463, -0.0851, -0.2839], rpy: [0.9019, 0.7429, 2.5869]}}}
  - {name: rocker, joint: {type: revolute, axis: [0.5985, -0.3300, -0.7300],
      origin: {xyz: [-0.5151, -0.2345, -0.0675], rpy: [2.3338, 0.2158, 1.1469]}}}
loops:
  - {joint: revolute, connects: [bar, rocker], at: {xyz: [-0.4751, 0.2265, 0.2187], rpy: [-2.4908, 0.6526, -0.7722]},
      on_second: {xyz: [0.2237, 0.1689, 0.1070], rpy: [-2.4233, -0.2474, -1.8015]}}
assembly: {crank: 0.1033, bar: 0.9680, rocker: 0.3052}
"""
SPINDLE = """
echelon: 1
bodies:
  - {name: spindle, joint: {type: revolute, axis: [0.279505, 0.739690, 0.612157],
      origin: {rpy: [-0.677400, 0.047839, -1.287184]}}}
  - {name: far, parent: spindle, joint: {type: spherical,
      origin: {xyz: [-0.134162, -0.355051, -0.293835], rpy: [-1.310136, 0.274285, -2.499315]}}}
  - {name: near, parent: spindle, joint: {type: spherical, origin: {rpy: [-2.692619, -0.077166, 0.483491]}}}
  - {name: link, parent: near, joint: {type: revolute, axis: [-0.584937, 0.528881, 0.614926],
      origin: {xyz: [0.004851, -0.521700, 0.294221], rpy: [-1.778991, -0.884885, 1.205161]}}}
loops:
  - {joint: revolute, connects: [far, link], at: {rpy: [2.412814, 0.396179, 0.163131]}}
"""


@pytest.mark.parametrize(
    ("text", "freedom", "rank"), one_in(2, [(FOLDED, 1, 8), (TURNTABLE, 2, 7)])
)
def test_all_that_is_special_is_told(text: str, freedom: int, rank: int) -> None:
    """With gravity in any direction, and as many digits as there are.

    A turntable carries a four-bar on axes along its own, and along gravity; crossed bars stay so at a pose where four
    decimals leave them open, and locked.
    """
    assert is_told(text, freedom, rank)


@pytest.mark.parametrize(
    ("text", "freedom", "rank"), one_in(2, [(SPINDLE, 3, 13), (SARRUS, 1, 5)])
)
def test_what_rounding_blurs_little_is_answered(
    text: str, freedom: int, rank: int
) -> None:
    """The legs of a Sarrus linkage, and their halves, are as long; a link between two balls turns about its spindle."""
    assert found(text) == (freedom, rank)


BENNETT = """
echelon: 1
gravity: [1.9763, -5.5637, -7.8343]
bodies:
  - {name: turn, joint: {type: revolute, axis: [0.7766, -0.5660, -0.2767], origin: {rpy: [0.3624, -0.2643, 0.7855]}}}
  - {name: tilt, parent: turn, joint: {type: revolute, axis: [-0.4909, -0.8066, 0.3294],
      origin: {xyz: [0.1769, 0.0926, 0.1365], rpy: [0.5424, -0.5781, 2.2957]}}}
  - {name: b1, parent: tilt, joint: {type: revolute, axis: [0.9022, 0.4124, 0.1260],
      origin: {xyz: [-0.0939, -0.0336, -0.7315], rpy: [1.6231, 0.4728, -0.1065]}}}
  - {name: b2, parent: b1, joint: {type: revolute, axis: [0.6405, -0.6984, -0.3194],
      origin: {xyz: [-0.1708, 0.4924, -0.3885], rpy: [2.6360, 1.0809, -1.5027]}}}
  - {name: b3, parent: b2, joint: {type: revolute, axis: [0.8886, -0.2506, 0.3842],
      origin: {xyz: [0.3872, 0.3616, -0.0144], rpy: [1.9946, 0.7271, -0.3239]}}}
loops:
  - {joint: revolute, connects: [b3, tilt], at: {xyz: [-0.2867, -0.1540, 0.5626], rpy: [0.6856, 0.9030, 1.6350]},
      on_second: {xyz: [-0.0344, 0.0935, -0.2204], rpy: [-1.8083, -0.4293, -0.9858]}}
"""


@pytest.mark.slow
def test_loops_that_rounding_has_locked_move_as_they_are_meant() -> None:
    """A Bennett linkage on two joints: four decimals lock it, and tell no number of base parameters."""
    mechanism = ec.load(BENNETT)
    assert mechanism.degrees_of_freedom == 3
    with pytest.warns(ec.DoubtWarning, match="decimals do not decide"):
        ec.base_structure(mechanism)


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


def test_loops_in_general_frames_that_are_open_by_rounding_alone(
    tmp_path: Path,
) -> None:
    """Sides of a parallelogram are equal but for the place where it closes."""
    (tmp_path / "bars.urdf").write_text(PARALLELOGRAM)
    file = tmp_path / "loop.yaml"
    file.write_text(
        "echelon: 1\nrobot: bars.urdf\nloops: [{joint: revolute, connects: [one, two]}]\n"
    )
    assert ec.base_structure(ec.load(file)).rank == 3


def tilted_delta() -> str:
    """Rods between a cross and a ball, in six decimals."""
    whole, loops, at = (
        rotation_of(np.array([0.8, 0.2, 0.4, 0.4])),
        "",
        {"base": np.zeros(3)},
    )
    text = "echelon: 1\nbodies:\n"

    def shown(numbers: np.ndarray) -> str:
        return f"[{', '.join(f'{x:.6f}' for x in numbers)}]"

    def body(name: str, parent: str, place: np.ndarray, axis: np.ndarray | None) -> str:
        at[name], along = (
            place,
            "type: spherical"
            if axis is None
            else f"type: revolute, axis: {shown(axis)}",
        )
        origin, light = (
            shown(place - at[parent]),
            ", massless: true" * name.startswith("cross"),
        )
        return f"  - {{name: {name}, parent: {parent}, joint: {{{along}, origin: {{xyz: {origin}}}}}{light}}}\n"

    for k, angle in enumerate(2 * np.pi * np.arange(3) / 3):
        out, along, up = (
            whole @ v
            for v in (
                (np.cos(angle), np.sin(angle), 0),
                (-np.sin(angle), np.cos(angle), 0),
                AXES["z"],
            )
        )
        text += body(f"arm{k}", "base", 0.2 * out, along)
        for name, side in ((f"{k}a", 0.05 * along), (f"{k}b", -0.05 * along)):
            low, high = 0.45 * out - 0.1 * up + side, 0.1 * out - 0.6 * up + side
            across = np.cross(along, high - low)
            text += body(f"cross{name}", f"arm{k}", low, along)
            text += body(
                f"rod{name}", f"cross{name}", low, across / np.linalg.norm(across)
            )
            if "top" in at:
                frames = f"at: {{xyz: {shown(high - low)}}}, on_second: {{xyz: {shown(high - at['top'])}}}"
                loops += (
                    f"  - {{joint: spherical, connects: [rod{name}, top], {frames}}}\n"
                )
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


@pytest.mark.slow
def test_links_stay_crossed_where_rounding_opens_their_loop() -> None:
    """Equal opposite sides in four decimals: the nearest pose is taken, not the one far away that closes best."""
    assert found(CROSSED) == (1, 8)


@pytest.mark.slow
def test_parallel_rods_of_a_tilted_delta() -> None:
    """Its arms are in no coordinate plane; a rod ends in a cross, whose centre is on the other side of the joint."""
    assert found(tilted_delta()) == (3, 34)


@pytest.mark.slow
def test_rounded_loops_that_are_open_at_zero_are_read_again() -> None:
    turned = CARDAN.replace(
        "[0.7, 0.12, 0.05]}", "[0.7, 0.12, 0.05], rpy: [0.400037, 0, 0]}"
    )
    base = ec.base_parameters(ec.load(turned))
    assert (base.rank, ec.verify(from_json(to_json(base))).rank) == (6, 6)


def in_line(turned: str, along: float, aside: float) -> ec.Mechanism:
    """Shafts in line, whose universal joint may be off by little."""
    held = f"at: {{xyz: [0.25, 0, 0], rpy: [{turned}, 0, pi/2]}}, on_second: {{xyz: [{-0.25 - along}, {aside}, 0]"
    return ec.load(f"""
echelon: 1
bodies:
  - {{name: in, joint: {{type: revolute, axis: x}}}}
  - {{name: out, joint: {{type: revolute, axis: x, origin: {{xyz: [0.5, 0, 0], rpy: [0.3, 0, 0]}}}}}}
loops:
  - {{joint: universal, connects: [in, out], {held}, rpy: [-0.3, 0, pi/2]}}}}
""")


@pytest.mark.filterwarnings("ignore::echelon.AssemblyWarning")
@pytest.mark.parametrize("turned", ["0", "pi/2"])
def test_shafts_in_line_turn_together(turned: str) -> None:
    """All that a universal joint holds but one turn is redundant there; where its second axis is stays as stated."""
    base = ec.base_parameters(in_line(turned, 0, 0))
    assert [str(e) for e in base.expressions] == ["XX1 + XX2", "MY1 + MY2", "MZ1 + MZ2"]
    assert not base.reading.doubt


@pytest.mark.filterwarnings("ignore::echelon.AssemblyWarning")
@pytest.mark.parametrize("aside", [0, 2e-4])
def test_shafts_in_line_are_refused_if_their_joint_is_off_by_more_than_digits_explain(
    aside: float,
) -> None:
    with pytest.raises(ec.InputError, match=r"closure 'loop1' is off by 0\.0001"):
        in_line("0", 1e-4, aside)


@pytest.mark.slow
def test_hinges_of_two_points_are_as_parallel_as_other_axes() -> None:
    """They are a tenth of the mechanism apart, so that rounding turns the lines between them ten times as much."""
    assert is_told((LOOPS / "peaucellier_pairs.xml").read_text(), 1, 14)


BENT_SHAFTS = """
echelon: 1
gravity: [1.3276, -4.3370, -8.6985]
bodies:
  - {name: in, joint: {type: revolute, axis: [0.2821, -0.9096, 0.3049],
      origin: {xyz: [0.0406, -0.1326, -0.2660], rpy: [-1.3606, 0.1815, 1.6313]}}}
  - {name: cross1, parent: in, joint: {type: revolute, axis: [-0.3955, -0.7335, -0.5529],
      origin: {xyz: [0.0846, -0.2729, 0.0915], rpy: [-0.0581, -0.0302, -0.6121]}}}
  - {name: mid, parent: cross1, joint: {type: revolute, axis: [-0.9832, 0.0843, -0.1616],
      origin: {rpy: [-2.8558, 0.7088, 0.1339]}}}
  - {name: cross2, parent: mid, joint: {type: revolute, axis: [-0.2001, 0.8968, 0.3946],
      origin: {xyz: [0.1133, 0.1903, -0.5898], rpy: [2.2264, -1.4902, -1.1427]}}}
  - {name: out, parent: cross2, joint: {type: revolute, axis: [0.4895, 0.5298, 0.6926],
      origin: {rpy: [0.2154, -0.7385, 2.6650]}}}
loops:
  - {joint: revolute, connects: [out, base], at: {xyz: [0.1900, 0.0990, -0.2100], rpy: [2.9527, -0.7775, 0.7466]},
      on_second: {xyz: [-0.4477, 0.4292, 0.6815], rpy: [0.5241, 0.7721, -3.0632]}}
"""


@pytest.mark.slow
def test_a_rank_that_fades_below_rounding_raises_a_doubt() -> None:
    """Shafts at equal angles to the one between them have 12 base parameters."""
    with pytest.raises(
        ec.DoubtWarning,
        match=r"12.* base parameters: the file's last decimals do not decide",
    ):
        found(BENT_SHAFTS)


def slider(heights: Sequence[str]) -> str:
    """A vertical hinge that a slide between two balls turns; the balls are level if the second height is a sum."""
    one, two, hinge = heights
    inertial = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    links = "".join(
        f'<link name="{name}">{inertial}</link>'
        for name in ("hip", "leg", "rod", "arm", "motor", "nut")
    )
    joints = (
        ("leg", "revolute", "hip", f"-0.0125 -0.205 {hinge}", "0 0 3.141592653589793"),
        (
            "rod",
            "revolute",
            "leg",
            f"0 0.044041666666666673 {one}",
            "1.5707963267948966 0 1.5707963267948966",
        ),
        ("arm", "revolute", "hip", "0.119625 -0.24904166666666669 0", "0 0 0"),
        (
            "motor",
            "revolute",
            "arm",
            f"0 0 {two}",
            "1.5707963267948966 0 1.5707963267948966",
        ),
        (
            "nut",
            "prismatic",
            "motor",
            "0 0 -0.062916666666666649",
            "0 0 -1.5707963267948966",
        ),
        (
            "on_rod",
            "fixed",
            "rod",
            "0 -1.3877787807814457e-17 -0.025000000000000074246",
            "3.141592653589793 0 -1.5707963267948966",
        ),
        (
            "on_nut",
            "fixed",
            "nut",
            "-6.9388939039072284e-18 0 -0.025000000000000077716",
            "0 0 0",
        ),
    )
    text = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/><axis xyz="0 0 1"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        for name, kind, parent, xyz, rpy in joints
    )
    return f'<robot name="slider">{links}<link name="on_rod"/><link name="on_nut"/>{text}</robot>'


@pytest.mark.parametrize(
    "heights",
    [
        (
            "-0.053479166666666744234",
            "-0.058479166666666637653",
            "-0.0049999999999998934186",
        ),
        ("-0.0534791666667", "-0.0584791666667", "-0.005"),
    ],
)
def test_sums_of_lengths_agree_beyond_the_digits_of_doubles(
    heights: Sequence[str], tmp_path: Path
) -> None:
    (tmp_path / "robot.urdf").write_text(slider(heights))
    (tmp_path / "robot.yaml").write_text(
        "closed_loop: [[on_nut, on_rod]]\ntype: [6d]\njoint_name: [rod, motor]\njoint_type: [SPHERICAL, SPHERICAL]\n"
    )
    mechanism = ec.load(tmp_path / "robot.yaml")
    assert (mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank) == (3, 13)


def trammel(decimals: int, second_slide: bool) -> str:
    """A crank whose rod's ends slide along x and y: lengths of few decimals break nothing."""
    ends = {"rod": TRAMMEL_CRANK * np.exp(1j * TRAMMEL_ANGLE)}
    ends |= {"along": 2 * ends["rod"].real + 0j, "up": 2j * ends["rod"].imag}

    def shown(point: complex) -> str:
        return f"{point.real:.{decimals}f} {point.imag:.{decimals}f} 0"

    sites = "".join(
        f'<site name="{name}1" pos="{shown(ends[name] - ends["rod"])}"/>'
        for name in ("along", "up")
    )
    slides = "".join(
        f'<body name="{name}" pos="{shown(ends[name])}"><joint name="{name}" type="slide" axis="{axis}"/>'
        f'{INERTIA}<site name="{name}2"/></body>'
        for name, axis in (("along", "1 0 0"), ("up", "0 1 0"))[: 1 + second_slide]
    )
    held = "".join(
        f'<connect site1="{name}1" site2="{name}2"/>'
        for name in ("along", "up")[: 1 + second_slide]
    )
    return (
        f'<mujoco><option gravity="0.3 -9.1 1.2"/><worldbody><body name="crank"><joint name="crank"/>{INERTIA}'
        f'<body name="rod" pos="{shown(ends["rod"])}"><joint name="rod"/>{INERTIA}{sites}</body></body>'
        f"{slides}</worldbody><equality>{held}</equality></mujoco>"
    )


TRAMMEL_CRANK, TRAMMEL_ANGLE = 0.213, 0.65


@pytest.mark.parametrize("second_slide", [False, True])
@pytest.mark.parametrize("decimals", slow_unless([4, 6], [3, 4, 6, 8]))
def test_what_shows_little_is_not_taken_for_rounding_in_silence(
    decimals: int, second_slide: bool
) -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", ec.DoubtWarning)
        rank = ec.base_structure(ec.load(trammel(decimals, second_slide))).rank
    assert rank == 5 or (decimals < 6 and names(str(told[0].message), 5))


SIX_DIGITS = """
echelon: 1
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank,
      joint: {type: revolute, axis: z, origin: {xyz: [1.38159, 0.584128, 0.00453223]}}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [3.82135, 1.18208, 0.0031416]}}}
loops:
  - joint: revolute
    connects: [coupler, rocker]
    at: {xyz: [2.48644, 3.13331, 0.00712345]}
    on_second: {xyz: [0.401248, 1.44534, 0.00851408]}
independent: [crank]
assembly: {crank: 0.5, coupler: -1.1, rocker: -0.4}
"""


def test_numbers_of_as_many_significant_digits_are_as_fine_as_the_largest() -> None:
    """A parallelogram of 1.5 and 4 m as programs print it; small offsets along the axes have more decimals."""
    assert found(SIX_DIGITS) == (1, 3)
    assert ec.load(SIX_DIGITS).rounding == pytest.approx(1e-5 / 3.82135, rel=0.1)


def test_coefficients_have_digits_in_their_own_units() -> None:
    """That of a mass is a length, which is small on a small robot."""
    small = re.sub(
        r"\d\.\d{4,}", lambda number: f"{float(number[0]) / 100:.6g}", SIX_DIGITS
    )
    base = ec.base_parameters(ec.load(small), budget=0)
    lengths = base.B_float()[1:, base.matrix.parameters.index("M2")]
    np.testing.assert_allclose(lengths, [0.0138159, 0.00584128], rtol=1e-3)
