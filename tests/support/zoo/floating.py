"""Mechanisms with loops on a floating base."""

from __future__ import annotations

from support.zoo.case import Case

FLOATING_BASE = """
floating_base: true
symbols: {l: 0.4}
bodies:
  - {name: arm, joint: {type: revolute, axis: z}}
"""

FLOATING = {
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
}
