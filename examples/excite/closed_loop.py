"""The loop closed: derive, excite, run in MuJoCo, identify.

python examples/excite/closed_loop.py

A robot file states an arm of six joints as its maker thinks it is.  The arm that MuJoCo simulates has other masses, it
has friction, and its joints cog, which no model here says.  A trajectory is designed for the first and run by the
second.  Two others, within the same limits and as long, are run to compare.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.excite.problem.trajectory import Fourier

Floats = npt.NDArray[np.float64]

PERIOD, RATE = 8.0, 200.0
NOISE = np.array([0.5, 0.5, 0.5, 0.1, 0.1, 0.05])  # of the torques, N·m
POSITION, ACCELERATION = 2.0, 15.0
VELOCITY = np.array([2.0, 2.0, 2.0, 3.0, 3.0, 3.0])
EFFORT = np.array([90.0, 110.0, 60.0, 20.0, 15.0, 10.0])
VISCOUS = np.array([1.5, 2.0, 1.0, 0.3, 0.2, 0.1])
COULOMB = np.array([1.2, 2.0, 0.8, 0.2, 0.15, 0.1])
COGGING = 0.2  # amplitude of a torque that comes and goes 20 times a turn, as a share of the dry friction
JOINTS = [f"j{k}" for k in range(1, 7)]

# place in the parent, axis, mass, centre of mass, moments of inertia
BODIES = [
    ((0, 0, 0.3), (0, 0, 1), 4.0, (0.02, 0, 0.05), (0.03, 0.04, 0.03)),
    ((0.05, 0.05, 0.1), (0, 1, 0), 3.5, (0.02, 0.01, 0.2), (0.06, 0.07, 0.02)),
    ((0, 0, 0.4), (0, 1, 0), 2.0, (0.1, -0.01, 0.03), (0.01, 0.03, 0.03)),
    ((0.15, 0, 0.05), (1, 0, 0), 1.2, (0.08, 0.01, 0), (0.004, 0.008, 0.007)),
    ((0.2, 0, 0), (0, 1, 0), 0.8, (0.04, 0.01, 0.02), (0.003, 0.004, 0.003)),
    ((0.1, 0, 0), (1, 0, 0), 0.6, (0.05, 0.02, -0.01), (0.002, 0.003, 0.003)),
]

SETUP = f"""
echelon: 1
name: arm
robot: {{file: arm.xml}}
effects: [{{type: viscous, at: all}}, {{type: coulomb, at: all}}]
log: {{time: time, position: "q_{{n}}", output: "tau_{{n}}"}}
preparation: {{delays: {{{", ".join(f"{name}: 0" for name in JOINTS)}}}}}
excitation:
  duration: {PERIOD}
  rate: {RATE}
  noise: {dict(zip(JOINTS, NOISE.tolist(), strict=True))}
  limits:
    position: [-{POSITION}, {POSITION}]
    velocity: {dict(zip(JOINTS, VELOCITY.tolist(), strict=True))}
    acceleration: {ACCELERATION}
    jerk: none
    effort: {dict(zip(JOINTS, EFFORT.tolist(), strict=True))}
