"""Constraints on the state: functions of q, q̇ and q̈ that stay between bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.dynamics.arguments import STATE
from echelon.machine.kernel import Kernel
from echelon.program.derivatives import derivatives
from echelon.program.function import Argument, Function
from echelon.program.intervals import Interval, interval_values
from echelon.program.rewriting import smooth_function

Slopes = tuple[Floats | None, Floats | None, Floats | None]
"""Derivatives by q, q̇ and q̈, each of shape (N, m, n); None where there are none."""

_NUMBERS = 2**22  # that are worked on together: every operation keeps its result


class Limited(Protocol):
    """Some functions of the state with limits."""

    @property
    def labels(self) -> tuple[str, ...]:
        """What each function is, for messages: ``"torque of j2"``."""

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the functions."""

    @property
    def low(self) -> Floats:
        """Least values, shape (m,); −∞ for none."""

    @property
    def high(self) -> Floats:
        """Largest values, shape (m,); ∞ for none."""


class StateConstraint(Limited, Protocol):
    """Limited functions that a solver can keep."""

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, m)."""

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Their derivatives."""


class Bounded(Limited, Protocol):
    """Limited functions with bounds of what they reach between samples."""

    def enclosures(self, ranges: Mapping[str, Interval]) -> Interval:
        """Bounds of the functions while states stay in intervals: least and largest, each of shape (cells, m).

        Parameters
        ----------
        ranges : mapping of str to (array, array)
            Least and largest ``q``, ``qd``, ``qdd``, of shape (cells, n), and ``t``, of shape (cells, 1).
        """


@runtime_checkable
class Enclosed(StateConstraint, Bounded, Protocol):
    """A constraint with bounds of what happens between samples."""


@dataclass(frozen=True, eq=False)
class StateLimits:
    """Limits of recorded functions, such as torques and coordinates of points.

    Attributes
    ----------
    function : Function
        Of some of ``q``, ``qd`` and ``qdd`` and of uniform arguments; of shape (m,).
    uniform : mapping of str to array
        Values of the uniform arguments.
    labels, units : tuple of str
    low, high : array of shape (m,)
    smooth : float, optional
        Velocity within which dry friction changes sign gradually in what the solver sees, rad/s or m/s.
    """

    function: Function
    uniform: Mapping[str, Floats]
    labels: tuple[str, ...]
    units: tuple[str, ...]
    low: Floats
    high: Floats
    smooth: float | None = None

    @property
    def recorded(self) -> Function:
        """What is bounded."""
        return self.function

    def values(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """The functions at states of shape (N, n), shape (N, m)."""
        found: Floats = self._kernels[0](self._given(q, qd, qdd))
        return found

    def slopes(self, q: Floats, qd: Floats, qdd: Floats) -> Slopes:
        """Their derivatives by q, q̇ and q̈, each of shape (N, m, n)."""
        found = self._kernels[1](self._given(q, qd, qdd))
        parts: dict[str, Floats] = {}
        place = 0
        for argument in self._states:
            parts[argument.name] = found[:, :, place : place + len(argument)]
            place += len(argument)
        return parts.get("q"), parts.get("qd"), parts.get("qdd")

    def enclosures(self, ranges: Mapping[str, Interval], known: Sequence[Argument] = ()) -> Interval:
        """Bounds of the functions while states stay in intervals, without smoothing.

        Parameters
        ----------
        ranges : mapping of str to (array, array)
            Least and largest ``q``, ``qd``, ``qdd``, of shape (cells, n).
        known : sequence of Argument
            See :func:`enclosures_of`.

        Returns
        -------
        low, high : arrays of shape (cells, m)
        """
        least, largest = enclosures_of(self.function, self.uniform, ranges, known)
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


def enclosures_of(
    function: Function,
    uniform: Mapping[str, Floats],
    ranges: Mapping[str, Interval],
    known: Sequence[Argument] = (),
) -> Interval:
    """Bounds of a function's entries while states stay in intervals.

    Parameters
    ----------
    function : Function
    uniform : mapping of str to array
        Values of its uniform arguments.
    ranges : mapping of str to (array, array)
        Least and largest ``q``, ``qd``, ``qdd``, of shape (cells, n).
    known : sequence of Argument
        Other nodes of the program, in ranges by the arguments' names, that are known better than from the states.

    Returns
    -------
    low, high : arrays of shape (cells, entries)
    """
    cells, together = len(ranges["q"][0]), max(_NUMBERS // max(len(function.program), 1), 16)
    blocks = [slice(k, k + together) for k in range(0, cells, together)]
    parts = [_enclosed(function, uniform, ranges, block, known) for block in blocks]
    return np.concatenate([low for low, _ in parts]), np.concatenate([high for _, high in parts])


def _enclosed(
    function: Function,
    uniform: Mapping[str, Floats],
    ranges: Mapping[str, Interval],
    cells: slice,
    known: Sequence[Argument],
) -> Interval:
    inputs: dict[int, Interval] = {}
    for argument in (*function.arguments, *known):
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
