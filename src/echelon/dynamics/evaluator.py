"""A robot's function as machine code, called with states, parameters, values of symbols and measured inputs.

With loops, recorded functions take all positions and independent rates.  Callers may give each of q, q̇ and q̈ of all
coordinates or of the independent ones only.  Given positions are checked, or followed from the assembly pose; given
dependent rates are checked and left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from echelon.algebra import Argument, Function
from echelon.compute import Kernel, real_array, value_of
from echelon.dynamics.arguments import STANDARD, STATE, geometry_values
from echelon.dynamics.functions import (
    Builder,
    closed_accelerations,
    closed_positions,
    closed_velocities,
    closure_pivots,
)
from echelon.loops import NEGLIGIBLE, Assembly, largest
from echelon.robot import Mechanism, symbol_values
from echelon.shared import Flags, Floats, InputError

LAST_STEP = 1e-9
"""Step, rad or characteristic lengths, after which what Newton's iteration leaves is rounding."""
_SINGULAR = NEGLIGIBLE**2  # pivots are squares
FEW = 8
"""Iterations that lead from near a closed configuration to it."""


class CompiledAssembly(Assembly):
    """Closed configurations of a mechanism with loops, in machine code."""

    functions: ClassVar[tuple[Builder, ...]] = (
        closed_positions,
        closed_velocities,
        closed_accelerations,
        closure_pivots,
    )
    """The function that is compiled."""
    _determined = False

    def near(self, guess: Floats) -> tuple[Floats, Flags]:
        """Closed configurations near guesses, with the same independent positions; and which of them were found."""
        q, done = guess, np.zeros(len(guess), dtype=np.bool_)
        for _ in range(FEW):
            moved = self.run("closed_positions", q=q)
            done = (
                largest((moved - q) / self.position_units) < LAST_STEP
            )  # false where a singular one makes it NaN
            q = np.where(np.isfinite(moved), moved, q)
            if done.all():
                break
        return q, done

    def independent_state(self, state: Mapping[str, Floats]) -> dict[str, Floats]:
        """All positions, and independent rates, from those of all or of independent coordinates, shape (N, size).

        Refused are loops that are not or cannot be closed, singular configurations, and motions that do not determine
        an output.
        """
        found = {"q": self._positions(state["q"])}
        pivots = self.run("closure_pivots", **found)
        singular = ~(pivots > _SINGULAR).all(axis=1)
        if singular.any():
            sample = int(singular.argmax())
            place = int(np.argmin(np.nan_to_num(pivots[sample])))
            self._refuse_singular(
                sample, self._kernels["closure_pivots"].function.axes[0][place]
            )
        trust = np.sqrt(pivots.min(axis=1, initial=1.0))
        self._check_closed(found["q"], trust)
        if len(trust) and not self._determined:
            self.virtual_velocities(
                found["q"][:1]
            )  # refuses outputs and coordinates that redundant constraints forbid
            self._determined = True
        for name, function in (
            ("qd", "closed_velocities"),
            ("qdd", "closed_accelerations"),
        ):
            if name in state:
                found[name] = self._independent_rates(
                    name, function, found, state, trust
                )
        return found

    def _positions(self, q: Floats) -> Floats:
        if q.shape[1] == len(self.mechanism.positions):
            return q
        _check_shape(q, "q", self.mechanism.positions, self.independent_positions)
        return self.from_independent(q)

    def _independent_rates(
        self,
        name: str,
        function: str,
        found: Mapping[str, Floats],
        state: Mapping[str, Floats],
        trust: Floats,
    ) -> Floats:
        mechanism, given = self.mechanism, state[name]
        names, free = mechanism.velocities, mechanism.independent_velocities
        if given.shape[1] != len(names):
            _check_shape(given, name, names, free)
            return given
        chosen = np.ascontiguousarray(given[:, [names.index(n) for n in free]])
        rates = {"qd": np.zeros_like(chosen), **found, name: chosen}
        closed, units = self.run(function, **rates), self.speed_units
        sizes = np.maximum(largest(closed / units), 1.0) / trust
        off = np.abs(given - closed) / units > NEGLIGIBLE * sizes[:, None]
        if off.any():
            sample, place = np.argwhere(off)[0].tolist()
            what = {"qd": "velocities", "qdd": "accelerations"}[name]
            raise InputError(
                f"the {what} of sample {sample} do not keep the loops closed: '{names[place]}' has "
                f"{given[sample, place]:.6g}, but {closed[sample, place]:.6g} follows from the independent ones; give "
                f"those of the independent coordinates only ({', '.join(free)})"
            )
        return chosen

    def _check_closed(self, q: Floats, trust: Floats) -> None:
        step = largest((self.run("closed_positions", q=q) - q) / self.position_units)
        off = ~(step * trust < NEGLIGIBLE)
        if off.any():
            sample = int(off.argmax())
            problem = self.opening(q[sample])
            raise InputError(
                f"the positions of sample {sample} do not keep the loops closed: {problem}; give those of the "
                f"independent coordinates only ({', '.join(self.mechanism.independent_velocities)})"
            )

    def run(self, name: str, **state: Floats) -> Floats:
        """Evaluate a recorded function at ``q`` of all coordinates, ``qd`` and ``qdd`` of the independent ones."""
        kernel = self._kernels[name]
        names = {argument.name for argument in kernel.function.arguments}
        return kernel(
            {**{k: v for k, v in state.items() if k in names}, **self._geometry[name]}
        )

    @cached_property
    def _kernels(self) -> dict[str, Kernel]:
        made: list[Function] = [build(self.mechanism, ()) for build in self.functions]
        return {function.name: Kernel(function) for function in made}

    @cached_property
    def _geometry(self) -> dict[str, dict[str, Floats]]:
        return {
            n: geometry_values(self.mechanism, k.function.arguments, self.symbols)
            for n, k in self._kernels.items()
        }


