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
GAIN = np.array([20, 20, 10, 8, 1.5, 1.0, 0.2])  # N·m·s/rad
ADAPTATION = 1.0  # 1/s
STEP = 0.004  # s, of controller and simulation
PERIOD = 4.0  # s, of the motion


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
    # parameters adapt at the same pace in all directions if the gain is the inverse of what the motion shows
    rows = base.regressor(*wanted(np.linspace(0, 20, 2000)))
    seen = np.einsum("nij,i,nik->jk", rows, 1 / GAIN, rows) / len(rows)
    gamma = adaptation * np.linalg.inv(seen)

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
        Y = base.evaluate("slotine_li_regressor", moving)[0]
        sliding = qd - reference
        torque = Y @ estimate - GAIN * sliding
        estimate = estimate - STEP * gamma @ (Y.T @ sliding)
        # the arm
        bias = base.predict(q, qd, np.zeros(7), TRUE)[0]
        qd = qd + STEP * np.linalg.solve(base.mass_matrix(q, TRUE)[0], torque - bias)
        q = q + STEP * qd
    return times, errors, estimates


if __name__ == "__main__":
    times, errors, estimates = simulated(20.0, ADAPTATION)
    last = times > times[-1] - 2
    print(f"tracking error in the last 2 s: {1e3 * np.abs(errors[last]).max():.3f} mrad")
    still = simulated(5.0, 0.0)[1]
    print(f"without adaptation: {1e3 * np.abs(still[times[: len(still)] > 3]).max():.0f} mrad")
    # what is left of the parameters' error, as torque along the motion
    rows = base.regressor(*wanted(times))
    left = [np.sqrt(np.mean((rows @ (z - TRUE)) ** 2)) for z in (estimates[0], estimates[-1])]
    print(f"torque that the estimate misses: {left[0]:.2f} N·m at first, {left[1]:.5f} N·m at last")
    print("converged:", np.abs(errors[last]).max() < 1e-4 and left[1] < 1e-2 * left[0])
