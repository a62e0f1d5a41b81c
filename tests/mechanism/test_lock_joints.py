"""Held coordinates against an independent reading: Pinocchio's reduced models, and the whole robot standing still."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.dynamics.kinematics import Kinematics
from echelon.robot.locking import lock_joints
from echelon.robot.mechanism import Mechanism
from echelon.shared.errors import InputError
from support.excitation_cases import Floats
from support.float_regressor import float_regressor, random_states
from support.paths import EXAMPLES
from support.pinocchio_regressor import ORDER, pinocchio_regressor
from support.robot_files import pinocchio_model, robot_file

TURNED = 3e-8
"""Held angles are next to those that are asked for."""

HELD = [
    ("ur10_robot", ("shoulder_pan_joint",)),
    ("ur10_robot", ("elbow_joint", "wrist_3_joint")),
    ("panda", ("panda_joint2", "panda_joint4", "panda_joint6")),
    ("panda", ("panda_joint7", "panda_finger_joint1", "panda_finger_joint2")),
    ("xarm7", ("joint1", "joint3", "joint5")),
    ("solo12", ("FL_HFE", "HR_KFE")),
    (
        "talos_full_v2",
        ("leg_left_1_joint", "arm_right_3_joint", "torso_1_joint", "head_2_joint"),
    ),
]


@cache
def loaded(name: str, floating: bool = False) -> Mechanism:
    return ec.load(
        robot_file(name), floating=floating, snap_tolerance=0, independent_mimics=True
    )


def reduced(model: Any, positions: dict[str, float]) -> Any:
    """Pinocchio's model with joints locked."""
    q = pin.neutral(model)
    for name, angle in positions.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = (
            (np.cos(angle), np.sin(angle)) if joint.nq == 2 else angle
        )
    return pin.buildReducedModel(
        model, [model.getJointId(name) for name in positions], q
    )


def random_model(name: str, seed: int) -> tuple[Any, Floats]:
    """Pinocchio's model with random inertias, and these in our order of bodies and parameters."""
    model, mechanism = pinocchio_model(robot_file(name), False).copy(), loaded(name)
    pin.seed(seed)
    for joint in range(1, model.njoints):
        model.inertias[joint] = pin.Inertia.Random()
    joints = [
        model.getJointId(body.joint.name) for body in mechanism.bodies if body.carried
    ]
    return model, np.concatenate(
        [model.inertias[j].toDynamicParameters()[ORDER] for j in joints]
    )


def chosen(names: tuple[str, ...], seed: int) -> dict[str, float]:
    return dict(
        zip(
            names,
            np.random.default_rng(seed).uniform(-1.5, 1.5, len(names)).tolist(),
            strict=True,
        )
    )


# -- single joints -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "names"), HELD, ids=lambda v: v if isinstance(v, str) else "+".join(v)
)
def test_remaining_joints_are_those_of_the_reduced_model(
    name: str, names: tuple[str, ...]
) -> None:
    """Torques of random inertias: what is held rides on as a part of the links before it."""
    positions = chosen(names, 3)
    model, zeta = random_model(name, 3)
    truth, ours = reduced(model, positions), lock_joints(loaded(name), positions)
    assert set(ours.velocities) == {
        n for n in loaded(name).velocities if n not in names
    }
    q, qd, qdd = random_states(ours, 4)
    found = float_regressor(ours, q, qd, qdd) @ zeta
    data = truth.createData()
    for k in range(4):
        full = pin.neutral(truth)
        rates = np.zeros((2, truth.nv))
        places = []
        for column, joint in enumerate(ours.velocities):
            at = truth.joints[truth.getJointId(joint)]
            angle = q[k, column]
            full[at.idx_q : at.idx_q + at.nq] = (
                (np.cos(angle), np.sin(angle)) if at.nq == 2 else angle
            )
            rates[:, at.idx_v] = qd[k, column], qdd[k, column]
            places.append(at.idx_v)
        expected = pin.rnea(truth, data, full, *rates)[places]
        np.testing.assert_allclose(
            found[k], expected, atol=100 * TURNED * np.abs(expected).max()
        )


@pytest.mark.parametrize(
    "angle",
    [1e-4, 4.9e-5, -0.0003, 0.7853, 2 * np.arctan(0.50005), np.pi, -np.pi, 3.1, 40.0],
)
def test_held_angles_are_those_asked_for(angle: float) -> None:
    arm = lock_joints(ec.load(EXAMPLES / "double_pendulum.yaml"), {"j1": angle})
    turn = Kinematics(arm).frames(np.zeros((1, 1)))[0, 0, :, :3]
    expected = [
        [np.cos(angle), -np.sin(angle), 0],
        [np.sin(angle), np.cos(angle), 0],
        [0, 0, 1],
    ]
    np.testing.assert_allclose(turn, expected, atol=TURNED)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-15)


