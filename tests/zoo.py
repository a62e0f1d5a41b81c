"""Mechanisms with loops, as texts of descriptions and MJCF files, with their freedoms and ranks."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """A mechanism with its numbers of degrees of freedom and of base parameters."""

    freedom: int
    rank: int
    text: str
    slow: bool = False


INERTIA = '<inertial pos="0.05 -0.02 0.11" mass="1.3" diaginertia="0.021 0.017 0.012"/>'


def mjcf(world: str, equality: str, motors: str = "") -> str:
    """An MJCF file; all bodies have some inertia, motors are on the named joints."""
    actuator = "".join(f'<motor joint="{name}"/>' for name in motors.split())
    return f"""<mujoco><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>{world}</worldbody>
<equality>{equality}</equality><actuator>{actuator}</actuator></mujoco>""".replace("INERTIA", INERTIA)


def stewart() -> str:
    """A Gough-Stewart platform whose legs slide along their own directions; the file's numbers are decimals."""
    base = [(0.58, 0.16), (-0.15, 0.58), (-0.43, 0.42), (-0.44, -0.41), (-0.14, -0.59), (0.57, -0.18)]
    top = [(0.27, 0.14), (0.03, 0.31), (-0.29, 0.12), (-0.28, -0.13), (0.02, -0.3), (0.26, -0.16)]
    world, equality = '<body name="platform" pos="0 0 0.7"><freejoint name="platform"/>INERTIA</body>', ""
    for k, ((x, y), (u, v)) in enumerate(zip(base, top, strict=True), 1):
        along = f"{u - x:.2f} {v - y:.2f} 0.7"
        world += f"""<body name="leg{k}" pos="{x} {y} 0"><joint name="x{k}" axis="1 0 0"/>
          <joint name="y{k}" axis="0 1 0"/>INERTIA<body name="rod{k}">
          <joint name="slide{k}" type="slide" axis="{along}"/>INERTIA</body></body>"""
        equality += f'<connect body1="rod{k}" body2="platform" anchor="{along}"/>'
    return mjcf(world, equality, "slide1 slide2 slide3 slide4 slide5 slide6")


def delta() -> str:
    """A Delta robot: three arms, six rods with balls at both ends, each free to spin."""
    world, equality = '<body name="platform" pos="0 0 -0.4"><freejoint name="platform"/>INERTIA</body>', ""
    for k in (1, 2, 3):
        rods = ""
        for side, y in (("l", 0.05), ("r", -0.05)):
            rods += f'<body name="{side}{k}" pos="0.2 {y} 0"><joint name="b{side}{k}" type="ball"/>INERTIA</body>'
            equality += f'<connect body1="{side}{k}" body2="platform" anchor="-0.3 0 -0.4"/>'
        world += f"""<frame euler="0 0 {120 * (k - 1)}"><body name="arm{k}" pos="0.15 0 0">
          <joint name="arm{k}" axis="0 1 0"/>INERTIA{rods}</body></frame>"""
    return mjcf(world, equality, "arm1 arm2 arm3")


def leg(side: str, y: float) -> str:
    """A biped's leg of the kind of Cassie's: one rod closes a loop over knee and heel, one moves the foot.

    The ends of the rods are to be held together by :func:`leg_loops`.
    """
    return f"""
<body name="roll-{side}" pos="0.021 {y} 0"><joint name="roll-{side}" axis="1 0 0"/>INERTIA
 <body name="yaw-{side}" pos="-0.07 0 0"><joint name="yaw-{side}" axis="0 0 1"/>INERTIA
  <body name="pitch-{side}" pos="0 0 -0.09"><joint name="pitch-{side}" axis="0 1 0"/>INERTIA
   <body name="achilles-{side}" pos="0.02 0.04 0.03"><joint name="achilles-{side}" type="ball"/>INERTIA</body>
   <body name="knee-{side}" pos="0.12 0 -0.02"><joint name="knee-{side}" axis="0 1 0"/>INERTIA
    <body name="shin-{side}" pos="0.0607 0 -0.0474"><joint name="shin-{side}" axis="0 1 0"/>INERTIA
     <body name="tarsus-{side}" pos="0.4348 0 -0.02"><joint name="tarsus-{side}" axis="0 1 0"/>INERTIA
      <body name="heel-{side}" pos="-0.01269 0 -0.03059"><joint name="heel-{side}" axis="0 1 0"/>INERTIA</body>
      <body name="crank-{side}" pos="0.058 0 -0.034"><joint name="crank-{side}" axis="0 1 0"/>INERTIA
       <body name="rod-{side}" pos="0.055 0 0"><joint name="rod-{side}" axis="0 1 0"/>INERTIA</body></body>
      <body name="foot-{side}" pos="0.408 0 -0.04"><joint name="foot-{side}" axis="0 1 0"/>INERTIA</body>
     </body></body></body></body></body></body>"""


def leg_loops(side: str) -> str:
    return f"""<connect body1="achilles-{side}" body2="heel-{side}" anchor="0.5012 0 -0.1"/>
      <connect body1="rod-{side}" body2="foot-{side}" anchor="0.35 0 0.02"/>"""


