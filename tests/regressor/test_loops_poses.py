"""Assembly modes of mechanisms that have several: the answer is that of the stated pose."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import echelon as ec
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.loops.assembly import Assembly
from echelon.robot.mechanism import Mechanism
from support.selection import one_in


def turning(name: str, parent: str, xyz: str = "0, 0, 0", rpy: str = "0, 0, 0") -> str:
    joint = f"{{type: revolute, axis: z, origin: {{xyz: [{xyz}], rpy: [{rpy}]}}}}"
    return f"  - {{name: {name}, parent: {parent}, joint: {joint}}}\n"


def sliding(name: str, axis: str) -> str:
    return f"  - {{name: {name}, parent: base, joint: {{type: prismatic, axis: {axis}}}}}\n"


def pin(
    first: str, second: str, at: str, on: str, kind: str = "joint: revolute"
) -> str:
    return f"  - {{{kind}, connects: [{first}, {second}], at: {{xyz: [{at}]}}, on_second: {{xyz: [{on}]}}}}\n"


def robot(symbols: str, bodies: str, loops: str, gravity: str = "0, -9.81, 0") -> str:
    return f"echelon: 1\nsymbols: {{{symbols}}}\ngravity: [{gravity}]\nbodies:\n{bodies}loops:\n{loops}"


def four_bar(symbols: str, ground: str, crank: str, coupler: str, rocker: str) -> str:
    bodies = turning("crank", "base") + turning("coupler", "crank", f"{crank}, 0, 0")
    bodies += turning("rocker", "base", f"{ground}, 0, 0")
    return robot(
        symbols, bodies, pin("coupler", "rocker", f"{coupler}, 0, 0", f"{rocker}, 0, 0")
    )


PLANE = "joint: point_on_plane, axis: x"
MECHANISMS = {
    "parallelogram": four_bar("a: 0.3, d: 0.5", "d", "a", "d", "a"),
    "kite": four_bar("a: 0.3, b: 0.5", "a", "a", "b", "b"),
    "rhombus": four_bar("a: 0.3", "a", "a", "a", "a"),
    "isosceles slider-crank": robot(
        "a: 0.3",
        turning("crank", "base")
        + turning("rod", "crank", "a, 0, 0")
        + sliding("piston", "x"),
        pin("rod", "piston", "a, 0, 0", "0, 0, 0"),
    ),
    "trammel": robot(
        "a: 0.4",
        sliding("h", "x") + turning("bar", "h") + sliding("v", "y"),
        pin("bar", "v", "a, 0, 0", "0, 0, 0"),
    ),
    "palletizer": robot(
        "a: 0.7, b: 0.15, c: 0.6",
        turning("turntable", "base", rpy="pi/2, 0, 0")
        + turning("upper", "turntable", "0.1, 0.4, 0")
        + turning("fore", "upper", "a, 0, 0")
        + turning("rod1", "turntable", "0.1, 0.55, 0")
        + turning("plate", "upper", "a, 0, 0")
        + turning("rod2", "plate", "0, b, 0")
        + turning("wrist", "fore", "c, 0, 0"),
        pin("rod1", "plate", "a, 0, 0", "0, b, 0")
        + pin("rod2", "wrist", "c, 0, 0", "0, b, 0"),
        "0, 0, -9.81",
    ),
    "redundant picker": robot(
        "a: 0.4, b: 0.1, c: 0.35",
        turning("one", "base")
        + turning("rod", "base", "0, b, 0")
        + turning("plate", "one", "a, 0, 0")
        + turning("two", "plate")
        + turning("three", "two", "c, 0, 0")
        + turning("hand", "three", "0.2, 0, 0"),
        pin("rod", "plate", "a, 0, 0", "0, b, 0"),
    ),
    "three cranks in a guide": robot(
        "r: 0.3, d: 0.8",
        turning("first", "base")
        + turning("second", "base", "d, 0, 0")
        + sliding("guide", "x")
        + turning("third", "base", "-d, 0, 0"),
        pin("guide", "first", "0, 0, 0", "r, 0, 0", PLANE)
        + pin("guide", "second", "d, 0, 0", "r, 0, 0", PLANE)
        + pin("guide", "third", "-d, 0, 0", "r, 0, 0", PLANE),
    ),
    "spherical four-bar": robot(
        "",
        turning("j1", "base")
        + turning("j2", "j1", rpy="pi/3, 0, 0")
        + turning("j3", "base", rpy="pi/4, 0, 0"),
        "  - {joint: revolute, connects: [j2, j3], at: {rpy: [pi/4, 0, 0]}, on_second: {rpy: [pi/3, 0, 0]}}\n",
    ),
    "Bennett": robot(
        "",
        turning("j1", "base")
        + turning("j2", "j1", "0.2, 0, 0", "pi/2, 0, 0")
        + turning("j3", "j2", "0.1, 0, 0", "pi/6, 0, 0"),
        "  - {joint: revolute, connects: [j3, base], at: {xyz: [0.2, 0, 0], rpy: [pi/2, 0, 0]}, "
        "on_second: {xyz: [-0.1, 0, 0], rpy: [-pi/6, 0, 0]}}\n",
    ),
}


def read(text: str) -> Mechanism:
    return RobotFile.of(text.encode(), "robot.yaml").mechanism(ReadingOptions())


def at_random_poses(name: str, count: int, seed: int) -> Iterator[Mechanism]:
    """The mechanism with random closed poses as the stated ones."""
    mechanism, rng = read(MECHANISMS[name]), np.random.default_rng(seed)
    assembly = Assembly(mechanism)
    q, done = assembly.closed(
        rng.uniform(-2.5, 2.5, (20 * count, len(mechanism.positions)))
    )
    for pose in q[done][:count]:
        stated = ", ".join(
            f"{n}: {x:.12f}" for n, x in zip(mechanism.positions, pose, strict=True)
        )
        yield read(f"{MECHANISMS[name]}assembly: {{{stated}}}\n")


def rank_near(mechanism: Mechanism) -> int:
    """Rank of rows at closed states near the stated pose, by the widest gap of their singular values."""
    real = Assembly(mechanism).random_closed_states(
        np.random.default_rng(3), 100, moves=1
    )
    rows = evaluate_floats(virtual_power_form(mechanism), mechanism, *real)
    singular = np.linalg.svd(rows.reshape(-1, rows.shape[2]), compute_uv=False)
    singular = np.maximum(singular / singular[0], 1e-13)
    ratios = singular[:-1] / singular[1:]
    assert ratios.max() > 1e4
    return int(ratios.argmax()) + 1


def check(name: str, count: int, seed: int) -> None:
    for mechanism in at_random_poses(name, count, seed):
        assert ec.base_structure(mechanism).rank == rank_near(mechanism)


@pytest.mark.parametrize("name", one_in(4, MECHANISMS))
def test_the_mode_is_that_of_the_stated_pose(name: str) -> None:
    check(name, 2, 11)


@pytest.mark.slow
@pytest.mark.parametrize("name", MECHANISMS)
def test_the_mode_is_right_at_many_poses(name: str) -> None:
    check(name, 20, 5)


def test_what_is_in_no_loop_stays_at_its_stated_pose() -> None:
    arm = (
        turning("arm", "base")
        + turning("crank", "arm", "0.1, 0, 0")
        + turning("coupler", "crank", "0.15, 0, 0")
    )
    arm += turning("rocker", "arm", "0.5, 0, 0")
    text = robot("", arm, pin("coupler", "rocker", "0.35, 0, 0", "0.3, 0, 0"))
    assert Assembly(read(f"{text}assembly: {{arm: 0.4}}\n")).pose[0] == 0.4


def test_a_coordinate_that_stands_still_is_not_drawn() -> None:
    """A kite folded onto its ground: the crank rests, coupler and rocker turn together."""
    folded = read(
        f"{MECHANISMS['kite']}assembly: {{crank: 0, coupler: 1, rocker: 1}}\n"
    )
    assert ec.base_structure(folded).rank == 3
    assert folded.independent != ("crank",)
