"""Base parameters of mechanisms with loops as the literature has them."""

from __future__ import annotations

import math

import numpy as np
import pytest

import echelon as ec
from echelon.base.structure import Structure, find_structure
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.robot.mechanism import Mechanism
from support.paths import ROOT
from support.selection import slow_unless

LOOPS = ROOT / "examples" / "loops"
FOUR_BAR = (LOOPS / "four_bar.yaml").read_text()
PARALLELOGRAM = (LOOPS / "parallelogram.yaml").read_text()
IN_PLANE, NONE = "gravity: [0, -9.81, 0]", "gravity: none"


def read(text: str) -> Mechanism:
    return RobotFile.of(text.encode(), "robot.yaml").mechanism(ReadingOptions())


def structure(text: str, seed: int = 1) -> Structure:
    return find_structure(read(text), np.random.default_rng(seed))


def expressions(text: str) -> list[str]:
    return [str(e) for e in ec.base_parameters(read(text)).expressions]


# -- four-bar linkages -------------------------------------------------------------------------------------------------


def test_four_bar() -> None:
    assert expressions(FOUR_BAR) == [
        "ZZ1 + l2²·M2 + (l2²/l4)·MX3",
        "MX1 + l2·M2 + (l2/l4)·MX3",
        "MY1",
        "ZZ2 + (l3²/l4)·MX3",
        "MX2 + (l3/l4)·MX3",
        "MY2",
        "ZZ3 − l4·MX3",
        "MY3",
    ]


def test_four_bar_without_gravity() -> None:
    assert structure(FOUR_BAR.replace(IN_PLANE, NONE)).rank == 4
    assert structure(FOUR_BAR.replace(IN_PLANE, "gravity: [0, 0, -9.81]")).rank == 4


def test_parallelogram() -> None:
    assert expressions(PARALLELOGRAM) == [
        "ZZ1 + l2²·M2 + ZZ3",
        "MX1 + l2·M2 + MX3",
        "MY1 + MY3",
    ]
    assert expressions(PARALLELOGRAM.replace(IN_PLANE, NONE)) == ["ZZ1 + l2²·M2 + ZZ3"]


def antiparallelogram() -> str:
    """The parallelogram folded over: its coupler mirrored at the line from the crank's end to the rocker's foot."""
    ground, crank, angle = 0.4, 0.15, math.pi / 3
    end = crank * np.array([math.cos(angle), math.sin(angle)])
    foot = np.array([ground, 0.0])
    along = (foot - end) / np.linalg.norm(foot - end)
    coupler = 2 * along[0] * ground * along - [ground, 0.0]
    rocker = end + coupler - foot
    pose = f"coupler: {math.atan2(*coupler[::-1]) - angle:.4f}, rocker: {math.atan2(*rocker[::-1]):.4f}"
    return PARALLELOGRAM.replace("coupler: -pi/3, rocker: pi/3", pose)


@pytest.mark.parametrize("seed", range(3))
def test_the_assembly_pose_tells_parallelogram_and_antiparallelogram(seed: int) -> None:
    assert structure(PARALLELOGRAM, seed).rank == 3
    assert structure(antiparallelogram(), seed).rank == 8


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    "pose", ["crank: 1, coupler: -1, rocker: 1", "crank: 1, coupler: -1.2, rocker: 1.1"]
)
def test_a_rounded_assembly_pose_tells_it_as_well(pose: str, seed: int) -> None:
    assert (
        structure(
            PARALLELOGRAM.replace("crank: pi/3, coupler: -pi/3, rocker: pi/3", pose),
            seed,
        ).rank
        == 3
    )


def test_antiparallelogram_without_gravity() -> None:
    # as many as any four-bar linkage: its links turn at different rates
    assert structure(PARALLELOGRAM.replace(IN_PLANE, NONE)).rank == 1
    assert structure(antiparallelogram().replace(IN_PLANE, NONE)).rank == 4


# -- chains of four-bar linkages ---------------------------------------------------------------------------------------


def chain(count: int) -> str:
    """Four-bar linkages in a row; the rocker of each is the crank of the next."""
    symbols, rows, loops = ["h0: 0.15"], ["  - {name: r0, joint: revolute}"], []
    pose, foot = ["r0: 1"], ""
    for k in range(1, count + 1):
        symbols += [f"g{k}: 0.4", f"c{k}: 0.{35 + k}", f"h{k}: 0.{30 + k}"]
        foot = f"{foot} + g{k}".removeprefix(" + ")
        rows += [f"  - {{name: c{k}, joint: revolute, parent: r{k - 1}, a: h{k - 1}}}"]
        rows += [f"  - {{name: r{k}, joint: revolute, parent: base, a: {foot}}}"]
        ends = f"at: {{xyz: [c{k}, 0, 0]}}, on_second: {{xyz: [h{k}, 0, 0]}}"
        loops += [f"  - {{joint: revolute, connects: [c{k}, r{k}], {ends}}}"]
        pose += [f"c{k}: {-1.5 if k > 1 else -0.48}", f"r{k}: 1.6"]
    head = f"echelon: 1\nname: chain\n{IN_PLANE}\nsymbols: {{{', '.join(symbols)}}}\n"
    tail = f"independent: [r0]\nassembly: {{{', '.join(pose)}}}\n"
    return head + "\n".join(["modified_dh:", *rows, "loops:", *loops, tail])


@pytest.mark.parametrize("count", slow_unless((1, 2, 4), range(1, 7)))
def test_every_further_four_bar_adds_five(count: int) -> None:
    assert structure(chain(count)).rank == 5 * count + 3


# -- in space ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_gough_stewart() -> None:
    assert structure((LOOPS / "gough_stewart.yaml").read_text()).rank == 82
