"""Bias and coverage of the automatic preparation against planted parameters, over rates, encoders and motions.

python benchmarks/preparation.py [--seeds 200] [--only TEXT]      one line per condition, and a page in results/

Every seed has a motion and noise of its own.  Positions are rounded to the encoder's steps, outputs have noise, and
band, derivatives, delays and rows near rest are chosen as ``echelon identify`` chooses them.  Intervals are those of
the default estimator, from batches of time.  The conditions mix what may go wrong: rates of 30 Hz to 5 kHz, encoders of
1e-6 to 1e-2 rad, slow and fast motion, fixed and floating bases, with and without friction.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from textwrap import fill

import numpy as np
from scipy.stats import binom

import echelon as ec
from echelon.identification.band import with_band
from echelon.identification.delays import with_delays
from echelon.identification.estimators.covariance import clustered
from echelon.identification.estimators.least_squares import irls
from echelon.identification.logs.preparation.choices import Signals, chosen
from echelon.identification.logs.preparation.prepare import Preparation, prepare
from echelon.identification.logs.recording import Segment
from echelon.identification.rows.rows import ModelRows
from tabular import table

OUTPUT = Path(__file__).resolve().parent / "results" / "preparation.md"

ARM = """
echelon: 1
name: arm
gravity: [0, 0, -9.81]
bodies:
  - {name: upper, joint: {name: j1, type: revolute, axis: z}}
  - {name: fore, parent: upper, joint: {name: j2, type: revolute, axis: y, origin: {xyz: [0.1, 0, 0.3]}}}
  - {name: hand, parent: fore, joint: {name: j3, type: revolute, axis: y, origin: {xyz: [0.4, 0, 0]}}}
"""
EFFECTS = "effects: [{type: viscous, at: all}, {type: coulomb, at: all}, {type: offset, at: all}]\n"
FLOATING = """
echelon: 1
name: floating
floating_base: true
bodies:
  - {name: trunk}
  - {name: arm, parent: trunk, joint: {name: j1, type: revolute, axis: y, origin: {xyz: [0.2, 0, 0]}}}
  - {name: hand, parent: arm, joint: {name: j2, type: revolute, axis: x, origin: {xyz: [0, 0, 0.3]}}}
"""
ROBOTS = {
    "arm": ARM,
    "arm with friction": ARM + EFFECTS,
    "floating": FLOATING,
    "floating with friction": FLOATING + EFFECTS,
}
MOTIONS = {"slow": 0.1, "fast": 0.6}
"""Lowest of five frequencies, Hz.  Motions do not repeat, since rounding would repeat with them."""
NOISE = 0.03
"""Of outputs, by their own deviation."""


@dataclass(frozen=True)
class Condition:
    """What a log was made from."""

    robot: str
    motion: str
    rate: float
    step: float

    def __str__(self) -> str:
        return f"{self.robot}, {self.motion}, {self.rate:g} Hz, {self.step:g} rad"


CONDITIONS = (
    Condition("arm", "fast", 30, 1e-6),
    Condition("arm with friction", "fast", 30, 1e-2),
    Condition("floating", "slow", 30, 1e-2),
    Condition("floating with friction", "fast", 30, 1e-3),
    Condition("arm with friction", "slow", 50, 1e-3),
    Condition("floating", "fast", 50, 1e-2),
    Condition("arm", "slow", 100, 1e-2),
    Condition("arm with friction", "fast", 100, 1e-4),
    Condition("floating", "fast", 100, 1e-2),
    Condition("floating with friction", "slow", 100, 1e-5),
    Condition("arm", "fast", 250, 1e-5),
    Condition("arm with friction", "slow", 250, 1e-2),
    Condition("floating", "fast", 250, 1e-3),
    Condition("arm", "slow", 1000, 1e-4),
    Condition("arm with friction", "fast", 1000, 1e-3),
    Condition("floating with friction", "fast", 1000, 1e-2),
    Condition("arm", "fast", 5000, 1e-6),
    Condition("arm with friction", "slow", 5000, 1e-3),
    Condition("floating", "fast", 5000, 1e-3),
    Condition("floating with friction", "fast", 5000, 1e-4),
)


@cache
def model(name: str) -> ec.BaseModel:
    """The base model of a robot."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "robot.yaml"
        file.write_text(ROBOTS[name])
        return ec.base_parameters(ec.load(file))


@cache
def truth(name: str) -> np.ndarray:
    """Base parameters of bodies of about 3 kg and 0.3 m, with friction that counts."""
    base, rng, standard = model(name), np.random.default_rng(1), []
    for _ in base.mechanism.bodies:
        mass, centre = rng.uniform(2, 4), rng.uniform(-0.15, 0.15, 3)
        inertia = mass * (
            0.02 * np.eye(3) + centre @ centre * np.eye(3) - np.outer(centre, centre)
        )
        standard += [*inertia[np.triu_indices(3)], *(mass * centre), mass]
    standard += [
        rng.uniform(0.3, 1.0)
        for _ in range(len(base.mechanism.parameters) - len(standard))
    ]
    return base.values(standard)


def motion(
    base: ec.BaseModel, fundamental: float, t: np.ndarray, rng: np.random.Generator
) -> list[np.ndarray]:
    """Positions, velocities and accelerations: five waves each that never repeat; a base turns to all sides."""
    count = len(base.mechanism.velocities)
    w = (
        2
        * np.pi
        * fundamental
        * (np.arange(1, 6)[:, None] + rng.uniform(-0.4, 0.4, (5, count)))
    )
    sizes, phases = (
        rng.uniform(0.15, 0.45, (5, count)) / np.arange(1, 6)[:, None] ** 0.5,
        rng.uniform(0, 6.3, (5, count)),
    )
    waves = np.exp(1j * (t[:, None, None] * w + phases))
    q, qd, qdd = ((sizes * waves * (1j * w) ** k).real.sum(axis=1) for k in range(3))
    if not any(body.joint.kind == "floating" for body in base.mechanism.bodies):
        return [q, qd, qdd]
    return [*turned(q, qd, qdd)]


