"""Linkages in space: balls, crosses, spherical ones, Sarrus's and Bennett's."""

from __future__ import annotations

from support.zoo.case import Case

BENNETT = """
symbols: {u: 0.4}
gravity: [1, -2, -9.81]
modified_dh:
  - {name: r1, joint: revolute}
  - {name: r2, joint: revolute, alpha: pi/2, a: 2*u}
  - {name: r3, joint: revolute, alpha: pi/6, a: u}
"""

SPATIAL = {
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
}