"""


def mjcf(real: bool) -> str:
    """The arm as its maker thinks it is, or as it is."""
    rng, opened = np.random.default_rng(7), ""
    for name, (at, axis, mass, centre, inertia), viscous, coulomb in zip(
        JOINTS, BODIES, VISCOUS, COULOMB, strict=True
    ):
        friction = (
            f'damping="{viscous}" frictionloss="{coulomb}" solreffriction="0.001 1"'
            if real
            else ""
        )
        factors = rng.uniform(0.8, 1.2, 7) if real else np.ones(7)
        m, c, moments = mass * factors[0], centre * factors[1:4], inertia * factors[4:]
        opened += (
            f'<body name="{name}" pos="{text(at)}"><joint name="{name}" axis="{text(axis)}" {friction}/>'
            f'<inertial mass="{m}" pos="{text(c)}" diaginertia="{text(moments)}"/>'
        )
    motors = "".join(f'<motor joint="{name}"/>' for name in JOINTS)
    option = '<option timestep="0.0005" integrator="RK4" tolerance="1e-14" iterations="200"/>'
    bodies = opened + "</body>" * len(JOINTS)
    return f"<mujoco>{option}<worldbody>{bodies}</worldbody><actuator>{motors}</actuator></mujoco>"


def text(values: npt.ArrayLike) -> str:
    """Numbers as MJCF has them."""
    return " ".join(f"{value:.12g}" for value in np.ravel(values))


def run(trajectory: ec.Trajectory, path: Path, noise: int | None) -> Path:
    """Let the real arm follow a trajectory, and write the log, with noise if there is a seed of it."""
    real, maker = (mujoco.MjModel.from_xml_string(mjcf(real)) for real in (True, False))
    state, model, step = mujoco.MjData(real), mujoco.MjData(maker), real.opt.timestep
    q, qd, qdd = trajectory.states(np.arange(2 * round(PERIOD / step) + 1) * step / 2)

    def control(_: object, now: mujoco.MjData) -> None:
        k = round(2 * now.time / step)
        model.qpos[:], model.qvel[:], model.qacc[:] = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(maker, model)  # computed torque, by what the maker says
        now.ctrl[:] = model.qfrc_inverse + EFFORT * (
            5 * (q[k] - now.qpos) + 0.3 * (qd[k] - now.qvel)
        )
        now.qfrc_applied[:] = COGGING * COULOMB * np.sin(20 * now.qpos)

    state.qpos[:], state.qvel[:] = q[0], qd[0]
    rows = []
    mujoco.set_mjcb_control(control)
    for k in range(round(PERIOD / step)):
        if k % round(1 / RATE / step) == 0:
            mujoco.mj_forward(real, state)
            rows.append([state.time, *state.qpos, *state.ctrl])
        mujoco.mj_step(real, state)
    mujoco.set_mjcb_control(None)
    log = np.array(rows)
    if noise is not None:
        rng = np.random.default_rng(noise)
        log[:, 1:] += np.append(np.full(6, 1e-6), NOISE) * rng.standard_normal(
            (len(log), 12)
        )
    names = [
        "time",
        *(f"q_{k}" for k in range(1, 7)),
        *(f"tau_{k}" for k in range(1, 7)),
    ]
    np.savetxt(path, log, delimiter=",", header=",".join(names), comments="")
    return path


def within_limits(coefficients: Floats) -> ec.Trajectory:
    """A Fourier series of the period, each joint as large as its limits let it be."""
    basis = Fourier(PERIOD, (len(coefficients) - 1) // 2)
    t = np.linspace(0, PERIOD, 2000)
    limits = POSITION, VELOCITY, ACCELERATION
    reached = [
        np.abs(basis.motion(t, coefficients, order)).max(axis=0) / limits[order]
        for order in range(3)
    ]
    scaled = 0.98 * coefficients / np.max(reached, axis=0)
    return ec.Trajectory(tuple(JOINTS), ("rad",) * 6, basis, scaled)


def random_motion(seed: int) -> ec.Trajectory:
    """Five harmonics at random."""
    return within_limits(
        np.vstack([np.zeros(6), np.random.default_rng(seed).normal(size=(10, 6))])
    )


def sines() -> ec.Trajectory:
    """Each joint at a frequency of its own, the slowest for the largest."""
    return within_limits(np.vstack([np.zeros(6), np.kron(np.eye(6), [[1.0], [0.0]])]))


def true_values(base: ec.BaseModel, folder: Path) -> Floats:
    """Base parameters of the real arm."""
    (folder / "real.xml").write_text(mjcf(True))
    bodies = ec.load(folder / "real.xml").standard_values()[:60]
    return base.values([*(value or 0.0 for value in bodies), *VISCOUS, *COULOMB])


def main() -> None:
    """Print what becomes of each trajectory: deviations and errors in units of those predicted for the first."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "arm.xml").write_text(mjcf(False))
        (folder / "setup.yaml").write_text(SETUP)
        setup = ec.load_setup(folder / "setup.yaml")
        found = ec.exciting_trajectory(setup, starts=4, seed=1)
        print(
            f"{found.base.rank} base parameters of {len(found.base.mechanism.parameters)}"
        )
        print(
            f"safe: {found.safe}; at their limits: {', '.join(margin.label for margin in found.active)}"
        )
        truth, predicted = (
            true_values(found.base, folder),
            np.array(found.conditioning.std),
        )
        fresh = run(random_motion(99), folder / "fresh.csv", None)
        print(
            "\ntrajectory   log det   scaled condition   deviations: predicted   found   errors   prediction"
        )
        for kind, trajectory in (
            ("excited", found.trajectory),
            ("random", random_motion(1)),
            ("sines", sines()),
        ):
            shown = ec.judged_trajectory(setup, trajectory).conditioning
            result = ec.identify(
                setup, [run(trajectory, folder / f"{kind}.csv", 0)], validate_on=[fresh]
            )
            mean = [
                typical(some / predicted) for some in (shown.std, result.estimate.std)
            ]
            error = typical((result.estimate.values - truth) / predicted)
            left = typical(
                [score.rms for score in result.validations[-1].scores] / NOISE
            )
            print(
                f"{kind:10}{shown.log_det:10.1f}{shown.scaled_condition:19.1f}{mean[0]:25.2f}{mean[1]:8.2f}",
                end="",
            )
            print(f"{error:9.2f}{left:13.2f}")
        print(
            f"no model predicts the cogging itself: {typical(COGGING * COULOMB / NOISE) / np.sqrt(2):.2f}"
        )


def typical(values: Floats) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))


if __name__ == "__main__":
    main()
