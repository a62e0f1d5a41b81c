"""Designed trajectories of real robots, judged by Pinocchio and MuJoCo at 10 kHz."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest

import echelon as ec
from echelon.excite.excite import ExcitingTrajectory
from support.paths import EXAMPLES
from support.pinocchio_regressor import pinocchio_regressor
from support.resampled_motions import resampled
from support.robot_files import pinocchio_model, robot_file

Floats = npt.NDArray[np.float64]
NEAR = 0.98
"""Share of a limit from which on it counts as used."""


def design(file: Path, *, floating: bool = False, **changes: Any) -> ExcitingTrajectory:
    return ec.exciting_trajectory(
        ec.load_setup(file, floating=floating), **{"starts": 1, **changes}
    )


def torques(model: Any, states: tuple[Floats, ...]) -> Floats:
    data = model.createData()
    return np.array(
        [pin.rnea(model, data, *state) for state in zip(*states, strict=True)]
    )


def places(
    model: Any, joint: str, point: tuple[float, float, float], q: Floats
) -> Floats:
    """A point of the body behind a joint in the base frame, shape (N, 3)."""
    data, k = model.createData(), model.getJointId(joint)
    found = []
    for row in q:
        pin.forwardKinematics(model, data, row)
        found.append(data.oMi[k].act(np.array(point)))
    return np.array(found)


# -- torques and places of an arm --------------------------------------------------------------------------------------

EFFORT = {"shoulder_pan_joint": 40.0, "shoulder_lift_joint": 60.0, "elbow_joint": 30.0}
"""N·m; the file allows 330, 330 and 150."""


@pytest.mark.slow
def test_torques_by_pinocchio_stay_below_limits_that_bind() -> None:
    file = robot_file("ur10_robot")
    limits = {"position": [-2.5, 2.5], "effort": EFFORT}
    found = design(
        file,
        duration=6,
        harmonics=3,
        limits=limits,
        centre={"shoulder_lift_joint": -1.57},
    )
    model = pinocchio_model(file, False)
    assert list(model.names)[1:] == list(found.trajectory.coordinates)
    states = tuple(resampled(found, order) for order in range(3))
    tau = np.abs(torques(model, states)).max(axis=0)
    allowed = 0.9 * np.array(
        [*EFFORT.values(), *model.effortLimit[3:]]
    )  # a tenth is kept free
    assert np.all(tau <= allowed)
    assert (tau / allowed).max() >= NEAR
    assert np.all(np.abs(states[0]) <= 2.5)
    assert np.all(np.abs(states[1]).max(axis=0) <= model.velocityLimit)
    assert (np.abs(states[1]).max(axis=0) / model.velocityLimit).max() >= NEAR
    # without these limits the same design asks for more
    wide = {"position": [-2.5, 2.5], "effort": "none"}
    free = design(
        file,
        duration=6,
        harmonics=3,
        limits=wide,
        centre={"shoulder_lift_joint": -1.57},
    )
    more = np.abs(
        torques(model, tuple(resampled(free, order, 100) for order in range(3)))
    ).max(axis=0)
    assert np.any(more > allowed)


@pytest.mark.slow
def test_boxes_by_pinocchio_hold_a_ball_about_the_flange() -> None:
    file = robot_file("ur10_robot")
    point, radius = (0.05, 0.0, 0.1), 0.1
    box = {"z": [0.3, 1.2], "x": [-0.6, 0.6]}
    found = design(
        file,
        duration=5,
        harmonics=3,
        limits={"position": [-2.5, 2.5]},
        centre={"shoulder_lift_joint": -1.57},
        frames=[
            {"body": "wrist_3_link", "point": list(point), "radius": radius, "box": box}
        ],
    )
    p = places(
        pinocchio_model(file, False), "wrist_3_joint", point, resampled(found, 0)
    )
    room = {
        "x": (p[:, 0].min() - (-0.6 + radius), 0.6 - radius - p[:, 0].max()),
        "z": (p[:, 2].min() - (0.3 + radius), 1.2 - radius - p[:, 2].max()),
    }
    assert min(min(ends) for ends in room.values()) >= 0
    assert min(room["x"]) <= 0.02 * 1.0 or min(room["z"]) <= 0.02 * 0.7
    reached = {m.label[0]: m for m in found.margins if m.unit == "m"}
    for k, axis in enumerate("xyz"):
        if axis in reached:
            assert reached[axis].least <= p[:, k].min() + 1e-12
            assert reached[axis].largest >= p[:, k].max() - 1e-12


@pytest.mark.slow
def test_conditioning_is_that_of_pinocchios_regressor() -> None:
    """Standard parameters by Pinocchio, friction by its formula, and the base by the pivots."""
    file = robot_file("ur10_robot")
    found = design(file, duration=4, iterations=20, limits={"position": [-2.5, 2.5]})
    q, qd, qdd = (resampled(found, order, 100)[:400] for order in range(3))
    rigid = pinocchio_regressor(
        found.base.mechanism, pinocchio_model(file, False), q, qd, qdd
    )
    eye = np.eye(6)
    friction = [
        values[:, :, None] * eye for values in (qd, np.sign(qd), np.ones_like(qd), qdd)
    ]
    W = np.concatenate([rigid, *friction], axis=2)[
        :, :, found.base.matrix.pivots
    ].reshape(2400, -1)
    # a different sign of a speed that is zero up to rounding, at the ends, changes little
    assert found.conditioning.condition == pytest.approx(np.linalg.cond(W), rel=0.01)
    assert found.conditioning.log_det == pytest.approx(
        np.linalg.slogdet(W.T @ W)[1], rel=1e-3
    )


# -- distances by MuJoCo -----------------------------------------------------------------------------------------------

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <worldbody>
    <body name="b1" pos="0 0 0.3">
      <joint name="j1" axis="0 0 1" range="-2.6 2.6"/>
      <geom name="g1" type="capsule" fromto="0 0 0 0 0 0.1" size="0.05" mass="2"/>
      <body name="b2" pos="0 0 0.1">
        <joint name="j2" axis="0 1 0" range="-2.2 2.2"/>
        <geom name="g2" type="capsule" fromto="0 0 0 0.4 0 0" size="0.04" mass="2"/>
        <body name="b3" pos="0.4 0 0">
          <joint name="j3" axis="0 1 0" range="-2.8 2.8"/>
          <geom name="g3" type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="1"/>
          <body name="b4" pos="0.3 0 0">
            <joint name="j4" axis="1 0 0" range="-2 2"/>
            <geom name="g4" type="box" pos="0.05 0 0" size="0.05 0.08 0.02" mass="0.5"/>
          </body>
        </body>
      </body>
    </body>
    <geom name="post" type="box" pos="0.5 0.5 0.4" size="0.08 0.08 0.4"/>
    <geom name="ball" type="sphere" pos="-0.5 -0.4 0.4" size="0.1"/>
    <geom name="floor" type="plane" size="2 2 0.1"/>
  </worldbody>
</mujoco>
"""
PAIRS = [("g4", "g2"), ("g4", "g1"), ("g3", "g1")] + [
    (g, fixed) for fixed in ("post", "ball", "floor") for g in ("g2", "g3", "g4")
]
CLEARANCE = 0.03


