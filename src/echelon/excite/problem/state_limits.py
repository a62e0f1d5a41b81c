"""Limits that a motion keeps: of positions and their derivatives, and of functions of the state (q, q̇, q̈).

The first are linear in the coefficients of every family.  The others have values, exact derivatives, and bounds by
interval arithmetic.

Torques and forces are predicted by a model that is known beforehand: either the inertial values of a file, or base
parameters of an identification with their covariance; then a multiple of the predicted standard deviation is kept free
as well.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    Argument,
    Function,
    Interval,
    Program,
    derivatives,
    interval_values,
    smooth_function,
)
from echelon.compute import Kernel
from echelon.dynamics import (
    STATE,
    Arguments,
    body_frames,
    geometry_values,
    robot_function,
)
from echelon.excite.problem.information import StateRegressor
from echelon.robot import Force, Mechanism, Output, Recorder, Side, add, apply
from echelon.shared import Floats, InputError, nearest_of

ORDERS = (
    "position",
    "velocity",
    "acceleration",
    "jerk",
)  # kinds of limits, by the order of the derivative


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
    def label(self) -> str:
        """For messages, ``"velocity of j3"``."""
        return f"{ORDERS[self.order]} of {self.name}"


Slopes = tuple[Floats | None, Floats | None, Floats | None]
"""Derivatives by q, q̇ and q̈, each of shape (N, m, n); None where there are none."""

NUMBERS_AT_ONCE = 2**22
"""Numbers that are worked on together, because every operation keeps its result: 32 MiB."""


@dataclass(frozen=True)
class _Seconds:
    """Work as measured in one thread, s; budgets of work are the same on every machine."""

    product: float = 1e-9  # a product of two numbers with its sum
    information: float = 6e-8  # an entry of the observation matrix with its derivatives
    function: float = 2e-6  # a recorded function of the state with its slopes
    distance: float = (
        8e-6  # a distance of two meshes with its slope, where half are out of reach
    )
    closing: float = (
        2e-4  # closing the loops of a Delta robot at a sample, with derivatives
    )


SECONDS = _Seconds()


@dataclass(frozen=True, eq=False)
class StateConstraint(ABC):
    """Functions of the state with limits that a solver can keep."""

    labels: tuple[str, ...]  # what each function is, for messages: ``"torque of j2"``
    units: tuple[str, ...]  # SI units of the functions
    low: Floats  # least values, shape (m,); −∞ for none
    high: Floats  # largest values, shape (m,); ∞ for none

    @property
    def seconds(self) -> float:
        """Work of all values and slopes at a sample, about what a processor takes for it, s."""
        return SECONDS.function * len(self.labels)

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
        return self._kernels[0](self._given(q, qd, qdd))

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Derivatives of the functions by q, q̇ and q̈, each of shape (N, m, n)."""
        cuts = np.cumsum([len(argument) for argument in self._states])[:-1]
        found = np.split(self._kernels[1](self._given(q, qd, qdd)), cuts, axis=2)
        parts = {
            argument.name: part
            for argument, part in zip(self._states, found, strict=True)
        }
        return parts.get("q"), parts.get("qd"), parts.get("qdd")

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while states stay in intervals, without smoothing, shape (cells, m)."""
        least, largest = enclosures_of(self.function, self.uniform, ranges)
        low = np.zeros((len(least), len(self.labels)))
        high = np.zeros((len(least), len(self.labels)))
        rows = [row for (row,) in self.function.entries]
        low[:, rows], high[:, rows] = least, largest
        return low, high

    def _given(self, q: Floats, qd: Floats, qdd: Floats) -> dict[str, npt.ArrayLike]:
        states = dict(zip(STATE, (q, qd, qdd), strict=True))
        return {**{a.name: states[a.name] for a in self._states}, **self.uniform}

    @property
    def _states(self) -> list[Argument]:
        return [
            argument for argument in self.function.arguments if argument.name in STATE
        ]

    @cached_property
    def _kernels(self) -> tuple[Kernel, Kernel]:
        function = (
            self.function
            if self.smooth is None
            else smooth_function(self.function, self.smooth)
        )
        return Kernel(function), Kernel(state_slopes(function))


def enclosures_of(
    function: Function, uniform: Mapping[str, Floats], ranges: Mapping[str, Interval]
) -> Interval:
    """Bounds of a function's entries while states stay in intervals, shape (cells, entries)."""
    cells = len(ranges["q"][0])
    together = max(NUMBERS_AT_ONCE // max(len(function.program), 1), 16)
    blocks = [slice(k, k + together) for k in range(0, cells, together)]
    parts = [_enclosed(function, uniform, ranges, block) for block in blocks]
    return np.concatenate([low for low, _ in parts]), np.concatenate(
        [high for _, high in parts]
    )


def _enclosed(
    function: Function,
    uniform: Mapping[str, Floats],
    ranges: Mapping[str, Interval],
    cells: slice,
) -> Interval:
    inputs: dict[int, Interval] = {}
    for argument in function.arguments:
        if argument.uniform:
            exact = [(np.asarray(v), np.asarray(v)) for v in uniform[argument.name]]
            inputs |= dict(zip(argument.nodes, exact, strict=True))
        else:
            low, high = ranges[argument.name]
            inputs |= {
                node: (low[cells, k], high[cells, k])
                for k, node in enumerate(argument.nodes)
            }
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
    entries: dict[tuple[int, ...], int] = {
        (rows[i], j): node for (i, j), node in found.items()
    }
    axis = tuple(
        f"{argument.name}[{label}]" for argument in states for label in argument.labels
    )
    return Function(
        f"{function.name}_slopes",
        function.program,
        function.arguments,
        entries,
        (*function.axes, axis),
    )


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
            raise InputError(
                f"there is no body '{limit.body}'{nearest_of(limit.body, names)}",
                element="frames",
            )
        rotation, shift = frames[names.index(limit.body)]
        point = [program.constant(Fraction(x)) for x in limit.point]
        place = add(shift, apply(rotation, (point[0], point[1], point[2])))
        value = sum(
            (Fraction(d) * x for d, x in zip(limit.direction, place, strict=True)),
            program.zero,
        )
        if value.node != program.zero.node:
            entries[(row,)] = value.node
    arguments = Arguments(mechanism, program, {}).of(("q", "symbols"), entries.values())
    function = Function("points", program, arguments, entries, (_axis(limits),))
    uniform = geometry_values(mechanism, arguments)
    low = np.array([limit.low for limit in limits])
    high = np.array([limit.high for limit in limits])
    return StateLimits(
        _axis(limits), ("m",) * len(limits), low, high, function, uniform
    )


def _axis(limits: Sequence[PointLimit]) -> tuple[str, ...]:
    return tuple(limit.name for limit in limits)


# -- torques and forces ------------------------------------------------------------------------------------------------

SIGNS = (
    "plus",
    "minus",
)  # signs of the deviations, in the order of EffortModel.extremes

LEAST_DEVIATION = 1e-6
"""Effort, N·m or N, that is added to every deviation in squares: a root has no derivative at zero."""
ROUNDING = 1e-12
"""Relative width that rounding of sums adds to intervals of the regressor."""


@dataclass(frozen=True, eq=False)
class EffortModel:
    """Parameters by which efforts x̄ᵀζ are predicted, x̄ a row of the regressor."""

    values: Floats  # shape (c,); ζ, SI units
    # columns of the regressor that they belong to, while all other parameters count as zero: the pivots for base
    # parameters.  All standard parameters if omitted.
    columns: Sequence[int] | None = None
    covariance: Floats | None = (
        None  # shape (c, c); Σ, of the values, where these were identified
    )
    deviations: float = 0.0  # how many standard deviations √(x̄ᵀ Σ x̄) of a predicted effort are kept free

    @property
    def certain(self) -> bool:
        """Whether efforts are taken as predicted."""
        return self.covariance is None or not self.deviations

    def places(self, mechanism: Mechanism) -> Sequence[int]:
        """Columns of a mechanism's regressor."""
        if self.columns is None:
            return range(len(mechanism.parameters))
        return self.columns

    def part(self, columns: npt.NDArray[np.intp]) -> EffortModel:
        """The model of some of the values."""
        covariance = (
            None
            if self.covariance is None
            else self.covariance[np.ix_(columns, columns)]
        )
        return EffortModel(self.values[columns], None, covariance, self.deviations)

    def extremes(self, x: Floats) -> Floats:
        """Efforts plus, then minus the deviations that are kept free, shape (N, 2)."""
        mean, free = x @ self.values, self.deviations * self._std(x)
        return np.stack([mean + free, mean - free], axis=1)

    def adjoints(self, x: Floats) -> Floats:
        """Derivatives of :meth:`extremes` by x, shape (2, N, c)."""
        free = (
            self.deviations
            * (x @ self._factor)
            @ self._factor.T
            / self._std(x)[:, None]
        )
        return np.stack([self.values + free, self.values - free])

    def enclosed(self, x: Interval) -> Interval:
        """Bounds of :meth:`extremes` while x stays in intervals, each of shape (cells, 2)."""
        middle, radius = (x[0] + x[1]) / 2, (x[1] - x[0]) / 2
        radius = radius + ROUNDING * np.abs(middle)
        mean, wide = middle @ self.values, radius @ np.abs(self.values)
        along, across = np.abs(middle @ self._factor), radius @ np.abs(self._factor)
        least = self.deviations * np.linalg.norm(
            np.maximum(along - across, 0.0), axis=1
        )
        most = self.deviations * np.sqrt(
            np.sum((along + across) ** 2, axis=1) + LEAST_DEVIATION**2
        )
        low = np.stack([mean - wide + least, mean - wide - most], axis=1)
        high = np.stack([mean + wide + most, mean + wide - least], axis=1)
        return low, high

    def _std(self, x: Floats) -> Floats:
        found: Floats = np.sqrt(
            np.sum((x @ self._factor) ** 2, axis=1) + LEAST_DEVIATION**2
        )
        return found

    @cached_property
    def _factor(self) -> Floats:
        """L with L Lᵀ = Σ, without directions in which nothing varies."""
        assert self.covariance is not None
        sizes = np.sqrt(np.maximum(np.diag(self.covariance), 0.0))
        units = np.where(sizes > 0, sizes, 1.0)
        values, vectors = np.linalg.eigh(self.covariance / np.outer(units, units))
        kept = values > 0
        found: Floats = units[:, None] * vectors[:, kept] * np.sqrt(values[kept])
        return found


@dataclass(frozen=True)
class EffortLimit:
    """The largest torque or force of a drive or joint."""

    name: str  # actuator, or joint coordinate on the joint's side of its drive
    unit: str
    limit: float  # N·m or N, both directions


def effort_limits(
    mechanism: Mechanism,
    limits: Sequence[EffortLimit],
    model: EffortModel,
    margin: float,
    smooth: float | None,
) -> StateLimits | UncertainEfforts:
    """Limits of efforts as constraints of the state, of which a share, the margin, is kept free as well."""
    check_model(mechanism, model)
    measured = mechanism.measuring(effort_output(mechanism, limit) for limit in limits)
    labels = tuple(
        f"{'force' if limit.unit == 'N' else 'torque'} of {limit.name}"
        for limit in limits
    )
    units = tuple(limit.unit for limit in limits)
    high = np.array([limit.limit for limit in limits]) * (1 - margin)
    if model.certain:
        function = robot_function("inverse_dynamics", measured, model.places(mechanism))
        uniform = {
            "parameters": model.values,
            **geometry_values(mechanism, function.arguments),
        }
        return StateLimits(labels, units, -high, high, function, uniform, smooth)
    # plus deviations below the highest, minus deviations above the lowest value
    labels = tuple(
        f"{label} {sign} {model.deviations:g} deviations"
        for label in labels
        for sign in SIGNS
    )
    none = np.full(len(high), np.inf)
    ends = (
        np.column_stack([-none, -high]).ravel(),
        np.column_stack([high, none]).ravel(),
    )
    regressor = StateRegressor(measured, model.places(measured), smooth)
    return UncertainEfforts(
        labels, tuple(np.repeat(units, 2)), *ends, measured, model, regressor
    )


def check_model(mechanism: Mechanism, model: EffortModel) -> None:
    """Refuse a model that leaves parameters open."""
    columns = zip(model.places(mechanism), model.values, strict=True)
    lacking = [
        mechanism.parameters[k] for k, value in columns if not np.isfinite(value)
    ]
    if lacking:
        raise InputError(
            f"limits of torques need a prior model; {', '.join(lacking[:6])} have no values"
        )


def effort_output(mechanism: Mechanism, limit: EffortLimit) -> Output:
    """The effort of an actuator, or of a coordinate that none of its name drives, as an output."""
    drives = {actuator.name for actuator in mechanism.transmission.actuators}
    force = Force(limit.name, Side.ACTUATOR if limit.name in drives else Side.JOINT)
    return force.output(limit.name, limit.unit)


@dataclass(frozen=True, eq=False)
class UncertainEfforts(Enclosed):
    """Two functions for each effort: plus and minus the deviations that are kept free."""

    mechanism: Mechanism  # whose outputs are the efforts
    model: EffortModel
    regressor: StateRegressor

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, 2m)."""
        entries = self.regressor.entries(dict(zip(STATE, (q, qd, qdd), strict=True)))
        return np.hstack(
            [model.extremes(entries[:, mine]) for mine, model in self._rows]
        )

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Derivatives of the functions by q, q̇ and q̈, each of shape (N, 2m, n)."""
        state = dict(zip(STATE, (q, qd, qdd), strict=True))
        entries, found = self.regressor.entries(state), []
        for mine, model in self._rows:
            for part in model.adjoints(entries[:, mine]):
                adjoint = np.zeros_like(entries)
                adjoint[:, mine] = part
                found.append(self.regressor.pulled(state, adjoint))
        by_q, by_qd, by_qdd = (
            np.stack(parts, axis=1) for parts in zip(*found, strict=True)
        )
        return by_q, by_qd, by_qdd

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while states stay in intervals, without smoothing, shape (cells, 2m)."""
        recorded = self.regressor.recorded
        low, high = enclosures_of(
            recorded, geometry_values(self.mechanism, recorded.arguments), ranges
        )
        parts = [
            model.enclosed((low[:, mine], high[:, mine])) for mine, model in self._rows
        ]
        return np.hstack([part for part, _ in parts]), np.hstack(
            [part for _, part in parts]
        )

    @cached_property
    def _rows(self) -> list[tuple[slice, EffortModel]]:
        """For each effort, its entries and the model of their parameters."""
        return [
            (row.entries, self.model.part(row.columns)) for row in self.regressor.rows
        ]
