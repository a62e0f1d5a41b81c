"""Limits that a motion keeps: of positions and their derivatives, and of functions of the state (q, q̇, q̈).

The first are linear in the coefficients of every family.  The others have values, exact derivatives, and bounds by
interval arithmetic.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.dynamics.arguments import STATE, Arguments, geometry_values
from echelon.dynamics.kinematics import body_frames
from echelon.errors import InputError
from echelon.hints import nearest_of
from echelon.machine.kernel import Kernel
from echelon.mechanism.mechanism import Mechanism
from echelon.program.derivatives import derivatives
from echelon.program.function import Argument, Function
from echelon.program.intervals import Interval, interval_values
from echelon.program.rewriting import smooth_function
from echelon.program.tape import Program
from echelon.regressor.steps import Recorder, add, apply

ORDERS = ("position", "velocity", "acceleration", "jerk")
"""Kinds of limits, by the order of the derivative."""


@dataclass(frozen=True, eq=False)
class MotionLimit:
    """low ≤ weights · d^order q/dt^order ≤ high, for a coordinate or, through a transmission, for an actuator."""

    name: str  # coordinate or actuator
    unit: str
    order: int  # of the derivative; see :data:`ORDERS`
    weights: Floats  # shape (n,); over the coordinates that move
    low: float  # SI units; infinite where there is no limit
    high: float

    @property
    def kind(self) -> str:
        """The kind of limit, by the order of the derivative."""
        return ORDERS[self.order]

    @property
    def label(self) -> str:
        """For messages, ``"velocity of j3"``."""
        return f"{self.kind} of {self.name}"


Slopes = tuple[Floats | None, Floats | None, Floats | None]
"""Derivatives by q, q̇ and q̈, each of shape (N, m, n); None where there are none."""

_NUMBERS = 2**22  # that are worked on together: every operation keeps its result


@dataclass(frozen=True, eq=False)
class StateConstraint(ABC):
    """Functions of the state with limits that a solver can keep."""

    labels: tuple[str, ...]  # what each function is, for messages: ``"torque of j2"``
    units: tuple[str, ...]  # SI units of the functions
    low: Floats  # least values, shape (m,); −∞ for none
    high: Floats  # largest values, shape (m,); ∞ for none
    leading: ClassVar[int] = 0  # functions, the first ones, that a solver has to keep from the beginning

    @abstractmethod
    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, m)."""

    @abstractmethod
    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Derivatives of the functions by q, q̇ and q̈."""


class Enclosed(StateConstraint):
    """A constraint with bounds of what happens between samples."""

    @abstractmethod
    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Least and largest values, shape (cells, m), while states stay in ranges of shape (cells, n), unsmoothed."""


