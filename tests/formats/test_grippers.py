"""Grippers with loops and coupled fingers: ranks, and how other ways of counting come to other ones.

Each finger of an adaptive gripper has a loop, and a joint equality makes the fingers move alike.  States at which only
the velocities of the fingers agree, not their positions, show two parameters more than there are: what the cosine and
sine of each finger's angle weigh.  And a parallelogram that is closed from random guesses is often a crossed one.
"""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from support.mjcf_models import model
from support.mujoco_loops import Array, Equalities, null_space
from support.selection import slow_unless

_INERTIA = (
    '<inertial pos="0.001 0.002 0.003" mass="0.02" diaginertia="2e-6 2.1e-6 2.2e-6"/>'
)
_HEAD = '<compiler angle="radian"/><default><joint axis="1 0 0"/></default>'
_TIED = '<joint joint1="left_driver" joint2="right_driver" polycoef="0 1 0 0 0"/>'


def adaptive(side: str, sign: str, quat: str) -> str:
    """A five-bar: driver and coupler against spring link and follower."""
    return f"""<body name="{side}_driver" pos="0 {sign}0.0306011 0.054904" {quat}>{_INERTIA}
      <joint name="{side}_driver"/>
      <body name="{side}_coupler" pos="0 0.0315 -0.0041">{_INERTIA}<joint name="{side}_coupler"/></body></body>
    <body name="{side}_spring_link" pos="0 {sign}0.0132 0.0609" {quat}>{_INERTIA}<joint name="{side}_spring_link"/>
      <body name="{side}_follower" pos="0 0.055 0.0375">{_INERTIA}<joint name="{side}_follower" pos="0 -0.018 0.0065"/>
      </body></body>"""


def parallelogram(side: str, sign: str, quat: str) -> str:
    return f"""<body name="{side}_knuckle" pos="0 {sign}0.035 0.059098" {quat}>{_INERTIA}<joint name="{side}_driver"/>
      <body name="{side}_finger" pos="0 0.035465 0.042039">{_INERTIA}<joint name="{side}_finger"/></body></body>
    <body name="{side}_inner" pos="0 {sign}0.02 0.074098" {quat}>{_INERTIA}<joint name="{side}_inner"/></body>"""


def hand(finger, anchor: str, ends: tuple[str, str], tied: bool = True) -> str:  # type: ignore[no-untyped-def]
    pins = "".join(
        f'<connect body1="{s}_{ends[0]}" body2="{s}_{ends[1]}" anchor="{anchor}"/>'
        for s in ("right", "left")
    )
    sides = finger("right", "", "") + finger("left", "-", 'quat="0 0 0 1"')
    return model(sides, _HEAD, f"<equality>{pins}{_TIED * tied}</equality>")


HANDS = {
    "adaptive": hand(adaptive, "0 0 0", ("follower", "coupler")),
    "adaptive, untied": hand(adaptive, "0 0 0", ("follower", "coupler"), tied=False),
    "parallelogram": hand(parallelogram, "0 -0.015 0.015", ("finger", "inner")),
    "parallelogram, untied": hand(
        parallelogram, "0 -0.015 0.015", ("finger", "inner"), tied=False
    ),
}
RANKS = {
    "adaptive": 19,
    "adaptive, untied": 22,
    "parallelogram": 3,
    "parallelogram, untied": 6,
}


@pytest.mark.parametrize("name", slow_unless(["parallelogram, untied"], RANKS))
def test_ranks_are_those_at_closed_states(name: str) -> None:
    robot = RobotFile.of(HANDS[name].encode(), "hand.xml").mechanism(ReadingOptions())
    assert ec.base_parameters(robot).rank == RANKS[name]
    equalities = Equalities(HANDS[name])
    singular = equalities.singular_values(
        np.random.default_rng(1), equalities.model.qpos0, 25
    )
    gap = singular[RANKS[name] - 1] / singular[RANKS[name]]
    assert gap > 1e4


def apart(name: str, spread: float) -> int:
    """Rank at states where the fingers' velocities are tied and their positions are not.

    Parameters
    ----------
    name : str
    spread : float
        Of the guesses from which loops are closed; 0 for walks from the reference pose.
    """
    tied, free = Equalities(HANDS[name]), Equalities(HANDS[f"{name}, untied"])
    rng, q, rows = np.random.default_rng(2), np.array(free.model.qpos0), []
    _, rest = free.energies(q, np.zeros(free.model.nv))
    for _ in range(60):
        q = (
            free.closed(rng.uniform(-spread, spread, free.model.nq), 300)
            if spread
            else free.walk(rng, 3, q)
        )
        if np.abs(free.at(q)[0]).max() < 1e-12:
            motions = null_space(tied.at(q)[1])
            kinetic, potential = free.energies(
                q, motions @ rng.normal(size=motions.shape[1])
            )
            rows += [kinetic, potential - rest]
    table = np.array(rows)
    sizes = np.linalg.norm(table, axis=0)
    singular: Array = np.linalg.svd(
        table / np.maximum(sizes, 1e-6 * sizes.max()), compute_uv=False
    )
    return int((singular > 1e-8 * singular[0]).sum())


def test_what_states_with_fingers_apart_would_show() -> None:
    """Two parameters too many; and with crossed parallelograms 15 where 3 are right."""
    assert (apart("adaptive", 0), apart("parallelogram", 0)) == (21, 5)
    assert apart("parallelogram", 2.0) == 15


NEAR = (
    HANDS["parallelogram"]
    .replace("0.035465 0.042039", "0.03546 0.04204")
    .replace("-0.015 0.015", "-0.01501 0.015")
)


@pytest.mark.slow
def test_a_parallelogram_within_rounding_is_meant() -> None:
    """The literal count stands beside the intended one: two different four-bars with one driver."""
    robot = RobotFile.of(NEAR.encode(), "hand.xml").mechanism(ReadingOptions())
    base = ec.base_parameters(robot)
    assert (base.rank, base.reading.literal_rank) == (3, 8)
    assert {snap.element for snap in base.reading.decisive} == {
        f"equality connect '{side}_finger and {side}_inner'"
        for side in ("left", "right")
    }
    assert base.reading.snaps[0].difference == pytest.approx(1e-5)
    robot = RobotFile.of(NEAR.encode(), "hand.xml").mechanism(
        ReadingOptions(snap_tolerance=0)
    )
    assert ec.base_structure(robot).rank == 8
    far = NEAR.replace("-0.01501 0.015", "-0.0155 0.015")
    robot = RobotFile.of(far.encode(), "hand.xml").mechanism(ReadingOptions())
    assert robot.reading is not None
    assert not robot.reading.snaps
