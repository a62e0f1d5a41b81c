"""Mechanisms with loops whose independent coordinates move, with limits and small motions of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.excite.problem.closed_loops import (
    LoopLimits,
    LoopMotion,
    LoopRegressor,
    loop_limits,
    state_regressor,
)
from echelon.excite.problem.state_limits import (
    EffortLimit,
    EffortModel,
    PointLimit,
    effort_limits,
    point_limits,
)
from echelon.excite.problem.trajectory import Fourier, Trajectory, resting_ends
from echelon.robot.closure import ClosureKind
from echelon.robot.mechanism import Mechanism
from support import linkages
from support.paths import ROOT
from support.selection import slow_unless

Floats = npt.NDArray[np.float64]
LOOPS = ROOT / "examples" / "loops"

# in-plane loops with and without redundant equations, spatial ones, balls and couplings among the dependent coordinates
FILES = ("four_bar", "parallelogram", "delta", "three_rps", "gough_stewart")
BUILT = {
    "four-bar": linkages.four_bar,
    "slider-crank": linkages.slider_crank,
    "chain": lambda: linkages.closed_chain(ClosureKind.REVOLUTE),
    "coupled chain": lambda: linkages.closed_chain(ClosureKind.REVOLUTE, coupled=True),
}
MECHANISMS = (*BUILT, *FILES)
LARGE = {"chain", "gough_stewart"}
"""Mechanisms that take long."""
CASES = slow_unless(lambda name: name not in LARGE, MECHANISMS)
DERIVED = slow_unless(
    lambda name: name not in {*LARGE, "coupled chain", "delta"}, MECHANISMS
)
"""For tests that need base parameters; the spatial one is 3-RPS."""
REDUNDANT = {"four-bar", "slider-crank", "four_bar", "parallelogram"}


@cache
def mechanism(name: str) -> Mechanism:
    return BUILT[name]() if name in BUILT else ec.load(LOOPS / f"{name}.yaml")


@cache
def base(name: str) -> ec.BaseModel:
    return ec.base_parameters(mechanism(name))


@cache
def regressor(name: str, smooth: float | None = None) -> LoopRegressor:
    made = state_regressor(mechanism(name), base(name).matrix.pivots, smooth)
    assert isinstance(made, LoopRegressor)
    return made


def states(
    motion: LoopMotion, count: int = 4, reach: float = 0.02
) -> dict[str, Floats]:
    """Random states of the independent coordinates near the assembly pose."""
    rng, units = np.random.default_rng(5), motion.independent_units
    names = motion.mechanism.positions
    centre = motion.pose[[names.index(name) for name in motion.independent_positions]]
    q = centre + reach * units * rng.uniform(-1, 1, (count, len(units)))
    return {
        "q": q,
        "qd": units * rng.uniform(-1, 1, q.shape),
        "qdd": units * rng.uniform(-2, 2, q.shape),
    }


def full(found: Floats, made: LoopRegressor, rank: int) -> Floats:
    """Entries as X, shape (N, outputs, parameters)."""
    X = np.zeros((len(found), len(made.rows), rank))
    for row, rows in enumerate(made.rows):
        X[:, row, rows.columns] = found[:, rows.entries]
    return X


def assert_slopes(found: Floats, expected: Floats, size: float) -> None:
    assert np.abs(found - expected).max() < 1e-6 * max(np.abs(expected).max(), size)


def certain(name: str, rng: np.random.Generator) -> EffortModel:
    return EffortModel(rng.uniform(0.5, 1.0, len(mechanism(name).parameters)))


def identified(name: str, rng: np.random.Generator) -> EffortModel:
    """Base parameters with a covariance."""
    found = base(name)
    spread = rng.normal(size=(found.rank, found.rank - 1))
    values = found.values(certain(name, rng).values)
    return EffortModel(values, found.matrix.pivots, 0.01 * spread @ spread.T, 2.0)


def limited(name: str, rng: np.random.Generator) -> LoopLimits:
    """Torques and a point, by a model that is not certain."""
    robot = mechanism(name)
    efforts = [EffortLimit(output.name, output.unit, 500.0) for output in robot.outputs]
    points = [
        PointLimit(
            "p", robot.bodies[-1].name, (0.1, 0.2, 0.3), (0.6, 0.0, 0.8), -3.0, 3.0
        )
    ]
    return loop_limits(
        LoopMotion(robot),
        [
            effort_limits(robot, efforts, identified(name, rng), 0.1, None),
            point_limits(robot, points),
        ],
    )


def motion_of(limits: LoopLimits, size: float) -> Trajectory:
    """A small motion about the pose of the assembly."""
    motion, basis = limits.motion, resting_ends(Fourier(2.0, 2))
    rest = np.linalg.lstsq(
        basis.values(np.linspace(0, 2, 50), 0), np.ones(50), rcond=None
    )[0]
    centre = motion.pose[
        [
            motion.mechanism.positions.index(name)
            for name in motion.independent_positions
        ]
    ]
    swing = np.random.default_rng(3).normal(size=(basis.size, len(centre)))
    swing *= size / np.abs(basis.values(np.linspace(0, 2, 500), 0) @ swing).max()
    units = ("rad",) * len(centre)
    return Trajectory(
        motion.mechanism.independent_velocities,
        units,
        basis,
        np.outer(rest, centre) + swing,
    )