@pytest.mark.parametrize(
    ("stated", "rate"),
    [
        pytest.param("by the file", 10_000, marks=pytest.mark.slow),
        pytest.param("by the set-up", 1000, marks=pytest.mark.slow),
    ],
)
def test_distances_by_mujoco_keep_the_clearance(
    tmp_path: Path, stated: str, rate: float
) -> None:
    import mujoco

    file = tmp_path / "arm.xml"
    collisions: dict[str, Any] = {"clearance": CLEARANCE}
    text = ARM
    if stated == "by the set-up":
        text = "\n".join(
            line
            for line in ARM.splitlines()
            if 'name="post"' not in line and 'name="ball"' not in line
        )
        collisions["obstacles"] = [
            {"name": "post", "box": [0.16, 0.16, 0.8], "at": [0.5, 0.5, 0.4]},
            {"name": "ball", "sphere": 0.1, "at": [-0.5, -0.4, 0.4]},
        ]
    file.write_text(text)
    limits = {"velocity": 2.5, "acceleration": 25, "jerk": "none"}
    centre = {"j2": -0.6, "j3": 1.0}
    changes: dict[str, Any] = {
        "limits": limits,
        "centre": centre,
        "collisions": collisions,
    }
    found = design(file, duration=6, harmonics=3, **changes)
    assert found.safe
    assert list(found.trajectory.coordinates) == ["j1", "j2", "j3", "j4"]
    model = mujoco.MjModel.from_xml_string(ARM)
    data, q = mujoco.MjData(model), resampled(found, 0, rate)
    ids = [
        tuple(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in pair)
        for pair in PAIRS
    ]
    least = np.full(len(PAIRS), np.inf)
    for row in q:
        data.qpos[:] = row
        mujoco.mj_kinematics(model, data)
        for k, (a, b) in enumerate(ids):
            least[k] = min(
                least[k], mujoco.mj_geomDistance(model, data, a, b, 2 * CLEARANCE, None)
            )
    assert least.min() >= CLEARANCE - 1e-6  # what MuJoCo's own iterations leave
    assert least.min() <= CLEARANCE * 1.1  # a limit in metres that is used
    bound = min(m.least for m in found.margins if m.unit == "m")
    assert bound <= least.min() + 1e-6


