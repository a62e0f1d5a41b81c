"""Robots and machines: parallel in a plane, with a parallelogram, hydraulic, with two arms."""

from __future__ import annotations

from support.zoo.case import Case

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

MACHINES = {
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
independent: [l1, l2, l3, box.x, box.y, box.z]
assembly: {l2: -0.9, l3: 1.9, r2: 0.9, r3: -1.7}
""",
    ),
}
