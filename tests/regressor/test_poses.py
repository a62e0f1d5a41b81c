"""Closed poses of loops with wrists: the wrist's centre is brought to its place, then its rotations follow."""

from __future__ import annotations

import pytest

import echelon as ec
from echelon.formats.robot_file import RobotFile
from support.paths import EXAMPLES

BALL = "{{name: end{k}, massless: true, parent: platform, joint: {{type: spherical, origin: {{xyz: {at}}}}}}}"
CROSS = (
    "{{name: a{k}, massless: true, parent: platform, joint: {{type: revolute, axis: x, origin: {{xyz: {at}}}}}}}\n"
    "  - {{name: b{k}, massless: true, parent: a{k}, joint: {{type: revolute, axis: y}}}}\n"
    "  - {{name: end{k}, massless: true, parent: b{k}, joint: {{type: revolute, axis: z}}}}"
)


@pytest.mark.parametrize(
    "wrist",
    [
        pytest.param(CROSS, id="three rotations"),
        pytest.param(BALL, id="ball", marks=pytest.mark.slow),
    ],
)
def test_welded_wrists_close_like_spherical_joints(wrist: str) -> None:
    """A 3-RPS platform whose balls belong to the tree; the links between the rotations have no mass."""
    text = (EXAMPLES / "loops" / "three_rps.yaml").read_text(encoding="utf-8")
    places = {2: "[-p/2, sqrt(3)/2*p, 0]", 3: "[-p/2, -sqrt(3)/2*p, 0]"}
    for k, at in places.items():
        spherical = f"{{name: ball{k}, joint: spherical, connects: [slide{k}, platform], on_second: {{xyz: {at}}}}}"
        assert spherical in text
        text = text.replace(
            spherical, f"{{name: weld{k}, joint: weld, connects: [slide{k}, end{k}]}}"
        )
        text = text.replace("loops:", f"  - {wrist.format(k=k, at=at)}\nloops:")
    text = text.replace("value: 0.4, ", "").replace(
        "value: 0.2, ", ""
    )  # without values no frames are made to follow
    mechanism = RobotFile.of(text.encode(), "three_rps.yaml").mechanism()
    expected = ec.base_structure(ec.load(EXAMPLES / "loops" / "three_rps.yaml"))
    assert ec.base_structure(mechanism).pivots == expected.pivots