@dataclass(frozen=True, eq=False)
class StateLimits(Enclosed):
    """Limits of recorded functions, such as torques and coordinates of points."""

    function: Function  # of some of ``q``, ``qd`` and ``qdd`` and of uniform arguments; of shape (m,)
    uniform: Mapping[str, Floats]  # values of the uniform arguments
    # velocity within which dry friction changes sign gradually in what the solver sees, rad/s or m/s
    smooth: float | None = None

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, m)."""
        found: Floats = self._kernels[0](self._given(q, qd, qdd))
        return found

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Derivatives of the functions by q, q̇ and q̈, each of shape (N, m, n)."""
        found = self._kernels[1](self._given(q, qd, qdd))
        parts: dict[str, Floats] = {}
        place = 0
        for argument in self._states:
            parts[argument.name] = found[:, :, place : place + len(argument)]
            place += len(argument)
        return parts.get("q"), parts.get("qd"), parts.get("qdd")

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while states stay in intervals, without smoothing, shape (cells, m)."""
        least, largest = enclosures_of(self.function, self.uniform, ranges)
        low, high = np.zeros((len(least), len(self.labels))), np.zeros((len(least), len(self.labels)))
        rows = [row for (row,) in self.function.entries]
        low[:, rows], high[:, rows] = least, largest
        return low, high

    def _given(self, q: Floats, qd: Floats, qdd: Floats) -> dict[str, npt.ArrayLike]:
        states = dict(zip(STATE, (q, qd, qdd), strict=True))
        return {**{a.name: states[a.name] for a in self._states}, **self.uniform}

    @property
    def _states(self) -> list[Argument]:
        return [argument for argument in self.function.arguments if argument.name in STATE]

    @cached_property
    def _kernels(self) -> tuple[Kernel, Kernel]:
        function = self.function if self.smooth is None else smooth_function(self.function, self.smooth)
        return Kernel(function), Kernel(state_slopes(function))


def enclosures_of(function: Function, uniform: Mapping[str, Floats], ranges: Mapping[str, Interval]) -> Interval:
    """Bounds of a function's entries while states stay in intervals, shape (cells, entries)."""
    cells, together = len(ranges["q"][0]), max(_NUMBERS // max(len(function.program), 1), 16)
    blocks = [slice(k, k + together) for k in range(0, cells, together)]
    parts = [_enclosed(function, uniform, ranges, block) for block in blocks]
    return np.concatenate([low for low, _ in parts]), np.concatenate([high for _, high in parts])


def _enclosed(
    function: Function, uniform: Mapping[str, Floats], ranges: Mapping[str, Interval], cells: slice
) -> Interval:
    inputs: dict[int, Interval] = {}
    for argument in function.arguments:
        if argument.uniform:
            exact = [(np.asarray(v), np.asarray(v)) for v in uniform[argument.name]]
            inputs |= dict(zip(argument.nodes, exact, strict=True))
        else:
            low, high = ranges[argument.name]
            inputs |= {node: (low[cells, k], high[cells, k]) for k, node in enumerate(argument.nodes)}
    found = interval_values(function.program, function.outputs, inputs)
    shape = len(ranges["q"][0][cells]), len(found)
    bounds = np.zeros(shape), np.zeros(shape)
    for k, ends in enumerate(found):
        bounds[0][:, k], bounds[1][:, k] = ends
    return bounds


def state_slopes(function: Function) -> Function:
    """Derivatives of a function of shape (m,) by all its states, one after another: of shape (m, states)."""
    states = [argument for argument in function.arguments if argument.name in STATE]
    inputs = [node for argument in states for node in argument.nodes]
    rows = [row for (row,) in function.entries]
    found = derivatives(function.program, function.outputs, inputs, reverse=True)
    entries: dict[tuple[int, ...], int] = {(rows[i], j): node for (i, j), node in found.items()}
    axis = tuple(f"{argument.name}[{label}]" for argument in states for label in argument.labels)
    return Function(f"{function.name}_slopes", function.program, function.arguments, entries, (*function.axes, axis))


@dataclass(frozen=True)
class PointLimit:
    """low ≤ direction · p ≤ high for a point p of a body, in the base frame."""

    name: str  # for messages: ``"z of tool"``
    body: str
    point: tuple[float, float, float]  # in the body's frame, m
    direction: tuple[float, float, float]  # unit vector in the base frame
    low: float  # m; infinite for none
    high: float


def point_limits(mechanism: Mechanism, limits: Sequence[PointLimit]) -> StateLimits:
    """Limits of points as constraints of the state."""
    program = Program()
    frames = body_frames(Recorder(mechanism, program))
    names = [body.name for body in mechanism.bodies]
    entries: dict[tuple[int, ...], int] = {}
    for row, limit in enumerate(limits):
        if limit.body not in names:
            raise InputError(f"there is no body '{limit.body}'{nearest_of(limit.body, names)}", element="frames")
        rotation, shift = frames[names.index(limit.body)]
        point = [program.constant(Fraction(x)) for x in limit.point]
        place = add(shift, apply(rotation, (point[0], point[1], point[2])))
        value = sum((Fraction(d) * x for d, x in zip(limit.direction, place, strict=True)), program.zero)
        if value.node != program.zero.node:
            entries[(row,)] = value.node
    arguments = Arguments(mechanism, program, {}).of(("q", "symbols"), entries.values())
    function = Function("points", program, arguments, entries, (_axis(limits),))
    uniform = geometry_values(mechanism, arguments)
    low, high = np.array([limit.low for limit in limits]), np.array([limit.high for limit in limits])
    return StateLimits(_axis(limits), ("m",) * len(limits), low, high, function, uniform)


def _axis(limits: Sequence[PointLimit]) -> tuple[str, ...]:
    return tuple(limit.name for limit in limits)
