"""Platforms, hands, legs and suspensions that no other test has, drawn in a closed pose and held against the oracle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path

import pytest

import echelon as ec
from support.described_linkage import described
from support.loop_oracle import rank
from support.zoo.drawn import Drawn, Point

Vector = tuple[Fraction, Fraction, Fraction]


def vector(*numbers: float | str | Fraction) -> Vector:
    x, y, z = (Fraction(str(number)) for number in numbers)
    return x, y, z


def beyond(point: Vector, along: Vector, by: Fraction) -> Vector:
    return vector(*(a + by * b for a, b in zip(point, along, strict=True)))


def turn(axis: str | Vector) -> str:
    return f"revolute, axis: {axis if isinstance(axis, str) else shown(axis)}"


def shown(numbers: Sequence[Fraction]) -> str:
    return f"[{', '.join(map(str, numbers))}]"


# of a leg: where it starts, its length, its direction and two that are perpendicular to it
LEGS = [
    (
        vector(*start),
        Fraction(length, 20),
        *(vector(*(Fraction(x, size) for x in row)) for row in rows),
    )
    for start, length, size, rows in (
        ((0.5, 0.1, 0), 14, 5, ((3, 0, 4), (0, 5, 0), (4, 0, -3))),
        ((0.1, 0.6, 0), 16, 5, ((-3, 0, 4), (0, 5, 0), (4, 0, 3))),
        ((-0.4, 0.3, 0), 15, 5, ((0, 3, 4), (5, 0, 0), (0, 4, -3))),
        ((-0.5, -0.2, 0.1), 18, 5, ((0, -3, 4), (5, 0, 0), (0, 4, 3))),
        ((-0.1, -0.6, 0), 13, 3, ((1, 2, 2), (2, 1, -2), (2, -2, 1))),
        ((0.4, -0.3, -0.05), 16, 7, ((2, -3, 6), (3, 6, 2), (6, -2, -3))),
    )
]
CRANKS = (
    ("x", vector(0.1, 0.2, 0.1)),
    ("y", vector(-0.2, 0.1, 0.1)),
    ("[3/5, 4/5, 0]", vector(0.1, 0.1, 0.15)),
    ("[0, 3/5, 4/5]", vector(0.2, 0, 0.05)),
    ("[-4/5, 3/5, 0]", vector(0.1, -0.1, 0.1)),
    ("[2/3, 1/3, 2/3]", vector(-0.1, 0.1, 0.2)),
)


def platform(low: str, middle: str, high: str) -> str:
    """Six legs: S, or U by two revolutes, below; P, C or nothing in the middle, on cranks then; S, U or RRR above."""
    robot = Drawn()
    for k, (start, length, along, one, two) in enumerate(LEGS):
        below, last = start, "base"
        if not middle:
            last, below = (
                robot.body(f"crank{k}", "base", start, turn(CRANKS[k][0])),
                beyond(start, CRANKS[k][1], 1),
            )
        joints = {"S": ["spherical"], "U": [turn(one), turn(two)]}[low]
        slide = {
            "P": [f"prismatic, axis: {shown(along)}"],
            "C": [f"cylindrical, axis: {shown(along)}"],
            "": [],
        }[middle]
        last = robot.chain(f"leg{k}_", last, *((below, joint) for joint in joints))
        last = robot.chain(
            f"rod{k}_", last, *((beyond(below, along, length / 2), s) for s in slide)
        )
        joints = {
            "S": ["spherical"],
            "U": [turn(two), turn(one)],
            "RRR": [turn(axis) for axis in "xyz"],
        }[high]
        top = beyond(below, along, length)
        end = (
            robot.chain(f"end{k}_", last, *((top, joint) for joint in joints[:-1]))
            if joints[1:]
            else last
        )
        robot.loop(end, "top", top, joints[-1]) if k else robot.body(
            "top", end, top, joints[-1]
        )
    return robot.text


def crossed(ball: str, numbers: bool) -> str:
    """A crank and a rocker that a rod joins."""
    values = {"a": "0.1", "b": "0.4", "c": "0.3", "d": "0.2"}
    names = values if numbers else {name: name for name in values}
    robot = Drawn("1, -2, -9.81")
    robot.body("crank", "base", (0, 0, 0))
    axes = {"spherical": ["spherical"], "revolutes": [turn(axis) for axis in "zyx"]}[
        ball
    ]
    robot.bodies += [
        f"{{name: rod{k}, parent: {f'rod{k - 1}' if k else 'crank'}, joint: {{type: {joint}, "
        f"origin: {{xyz: [{0 if k else names['a']}, 0, 0]}}}}}}"
        for k, joint in enumerate(axes)
    ]
    robot.body("rocker", "base", (0.35, 0.1, 0.05), turn("[0, 3/5, 4/5]"))
    robot.loops.append(
        f"{{joint: spherical, connects: [rod{len(axes) - 1}, rocker], at: {{xyz: [{names['b']}, {names['c']}, 0]}}, "
        f"on_second: {{xyz: [0.05, {names['d']}, {names['c']}]}}}}"
    )
    return (
        ""
        if numbers
        else f"symbols: {{{', '.join(f'{n}: {v}' for n, v in values.items())}}}\n"
    ) + robot.text


RSCR = """symbols: {a: 0.1, h: 0.2, r: 0.25}
gravity: [1, -2, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: spherical, origin: {xyz: [a, 0, 0]}}}
  - {name: slider, parent: rod, joint: {type: cylindrical, axis: [0, 3/5, 4/5], origin: {xyz: [0, r, 0.1]}}}
