"""Frames of bodies against Pinocchio's forward kinematics, and their derivatives against differences."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import echelon as ec
from echelon.dynamics.kinematics import Kinematics
from echelon.robot.joint import GROUND
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.excitation_cases import Floats, slopes_by_state
from support.float_regressor import random_states
from support.paths import EXAMPLES
from support.random_mechanisms import mechanisms
from support.robot_files import pinocchio_model, pinocchio_state, robot_file
from support.selection import examples
from support.textbook_poses import pose_of

ROBOTS = [
    ("ur10_robot", False),
    ("panda", False),
    ("xarm7", False),
    ("z1", False),
    ("talos_full_v2", True),
    ("a1", True),
]


@cache
def loaded(name: str, floating: bool) -> Mechanism:
    return ec.load(
        robot_file(name), floating=floating, snap_tolerance=0, independent_mimics=True
    )


@pytest.mark.parametrize(("name", "floating"), ROBOTS)
def test_frames_are_pinocchios(name: str, floating: bool) -> None:
    import pinocchio as pin

    mechanism, model = (
        loaded(name, floating),
        pinocchio_model(robot_file(name), floating),
    )
    q, qd, qdd = random_states(mechanism, 5)
    found = Kinematics(mechanism).frames(q)
    assert found.shape == (5, len(mechanism.bodies), 3, 4)
    data = model.createData()
    for k in range(5):
        pin.forwardKinematics(
            model, data, pinocchio_state(mechanism, model, q[k], qd[k], qdd[k]).q
        )
        seen = 0
        for index, body in enumerate(mechanism.bodies):
            joint = "root_joint" if body.joint.kind == "floating" else body.joint.name
            if not body.joint.motions:
                continue
            theirs = data.oMi[model.getJointId(joint)]
            np.testing.assert_allclose(
                found[k, index, :, :3], theirs.rotation, atol=1e-13
            )
            np.testing.assert_allclose(
                found[k, index, :, 3], theirs.translation, atol=1e-12
            )
            seen += 1
        assert seen == model.njoints - 1


def by_hand(mechanism: Mechanism, q: Floats) -> Floats:
    """Products of textbook matrices from the base outwards."""
    position = dict(zip(mechanism.positions, q.tolist(), strict=True))
    known = {
        name: s.value for name, s in mechanism.symbols.items() if s.value is not None
    }
    for coupling in mechanism.couplings:
        position[coupling.coordinate] = sum(
            f.floats(position[n], known)[0] for n, f in coupling.terms
        )
    poses: list[Floats] = []
    for index, body in enumerate(mechanism.bodies):
        before = np.eye(4) if body.parent == GROUND else poses[body.parent]
        poses.append(before @ pose_of(mechanism, index, position))
    return np.array(poses)[:, :3]


@examples(10)
@given(mechanisms(), st.integers(0, 2**32 - 1))
def test_frames_of_random_trees(mechanism: Mechanism, seed: int) -> None:
    q, _, _ = random_states(mechanism, 2, seed)
    if not mechanism.positions:
        return
    found = Kinematics(mechanism).frames(q)
    for k in range(2):
        np.testing.assert_allclose(found[k], by_hand(mechanism, q[k]), atol=1e-12)


@pytest.mark.parametrize(
    "name", ["ur10", "scara", "cart_pole", "gripper_coupled", "floating_tree"]
)
def test_slopes(name: str) -> None:
    mechanism = ec.load(EXAMPLES / f"{name}.yaml")
    arm, state = Kinematics(mechanism), {"q": random_states(mechanism, 3)[0]}
    found = arm.slopes(state["q"])
    assert found.shape == (3, len(mechanism.bodies), 3, 4, len(mechanism.positions))
    np.testing.assert_allclose(
        found, slopes_by_state(arm.frames, state, "q"), atol=1e-10
    )
    assert np.abs(found).max() > 0.1


@pytest.mark.parametrize("name", ["panda", "z1"])
def test_slopes_of_files(name: str) -> None:
    arm = Kinematics(loaded(name, False))
    state = {"q": random_states(arm.mechanism, 2)[0]}
    np.testing.assert_allclose(
        arm.slopes(state["q"]), slopes_by_state(arm.frames, state, "q"), atol=1e-10
    )


def test_rotations_turn() -> None:
    arm = Kinematics(ec.load(EXAMPLES / "panda.yaml"))
    found = arm.frames(random_states(arm.mechanism, 50)[0])[..., :3]
    np.testing.assert_allclose(
        np.einsum("nbij,nbkj->nbik", found, found),
        np.eye(3) + np.zeros_like(found),
        atol=1e-14,
    )
    np.testing.assert_allclose(np.linalg.det(found), 1, atol=1e-13)


def test_symbols_can_be_given() -> None:
    open_length = ec.load(EXAMPLES / "stanford.yaml")
    q = random_states(open_length, 3)[0]
    with pytest.raises(InputError, match="d2"):
        Kinematics(open_length).frames(q)
    short, long = (Kinematics(open_length, {"d2": d}).frames(q) for d in (0.1, 0.3))
    # the arm is shifted along the second axis by the difference
    along = short[:, 1, :, 2]
    np.testing.assert_allclose(
        long[:, 1:, :, 3] - short[:, 1:, :, 3],
        0.2 * along[:, None] + 0 * long[:, 1:, :, 3],
        atol=1e-14,
    )
    np.testing.assert_allclose(long[..., :3], short[..., :3], atol=1e-15)
