"""Equality constraints of MJCF as they are read, against the constraint Jacobian of MuJoCo at random closed states."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.loops.closed_motion import ClosureValues
from echelon.robot.mechanism import Mechanism
from echelon.robot.stated import known_values
from support.mjcf_models import INERTIA, model, random_model
from support.mujoco_loops import Array, Equalities, null_space
from support.selection import one_in, slow_unless

_DIGITS = 1e-9


@pytest.fixture
def unclosed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Constraints are read; whether the program finds its own way to close them is not asked."""
    monkeypatch.setattr("echelon.loops.close", lambda mechanism, *_, **__: mechanism)


def read(text: str) -> Mechanism:
    return RobotFile.of(text.encode(), "robot.xml").mechanism(
        ReadingOptions(snap_tolerance=0)
    )


def coordinates(model: Any) -> tuple[list[str], list[str]]:
    """The package's names of MuJoCo's positions and velocities."""
    positions, velocities = [], []
    for k in range(model.njnt):
        name, count = model.joint(k).name, len(model.joint(k).qpos0)
        ball = {1: "", 4: name, 7: f"{name}.r"}[count]
        moved = (
            [f"{name}.t{c}" for c in "xyz"] if count == 7 else [] if ball else [name]
        )
        positions += moved + [f"{ball}.{c}" for c in "wxyz" if ball]
        velocities += moved + [f"{ball}.{c}" for c in "xyz" if ball]
    return positions, velocities


def allowed(mechanism: Mechanism, model: Any, q: Array) -> tuple[Array, Array]:
    """Closure errors, and a basis of the motions that closures, couplings and held joints allow."""
    positions, velocities = coordinates(model)
    at = dict(zip(positions, q, strict=True))
    place = {name: k for k, name in enumerate(mechanism.velocities)}
    followed = np.zeros((len(velocities), len(place)))
    for row, name in enumerate(velocities):
        if name in place:
            followed[row, place[name]] = 1.0
    for coupling in mechanism.couplings:
        for name, function in coupling.terms:
            slope = function.floats(at[name], known_values(mechanism))[1]
            followed[velocities.index(coupling.coordinate), place[name]] += slope
    if not mechanism.closures:
        return np.zeros(0), np.linalg.qr(followed)[0]
    closures = ClosureValues(mechanism)
    values, jacobian = closures.at(
        np.array([[at[name] for name in mechanism.positions]])
    )
    free = null_space(jacobian[0][:, : len(place)] / closures.units[: len(place)])
    return values[0], np.linalg.qr(followed @ free)[0]


def check(text: str, seed: int) -> None:
    equalities = Equalities(text)
    agree(
        read(text),
        equalities,
        equalities.closed(equalities.model.qpos0),
        np.random.default_rng(seed),
    )


def agree(
    mechanism: Mechanism,
    equalities: Equalities,
    q: Array,
    rng: np.random.Generator,
    states: int = 2,
) -> int:
    """Equal motions are allowed at random closed states; returns the number of their directions."""
    freedoms = 0
    assert np.abs(equalities.at(q)[0]).max(initial=0.0) < _DIGITS
    for _ in range(states):
        q = equalities.walk(rng, 5, q)
        values, jacobian = equalities.at(q)
        assert np.abs(values).max(initial=0.0) < _DIGITS
        expected = null_space(jacobian)
        opening, found = allowed(mechanism, equalities.model, q)
        assert np.abs(opening).max(initial=0.0) < _DIGITS
        assert found.shape == expected.shape
        np.testing.assert_allclose(found @ found.T, expected @ expected.T, atol=1e-7)
        freedoms = found.shape[1]
    return freedoms


UNCLOSED = {2, 7, 8, 9, 12, 13, 15, 16, 17, 18, 21, 25, 26, 33, 38}
"""Seeds of models with more constraints than they have freedoms."""


@pytest.mark.usefixtures("unclosed")
@pytest.mark.parametrize(
    "seed", slow_unless(range(12), sorted(set(range(40)) - UNCLOSED))
)
def test_loops_allow_the_motions_that_mujoco_allows(seed: int) -> None:
    check(random_model(seed, loops=True), seed)


@pytest.mark.usefixtures("unclosed")
@pytest.mark.parametrize("seed", one_in(3, range(25)))
def test_couplings_allow_the_motions_that_mujoco_allows(seed: int) -> None:
    check(random_model(seed, loops=False), seed)


# -- couplings in loops that are closed away from the reference pose ---------------------------------------------------

ARM = f"""<body name="b0"><joint name="j0"/>{INERTIA}
    <body name="b1" pos="0.4 0 0"><joint name="j1" ref="0.2"/>{INERTIA}
      <body name="b2" pos="0.35 0.05 0"><joint name="j2"/>{INERTIA}
        <site name="tip" pos="0.28 0 0"/></body></body></body>
  <body name="b3" pos="0.6 0.1 0"><joint name="j3" type="slide" axis="1 0 0" ref="-0.1"/>{INERTIA}
    <body name="b4"><joint name="j4"/>{INERTIA}
      <site name="pin" pos="-0.1401 0.5825 0" euler="0 0 1.4"/></body></body>"""
TENDONS = """<tendon><fixed name="sum"><joint joint="j1" coef="1"/><joint joint="j2" coef="-0.5"/></fixed>
  <fixed name="one"><joint joint="j0" coef="1.2"/></fixed></tendon>"""
HOME = (0.5, 0.4, 0.3, -0.06, -0.4)
COUPLED = {
    "a decimal ratio": '<joint joint1="j1" joint2="j0" polycoef="0.6445 -0.889 0 0 0"/>',
    "a ratio of nine digits": '<joint joint1="j2" joint2="j0" polycoef="-0.22926 1.05851325 0 0 0"/>',
    "a rack": '<joint joint1="j3" joint2="j0" polycoef="0.014 0.052 0 0 0"/>',
    "a tendon": '<tendon tendon1="sum" tendon2="one" polycoef="-0.4 0.75 0 0 0"/>',
}


@pytest.mark.parametrize("name", slow_unless(["a rack"], COUPLED))
def test_couplings_act_away_from_the_reference_pose(name: str, tmp_path: Path) -> None:
    head = '<compiler angle="radian"/><default><joint axis="0 0 1"/></default>'
    home = f'<keyframe><key name="home" qpos="{" ".join(map(str, HOME))}"/></keyframe>'
    text = model(
        ARM,
        head,
        f'{TENDONS}<equality><weld site1="tip" site2="pin"/>{COUPLED[name]}</equality>{home}',
    )
    equalities, rng = Equalities(text), np.random.default_rng(1)
    q = equalities.closed(np.array(HOME))
    mechanism = loaded(text, tmp_path)
    assert agree(mechanism, equalities, q, rng) == 1
    rank = ec.base_structure(mechanism).rank
    singular = equalities.singular_values(rng, q, 80)
    assert singular[rank - 1] > 1e3 * singular[rank]
    tilted = loaded(text.replace('euler="0 0 1.4"', 'euler="2e-5 0 1.4"'), tmp_path)
    assert (
        tilted.closures != mechanism.closures
    )  # frames are moved, because the rounded ones lock the loop
    assert ec.base_structure(tilted).rank == rank


def loaded(text: str, folder: Path) -> Mechanism:
    (folder / "arm.xml").write_text(text)
    return ec.load(folder / "arm.xml")