loops:
  - {name: pin, joint: revolute, axis: y, connects: [slider, base], at: {xyz: [0.1, 0, h]}}
"""
RUSP = """symbols: {a: 0.15, b: 0.4, c: 0.25, h: 0.1}
gravity: [1, -2, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: universal, axis: z, axis2: y, origin: {xyz: [a, 0, h]}}}
  - {name: slide, joint: {type: prismatic, axis: x, origin: {xyz: [0, c, 0]}}}
loops:
  - {joint: spherical, connects: [rod, slide], at: {xyz: [b, 0, 0]}, on_second: {xyz: [0, 0, c]}}
assembly: {crank: 0.3}
"""
THREE_RPS = """symbols: {r: 0.5, s: 0.3, h: 0.8}
gravity: [1, -2, -9.81]
bodies:
  - {name: a, joint: {type: revolute, axis: y, origin: {xyz: [r, 0, 0]}}}
  - {name: ap, parent: a, joint: {type: prismatic, axis: z, origin: {xyz: [0, 0, 0.1]}}}
  - {name: top, parent: ap, joint: {type: spherical, origin: {xyz: [0, 0, h]}}}
  - {name: b, joint: {type: revolute, axis: x, origin: {xyz: [0, r, 0]}}}
  - {name: bp, parent: b, joint: {type: prismatic, axis: z, origin: {xyz: [0, 0, 0.1]}}}
  - {name: c, joint: {type: revolute, axis: [3/5, 4/5, 0], origin: {xyz: [-4/5*r, 3/5*r, 0]}}}
  - {name: cp, parent: c, joint: {type: prismatic, axis: z, origin: {xyz: [0, 0, 0.1]}}}
loops:
  - {joint: spherical, connects: [top, bp], at: {xyz: [-r, r, 0]}, on_second: {xyz: [0, 0, h]}}
  - {joint: spherical, connects: [top, cp], at: {xyz: [-s-r, s, 0.02]}, on_second: {xyz: [-s+4/5*r, s-3/5*r, h+0.02]}}
