"""An adaptive controller (Slotine and Li) of a Panda that knows nothing of its masses at first, simulated.

python examples/14_adaptive_control.py
"""

from pathlib import Path

import numpy as np

import echelon as ec

# links of a made-up arm of a Panda's size, the last one with a hand: mass, centre of mass, radius of gyration
MASS = np.array([3.0, 2.9, 2.7, 2.6, 2.4, 1.5, 1.5])
CENTRE = np.array([[0, -0.03, -0.08], [0, -0.07, 0.03], [0.04, 0.02, -0.04], [-0.04, 0.04, 0.02], [0, 0.04, -0.11], [0.05, 0, 0.01], [0.01, 0, 0.12]])  # fmt: skip
RADIUS = np.array([0.10, 0.10, 0.09, 0.09, 0.11, 0.07, 0.08])

LAMBDA = 4.0  # 1/s
GAIN = np.array([60, 60, 30, 24, 4.5, 3.0, 0.6])  # N·m·s/rad
ADAPTATION = 1.0  # 1/s
STEP = 0.002  # s, of controller and simulation
PERIOD = 4.0  # s, of the motion
SECONDS = 24.0  # of the simulation


def standard(mass: float, centre: np.ndarray, radius: float) -> list[float]:
    """Ten parameters about the origin of the link's frame."""
    inertia = mass * (radius**2 + centre @ centre) * np.eye(3)
    inertia -= mass * np.outer(centre, centre)
    return [*inertia[np.triu_indices(3)], *(mass * centre), mass]


base = ec.base_parameters(ec.load(Path(__file__).with_name("panda.yaml")))
links = zip(MASS, CENTRE, RADIUS, strict=True)
TRUE = base.values(np.concatenate([standard(*link) for link in links]))

rng = np.random.default_rng(0)
MIDDLE = np.array([0, 0.9, 0.4, -1.7, 0.4, 1.8, 0.5])
SIZE = rng.uniform(0.1, 0.3, (2, 7))
RATE = 2 * np.pi / PERIOD * np.array([[1], [2]])
PHASE = rng.uniform(0, 2 * np.pi, (2, 7))


def wanted(t: np.ndarray | float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The motion to follow: position, velocity, acceleration."""
    angle = np.multiply.outer(t, RATE) + PHASE
    q = MIDDLE + (SIZE * np.sin(angle)).sum(axis=-2)
    qd = (SIZE * RATE * np.cos(angle)).sum(axis=-2)
    return q, qd, -(SIZE * RATE**2 * np.sin(angle)).sum(axis=-2)


def simulated(
    seconds: float, adaptation: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, tracking errors (rad) and estimates, from rest beside the motion and with all parameters zero."""
    # the inverse of what the motion shows lets all directions adapt at the same pace; a thousandth more keeps those
    # calm that it hardly shows
    rows = base.regressor(*wanted(np.arange(0, PERIOD, 0.01)))
    seen = np.einsum("nij,i,nik->jk", rows, 1 / GAIN, rows) / len(rows)
    gamma = adaptation * np.linalg.inv(seen + 1e-3 * np.diag(np.diag(seen)))
    times = np.arange(0, seconds, STEP)
    q, qd, estimate = wanted(0.0)[0] + 0.1, np.zeros(7), np.zeros(base.rank)
    errors, estimates = np.empty((len(times), 7)), np.empty((len(times), base.rank))
    for k, t in enumerate(times):
        target, speed, acceleration = wanted(t)
        errors[k], estimates[k] = q - target, estimate
        # the controller, once in every step
        reference = speed - LAMBDA * (q - target)
        moving = {"q": q, "qd": qd, "qdr": reference}
        moving["qddr"] = acceleration - LAMBDA * (qd - speed)
        Y = base.evaluate("slotine_li_regressor", moving)
        sliding = qd - reference
        torque = Y @ estimate - GAIN * sliding
        estimate = estimate - STEP * gamma @ (Y.T @ sliding)
        # the arm
        bias = base.predict(q, qd, np.zeros(7), TRUE)
        qd = qd + STEP * np.linalg.solve(base.mass_matrix(q, TRUE), torque - bias)
        q = q + STEP * qd
    return times, errors, estimates


if __name__ == "__main__":
    times, errors, estimates = simulated(SECONDS, ADAPTATION)
    still = simulated(2 * PERIOD, 0.0)[1]
    last = times >= times[-1] - PERIOD
    final = np.abs(errors[last]).max()
    print(f"largest error without adaptation: {1e3 * np.abs(still).max():.0f} mrad")
    print(f"with adaptation, in the last {PERIOD:g} s: {1e3 * final:.2f} mrad")
    # how far the torques of the estimate are off, along the motion
    rows = base.regressor(*wanted(np.arange(0, PERIOD, 0.01)))
    first, left = (
        np.sqrt(np.mean((rows @ (z - TRUE)) ** 2))
        for z in (estimates[0], estimates[-1])
    )
    print(
        f"torque that the estimate misses: {first:.1f} N·m at first, {left:.3f} N·m now"
    )
    print("converged:", final < 3e-3 and left < 0.01 * first)
