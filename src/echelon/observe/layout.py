"""What the columns of an observation are: which parameters each output can depend on, and where the outputs stand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.arrays import Integers
from echelon.errors import InputError
from echelon.program.function import Argument, Function


@dataclass(frozen=True)
class Layout:
    """Rows and columns of [W y], output by output.

    Columns in which an output is structurally zero never enter that output's R-factor: joints of a serial arm do not
    see the bodies before them.
    """

    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    columns: tuple[tuple[int, ...], ...]
    """For each output, the parameters that it can depend on, ascending."""

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Rows and columns of each output's R-factor: its parameters and the measured value."""
        return tuple(len(columns) + 1 for columns in self.columns)

    def places(self, output: int) -> list[int]:
        """Columns of an output's factor among those of [W y]: its parameters, then y."""
        return [*self.columns[output], len(self.parameters)]


def measured(function: Function, name: str = "y") -> Function:
    """A regressor of shape (m, n) with the measured outputs, an argument of this name, as one more column."""
    if len(function.axes) != 2:
        raise InputError(f"{function} is not a regressor: expected a result of shape (outputs, parameters)")
    if any(argument.name == name for argument in function.arguments):
        raise InputError(f"{function} already has an argument '{name}': choose another name for the measured outputs")
    outputs, parameters = function.axes
    nodes = tuple(function.program.input(f"{name}[{label}]").node for label in outputs)
    units = function.units or ("",) * len(outputs)
    argument = Argument(name, nodes, outputs, units, "measured outputs")
    entries = dict(function.entries) | {(i, len(parameters)): node for i, node in enumerate(nodes)}
    axes = (outputs, (*parameters, name))
    return replace(function, arguments=(*function.arguments, argument), entries=entries, axes=axes)


def layout_of(function: Function) -> tuple[Layout, Integers]:
    """The layout of a regressor with measured outputs, and for each output's columns the entries of the function."""
    outputs, columns = function.axes
    entry = {index: e for e, index in enumerate(function.entries)}
    last = len(columns) - 1
    by_output = [sorted(column for row, column in function.entries if row == output) for output in range(len(outputs))]
    numbers = [entry[output, column] for output, some in enumerate(by_output) for column in some]
    kept = tuple(tuple(column for column in some if column != last) for some in by_output)
    return Layout(outputs, columns[:-1], kept), np.array(numbers, dtype=np.int64)


def restricted(layout: Layout, parameters: Sequence[int]) -> tuple[Layout, list[list[int]]]:
    """The layout of some parameters, in the given order, and for each output the places of its columns."""
    count = len(layout.parameters)
    wrong = [p for p in parameters if not 0 <= p < count]
    if wrong or len(set(parameters)) != len(parameters):
        problem = f"there is no parameter {wrong[0]}" if wrong else "a parameter is given twice"
        raise InputError(f"{problem}; expected different numbers from 0 to {count - 1}")
    kept, places = [], []
    for columns in layout.columns:
        position = {parameter: i for i, parameter in enumerate(columns)}
        new = [k for k, parameter in enumerate(parameters) if parameter in position]
        kept.append(tuple(new))
        places.append([*(position[parameters[k]] for k in new), len(columns)])
    labels = tuple(layout.parameters[p] for p in parameters)
    return Layout(layout.outputs, labels, tuple(kept)), places