def _check_shape(
    values: Floats, kind: str, names: tuple[str, ...], independent: tuple[str, ...]
) -> None:
    """Refuse values that are neither those of all coordinates nor those of the independent ones."""
    if values.ndim != 2 or values.shape[1] != len(independent):
        raise InputError(
            f"{kind} has shape {values.shape}; expected (samples, {len(names)}) for all coordinates "
            f"({', '.join(names)}) or (samples, {len(independent)}) for the independent ones ({', '.join(independent)})"
        )


class ClosedStates:
    """Completes and checks states of a mechanism, whatever the values of its symbols."""

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self._last: tuple[dict[str, float], CompiledAssembly] | None = None

    def independent_state(
        self, values: Mapping[str, npt.ArrayLike], symbols: Mapping[str, float] | None
    ) -> dict[str, Floats]:
        """See :meth:`CompiledAssembly.independent_state`."""
        moving = {
            name: np.atleast_2d(real_array(name, array))
            for name, array in values.items()
        }
        if (
            len({array.shape[:-1] for array in moving.values()}) > 1
            or moving["q"].ndim != 2
        ):
            shown = ", ".join(f"{name} {array.shape}" for name, array in moving.items())
            raise InputError(
                f"expected states of shape (samples, size), as many of each kind; got {shown}"
            )
        if self._last is None or self._last[0] != (symbols or {}):
            self._last = dict(symbols or {}), CompiledAssembly(self.mechanism, symbols)
        return self._last[1].independent_state(moving)


Values = dict[str, npt.ArrayLike]


def function_values(
    mechanism: Mechanism,
    function: Function,
    state: Mapping[str, npt.ArrayLike],
    symbols: Mapping[str, float] | None,
    inputs: Mapping[str, npt.ArrayLike] | None,
    loops: ClosedStates | None = None,
) -> Values:
    """Values of a function's arguments, by name.

    ``state`` is passed on (``q``, ``qd``, ``qdd``, ``parameters``); symbols replace or complete those of the mechanism,
    ``inputs`` are measured ones of shape (N,), and ``loops`` completes the states of a mechanism with loops.
    """
    values: Values = dict(state)
    arguments = {argument.name: argument for argument in function.arguments}
    for name in arguments.keys() & {*STATE, "parameters", STANDARD}:
        value_of(arguments[name], values)
    if loops is not None:
        values |= loops.independent_state(
            {name: state[name] for name in STATE if name in arguments}, symbols
        )
    labels = arguments["symbols"].labels if "symbols" in arguments else ()
    if labels or symbols:
        known = symbol_values(mechanism, labels, symbols)
        if labels:
            values["symbols"] = list(known.values())
    if inputs:
        _check_inputs(mechanism, inputs)
    if "inputs" in arguments:
        values["inputs"] = _measured(arguments["inputs"], inputs or {})
    return values


def _check_inputs(mechanism: Mechanism, inputs: Mapping[str, npt.ArrayLike]) -> None:
    """Refuse measured inputs of coordinates and actuators that there are not; others may belong to other functions."""
    valid = [*mechanism.velocities, *(a.name for a in mechanism.transmission.actuators)]
    strange = next((name for name in inputs if name not in valid), None)
    if strange is not None:
        raise InputError(
            f"inputs has '{strange}'; expected names of {', '.join(dict.fromkeys(valid))}"
        )


def _measured(argument: Argument, inputs: Mapping[str, npt.ArrayLike]) -> Floats:
    """Measured inputs as columns."""
    missing = next((name for name in argument.labels if name not in inputs), None)
    if missing is not None:
        raise InputError(
            f"the measured input i[{missing}] is needed; give it as inputs={{'{missing}': ...}}"
        )
    columns = [
        np.atleast_1d(real_array(f"inputs['{name}']", inputs[name]))
        for name in argument.labels
    ]
    if any(column.ndim != 1 or len(column) != len(columns[0]) for column in columns):
        shapes = ", ".join(str(column.shape) for column in columns)
        raise InputError(
            f"measured inputs must be vectors of equal length; got shapes {shapes}"
        )
    return np.stack(columns, axis=1)


class Evaluator:
    """Machine code of one function of a mechanism.

    Sparse results hold the entries that are not structurally zero.  ``loops`` completes the states of a mechanism with
    loops; without it, states are to be as the function takes them.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        function: Function,
        *,
        sparse: bool = False,
        loops: ClosedStates | None = None,
    ) -> None:
        self.mechanism, self.function, self._loops = mechanism, function, loops
        self.kernel = Kernel(function, sparse=sparse)

    def __call__(
        self,
        state: Mapping[str, npt.ArrayLike],
        symbols: Mapping[str, float] | None = None,
        inputs: Mapping[str, npt.ArrayLike] | None = None,
        out: Floats | None = None,
        threads: int | None = None,
    ) -> Floats:
        """Evaluate at states of shape (N, size), or at one of shape (size,); returns an array of shape (N, …), or (…).

        With loops, each of ``q``, ``qd`` and ``qdd`` may be that of the independent coordinates only.
        """
        values = function_values(
            self.mechanism, self.function, state, symbols, inputs, self._loops
        )
        is_one = all(np.ndim(state[name]) == 1 for name in STATE if name in state)
        if not is_one:
            return self.kernel(values, out, threads)
        found = self.kernel(values, None if out is None else out[None], threads)[0]
        return found if out is None else out
