"""Motions of two joints that tests of trajectory files write and read, and the waves of others' files."""

from __future__ import annotations

from typing import Any

import numpy as np

from echelon.excite.problem.trajectory import Basis, Fourier, Trajectory

NAMES, UNITS = ("j1", "slider"), ("rad", "m")
KIND = "trajectory_msgs/msg/JointTrajectory"

T = np.arange(50) / 100
WAVE, SPEED = np.sin(6 * T), 6 * np.cos(6 * T)


def motion(basis: Basis, seed: int = 0) -> Trajectory:
    coefficients = np.random.default_rng(seed).normal(size=(basis.size, 2))
    return Trajectory(NAMES, UNITS, basis, coefficients)


def smooth(duration: float = 2.0, harmonics: int = 2) -> Trajectory:
    return motion(Fourier(duration, harmonics), 3)


def states(found: Trajectory, t: Any) -> list[Any]:
    return [found(t, order) for order in range(4)]
