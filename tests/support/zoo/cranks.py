"""Slider cranks, scotch yokes, Whitworth's quick return and cranks on a table."""

from __future__ import annotations

from support.zoo.case import Case

SLIDER_CRANK_OFFSET = """
symbols: {r: 0.2, l: 0.5, e: 0.03}
gravity: [0, -9.81, 0]
bodies:
  - {name: crank, joint: {type: revolute, axis: z}}
  - {name: rod, parent: crank, joint: {type: revolute, axis: z, origin: {xyz: [r, 0, 0]}}}
"""

CRANKS = {
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
}