def test_zero_is_exact() -> None:
    arm = lock_joints(ec.load(EXAMPLES / "double_pendulum.yaml"), {"j1": 0})
    np.testing.assert_array_equal(
        Kinematics(arm).frames(np.zeros((1, 1)))[0, 0, :, :3], np.eye(3)
    )
    assert lock_joints(arm, {}) is arm


@pytest.mark.parametrize("name", ["scara", "cart_pole", "puma560"])
def test_slides_and_screws_stay_where_they_are(name: str) -> None:
    """Frames are those of the whole robot at the locked positions."""
    whole = ec.load(EXAMPLES / f"{name}.yaml")
    q = np.random.default_rng(0).uniform(-1, 1, (3, len(whole.positions)))
    for k, motion in enumerate(whole.positions):
        q[:, k] = 0.37
        part = lock_joints(whole, {motion: 0.37})
        kept = np.delete(q, k, axis=1)
        assert len(part.positions) == len(whole.positions) - 1
        np.testing.assert_allclose(
            Kinematics(part).frames(kept), Kinematics(whole).frames(q), atol=TURNED
        )
        q[:, k] = np.random.default_rng(k).uniform(-1, 1, 3)


# -- ranks -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "names"), HELD[:6], ids=lambda v: v if isinstance(v, str) else "+".join(v)
)
def test_ranks(name: str, names: tuple[str, ...]) -> None:
    """As many base parameters as Pinocchio's regressor of the reduced model has independent columns."""
    positions = chosen(names, 5)
    ours = lock_joints(loaded(name), positions)
    truth = reduced(pinocchio_model(robot_file(name), False), positions)
    carriers = [b for b in ours.bodies if b.joint.motions]
    plain = Mechanism(
        ours.name,
        tuple(_rooted(ours, carriers, body) for body in carriers),
        ours.gravity,
        symbols=ours.symbols,
    )
    X = pinocchio_regressor(plain, truth, *random_states(plain, 200)).reshape(
        -1, 10 * len(carriers)
    )
    values = np.linalg.svd(X, compute_uv=False)
    expected = int(np.sum(values > 1e-10 * values[0]))
    assert values[expected - 1] > 1e-6 * values[0]  # a gap: the rank is certain
    assert ec.base_parameters(ours).rank == expected


def _rooted(mechanism: Mechanism, carriers: list[Any], body: Any) -> Any:
    """The body on the next moving one before it: only names and motions of joints matter."""
    parent = body.parent
    while parent >= 0 and mechanism.bodies[parent] not in carriers:
        parent = mechanism.bodies[parent].parent
    return replace(
        body, parent=-1 if parent < 0 else carriers.index(mechanism.bodies[parent])
    )


# -- floating bases ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a1", "ur10_robot", "panda"])
def test_bases_held_upright_are_fixed_ones(name: str) -> None:
    free, fixed = loaded(name, True), loaded(name)
    base = next(body for body in free.bodies if body.joint.kind == "floating")
    bolted = lock_joints(free, {motion.name: 0.0 for motion in base.joint.motions})
    assert bolted.velocities == fixed.velocities
    state = random_states(fixed, 3)
    ours, theirs = float_regressor(bolted, *state), float_regressor(fixed, *state)
    column = {parameter: k for k, parameter in enumerate(bolted.parameters)}
    offset = len(bolted.bodies) - len(fixed.bodies)
    moving = [body.name for body in fixed.bodies]
    assert [body.name for body in bolted.bodies[offset:]] == moving
    first = len(column) - theirs.shape[2]
    np.testing.assert_array_equal(
        ours[:, :, :first], 0
    )  # what is bolted down is not seen
    np.testing.assert_allclose(
        ours[:, :, first:], theirs, atol=1e-12 * np.abs(theirs).max()
    )
    assert ec.base_parameters(bolted).rank == ec.base_parameters(fixed).rank


# -- drives, effects, outputs, couplings -------------------------------------------------------------------------------

GEARED = """
echelon: 1
name: geared
symbols: {l1: 0.4, l2: 0.3}
gravity: [0, -9.81, 0]
modified_dh:
  - {joint: revolute}
  - {joint: revolute, a: l1}
  - {joint: revolute, a: l2}
"""


def written(text: str) -> Mechanism:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "robot.yaml"
        file.write_text(GEARED + text, encoding="utf-8")
        return ec.load(file)


def compare_at_rest(whole: Mechanism, held_name: str, position: float) -> None:
    """The regressor of what is left is that of the whole robot while the joint stands still."""
    part = lock_joints(whole, {held_name: position})
    k = whole.velocities.index(held_name)
    q, qd, qdd = random_states(whole, 6)
    q[:, k], qd[:, k], qdd[:, k] = position, 0, 0
    kept = [np.delete(x, k, axis=1) for x in (q, qd, qdd)]
    rows = [
        whole.outputs.index(o)
        for o in whole.outputs
        if o.name in {p.name for p in part.outputs}
    ]
    expected = float_regressor(whole, q, qd, qdd)[:, rows]
    names = [whole.parameters.index(p) for p in part.parameters]
    found = float_regressor(part, *kept)
    np.testing.assert_allclose(
        found, expected[:, :, names], atol=100 * TURNED * np.abs(expected).max()
    )
    gone = np.delete(expected, names, axis=2)
    # parameters that are no longer there did nothing where anything is seen
    np.testing.assert_allclose(gone, 0, atol=1e-12)