"""


def hand(fingers: int) -> str:
    """Fingers with a crossed four-bar to the last phalanx, one of them oblique; the first joints are coupled."""
    robot = Drawn()
    robot.body("palm", "base", (0, 0, 0))
    for k in range(fingers):
        c, s = (
            (Fraction(4, 5), Fraction(3, 5)) if k == 1 else (Fraction(1), Fraction(0))
        )
        axis = turn(vector(s, c, 0))

        def point(
            x: str, z: str, k: int = k, c: Fraction = c, s: Fraction = s
        ) -> Point:
            return vector(Fraction(x) * c, Fraction(k, 20) - Fraction(x) * s, z)

        robot.body(f"near{k}", "palm", point("0", "0.1"), axis)
        robot.body(f"middle{k}", f"near{k}", point("0.01", "0.15"), axis)
        robot.body(f"tip{k}", f"middle{k}", point("0.02", "0.18"), axis)
        robot.body(f"link{k}", f"near{k}", point("0.018", "0.146"), axis)
        robot.loop(f"link{k}", f"tip{k}", point("0.012", "0.187"), axis)
    followers = "".join(f"  - {{near{k}: near0}}\n" for k in range(1, fingers))
    return robot.text + (f"couplings:\n{followers}" if followers else "")


Joints = Sequence[tuple[str, str, tuple[str, str, str], str]]


def drawn(bodies: Joints, loops: Joints) -> str:
    robot = Drawn()
    for name, parent, point, joint in bodies:
        robot.body(name, parent, point, joint)
    for first, second, point, joint in loops:
        robot.loop(first, second, point, joint)
    return robot.text


BALL, X, Y, Z = "spherical", turn("x"), turn("y"), turn("z")
HIP = [("hip1", "base", ("0", "0", "1"), Z), ("hip2", "hip1", ("0.02", "0", "1"), X)]
TALOS = (
    [
        *HIP,
        ("thigh", "hip2", ("0.02", "0", "0.98"), Y),
        ("shank", "thigh", ("0.03", "0", "0.6"), Y),
        ("cross", "shank", ("0.02", "0", "0.22"), Y),
        ("foot", "cross", ("0.02", "0", "0.22"), X),
        ("crank", "thigh", ("-0.05", "0.04", "0.7"), Y),
        ("rod", "crank", ("-0.11", "0.04", "0.71"), BALL),
        *((f"motor{y}", "shank", ("0", f"{y}0.05", "0.45"), Y) for y in ("", "-")),
        *(
            (
                f"push{y}",
                f"motor{y}",
                ("-0.06", f"{y}0.05", "0.44"),
                "universal, axis: y, axis2: x",
            )
            for y in ("", "-")
        ),
    ],
    [
        ("rod", "shank", ("-0.07", "0.04", "0.55"), BALL),
        *((f"push{y}", "foot", ("-0.07", f"{y}0.05", "0.2"), BALL) for y in ("", "-")),
    ],
)
CASSIE = (
    [
        ("hip1", "base", ("0", "0", "1"), X),
        ("hip2", "hip1", ("0.02", "0", "1"), Z),
        ("thigh", "hip2", ("0.02", "0", "0.9"), Y),
        ("knee", "thigh", ("0.14", "0", "0.85"), Y),
        ("shin", "knee", ("0.2", "0", "0.8"), Y),
        ("tarsus", "shin", ("0.5", "0.01", "0.5"), Y),
        ("heel", "tarsus", ("0.46", "0.01", "0.47"), Y),
        ("rod", "thigh", ("0.04", "0.05", "0.92"), BALL),
        ("toe", "tarsus", ("0.3", "0.01", "0.2"), Y),
        ("crank", "tarsus", ("0.44", "0.01", "0.45"), Y),
        ("plantar", "crank", ("0.4", "0.01", "0.46"), "universal, axis: y, axis2: z"),
    ],
    [
        ("rod", "heel", ("0.43", "0.02", "0.4"), BALL),
        ("plantar", "toe", ("0.27", "0.02", "0.19"), BALL),
    ],
)
WISHBONES = (
    [
        ("lower", "base", ("0", "0.2", "0.2"), X),
        ("upper", "base", ("0.02", "0.25", "0.45"), turn("[24/25, 0, 7/25]")),
        ("hub", "lower", ("0.01", "0.6", "0.18"), BALL),
        ("rack", "base", ("-0.1", "0", "0.25"), "prismatic, axis: y"),
        ("tie", "rack", ("-0.12", "0.22", "0.26"), "universal, axis: x, axis2: z"),
        ("wheel", "hub", ("0", "0.65", "0.3"), turn("[0, 3/5, 4/5]")),
    ],
    [
        ("hub", "upper", ("0.03", "0.55", "0.47"), BALL),
        ("tie", "hub", ("-0.11", "0.58", "0.24"), BALL),
    ],
)
PUSHROD = (
    [
        *WISHBONES[0],
        ("rocker", "base", ("0.05", "0.3", "0.6"), turn("[3/5, 0, 4/5]")),
        ("push", "rocker", ("0.05", "0.38", "0.62"), BALL),
        ("damper", "rocker", ("0.05", "0.3", "0.7"), "universal, axis: x, axis2: z"),
        ("piston", "damper", ("0.05", "0.2", "0.7"), "prismatic, axis: y"),
    ],
    [
        *WISHBONES[1],
        ("push", "lower", ("0.02", "0.5", "0.2"), BALL),
        ("piston", "base", ("0.05", "0.05", "0.7"), BALL),
    ],
)
CASES: dict[str, Callable[[], str]] = {
    "6-SPS": lambda: platform("S", "P", "S"),
    "6-UPS": lambda: platform("U", "P", "S"),
    "6-UCU": lambda: platform("U", "C", "U"),
    "6-UPRRR": lambda: platform("U", "P", "RRR"),
    "6-RUS": lambda: platform("U", "", "S"),
    "6-RSS": lambda: platform("S", "", "S"),
    "RSSR": lambda: crossed("spherical", True),
    "RRRRSR": lambda: crossed("revolutes", True),
    "RSSR, symbols": lambda: crossed("spherical", False),
    "RSCR": lambda: RSCR,
    "RUSP, symbols": lambda: RUSP,
    "3-RPS, symbols": lambda: THREE_RPS,
    "finger": lambda: hand(1),
    "hand": lambda: hand(2),
    "hand of three fingers": lambda: hand(3),
    "Talos-like leg": lambda: drawn(*TALOS),
    "Cassie-like leg": lambda: drawn(*CASSIE),
    "wishbones": lambda: drawn(*WISHBONES),
    "wishbones and pushrod": lambda: drawn(*PUSHROD),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::echelon.AssemblyWarning")
@pytest.mark.parametrize("name", CASES)
def test_drawn_mechanisms(name: str, tmp_path: Path) -> None:
    text, file = CASES[name](), tmp_path / "robot.yaml"
    file.write_text(f"echelon: 1\n{text}", encoding="utf-8")
    mechanism, truth = ec.load(file), rank(described(text))
    assert (mechanism.degrees_of_freedom, ec.base_structure(mechanism).rank) == (
        truth.freedom,
        truth.rank,
    )
