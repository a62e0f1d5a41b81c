"""Rounded numbers that stand for relations between consecutive axes, and what is said about them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.robot.mechanism import Mechanism

Row = tuple[str, str, str, str]
"""Type, xyz, rpy and axis of a joint."""


def load(folder: Path, *rows: Row, **options: object) -> Mechanism:
    links = ['<link name="l0"/>']
    for k, (kind, xyz, rpy, axis) in enumerate(rows, 1):
        links.append(
            f'<link name="l{k}"/><joint name="j{k}" type="{kind}"><parent link="l{k - 1}"/>'
        )
        stated = "" if kind == "fixed" else f'<axis xyz="{axis}"/>'
        links.append(
            f'<child link="l{k}"/><origin xyz="{xyz}" rpy="{rpy}"/>{stated}</joint>'
        )
    file = folder / "robot.urdf"
    file.write_text(f'<robot name="r">{"".join(links)}</robot>')
    return ec.load(file, **options)  # type: ignore[arg-type]


def snaps(robot: Mechanism) -> list[str]:
    assert robot.reading is not None
    return [str(s) for s in robot.reading.snaps]


FIRST = ("revolute", "0 0 0", "1.5707963267948966 0 0", "0 0 1")
BACK = ("revolute", "0.1 0 0.3", "-0.7 0 0", "0 0 1")


def test_decimals_that_cancel_make_axes_parallel_and_nothing_is_snapped(
    tmp_path: Path,
) -> None:
    rows = (
        FIRST,
        ("fixed", "0.1 0.2 0.3", "0.3 0 0", ""),
        ("fixed", "0 0.1 0", "0.4 0 0", ""),
        BACK,
    )
    for tolerance in (0.002, 0.0):
        robot = load(tmp_path, *rows, snap_tolerance=tolerance)
        assert ec.base_structure(robot).rank == 6
        assert not [text for text in snaps(robot) if "axis" in text]


@pytest.mark.parametrize(("second", "rank"), [("-0.70001", 6), ("-0.71", 10)])
def test_nearly_parallel_axes_are_parallel_and_the_literal_count_stands_beside(
    tmp_path: Path, second: str, rank: int
) -> None:
    base = ec.base_parameters(
        load(
            tmp_path,
            FIRST,
            ("fixed", "0.1 0 0", "0.7 0 0", ""),
            (*BACK[:2], f"{second} 0 0", BACK[3]),
        )
    )
    assert base.rank == rank
    if rank == 6:
        assert base.reading.literal_rank == 10
        assert [s.element for s in base.reading.decisive] == [
            "joint 'j3' axis against joint 'j1'"
        ]
        assert "axis against joint 'j1': 1e-05 read as 0°" in str(base)


def test_rounded_angles_that_add_up_to_a_right_angle(tmp_path: Path) -> None:
    """65° and 25° in radians to six digits."""
    robot = load(
        tmp_path,
        FIRST,
        ("fixed", "0 0 0", "1.134464 0 0", ""),
        ("revolute", "0 0 0.2", "0.436332 0 0", "0 0 1"),
    )
    assert [text for text in snaps(robot) if "axis" in text] == [
        "joint 'j3' axis against joint 'j1': 1.570796 read as 90°"
    ]


def test_axes_outside_loops_are_related_as_in_trees() -> None:
    """65 degrees in radians to six digits and back: the third axis is parallel to the first."""
    hinge, bar = '<joint name="{}" axis="0 0 1"/>', '<joint name="{}" axis="0 1 0"/>'
    tree = (
        f'<body>{hinge.format("j1")}<geom size="1"/><body pos=".1 0 0" euler="65 0 0"><body pos=".1 .2 0" '
        f'euler="-65.00005 0 0">{hinge.format("j2")}<geom size="1"/><body name="crank" pos=".2 0 0">'
        f'{bar.format("q1")}<geom size="1"/><body name="coupler" pos="0 0 .15">{bar.format("q2")}<geom size="1"/>'
        f'</body></body><body name="rocker" pos=".6 0 0">{bar.format("q3")}<geom size="1"/></body></body></body></body>'
    )
    loop = '<equality><connect body1="coupler" body2="rocker" anchor="0.35 0 0.03"/></equality>'
    text = f"<mujoco><worldbody>{tree}</worldbody>{loop}</mujoco>"
    base = ec.base_parameters(ec.load(text))
    assert base.rank < (base.reading.literal_rank or 0)
    assert (
        base.rank == ec.base_structure(ec.load(text.replace("-65.00005", "-65"))).rank
    )


@pytest.mark.parametrize(
    "axis", ["2 4 6", "0.26726124 0.53452248 0.80178373", "-0.1 -0.2 -0.3"]
)
def test_one_direction_in_several_spellings(tmp_path: Path, axis: str) -> None:
    rows = [("revolute", "0.2 0 0.1", "0 0 0", a) for a in ("1 2 3", axis, "1 2 3")]
    assert ec.base_structure(load(tmp_path, *rows)).rank == 9


def test_axes_that_meet_but_for_rounding(tmp_path: Path) -> None:
    """A point of the first axis in seven digits."""
    slanted = ("revolute", "0 0 0", "0 0 0", "1 2 3")
    robot = load(
        tmp_path,
        slanted,
        ("revolute", "0.0801784 0.1603568 0.2405351", "0 0.6 0", "0 0 1"),
    )
    assert any("distance of its axis from joint 'j1'" in text for text in snaps(robot))
    exactly = load(tmp_path, slanted, ("revolute", "0 0 0", "0 0.6 0", "0 0 1"))
    assert ec.base_structure(robot).rank == ec.base_structure(exactly).rank


def test_an_axis_along_an_oblique_gravity(tmp_path: Path) -> None:
    down = "-3.27,-6.54,-6.54"
    rows = [
        ("revolute", "0 0 0", "0 0 0", "1 2 2"),
        ("revolute", "0.1 0 0.2", "0.5 0 0", "0 0 1"),
    ]
    along = ec.base_structure(load(tmp_path, *rows, gravity=down)).rank
    across = ec.base_structure(load(tmp_path, *rows, gravity="0,0,-9.81")).rank
    assert (along, across) == (8, 10)


def test_the_geometry_stays_where_it_was(tmp_path: Path) -> None:
    """Rewriting frames in other angles changes no torque by more than the rounding."""
    rows = (
        FIRST,
        ("fixed", "0.1 0.2 0.3", "0.3 0.2 0.1", ""),
        ("revolute", "0.05 0 0.1", "0.4 -0.3 0.9", "0.26726124 0.53452248 0.80178373"),
        ("prismatic", "0.1 0 0", "0 0 0", "2 4 6"),
        ("revolute", "0 0.2 0", "0.1 0.2 0.3", "0 0 1"),
        ("fixed", "0.1 0 0", "1.134464 0 0.4", ""),
        ("fixed", "0 0.1 0", "0.436332 0 0", ""),
        ("revolute", "0 0.2 0.1", "0 0 0.7", "0 0 1"),
    )
    rng = np.random.default_rng(5)
    states = [rng.uniform(-1, 1, (4, 5)) for _ in range(3)]
    intended, literal = load(tmp_path, *rows), load(tmp_path, *rows, snap_tolerance=0.0)
    found = [
        evaluate_floats(inverse_dynamics_regressor(m), m, *states)
        for m in (intended, literal)
    ]
    assert intended.reading is not None
    assert [text for text in snaps(intended) if "axis" in text]
    np.testing.assert_allclose(found[0], found[1], atol=1e-5)


def test_relations_among_declared_symbols_are_not_presumed(tmp_path: Path) -> None:
    file = tmp_path / "robot.yaml"
    file.write_text(
        """
echelon: 1
symbols: {alpha: 0.7, beta: -0.70001}
gravity: [0, -9.81, 0]
modified_dh:
  - {joint: revolute}
  - {joint: fixed, alpha: alpha, a: 0.2}
  - {joint: revolute, alpha: beta}
"""
    )
    assert ec.base_structure(ec.load(file)).rank == 10


def test_lengths_of_nearly_one_size_share_a_symbol(tmp_path: Path) -> None:
    rows = (
        FIRST,
        ("revolute", "0.2 0 0", "0 0 0", "0 0 1"),
        ("revolute", "0.2000004 0 0", "1.5707963267948966 0 0", "0 0 1"),
    )
    assert len(ec.base_parameters(load(tmp_path, *rows)).matrix.symbols) == 1
    assert (
        len(
            ec.base_parameters(load(tmp_path, *rows, snap_tolerance=0.0)).matrix.symbols
        )
        == 2
    )