def turned(
    q: np.ndarray, qd: np.ndarray, qdd: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A floating base whose three angles about x, y and z are the coordinates 3 to 5: a quaternion and its rates."""
    from echelon.identification.signals.filters import body_rates

    # each factor is (cos a/2, sin a/2 · axis); products and their derivatives by Leibniz's rule
    factors = []
    for k in range(3):
        a, v, w = q[:, 3 + k] / 2, qd[:, 3 + k] / 2, qdd[:, 3 + k] / 2
        c, s = np.cos(a), np.sin(a)
        parts = []
        for x, y in ((c, s), (-s * v, c * v), (-c * v**2 - s * w, -s * v**2 + c * w)):
            part = np.zeros((len(a), 4))
            part[:, 0], part[:, 1 + k] = x, y
            parts.append(part)
        factors.append(parts)
    whole = factors[0]
    for other in factors[1:]:
        a, b = whole, other
        whole = [times(a[0], b[0]), times(a[1], b[0]) + times(a[0], b[1]),
                 times(a[2], b[0]) + 2 * times(a[1], b[1]) + times(a[0], b[2])]  # fmt: skip
    unit, omega, alpha = body_rates(*whole)
    return (
        np.hstack([q[:, :3], unit, q[:, 6:]]),
        np.hstack([qd[:, :3], omega, qd[:, 6:]]),
        np.hstack([qdd[:, :3], alpha, qdd[:, 6:]]),
    )


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Products of quaternions, shape (N, 4)."""
    from echelon.identification.signals.filters import multiply

    return multiply(a, b)


def log(condition: Condition, seed: int) -> Segment:
    """A log of a condition."""
    base, rng = model(condition.robot), np.random.default_rng([7, seed])
    fundamental = MOTIONS[condition.motion]
    seconds = 2.5 / fundamental if condition.rate > 2000 else 4 / fundamental
    t = np.arange(int(seconds * condition.rate)) / condition.rate
    q, qd, qdd = motion(base, fundamental, t, rng)
    y = base.predict(q, qd, qdd, truth(condition.robot))
    y = y + NOISE * y.std(axis=0) * rng.standard_normal(y.shape) * np.sqrt(
        condition.rate / 100
    )
    return Segment(
        "planted",
        0.0,
        condition.rate,
        {"q": np.round(q / condition.step) * condition.step, "y": y},
    )


def estimated(condition: Condition, seed: int):
    """Estimate of one seed, with the preparation that was chosen."""
    base, segment = model(condition.robot), log(condition, seed)
    signals = Signals.of([segment], base.mechanism)
    made, noisy = with_band(chosen(Preparation(), signals), signals, base)
    made = with_delays(made.model_copy(update={"delays": None}), [segment], base)
    rows = ModelRows.of(base, [prepare(segment, made, base.mechanism)])
    found = clustered(rows, irls(rows.observation(), rows.units))
    return found if noisy is None else noisy.corrected(found), made, noisy


def judged(condition: Condition, seeds: int) -> list[str]:
    """A line of the table."""
    real = truth(condition.robot)
    errors, inside, bands, told = [], [], [], []
    for seed in range(seeds):
        found, made, noisy = estimated(condition, seed)
        errors.append((found.values - real) / found.std)
        low, high = found.interval(0.95).T
        inside.append((low <= real) & (real <= high))
        bands.append(made.band)
        told.append(noisy is not None)
    biases, hits, told = (
        np.abs(np.mean(errors, axis=0)),
        np.array(inside),
        np.array(told),
    )
    silent = f"{hits[~told].mean():.3f}" if not told.all() else ""
    return [
        str(condition), f"{np.median(bands):.3g}", f"{np.median(biases):.2f}", f"{biases.max():.2f}",
        f"{hits.mean():.3f}", f"{hits.mean(axis=0).min():.3f}", f"{told.mean():.0%}", silent,
    ]  # fmt: skip


def page(rows: list[list[str]], seeds: int) -> str:
    """The table, and what chance alone would bring."""
    low, high = binom.interval(0.99, seeds, 0.95)
    head = [
        "condition",
        "band, Hz",
        "bias",
        "largest",
        "coverage",
        "least",
        "warned",
        "coverage, not warned",
    ]
    text = (
        f"Intervals of 95 % from {seeds} logs per condition.  "
        "`coverage` is the share of intervals that hold the truth, over all base parameters, and `least` that of the "
        f"parameter with the fewest; a single parameter has {low / seeds:.3f} to {high / seeds:.3f} in 99 of 100 cases "
        "by chance.  `bias` is the median over the base parameters of the mean error, by its standard deviation, of "
        f"which chance brings {0.67 / seeds**0.5:.2f}, and `largest` the largest, with {3 / seeds**0.5:.2f}.  `warned` "
        "are logs whose encoders were said to move a parameter by half a standard deviation or more; their "
        "estimates are corrected for it."
    )
    return f"# Automatic preparation against planted parameters\n\n{fill(text, 120)}\n\n{table(head, rows)}\n"


def main() -> None:
    """Print a line per condition; write the page where all were judged."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--only", default="")
    options = parser.parse_args()
    rows = []
    for condition in CONDITIONS:
        if options.only in str(condition):
            rows.append(judged(condition, options.seeds))
            print(*rows[-1], sep=" | ", flush=True)
    if not options.only:
        OUTPUT.write_text(page(rows, options.seeds), encoding="utf-8")


if __name__ == "__main__":
    main()
