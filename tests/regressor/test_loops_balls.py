"""Loops that are closed by solving for ball joints: exact ranks against singular values at closed states."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

import echelon as ec
from support.closed_states import check, read
from support.selection import one_in
from support.zoo import mjcf


@dataclass(frozen=True)
class Case:
    """A mechanism with its numbers of degrees of freedom and of base parameters."""

    freedom: int
    rank: int
    text: str


RSSR = """
symbols: {a: 0.1, b: 0.3, c: 0.4, d: 0.35}
gravity: [1, -2, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: spherical, origin: {xyz: [a, 0, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: y, origin: {xyz: [c, 0.1, 0.05]}}}
loops:
  - {name: ball, joint: spherical, connects: [rod, rocker], at: {xyz: [d, 0, 0]}, on_second: {xyz: [0, 0, b]}}
assembly: {crank: 0.3, rod.w: 1, rod.y: -0.3, rocker: 0.1}
"""

TIED = """
symbols: {a: 0.3, b: 0.4, c: 0.5}
bodies:
  - {name: one, joint: {type: spherical}}
  - {name: two, parent: one, joint: {type: JOINT, origin: {xyz: [a, 0, 0]}}}
loops:
  - {name: end, joint: spherical, connects: [two, base], at: {xyz: [b, 0, 0]}, on_second: {xyz: [END]}}
"""

UNIVERSAL = TIED.replace("JOINT", "universal, axis: x, axis2: y").replace(
    "END", "0, 0, c"
)

COUPLER = """
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, joint: {type: floating}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [l1, 0, 0]}}}
loops:
  - {name: pin1, joint: revolute, connects: [coupler, crank], on_second: {xyz: [l2, 0, 0]}}
  - {name: pin2, joint: axes, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
assembly: {crank: 1, coupler.tx: 0.081, coupler.ty: 0.126, coupler.r.w: 0.9666, coupler.r.z: 0.2563, rocker: 1.6206}
independent: [crank]
"""

ROCKER = "  - {name: rocker, joint: {type: spherical, origin: {xyz: [l1, 0, 0]}}}\n"
PLANAR = f"""
symbols: {{l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}}
gravity: [0, -9.81, 0]
bodies:
  - {{name: crank, joint: {{type: revolute, axis: z}}}}
  - {{name: coupler, parent: crank, joint: {{type: revolute, axis: z, origin: {{xyz: [l2, 0, 0]}}}}}}
{ROCKER}loops:
  - {{name: pin, joint: revolute, connects: [coupler, rocker], at: {{xyz: [l3, 0, 0]}}, on_second: {{xyz: [l4, 0, 0]}}}}
assembly: {{crank: 1, coupler: -0.4816, rocker.w: 0.6893, rocker.z: 0.7245}}
"""

BALL_FIRST = PLANAR.replace(ROCKER, "").replace("bodies:\n", f"bodies:\n{ROCKER}")

ZOO = {
    "RSSR": Case(2, 14, RSSR),
    "RSSR, crank": Case(2, 14, f"{RSSR}independent: [crank, rod.x]\n"),
    "RSSR, both balls free": Case(
        2,
        14,
        """
symbols: {a: 0.1, b: 0.3, c: 0.4, d: 0.35}
gravity: [1, -2, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, joint: {type: floating}}
  - {name: rocker, joint: {type: revolute, axis: y, origin: {xyz: [c, 0.1, 0.05]}}}
loops:
  - {name: near, joint: spherical, connects: [rod, crank], on_second: {xyz: [a, 0, 0]}}
  - {name: far, joint: spherical, connects: [rod, rocker], at: {xyz: [d, 0, 0]}, on_second: {xyz: [0, 0, b]}}
assembly: {crank: 0.3, rod.tx: 0.0955, rod.ty: 0.0296, rod.r.w: 1, rod.r.y: -0.3, rocker: 0.1}
""",
    ),
    "RSSP": Case(
        2,
        12,
        """
symbols: {a: 0.1, d: 0.35}
gravity: [1, -2, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: spherical, origin: {xyz: [a, 0, 0]}}}
  - {name: slider, joint: {type: prismatic, axis: x, origin: {xyz: [0, 0.05, 0.1]}}}
