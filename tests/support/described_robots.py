"""Robots with everything that a description may hold."""

from __future__ import annotations

from dataclasses import replace

from echelon.robot.joint import Placement
from echelon.robot.mechanism import Cut, Mechanism

EVERYTHING = """
echelon: 1
name: arm with everything
symbols: {l: 0.4, n: 2}
gravity: [1, 2, -9.81]
modified_dh:
  - {name: j1, joint: revolute}
  - {name: j2, joint: revolute, alpha: pi/2, a: 0.2}
  - {name: j3, joint: revolute, a: l, d: 0.1}
  - {name: j4, joint: prismatic, alpha: pi/2}
  - {name: j5, joint: revolute, alpha: pi/3}
couplings: [{j5: n*j1 - j3}]
actuators: {m2: 50*j2 + 10*j3, m3: -60*j3}
rotors: [{name: rotor, on: j2, drives: 30*j3, axis: x}]
effects:
  - {type: rotor_inertia, at: all}
  - {type: viscous, at: all}
  - {type: coulomb, at: j1}
  - {type: spring, at: j2}
  - {type: drive_gain, at: j1}
  - parameter: K
    unit: N·m
    acts: [{at: j1, term: "2*qdd[j2]*cos(q) + abs(qd)"}, {at: m2, term: "l*qdd[m3] + sin(q[j1])"}]
"""


SENSORS = """
outputs:
  - {joint: all}
  - {actuator: m2}
  - {actuator: j1, name: drive}
  - {wrench: base}
  - {wrench: j3, name: strain, fixed_to: parent, frame: {xyz: [0, l, 0.1], rpy: [pi/2, 0, 0]}}
  - {name: both, sum: [{joint: j1}, {joint: j2, weight: -1/2}]}
"""


def sensed(mechanism: Mechanism) -> Mechanism:
    cuts = [
        Cut(1, Placement(), False, axis, angular)
        for axis in range(3)
        for angular in (False, True)
    ]
    return replace(
        mechanism,
        measured=tuple(cut.output(f"s{k}", "N") for k, cut in enumerate(cuts)),
    )