def test_effects_of_what_is_held_go() -> None:
    whole = written(
        "effects: [{type: viscous, at: all}, {type: coulomb, at: all}, {type: offset, at: all}]\n"
    )
    compare_at_rest(whole, "j2", 0.8)
    part = lock_joints(whole, {"j2": 0.8})
    assert [effect.parameter for effect in part.effects] == [
        "Fv1",
        "Fv3",
        "Fc1",
        "Fc3",
        "Fo1",
        "Fo3",
    ]
    assert [output.name for output in part.outputs] == ["j1", "j3"]


def test_drives_of_their_own() -> None:
    compare_at_rest(
        written("actuators: {m1: 10*j1, m2: 20*j2, m3: 30*j3}\n"), "j3", 0.2
    )


def test_outputs_that_are_seen() -> None:
    whole = written("outputs: [{joint: j1}, {joint: j3}, {wrench: j2}]\n")
    compare_at_rest(whole, "j3", -0.4)
    assert len(lock_joints(whole, {"j3": -0.4}).outputs) == 7


def test_effects_between_what_is_held_and_what_moves() -> None:
    """Friction of the difference of two joints is felt by either."""
    term = '[{at: j1, side: joint, term: "qd[j1] - qd[j2]"}, {at: j2, side: joint, term: "qd[j2] - qd[j1]"}]'
    whole = written(
        f"outputs: [{{joint: all}}]\neffects: [{{parameter: fv12, unit: N·m·s/rad, acts: {term}}}]\n"
    )
    compare_at_rest(whole, "j2", 0.0)


def test_coupled_wrists_with_a_joint_held() -> None:
    """Joint 6 of the TX40 stands still: its motor turns with joint 5."""
    arm = ec.load(EXAMPLES / "tx40.yaml")
    with pytest.raises(
        ec.InputError,
        match=r"m5, m6 would drive j1, .* hold all joints that are coupled",
    ):
        lock_joints(arm, {"j6": 0.0})
    assert ec.base_parameters(lock_joints(arm, {"j5": 0.0, "j6": 0.0})).rank > 0


def test_coupled_coordinates_follow() -> None:
    whole = ec.load(EXAMPLES / "gripper_coupled.yaml")
    part = lock_joints(whole, {"left": 0.02})
    assert not part.couplings
    q = np.random.default_rng(0).uniform(-1, 1, (4, 2))
    expected = Kinematics(whole).frames(np.column_stack([q, np.full(4, 0.02)]))
    np.testing.assert_allclose(Kinematics(part).frames(q), expected, atol=1e-15)
    names = [body.name for body in part.bodies]
    apart = (
        expected[:, names.index("left_finger"), :, 3]
        - expected[:, names.index("right_finger"), :, 3]
    )
    np.testing.assert_allclose(np.linalg.norm(apart, axis=1), 0.04, atol=1e-15)


def test_what_cannot_be_held() -> None:
    gripper = ec.load(EXAMPLES / "gripper_coupled.yaml")
    with pytest.raises(InputError, match="'right' follows left; hold these instead"):
        lock_joints(gripper, {"right": 0.01})
    with pytest.raises(InputError, match=r"no coordinate 'lft' to hold.*left"):
        lock_joints(gripper, {"lft": 0.0})
    tree = ec.load(EXAMPLES / "floating_tree.yaml")
    ball = next(motion for motion in tree.motions if len(motion.positions) == 4)
    with pytest.raises(
        InputError, match=f"'{ball.name}' turns freely; it can be held at 0 only"
    ):
        lock_joints(tree, {ball.name: 0.3})
    loop = ec.load(next((EXAMPLES / "loops").glob("*.yaml")))
    with pytest.raises(InputError, match="with loops cannot be locked"):
        lock_joints(loop, {loop.velocities[0]: 0.0})


def test_couplings_are_held_whole_or_not() -> None:
    sums = written("couplings: [{j3: j1 + j2}]\n")
    with pytest.raises(
        InputError, match="'j3' follows j1, j2: hold all of them or none"
    ):
        lock_joints(sums, {"j1": 0.1})
    both = lock_joints(sums, {"j1": 0.1, "j2": 0.2})
    assert both.velocities == ()
    q = np.array([[0.1, 0.2]])
    np.testing.assert_allclose(
        Kinematics(both).frames(np.zeros((1, 0))),
        Kinematics(sums).frames(q),
        atol=6 * TURNED,
    )
    geared = written("couplings: [{j3: l1*j1}]\n")
    with pytest.raises(InputError, match="the coupling of 'j3' has symbols"):
        lock_joints(geared, {"j1": 0.1})