loops:
  - {name: ball, joint: spherical, connects: [rod, slider], at: {xyz: [d, 0, 0]}}
assembly: {crank: 0.3, rod.w: 1, rod.y: -0.15, slider: 0.4}
""",
    ),
    "rocker on a ball": Case(
        1,
        3,
        """
symbols: {a: 0.1, b: 0.3, c: 0.4, d: 0.35}
gravity: [1, -2, -9.81]
bodies:
  - {name: rod, joint: {type: spherical}}
  - {name: rocker, joint: {type: revolute, axis: y, origin: {xyz: [c, 0.1, 0.05]}}}
loops:
  - {name: ball, joint: spherical, connects: [rod, rocker], at: {xyz: [d, 0, 0]}, on_second: {xyz: [0, 0, b]}}
assembly: {rod.w: 1, rod.y: -0.3, rocker: -0.5}
""",
    ),
    "planar with a ball": Case(1, 8, PLANAR),
    "planar with a ball, the ball first": Case(1, 8, BALL_FIRST),
    "tied pendulum, universal": Case(
        2,
        8,
        TIED.replace("JOINT", "universal, axis: x, axis2: y").replace("END", "0, 0, c"),
    ),
    "tied pendulum, two balls": Case(
        3, 16, TIED.replace("JOINT", "spherical").replace("END", "c, 0, 0")
    ),
    "tied pendulum, hinge": Case(
        1, 1, TIED.replace("JOINT", "revolute, axis: z").replace("END", "0, 0, c")
    ),
    "floating coupler": Case(1, 8, COUPLER),
    "floating coupler, spherical": Case(
        1, 8, COUPLER.replace("joint: axes", "joint: spherical")
    ),
    "floating coupler, both hinges": Case(
        1, 8, COUPLER.replace("joint: axes", "joint: revolute")
    ),
    "connected freejoint": Case(
        2,
        14,
        mjcf(
            """<body name="a"><joint name="a" axis="0 1 0"/>INERTIA</body>
<body name="b" pos="0.5 0 0"><joint name="b" axis="1 0.2 0"/>INERTIA</body>
<body name="rod" pos="0.1 0.1 0.4"><freejoint name="rod"/>INERTIA</body>""",
            """<connect body1="rod" body2="a" anchor="0.1 0 0"/><connect body1="rod" body2="b" anchor="0.3 0 0.1"/>""",
        ),
    ),
}


@pytest.mark.parametrize(
    "case", one_in(4, [pytest.param(c, id=n) for n, c in ZOO.items()])
)
def test_the_rank_is_that_of_closed_states(case: Case) -> None:
    mechanism = read(case.text)
    assert len(mechanism.independent_velocities) == case.freedom
    check(mechanism, case.rank)


# only closes where it is stretched out, with velocities from which no motion goes on
STRETCHED = UNIVERSAL.replace(", on_second: {xyz: [0, 0, c]}", "")

RCCC = """
symbols: {a: 0.1, b: 0.3, c: 0.2, d: 0.25}
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, parent: crank, joint: {type: cylindrical, axis: z, origin: {xyz: [a, 0, 0], rpy: [pi/6, 0, 0]}}}
  - {name: rocker, joint: {type: cylindrical, axis: z, origin: {xyz: [0, c, d], rpy: [pi/2, pi/6, 0]}}}
loops:
  - {name: end, joint: cylindrical, connects: [coupler, rocker], at: {xyz: [b, 0, 0], rpy: [pi/3, 0, 0]}}
"""


@pytest.mark.parametrize("text", [RCCC, STRETCHED])
def test_loops_that_cannot_be_closed_are_refused(text: str) -> None:
    with pytest.raises(
        ec.InputError, match=r"'end' \(.*\) can move infinitesimally, but not really"
    ):
        read(text)