def biped(base: str) -> str:
    """A pelvis with two such legs."""
    pelvis = f'<body name="pelvis" pos="0 0 1">{base}INERTIA{leg("left", 0.135)}{leg("right", -0.135)}</body>'
    motors = " ".join(f"{joint}-{s}" for s in ("left", "right") for joint in ("roll", "yaw", "pitch", "knee", "crank"))
    return mjcf(pelvis, leg_loops("left") + leg_loops("right"), motors)


# -- trees that several mechanisms share -----------------------------------------------------------------------------

SLIDER_CRANK_OFFSET = """
symbols: {r: 0.2, l: 0.5, e: 0.03}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [r, 0, 0]}}}
"""

SR400 = """
symbols: {d2: 0.35, d3: 0.8, d4: 0.1, RL4: 0.9, d8: 0.45}
gravity: [0, 0, -9.81]
modified_dh:
  - {name: j1, joint: revolute}
  - {name: j2, joint: revolute, alpha: -pi/2, a: d2}
  - {name: j3, joint: revolute, a: d3}
  - {name: j4, joint: revolute, alpha: -pi/2, a: d4, d: RL4}
  - {name: j5, joint: revolute, alpha: pi/2}
  - {name: j6, joint: revolute, alpha: -pi/2}
  - {name: j7, joint: revolute, parent: j1, alpha: -pi/2, a: d2}
  - {name: j8, joint: revolute, a: d8}
"""

FLOATING_BASE = """
floating_base: true
symbols: {l: 0.4}
bodies:
  - {name: arm, joint: {type: revolute, axis: z}}
"""

BENNETT = """
symbols: {u: 0.4}
gravity: [1, -2, -9.81]
modified_dh:
  - {name: r1, joint: revolute}
  - {name: r2, joint: revolute, alpha: pi/2, a: 2*u}
  - {name: r3, joint: revolute, alpha: pi/6, a: u}
"""

# -- mechanisms ------------------------------------------------------------------------------------------------------