def test_the_first_link_is_kept_off_obstacles(tmp_path: Path) -> None:
    text = """
echelon: 1
name: sweeping
gravity: [0, -9.81, 0]
modified_dh: [{joint: revolute}]
excitation:
  duration: 5
  harmonics: 5
  limits: {position: [-2, 2], velocity: 2}
  collisions:
    shapes: [{body: j1, capsule: 0.05, from: [0, 0, 0], to: [0.6, 0, 0]}]
    obstacles: [{name: post, sphere: 0.1, at: [0.45, 0.3, 0]}]
"""
    (tmp_path / "sweeping.yaml").write_text(text)
    found = design(tmp_path / "sweeping.yaml", iterations=100)
    angle = resampled(found, 0, 1000)[:, 0]
    tip = 0.6 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    post = np.array([0.45, 0.3])
    along = np.clip(tip @ post / 0.36, 0, 1)
    least = np.linalg.norm(along[:, None] * tip - post, axis=1).min() - 0.05 - 0.1
    assert 0.02 <= least <= 0.025  # the clearance where none is stated


# -- conditioning of known arms ----------------------------------------------------------------------------------------

UR10: dict[str, Any] = {
    "duration": 8,
    "criterion": "condition",
    "limits": {
        "position": [-2.5, 2.5],
        "velocity": dict(
            zip(
                [f"j{k}" for k in range(1, 7)],
                (2.16, 2.16, 3.15, 3.2, 3.2, 3.2),
                strict=True,
            )
        ),
        "acceleration": "none",
        "jerk": "none",
    },
}
LOW = (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
HIGH = (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
SPEED = (2.175,) * 4 + (2.61,) * 3


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_ur10_reaches_condition_10_from_every_seed(seed: int) -> None:
    """Six harmonics, one start; with five nine of the ten seeds do."""
    found = design(EXAMPLES / "ur10.yaml", seed=seed, harmonics=6, **UR10)
    assert found.safe
    assert found.base.rank == 36
    q, qd, qdd = (resampled(found, order, 100)[:800] for order in range(3))
    W = found.base.regressor(q, qd, qdd).reshape(-1, 36)
    assert np.linalg.cond(W) <= 10
    assert found.conditioning.condition == pytest.approx(np.linalg.cond(W), rel=1e-6)
    speeds = np.abs(resampled(found, 1)).max(axis=0) / list(
        UR10["limits"]["velocity"].values()
    )
    assert speeds.max() <= 1
    assert np.sum(speeds >= NEAR) >= 3


@pytest.mark.slow
def test_panda_reaches_condition_9_5_with_five_harmonics() -> None:
    names = [f"j{k}" for k in range(1, 8)]
    limits = {
        "position": {
            name: list(ends) for name, *ends in zip(names, LOW, HIGH, strict=True)
        },
        "velocity": dict(zip(names, SPEED, strict=True)),
        "acceleration": "none",
        "jerk": "none",
    }
    found = design(
        EXAMPLES / "panda.yaml",
        duration=8,
        criterion="condition",
        harmonics=5,
        limits=limits,
    )
    assert found.safe
    q, qd, qdd = (resampled(found, order, 100)[:800] for order in range(3))
    assert np.linalg.cond(found.base.regressor(q, qd, qdd).reshape(-1, 43)) <= 9.5
    dense = resampled(found, 0)
    assert np.all((dense >= LOW) & (dense <= HIGH))
    assert np.all(np.abs(resampled(found, 1)).max(axis=0) <= SPEED)


@pytest.mark.slow
def test_tx40_with_its_coupled_wrist() -> None:
    """Motor 6 turns 32 times the sum of both last joints; friction and rotors of all are seen."""
    limits = {"position": [-2, 2], "velocity": {"all": 2, "m6": 60}}
    found = design(EXAMPLES / "tx40.yaml", duration=6, limits=limits)
    assert found.safe
    assert found.base.rank == 61
    motor = 32 * np.abs(resampled(found, 1) @ [0, 0, 0, 0, 1, 1]).max()
    assert NEAR * 60 <= motor <= 60
    assert np.abs(resampled(found, 1)).max() <= 2
    assert np.isfinite(found.conditioning.condition)
    assert np.all(np.isfinite(found.conditioning.std))


# -- robots with many joints -------------------------------------------------------------------------------------------


@cache
def fixed_model(file: Path, moving: tuple[str, ...]) -> Any:
    """Pinocchio's model with a fixed base and all other joints locked at zero."""
    whole = pinocchio_model(file, False)
    others = [
        whole.getJointId(name) for name in list(whole.names)[1:] if name not in moving
    ]
    return pin.buildReducedModel(whole, others, pin.neutral(whole))


def inertial_rank(model: Any, file: Path) -> int:
    """Number of base parameters of bodies and of rotors, which drives with a transmission have, by random states.

    A column of rounding errors counts as zero.
    """
    rng, data = np.random.default_rng(4), model.createData()
    states = rng.uniform(-1.5, 1.5, size=(60, 3, model.nv))
    geared = {
        joint.get("name")
        for joint in ElementTree.parse(file).findall("transmission/joint")
    }
    rotors = [k for k, name in enumerate(list(model.names)[1:]) if name in geared]
    W = np.concatenate(
        [
            np.hstack(
                [
                    pin.computeJointTorqueRegressor(model, data, *state),
                    np.diag(state[2])[:, rotors],
                ]
            )
            for state in states
        ]
    )
    sizes = np.linalg.norm(W, axis=0)
    values = np.linalg.svd(
        W / np.maximum(sizes, 1e-3 * np.median(sizes)), compute_uv=False
    )
    return int(np.sum(values > 1e-9 * values[0]))


def check_by_pinocchio(
    file: Path, found: ExcitingTrajectory, rate: float
) -> list[float]:
    """Shares of the limits of positions, speeds and torques that are used, after the base parameters are counted."""
    names = found.trajectory.coordinates
    model = fixed_model(file, names)
    order = [list(model.names).index(name) - 1 for name in names]
    assert found.base.rank == inertial_rank(model, file) + 3 * len(
        names
    )  # viscous and dry friction, and an offset
    states = []
    for k in range(3):
        values = np.empty((round(found.trajectory.duration * rate) + 1, len(names)))
        values[:, order] = resampled(found, k, rate)
        states.append(values)
    low, high = model.lowerPositionLimit, model.upperPositionLimit
    middle, half = (low + high) / 2, (high - low) / 2
    used = [
        np.abs((states[0] - middle) / half).max(),
        (np.abs(states[1]) / model.velocityLimit).max(),
        (np.abs(torques(model, tuple(states))) / (0.9 * model.effortLimit)).max(),
    ]
    assert max(used) <= 1
    return [float(share) for share in used]


PARTS = ("hip", "thigh", "calf")


@pytest.mark.slow
def test_a_leg_of_a_quadruped_moves_and_its_base_is_held() -> None:
    file, leg = robot_file("a1"), [f"FR_{part}_joint" for part in PARTS]
    found = design(file, floating=True, duration=6, move=leg)
    assert found.safe
    assert list(found.trajectory.coordinates) == leg
    base = {"base.tx", "base.ty", "base.tz", "base.r"}
    assert set(found.held) == base | {
        f"{end}_{joint}_joint" for end in ("FL", "RR", "RL") for joint in PARTS
    }
    assert max(check_by_pinocchio(file, found, 10_000)) >= NEAR


@pytest.mark.slow
def test_the_upper_body_of_talos() -> None:
    """18 joints of the torso, both arms and the head."""
    file = robot_file("talos_full_v2")
    setup = ec.load_setup(file)
    moving = [
        name
        for name in setup.mechanism.velocities
        if name.startswith(("torso", "arm", "head"))
    ]
    assert len(moving) == 18
    found = ec.exciting_trajectory(setup, starts=1, move=moving)
    assert found.safe
    assert (
        max(check_by_pinocchio(file, found, 2000)) >= NEAR
    )  # which limits bind depends on the local optimum


# -- the example -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_example_of_a_ur10_between_a_table_and_a_wall() -> None:
    found = design(EXAMPLES / "excite/ur10.yaml", starts=2)
    assert found.safe
    assert found.base.rank == 36 + 12
    velocity = np.abs(resampled(found, 1)).max(axis=0)
    allowed = np.array([2 * np.pi / 3] * 2 + [np.pi] * 4)
    assert np.all(velocity <= allowed)
    assert (velocity / allowed).max() >= NEAR
    q = resampled(found, 0)
    assert np.all((q[:, 1] >= -np.pi) & (q[:, 1] <= 0))
    assert np.abs(q[:, 2]).max() <= 2.5
    assert np.abs(resampled(found, 2)).max() <= 15
    assert np.abs(resampled(found, 3)).max() <= 200
    # the flange by standard DH matrices: a ball of 0.1 m about it stays above the table
    d, a = (0.1273, 0, 0, 0.163941, 0.1157, 0.0922), (0, -0.612, -0.5723, 0, 0, 0)
    twist = np.array([np.pi / 2, 0, 0, np.pi / 2, -np.pi / 2, 0])
    T = np.tile(np.eye(4), (len(q), 1, 1))
    for k in range(6):
        c, s, ca, sa = (
            np.cos(q[:, k]),
            np.sin(q[:, k]),
            np.cos(twist[k]),
            np.sin(twist[k]),
        )
        one, zero = np.ones_like(c), np.zeros_like(c)
        rows = [
            [c, -s * ca, s * sa, a[k] * c],
            [s, c * ca, -c * sa, a[k] * s],
            [zero, sa * one, ca * one, d[k] * one],
            [zero, zero, zero, one],
        ]
        T = T @ np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    assert T[:, 2, 3].min() >= 0.1
