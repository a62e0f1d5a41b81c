"""Random chains of joints, with the special geometry of real robots: parallel, crossing and right-angled axes."""

from __future__ import annotations

import numpy as np

import echelon as ec
from echelon.robot import Mechanism


def random_arm(
    rng: np.random.Generator, joints: int | None = None, slides: float = 0.2
) -> Mechanism:
    """A chain of revolute and some prismatic joints."""
    count = int(rng.integers(3, 8)) if joints is None else joints
    lines = ["echelon: 1", "name: chain", "bodies:"]
    for k in range(1, count + 1):
        kind = "prismatic" if rng.random() < slides else "revolute"
        shift = [f"{rng.choice([0, 0, rng.uniform(-0.5, 0.5)]):.3f}" for _ in range(3)]
        turns = ["0", "pi/2", "-pi/2", f"{rng.uniform(-1, 1):.2f}"]
        turn = [str(rng.choice(turns, p=[0.5, 0.2, 0.2, 0.1])) for _ in range(3)]
        origin = f"{{xyz: [{', '.join(shift)}], rpy: [{', '.join(turn)}]}}"
        parent = f", parent: b{k - 1}" if k > 1 else ""
        axis = rng.choice(["x", "y", "z", "-z"])
        joint = f"{{type: {kind}, name: j{k}, axis: {axis}, origin: {origin}}}"
        lines.append(f"  - {{name: b{k}{parent}, joint: {joint}}}")
    return ec.load("\n".join(lines) + "\n")
