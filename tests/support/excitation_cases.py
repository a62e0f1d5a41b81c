"""Helpers of the tests of exciting trajectories: families, limits, differences, values in fifty digits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import cache
from typing import Any

import mpmath
import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.algebra.program.operations import Op
from echelon.algebra.program.tape import Program
from echelon.excite.problem.state_limits import (
    EffortLimit,
    EffortModel,
    PointLimit,
    StateLimits,
    effort_limits,
    point_limits,
)
from echelon.excite.problem.trajectory import (
    Basis,
    Combined,
    Fourier,
    Splines,
    Trajectory,
    resting_ends,
    uniform_splines,
)
from echelon.robot.mechanism import Mechanism
from support.float_regressor import standard_vector
from support.paths import EXAMPLES
from support.robot_files import robot_file

Floats = npt.NDArray[np.float64]

_FOURTH = ((-2.0, 1 / 12), (-1.0, -2 / 3), (1.0, 2 / 3), (2.0, -1 / 12))
"""Offsets and weights of the central difference of fourth order."""


@cache
def families(duration: float = 4.0) -> dict[str, Basis]:
    """One basis of every kind."""
    series, splines = Fourier(duration, 3), uniform_splines(duration, 6)
    uneven = Splines((0.0, 0.1 * duration, 0.45 * duration, 0.5 * duration, duration))
    mixed = np.random.default_rng(5).normal(size=(series.size, 4))
    return {
        "fourier": series,
        "bspline": splines,
        "uneven": uneven,
        "sum": Combined((series, splines)),
        "recombined": Combined((series,), mixed),
        "fourier at rest": resting_ends(series),
        "bspline at rest": resting_ends(splines),
        "sum at rest": resting_ends(Combined((series, splines))),
    }


def random_motion(
    basis: Basis, count: int, seed: int = 0, size: float = 0.5
) -> Trajectory:
    """A random motion of some coordinates q1, q2, …"""
    coefficients = np.random.default_rng(seed).normal(
        scale=size, size=(basis.size, count)
    )
    names = tuple(f"q{k + 1}" for k in range(count))
    return Trajectory(names, ("rad",) * count, basis, coefficients)


def slope_along(function: Callable[[float], Any], step: float) -> Floats:
    """Derivative at 0 by differences of fourth order, values in fifty digits."""
    return (
        np.asarray(
            sum(weight * np.asarray(function(k * step)) for k, weight in _FOURTH)
        )
        / step
    )


def slopes_by_state(
    function: Callable[..., Floats],
    state: Mapping[str, Floats],
    name: str,
    step: float = 1e-3,
) -> Floats:
    """Derivatives of a function of q, q̇ and q̈ by one of them, shape (N, …, n)."""
    columns = []
    for k in range(state[name].shape[1]):
        direction = np.eye(state[name].shape[1])[k]

        def moved(t: float, direction: Floats = direction) -> Floats:
            return function(**{**state, name: state[name] + t * direction})

        columns.append(slope_along(moved, step))
    return np.stack(columns, axis=-1)


# -- limits of robots --------------------------------------------------------------------------------------------------


@cache
def ur10() -> Mechanism:
    return ec.load(robot_file("ur10_robot"), snap_tolerance=0)


def torques(
    mechanism: Mechanism,
    standard: Floats,
    limit: float = 100.0,
    **changes: float | None,
) -> StateLimits:
    names = [
        EffortLimit(name, "N·m", limit + k)
        for k, name in enumerate(mechanism.velocities)
    ]
    settings = {"margin": 0.1, "smooth": None} | changes
    model = EffortModel(standard)
    found = effort_limits(
        mechanism, names, model, settings["margin"] or 0.0, settings["smooth"]
    )
    assert isinstance(found, StateLimits)
    return found


def tx40_standard() -> tuple[Mechanism, Floats]:
    """The TX40 with made-up parameters, friction and coupled wrist included."""
    mechanism = ec.load(EXAMPLES / "tx40.yaml")
    return mechanism, np.random.default_rng(0).normal(size=len(mechanism.parameters))


def points() -> list[PointLimit]:
    slanted = tuple((np.array([1.0, 2.0, -2.0]) / 3).tolist())
    return [
        PointLimit(
            "z of wrist", "wrist_3_link", (0.0, 0.1, 0.05), (0.0, 0.0, 1.0), 0.1, 1.2
        ),
        PointLimit(
            "slanted of elbow", "forearm_link", (0.3, -0.2, 0.1), slanted, -np.inf, 0.5
        ),  # type: ignore[arg-type]
        PointLimit(
            "z of shoulder", "shoulder_link", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), -1, 1
        ),
    ]


def all_limits() -> list[tuple[Mechanism, StateLimits]]:
    mechanism, standard = tx40_standard()
    return [
        (mechanism, torques(mechanism, standard, smooth=0.1)),
        (ur10(), torques(ur10(), standard_vector(ur10()))),
        (ur10(), point_limits(ur10(), points())),
    ]


# -- programs in fifty digits ------------------------------------------------------------------------------------------

TRUTH: Mapping[Op, Any] = {
    Op.SIN: mpmath.sin,
    Op.COS: mpmath.cos,
    Op.TAN: mpmath.tan,
    Op.EXP: mpmath.exp,
    Op.LOG: mpmath.log,
    Op.TANH: mpmath.tanh,
    Op.SQRT: mpmath.sqrt,
    Op.ABS: abs,
    Op.SIGN: mpmath.sign,
    Op.ATAN: mpmath.atan,
}


def truth(program: Program, output: int, inputs: Mapping[str, float]) -> Any:
    """The value of a node in fifty digits; None where there is none."""
    values: dict[int, Any] = {}
    with mpmath.workdps(50):
        for node in program.needed([output]):
            op = Op(program.ops[node])
            if op is Op.INPUT:
                values[node] = mpmath.mpf(inputs[program.inputs[node].name])
                continue
            if op is Op.CONSTANT:
                number = Fraction(program.constants[node])  # type: ignore[arg-type]
                values[node] = mpmath.mpf(number.numerator) / number.denominator
                continue
            a, b = values[program.lhs[node]], values.get(program.rhs[node])
            if (
                (op is Op.DIV and b == 0)
                or (op is Op.LOG and a <= 0)
                or (op is Op.SQRT and a < 0)
                or (op is Op.EXP and abs(a) > 600)
                or (op in (Op.SIN, Op.COS, Op.TAN) and abs(a) > 100)
            ):
                return None
            values[node] = _operated(op, a, b)
            if values[node] and not 1e-250 < abs(values[node]) < 1e250:
                return None  # floating-point numbers end somewhere
        return values[output]


def _operated(op: Op, a: Any, b: Any) -> Any:
    if op is Op.NEG:
        return -a
    if op is Op.ADD:
        return a + b
    if op is Op.SUB:
        return a - b
    if op is Op.MUL:
        return a * b
    return a / b if op is Op.DIV else TRUTH[op](a)
