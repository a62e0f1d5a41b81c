"""Four-bars in series."""

from __future__ import annotations

from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism

CRANKS = """
echelon: 1
name: two cranks and a guide
symbols: {r: 0.3, d: 0.8, l: 0.25}
gravity: [0, -9.81, 0]
bodies:
  - {name: first, joint: {type: revolute, axis: z}}
  - {name: second, joint: {type: revolute, axis: z, origin: {xyz: [d, 0, 0]}}}
  - {name: guide, joint: {type: prismatic, axis: x}}
  - {name: bob, parent: second, joint: {type: revolute, axis: z, origin: {xyz: [l, 0, 0]}}}
loops:
  - {name: left, joint: point_on_plane, axis: x, connects: [guide, first], on_second: {xyz: [r, 0, 0]}}
  - name: right
    joint: point_on_plane
    axis: x
    connects: [guide, second]
    at: {xyz: [d, 0, 0]}
    on_second: {xyz: [r, 0, 0]}
independent: [first, bob]
assembly: {first: 0.7, second: SECOND, guide: 0.229}
"""


NUMBERS = {
    "{r: 0.3, d: 0.8, l: 0.25}": "{}",
    "[r, ": "[0.3, ",
    "[d, ": "[0.8, ",
    "[l, ": "[0.25, ",
}


def read(text: str) -> Mechanism:
    return RobotFile.of(text.encode(), "robot.yaml").mechanism(ReadingOptions())


def cranks(second: str, numbers: bool = False) -> Mechanism:
    text = CRANKS.replace("SECOND", second)
    for old, new in NUMBERS.items() if numbers else ():
        text = text.replace(old, new)
    return read(text)