ZOO = {
    "slider crank, body": Case(
        1,
        6,
        """
symbols: {r: 0.2, l: 0.5}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [r, 0, 0]}}}
  - {name: piston, joint: {type: prismatic, axis: x, origin: {xyz: [0, 0, 0]}}}
loops:
  - {name: pin, joint: revolute, connects: [rod, piston], at: {xyz: [l, 0, 0]}, on_second: {}}
assembly: {rod: 0, piston: 0.6, crank: 0.3}
independent: [crank]
""",
    ),
    "slider crank offset, body": Case(
        1,
        6,
        """
symbols: {r: 0.2, l: 0.5, e: 0.03}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [r, 0, 0]}}}
  - {name: piston, joint: {type: prismatic, axis: x, origin: {xyz: [0, e, 0]}}}
loops:
  - {name: pin, joint: revolute, connects: [rod, piston], at: {xyz: [l, 0, 0]}, on_second: {}}
assembly: {rod: 0, piston: 0.6, crank: 0.3}
independent: [crank]
""",
    ),
    "slider crank, prismatic": Case(
        1,
        6,
        """
symbols: {r: 0.2, l: 0.5}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [r, 0, 0]}}}
  - {name: piston, parent: rod, joint: {type: revolute, axis: z, origin: {xyz: [l, 0, 0]}}}
loops:
  - {name: guide, joint: prismatic, axis: x, connects: [base, piston], at: {xyz: [0, 0, 0]}, on_second: {}}
assembly: {rod: -0.4, piston: 0.1, crank: 0.3}
independent: [crank]
""",
    ),
    "slider crank offset, prismatic": Case(
        1,
        6,
        """
symbols: {r: 0.2, l: 0.5, e: 0.03}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [r, 0, 0]}}}
  - {name: piston, parent: rod, joint: {type: revolute, axis: z, origin: {xyz: [l, 0, 0]}}}
loops:
  - {name: guide, joint: prismatic, axis: x, connects: [base, piston], at: {xyz: [0, e, 0]}, on_second: {}}
assembly: {rod: -0.4, piston: 0.1, crank: 0.3}
independent: [crank]
""",
    ),
    "slider crank, point_on_axis": Case(
        1,
        6,
        """
symbols: {r: 0.2, l: 0.5}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [r, 0, 0]}}}
loops:
  - {name: guide, joint: point_on_axis, axis: x, connects: [base, rod], at: {xyz: [0, 0, 0]}, on_second: {xyz: [l,
        0, 0]}}
assembly: {rod: -0.4, crank: 0.3}
independent: [crank]
""",
    ),
    "slider crank offset, point_on_axis": Case(
        1,
        6,
        SLIDER_CRANK_OFFSET
        + """loops:
  - {name: guide, joint: point_on_axis, axis: x, connects: [base, rod], at: {xyz: [0, e, 0]}, on_second: {xyz: [l,
        0, 0]}}
assembly: {rod: -0.4, crank: 0.3}
independent: [crank]
""",
    ),
    "slider crank offset, point_on_plane": Case(
        1,
        6,
        SLIDER_CRANK_OFFSET
        + """loops:
  - {name: guide, joint: point_on_plane, axis: y, connects: [base, rod], at: {xyz: [0, e, 0]},
        on_second: {xyz: [l, 0, 0]}}
assembly: {rod: -0.4, crank: 0.3}
independent: [crank]
""",
    ),
    "five bar": Case(
        2,
        11,
        """
symbols: {a1: 0.2, a2: 0.3, b1: 0.25, b2: 0.35, c: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: left, joint: revolute}
  - {name: left2, joint: revolute, a: a1}
  - {name: right, joint: revolute, parent: base, a: c}
  - {name: right2, joint: revolute, a: b1}
loops:
  - {name: pin, joint: revolute, connects: [left2, right2], at: {xyz: [a2, 0, 0]}, on_second: {xyz: [b2, 0, 0]}}
independent: [left, right]
assembly: {left: 2, left2: -1, right: 1, right2: 1}
""",
    ),
    "watt I": Case(
        1,
        13,
        """
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3, u: 0.2, v: 0.1, w: 0.25, l5: 0.3, l6: 0.28}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
  - {name: link5, joint: revolute, parent: coupler, gamma: pi/4, a: u}
  - {name: link6, joint: revolute, parent: rocker, gamma: -pi/6, a: w}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
  - {name: pin2, joint: revolute, connects: [link5, link6], at: {xyz: [l5, 0, 0]}, on_second: {xyz: [l6, 0, 0]}}
independent: [crank]
assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206, link5: 0.5, link6: 0.5}
""",
    ),
    "watt II": Case(
        1,
        13,
        """
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3, w: 0.25, l5: 0.6, l6: 0.28, c: 0.9}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
  - {name: link5, joint: revolute, parent: rocker, gamma: -pi/6, a: w}
  - {name: link6, joint: revolute, parent: base, a: c}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
  - {name: pin2, joint: revolute, connects: [link5, link6], at: {xyz: [l5, 0, 0]}, on_second: {xyz: [l6, 0, 0]}}
independent: [crank]
assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206, link5: -1.0, link6: 2.0}
""",
    ),
    "stephenson III": Case(
        1,
        13,
        """
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3, u: 0.2, v: 0.1, l5: 0.4, l6: 0.45, c: 0.6}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
  - {name: link5, joint: revolute, parent: coupler, gamma: pi/6, a: u}
  - {name: link6, joint: revolute, parent: base, a: c, gamma: pi/6}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
  - {name: pin2, joint: revolute, connects: [link5, link6], at: {xyz: [l5, 0, 0]}, on_second: {xyz: [l6, 0, 0]}}
independent: [crank]
assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206, link5: -1.0, link6: 2.0}
""",
    ),
    "stephenson II": Case(
        1,
        13,
        """
symbols: {a: 0.15, b: 0.3, c: 0.4, d: 0.35, e: 0.2, f: 0.3, g: 0.25, h: 0.2}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: ternary, joint: revolute, a: a}
  - {name: link3, joint: revolute, a: b}
  - {name: link4, joint: revolute, parent: ternary, gamma: pi/3, a: e}
  - {name: rocker, joint: revolute, parent: base, a: c}
loops:
  - {name: pin, joint: revolute, connects: [link3, rocker], at: {xyz: [d, 0, 0]}, on_second: {xyz: [f, 0, 0]}}
  - {name: pin2, joint: revolute, connects: [link4, rocker], at: {xyz: [g, 0, 0]}, on_second: {xyz: [0.12, 0.1, 0]}}
independent: [crank]
assembly: {crank: 1, ternary: 0.3, link3: -0.5, link4: -1, rocker: 1.6}
""",
    ),
    "pantograph": Case(
        2,
        8,
        """
symbols: {l: 0.4, p: 0.15, q: 0.25}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: arm, joint: revolute}
  - {name: fore, joint: revolute, a: l}
  - {name: rod, joint: revolute, parent: arm, a: p}
  - {name: bar, joint: revolute, parent: fore, a: q}
loops:
  - {name: pin, joint: revolute, connects: [rod, bar], at: {xyz: [q, 0, 0]}, on_second: {xyz: [-l + p, 0, 0]}}
independent: [arm, fore]
assembly: {arm: 2, fore: -1.5, rod: -1.5, bar: 1.5}
""",
    ),
    "scotch yoke": Case(
        1,
        4,
        """
symbols: {r: 0.1}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: yoke, joint: {type: prismatic, axis: x}}
loops:
  - {name: slot, joint: point_on_axis, axis: y, connects: [yoke, crank], on_second: {xyz: [r, 0, 0]}}
independent: [crank]
assembly: {crank: 0.5, yoke: 0.0877}
""",
    ),
    "scotch yoke, block": Case(
        1,
        4,
        """
symbols: {r: 0.1}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: yoke, joint: {type: prismatic, axis: x}}
  - {name: block, parent: yoke, joint: {type: prismatic, axis: y}}
loops:
  - {name: pin, joint: revolute, connects: [block, crank], on_second: {xyz: [r, 0, 0]}}
independent: [crank]
assembly: {crank: 0.5, yoke: 0.0877, block: 0.0479}
""",
    ),
    "whitworth": Case(
        1,
        9,
        """
symbols: {r: 0.1, d: 0.25, l: 0.5, c: 0.2, h: 0.5}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z, origin: {xyz: [0, d, 0]}}}
  - {name: lever, joint: {type: revolute, axis: z}}
  - {name: rod, parent: lever, joint: {type: revolute, axis: z, origin: {xyz: [0, l, 0]}}}
  - {name: ram, joint: {type: prismatic, axis: x, origin: {xyz: [0, h, 0]}}}
loops:
  - {name: slot, joint: point_on_axis, axis: y, connects: [lever, crank], on_second: {xyz: [r, 0, 0]}}
  - {name: pin, joint: revolute, connects: [rod, ram], at: {xyz: [c, 0, 0]}, on_second: {}}
independent: [crank]
assembly: {crank: 0, lever: -0.3805, rod: 0.4, ram: 0.3}
""",
    ),
    "whitworth, block": Case(
        1,
        8,
        """
symbols: {r: 0.1, d: 0.25}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z, origin: {xyz: [0, d, 0]}}}
  - {name: lever, joint: {type: revolute, axis: z}}
  - {name: block, parent: lever, joint: {type: prismatic, axis: y}}
loops:
  - {name: pin, joint: revolute, connects: [block, crank], on_second: {xyz: [r, 0, 0]}}
independent: [crank]
assembly: {crank: 0, lever: -0.3805, block: 0.269}
""",
    ),
    "3-RRR": Case(
        3,
        19,
        """
symbols: {R: 0.5, p: 0.15, a: 0.3, b: 0.35}
gravity: [0, -9.81, 0]
bodies:
  - {name: a1, joint: {type: revolute, axis: z, origin: {xyz: [R, 0, 0]}}}
  - {name: b1, parent: a1, joint: {type: revolute, axis: z, origin: {xyz: [a, 0, 0]}}}
  - {name: plate, parent: b1, joint: {type: revolute, axis: z, origin: {xyz: [b, 0, 0]}}}
  - {name: a2, joint: {type: revolute, axis: z, origin: {xyz: [-R/2, sqrt(3)/2*R, 0], rpy: [0, 0, 2*pi/3]}}}
  - {name: b2, parent: a2, joint: {type: revolute, axis: z, origin: {xyz: [a, 0, 0]}}}
  - {name: a3, joint: {type: revolute, axis: z, origin: {xyz: [-R/2, -sqrt(3)/2*R, 0], rpy: [0, 0, 4*pi/3]}}}
  - {name: b3, parent: a3, joint: {type: revolute, axis: z, origin: {xyz: [a, 0, 0]}}}
loops:
  - {joint: revolute, connects: [b2, plate], at: {xyz: [b, 0, 0]}, on_second: {xyz: [3*p/2, sqrt(3)/2*p, 0]}}
  - {joint: revolute, connects: [b3, plate], at: {xyz: [b, 0, 0]}, on_second: {xyz: [3*p/2, -sqrt(3)/2*p, 0]}}
independent: [a1, a2, a3]
assembly: {a1: 1.8, b1: 2, plate: -0.6, a2: 1.8, b2: 2, a3: 1.8, b3: 2}
""",
    ),
    "gripper": Case(
        2,
        9,
        """
symbols: {l1: 0.04, l2: 0.06, l3: 0.03, l4: 0.07, w: 0.05}
gravity: [0, -9.81, 0]
bodies:
  - {name: palm, joint: {type: prismatic, axis: y}}
  - {name: crankL, parent: palm, joint: {type: revolute, axis: z, origin: {xyz: [w, 0, 0]}}}
  - {name: tipL, parent: crankL, joint: {type: revolute, axis: z, origin: {xyz: [l2, 0, 0]}}}
  - {name: rockL, parent: palm, joint: {type: revolute, axis: z, origin: {xyz: [w + l1, 0, 0]}}}
  - {name: crankR, parent: palm, joint: {type: revolute, axis: -z, origin: {xyz: [-w, 0, 0]}}}
  - {name: tipR, parent: crankR, joint: {type: revolute, axis: -z, origin: {xyz: [-l2, 0, 0]}}}
  - {name: rockR, parent: palm, joint: {type: revolute, axis: -z, origin: {xyz: [-w - l1, 0, 0]}}}
loops:
  - {name: left, joint: revolute, connects: [tipL, rockL], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
  - {name: right, joint: revolute, connects: [tipR, rockR], at: {xyz: [-l3, 0, 0]}, on_second: {xyz: [-l4, 0, 0]}}
couplings:
  - {crankR: crankL}
independent: [palm, crankL]
assembly: {crankL: 1.5, tipL: -1, rockL: 1, tipR: -1, rockR: 1}
""",
    ),
    "excavator": Case(
        4,
        60,
        """
gravity: [0, 0, -9.81]
bodies:
  - {name: swing, joint: {type: revolute, axis: z}}
  - {name: boom, parent: swing, joint: {type: revolute, axis: y, origin: {xyz: [0.2, 0, 0.8]}}}
  - {name: barrel1, parent: swing, joint: {type: revolute, axis: y, origin: {xyz: [0.5, 0, 0.4]}}}
  - {name: rod1, parent: barrel1, joint: {type: prismatic, axis: x}}
  - {name: stick, parent: boom, joint: {type: revolute, axis: y, origin: {xyz: [4, 0, 0]}}}
  - {name: barrel2, parent: boom, joint: {type: revolute, axis: y, origin: {xyz: [2, 0, 0.6]}}}
  - {name: rod2, parent: barrel2, joint: {type: prismatic, axis: x}}
  - {name: bucket, parent: stick, joint: {type: revolute, axis: y, origin: {xyz: [2, 0, 0]}}}
  - {name: barrel3, parent: stick, joint: {type: revolute, axis: y, origin: {xyz: [0.2, 0, 0.35]}}}
  - {name: rod3, parent: barrel3, joint: {type: prismatic, axis: x}}
  - {name: lever, parent: stick, joint: {type: revolute, axis: y, origin: {xyz: [1.6, 0, 0.05]}}}
  - {name: link, parent: lever, joint: {type: revolute, axis: y, origin: {xyz: [0, 0, 0.45]}}}
loops:
  - {name: c1, joint: revolute, axis: y, connects: [rod1, boom], on_second: {xyz: [1.8, 0, 0.3]}}
  - {name: c2, joint: revolute, axis: y, connects: [rod2, stick], on_second: {xyz: [-0.5, 0, 0.2]}}
  - {name: c3, joint: revolute, axis: y, connects: [rod3, lever], on_second: {xyz: [0, 0, 0.45]}}
  - {name: c4, joint: revolute, axis: y, connects: [link, bucket], at: {xyz: [0.4, 0, 0]}, on_second: {xyz: [0, 0,
        0.35]}}
independent: [swing, rod1, rod2, rod3]
assembly: {barrel1: -0.4, rod1: 1.6, barrel2: 0.2, rod2: 1.5, barrel3: -0.1, rod3: 1.4, stick: 0.5}
""",
    ),
    "hydraulic triangle": Case(
        1,
        8,
        """
symbols: {a: 0.5, b: 0.8}
gravity: [0, 0, -9.81]
bodies:
  - {name: boom, joint: {type: revolute, axis: y}}
  - {name: barrel, joint: {type: revolute, axis: y, origin: {xyz: [0, 0, -a]}}}
  - {name: rod, parent: barrel, joint: {type: prismatic, axis: x}}
loops:
  - {name: pin, joint: revolute, axis: y, connects: [rod, boom], on_second: {xyz: [b, 0, 0]}}
independent: [rod]
assembly: {barrel: -0.5586, rod: 0.943}
""",
    ),
    "RSUR": Case(
        1,
        14,
        """
symbols: {a: 0.1, b: 0.3, c: 0.4, d: 0.35}
gravity: [1, -2, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: universal, axis: z, axis2: y, origin: {xyz: [a, 0, 0]}}}
  - {name: rocker, joint: {type: revolute, axis: y, origin: {xyz: [c, 0.1, 0.05]}}}
loops:
  - {name: ball, joint: spherical, connects: [rod, rocker], at: {xyz: [d, 0, 0]}, on_second: {xyz: [0, 0, b]}}
assembly: {crank: 0.3, rod.2: -0.6, rocker: 0.1}
""",
    ),
    "RSCR": Case(
        1,
        13,
        """
symbols: {a: 0.1, h: 0.2, r: 0.25}
gravity: [1, -2, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: slider, joint: {type: cylindrical, axis: x, origin: {xyz: [0, 0.15, 0.2]}}}
  - {name: rocker, parent: slider, joint: {type: revolute, axis: y, origin: {xyz: [0.1, 0, 0]}}}
loops:
  - {name: ball, joint: spherical, connects: [rocker, crank], at: {xyz: [0, 0, r]}, on_second: {xyz: [a, 0, 0]}}
assembly: {crank: 0.3, slider.turn: 3, slider.slide: -0.1}
""",
    ),
    "sarrus": Case(
        1,
        5,
        """
symbols: {c: 0.3, l: 0.4}
gravity: [0, 0, -9.81]
bodies:
  - {name: a1, joint: {type: revolute, axis: y, origin: {xyz: [c, 0, 0]}}}
  - {name: a2, parent: a1, joint: {type: revolute, axis: y, origin: {xyz: [l, 0, 0]}}}
  - {name: top, parent: a2, joint: {type: revolute, axis: y, origin: {xyz: [l, 0, 0]}}}
  - {name: b1, joint: {type: revolute, axis: x, origin: {xyz: [0, c, 0]}}}
  - {name: b2, parent: b1, joint: {type: revolute, axis: x, origin: {xyz: [0, l, 0]}}}
loops:
  - {name: pin, joint: revolute, axis: x, connects: [b2, top], at: {xyz: [0, l, 0]}, on_second: {xyz: [-c, c, 0]}}
independent: [a1]
assembly: {a1: -pi/6, a2: -2*pi/3, top: 5*pi/6, b1: pi/6, b2: 2*pi/3}
""",
    ),
    "hooke": Case(
        1,
        11,
        """
gravity: [1, -2, -9.81]
bodies:
  - {name: input, joint: {type: revolute, axis: z}}
  - {name: cross, parent: input, joint: {type: revolute, axis: x}}
  - {name: output, joint: {type: revolute, axis: z, origin: {rpy: [0, pi/6, 0]}}}
loops:
  - {name: fork, joint: revolute, axis: y, connects: [cross, output]}
independent: [input]
""",
    ),
    "hooke, universal": Case(
        1,
        6,
        """
symbols: {beta: pi/5}
gravity: [1, -2, -9.81]
bodies:
  - {name: input, joint: {type: revolute, axis: z}}
  - {name: output, joint: {type: revolute, axis: z, origin: {rpy: [0, beta, 0]}}}
loops:
  - {name: joint, joint: universal, connects: [input, output], on_second: {}}
independent: [input]
""",
    ),
    "double hooke": Case(
        1,
        11,
        """
symbols: {L: 0.5}
gravity: [1, -2, -9.81]
bodies:
  - {name: input, joint: {type: revolute, axis: z}}
  - {name: cross1, parent: input, joint: {type: revolute, axis: x}}
  - {name: mid, parent: cross1, joint: {type: revolute, axis: y}, frame: {rpy: [0, pi/6, 0]}}
  - {name: cross2, parent: mid, joint: {type: revolute, axis: y, origin: {xyz: [0, 0, L]}}}
  - {name: output, joint: {type: revolute, axis: z, origin: {xyz: [L/2, 0, sqrt(3)/2*L]}}}
loops:
  - {name: fork, joint: revolute, axis: x, connects: [cross2, output], at: {rpy: [0, -pi/6, 0]}, on_second: {}}
independent: [input]
""",
    ),
    "spherical four bar": Case(
        1,
        11,
        """
gravity: [1, -2, -9.81]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, alpha: pi/6}
  - {name: rocker, joint: revolute, parent: base, alpha: pi/2}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {rpy: [pi/3, 0, 0]}, on_second: {rpy: [pi/4, 0,
        0]}}
independent: [crank]
assembly: {crank: 0.4, coupler: 1, rocker: 1}
""",
    ),
    "spherical four bar, symbols": Case(
        1,
        11,
        """
symbols: {al: 0.5, be: 1.1, ga: 0.9, de: 1.4}
gravity: [1, -2, -9.81]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, alpha: al}
  - {name: rocker, joint: revolute, parent: base, alpha: de}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {rpy: [be, 0, 0]}, on_second: {rpy: [ga, 0, 0]}}
independent: [crank]
assembly: {crank: 0.4, coupler: 1, rocker: 1}
""",
    ),
    "sr400": Case(
        6,
        39,
        SR400
        + """loops:
  - {name: pin, joint: revolute, connects: [j8, j3], at: {xyz: [d3, 0, 0]}, on_second: {xyz: [0, -d8, 0], rpy: [0,
        0, pi/2]}}
independent: [j1, j2, j7, j4, j5, j6]
assembly: {j7: -pi/2, j8: pi/2}
""",
    ),
    "sr400, actuators at 2 and 3": Case(
        6,
        39,
        SR400
        + """loops:
  - {name: pin, joint: revolute, connects: [j8, j3], at: {xyz: [d3, 0, 0]}, on_second: {xyz: [0, -d8, 0], rpy: [0,
        0, pi/2]}}
independent: [j1, j2, j3, j4, j5, j6]
assembly: {j7: -pi/2, j8: pi/2}
""",
    ),
    "four bar, twice": Case(
        1,
        8,
        """
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
  - {name: pin2, joint: spherical, connects: [rocker, coupler], at: {xyz: [l4, 0, 0]}, on_second: {xyz: [l3, 0, 0]}}
  - {name: pin3, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0.1]}, on_second: {xyz: [l4, 0,
        0.1]}}
assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206}
""",
    ),
    "four bar, sawn coupler": Case(
        1,
        8,
        """
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
  - {name: half, joint: revolute, a: l4}
loops:
  - {name: saw, joint: weld, connects: [coupler, half], at: {xyz: [l3, 0, 0]}, on_second: {}}
assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206, half: -1.1}
""",
    ),
    "four bar, planar kind": Case(
        1,
        8,
        """
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: coupler, joint: {type: planar, axis: z}}
  - {name: rocker, joint: {type: revolute, axis: z, origin: {xyz: [l1, 0, 0]}}}
loops:
  - {name: pin1, joint: revolute, connects: [coupler, crank], on_second: {xyz: [l2, 0, 0]}}
  - {name: pin2, joint: axes, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
assembly: {crank: 1, coupler.x: 0.081, coupler.y: 0.126, coupler.angle: 0.5184, rocker: 1.6206}
independent: [crank]
""",
    ),
    "four bar, floating base": Case(
        7,
        28,
        """
floating_base: true
symbols: {l1: 0.4, l2: 0.15, l3: 0.35, l4: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: crank, joint: revolute}
  - {name: coupler, joint: revolute, a: l2}
  - {name: rocker, joint: revolute, parent: base, a: l1}
loops:
  - {name: pin, joint: revolute, connects: [coupler, rocker], at: {xyz: [l3, 0, 0]}, on_second: {xyz: [l4, 0, 0]}}
assembly: {crank: 1, coupler: -0.4816, rocker: 1.6206}
""",
    ),
    "floating base, closed to the world": Case(
        4,
        16,
        FLOATING_BASE
        + """loops:
  - {name: grip, joint: spherical, connects: [arm, null], at: {xyz: [l, 0, 0]}}
""",
    ),
    "floating base, hinged to the world": Case(
        2,
        4,
        FLOATING_BASE
        + """loops:
  - {name: grip, joint: revolute, connects: [arm, null], at: {xyz: [l, 0, 0]}}
""",
    ),
    "geared five bar": Case(
        1,
        8,
        """
symbols: {a1: 0.2, a2: 0.3, b1: 0.25, b2: 0.35, c: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: left, joint: revolute}
  - {name: left2, joint: revolute, a: a1}
  - {name: right, joint: revolute, parent: base, a: c}
  - {name: right2, joint: revolute, a: b1}
couplings:
  - {right: -left + pi}
loops:
  - {name: pin, joint: revolute, connects: [left2, right2], at: {xyz: [a2, 0, 0]}, on_second: {xyz: [b2, 0, 0]}}
independent: [left]
assembly: {left: 2, left2: -1, right2: 1}
""",
    ),
    "geared five bar, 2:1": Case(
        1,
        10,
        """
symbols: {a1: 0.2, a2: 0.3, b1: 0.25, b2: 0.35, c: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: left, joint: revolute}
  - {name: left2, joint: revolute, a: a1}
  - {name: right, joint: revolute, parent: base, a: c}
  - {name: right2, joint: revolute, a: b1}
couplings:
  - {right: -2*left}
loops:
  - {name: pin, joint: revolute, connects: [left2, right2], at: {xyz: [a2, 0, 0]}, on_second: {xyz: [b2, 0, 0]}}
independent: [left]
assembly: {left: 2, left2: -1, right2: 1}
""",
    ),
    "geared five bar, 1:2": Case(
        1,
        10,
        """
symbols: {a1: 0.2, a2: 0.3, b1: 0.25, b2: 0.35, c: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {name: left, joint: revolute}
  - {name: left2, joint: revolute, a: a1}
  - {name: right, joint: revolute, parent: base, a: c}
  - {name: right2, joint: revolute, a: b1}
couplings:
  - {right: -left/2}
loops:
  - {name: pin, joint: revolute, connects: [left2, right2], at: {xyz: [a2, 0, 0]}, on_second: {xyz: [b2, 0, 0]}}
independent: [left]
assembly: {left: 2, left2: -1, right2: 1}
""",
    ),
    "two cranks on a table": Case(
        3,
        5,
        """
symbols: {r: 0.2, l: 0.5}
gravity: [0, 0, -9.81]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: plate, joint: {type: planar, axis: z, origin: {xyz: [0, 0, 0.1]}}}
loops:
  - {name: peg, joint: point_on_plane, axis: x, connects: [plate, crank], on_second: {xyz: [r, 0, 0]}}
""",
    ),
    "two arms carrying": Case(
        6,
        38,
        """
symbols: {a: 0.3, b: 0.25, c: 0.6, w: 0.2}
bodies:
  - {name: l1, joint: {type: revolute, axis: z}}
  - {name: l2, parent: l1, joint: {type: revolute, axis: y, origin: {xyz: [0, 0, a]}}}
  - {name: l3, parent: l2, joint: {type: revolute, axis: y, origin: {xyz: [a, 0, 0]}}}
  - {name: box, parent: l3, joint: {type: spherical, origin: {xyz: [b, 0, 0]}}}
  - {name: r1, joint: {type: revolute, axis: z, origin: {xyz: [c, 0, 0]}}}
  - {name: r2, parent: r1, joint: {type: revolute, axis: y, origin: {xyz: [0, 0, a]}}}
  - {name: r3, parent: r2, joint: {type: revolute, axis: y, origin: {xyz: [-a, 0, 0]}}}
loops:
  - {name: grip, joint: spherical, connects: [r3, box], at: {xyz: [-b, 0, 0]}, on_second: {xyz: [w, 0, 0]}}
assembly: {l2: -0.9, l3: 1.9, r2: 0.9, r3: -1.7}
""",
    ),
    "bennett, u": Case(
        1,
        9,
        BENNETT
        + """loops:
  - {name: pin, joint: revolute, connects: [r3, base], at: {xyz: [2*u, 0, 0], rpy: [pi/2, 0, 0]},
        on_second: {xyz: [-u, 0, 0], rpy: [-pi/6, 0, 0]}}
independent: [r1]
assembly: {r1: pi/2, r2: -2*pi/3, r3: -pi/2}
""",
    ),
    "bennett, u, rounded pose": Case(
        1,
        9,
        BENNETT
        + """loops:
  - {name: pin, joint: revolute, connects: [r3, base], at: {xyz: [2*u, 0, 0], rpy: [pi/2, 0, 0]},
        on_second: {xyz: [-u, 0, 0], rpy: [-pi/6, 0, 0]}}
independent: [r1]
assembly: {r1: 1, r2: -2.53, r3: -1}
""",
    ),
    "rod, connects at both ends": Case(
        3,
        17,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="thigh" pos="0 0 1"><joint name="hip" axis="0 1 0"/>
  INERTIA
  <body name="shank" pos="0 0 -0.4"><joint name="knee" axis="0 1 0"/>
    INERTIA
    <body name="foot" pos="0 0 -0.42"><joint name="ankle" axis="0 1 0"/>
      INERTIA</body></body></body>
<body name="rod" pos="0.05 0.02 0.9"><freejoint name="rod"/>
  INERTIA</body></worldbody><equality>
  <connect body1="rod" body2="thigh" anchor="0 0 0"/><connect body1="rod" body2="foot" anchor="0.03 0 -0.7"/>
  </equality><actuator><motor joint="hip"/><motor joint="knee"/></actuator></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "rod, welds": Case(
        1,
        8,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="a"><joint name="a" axis="0 1 0"/>
  INERTIA<body name="b" pos="0.3 0 0">
  <joint name="b" axis="0 1 0"/>INERTIA
<body name="c" pos="0.1 0 -0.35"><joint name="c" axis="0 1 0"/>
  INERTIA</body></body></body>
<body name="d" pos="0.1 0 -0.4"><joint name="d" axis="0 1 0"/>
  INERTIA</body></worldbody><equality>
  <weld body1="c" body2="d"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "four bar connect to world": Case(
        1,
        8,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="a"><joint name="a" axis="0 1 0"/>
  INERTIA<body name="b" pos="0.3 0 0.1">
  <joint name="b" axis="0 1 0"/>INERTIA
<body name="c" pos="0.1 0 -0.35"><joint name="c" axis="0 1 0"/>
  INERTIA</body></body></body></worldbody>
  <equality><connect body1="c" anchor="0.2 0 0.05"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "sarrus mjcf": Case(
        1,
        5,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="a1" pos="0.3 0 0"><joint name="a1" axis="0 1 0"/>
  INERTIA<body name="a2" pos="0.2 0 0.3">
  <joint name="a2" axis="0 1 0"/>INERTIA
<body name="top" pos="-0.2 0 0.3"><joint name="top" axis="0 1 0"/>
  INERTIA</body></body></body>
<body name="b1" pos="0 0.3 0"><joint name="b1" axis="1 0 0"/>
  INERTIA<body name="b2" pos="0 0.2 0.3">
  <joint name="b2" axis="1 0 0"/>INERTIA
  </body></body></worldbody><equality><connect body1="b2" body2="top" anchor="0.05 -0.2 0.3"/>
  <connect body1="b2" body2="top" anchor="-0.05 -0.2 0.3"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "door hung by two connects": Case(
        1,
        1,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
  <body name="door" pos="0.1 0.2 1"><freejoint name="door"/>
  INERTIA</body></worldbody><equality>
  <connect body1="door" anchor="0 0 0.5"/><connect body1="door" anchor="0 0 -0.5"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "scissors mjcf": Case(
        1,
        5,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="s1"><joint name="s1" axis="0 1 0"/>
  INERTIA</body>
<body name="foot" pos="0.4 0 0"><joint name="slide" type="slide" axis="1 0 0"/>
  INERTIA
 <body name="s2"><joint name="s2" axis="0 1 0"/>
   INERTIA</body></body>
<body name="top" pos="0 0 0.3"><joint name="up" type="slide" axis="0 0 1"/>
  INERTIA
 <body name="wheel" pos="0.4 0 0"><joint name="w" type="slide" axis="1 0 0"/>
   INERTIA</body></body></worldbody><equality>
   <connect body1="s1" body2="s2" anchor="0.2 0 0.15"/><connect body1="s1" body2="wheel" anchor="0.4 0 0.3"/>
   <connect body1="s2" body2="top" anchor="-0.4 0 0.3"/></equality><actuator><motor joint="up"/></actuator></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "stewart mjcf": Case(6, 82, stewart()),
    "delta mjcf": Case(9, 55, delta()),
    "leg mjcf": Case(8, 71, mjcf(leg("left", 0.135), leg_loops("left"))),
    "biped mjcf": Case(22, 160, biped('<freejoint name="pelvis"/>'), slow=True),
    "biped on a stand mjcf": Case(16, 142, biped("")),
}
