"""Bars in a plane: four, five and six of them, geared and not, and a pantograph."""

from __future__ import annotations

from support.zoo.case import Case

BARS = {
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
}
