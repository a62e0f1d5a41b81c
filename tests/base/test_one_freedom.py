"""Loops with one freedom that has to show many parameters."""

from __future__ import annotations

from math import atan2, cos, pi, sin

import pytest
from scipy.optimize import brentq

import echelon as ec
from echelon.base.sensors import sensor_report
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from support.descriptions import read_description
from support.selection import slow_unless

SEVEN_REVOLUTES = """echelon: 1
name: seven revolutes
bodies:
  - {name: b1, joint: {type: revolute, axis: z}}
  - {name: b2, parent: b1, joint: {type: revolute, axis: x, origin: {xyz: [0.3, 0.1, 0.2]}}}
  - {name: b3, parent: b2, joint: {type: revolute, axis: y, origin: {xyz: [0.25, -0.1, 0.15]}}}
  - {name: b4, parent: b3, joint: {type: revolute, axis: z, origin: {xyz: [0.2, 0.3, 0.1]}}}
  - {name: b5, parent: b4, joint: {type: revolute, axis: x, origin: {xyz: [-0.15, 0.2, 0.3]}}}
  - {name: b6, parent: b5, joint: {type: revolute, axis: y, origin: {xyz: [-0.3, 0.1, 0.1]}}}
  - {name: b7, parent: b6, joint: {type: revolute, axis: z, origin: {xyz: [0.1, -0.3, -0.1]}}}
loops: [{name: shut, joint: weld, connects: [b7, base]}]
"""


def read(text: str) -> Mechanism:
    return read_description(text.encode(), "robot.yaml", ReadingOptions())


def four_bars_in_series(count: int) -> Mechanism:
    """The rocker of each is the crank of the next; one freedom."""
    bars, pivots, angles = [0.15], [0.0], [1.0]
    bodies = ["{name: r0, joint: {type: revolute, axis: z}}"]
    loops, pose = [], ["r0: 1"]
    for k in range(count):
        bar, coupler = 0.3 + 0.013 * k, 0.41 + 0.011 * k
        pivots.append(pivots[-1] + 0.4 + 0.017 * k)
        x, y = pivots[k] + bars[k] * cos(angles[k]), bars[k] * sin(angles[k])

        def gap(
            t: float,
            x: float = x,
            y: float = y,
            k: int = k,
            bar: float = bar,
            coupler: float = coupler,
        ) -> float:
            return (
                (pivots[k + 1] + bar * cos(t) - x) ** 2
                + (bar * sin(t) - y) ** 2
                - coupler**2
            )

        angle = float(brentq(gap, 0.2, pi - 0.4))
        turned = (
            atan2(bar * sin(angle) - y, pivots[k + 1] + bar * cos(angle) - x)
            - angles[k]
        )
        bodies += [
            f"{{name: c{k}, parent: r{k}, joint: {{type: revolute, axis: z, origin: {{xyz: [{bars[k]:.3f}, 0, 0]}}}}}}",
            f"{{name: r{k + 1}, joint: {{type: revolute, axis: z, origin: {{xyz: [{pivots[k + 1]:.3f}, 0, 0]}}}}}}",
        ]
        ends = (
            f"at: {{xyz: [{coupler:.3f}, 0, 0]}}, on_second: {{xyz: [{bar:.3f}, 0, 0]}}"
        )
        loops.append(
            f"{{name: p{k}, joint: revolute, connects: [c{k}, r{k + 1}], {ends}}}"
        )
        pose += [f"c{k}: {turned:.5f}", f"r{k + 1}: {angle:.5f}"]
        bars.append(bar)
        angles.append(angle)
    lines = [
        "echelon: 1",
        "gravity: [0, -9.81, 0]",
        "bodies:",
        *(f"  - {body}" for body in bodies),
    ]
    lines += [
        "loops:",
        *(f"  - {loop}" for loop in loops),
        "independent: [r0]",
        f"assembly: {{{', '.join(pose)}}}",
    ]
    return read("\n".join(lines))


@pytest.mark.slow
def test_seven_revolutes() -> None:
    assert ec.base_structure(read(SEVEN_REVOLUTES)).rank == 27


@pytest.mark.slow
def test_closed_forms_of_seven_revolutes() -> None:
    mechanism = read(SEVEN_REVOLUTES)
    base = ec.base_parameters(mechanism)
    assert base.rank == 27
    assert ec.verify(base).rank == 27
    assert sensor_report(mechanism).ranks[("b1",)] == 27


@pytest.mark.parametrize("count", slow_unless([1], (1, 2, 4, 6, 8)))
def test_four_bars_in_series(count: int) -> None:
    mechanism = four_bars_in_series(count)
    assert ec.base_parameters(mechanism).rank == 3 + 5 * count
    assert sensor_report(mechanism).ranks[("r0",)] == 3 + 5 * count
