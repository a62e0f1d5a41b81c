"""R-factors or normal equations of [W y], output by output, in the place of the matrix.

Each output has an R-factor of its own.  That is less work than one factor for all (half for a serial arm), and outputs
can be weighted or left out afterwards: the factor of the stacked and weighted matrix is that of the stacked and
weighted factors.  Normal equations are faster, and good enough where W is well conditioned: their errors grow with the
square of the condition number.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.algebra import Argument, Function
from echelon.compute.observe.triangle import Triangle, positive, upper_triangle
from echelon.shared import Floats, InputError, Integers, public


@dataclass(frozen=True)
class Layout:
    """Rows and columns of [W y], output by output.

    Columns in which an output is structurally zero never enter that output's R-factor: joints of a serial arm do not
    see the bodies before them.
    """

    outputs: tuple[str, ...]
    parameters: tuple[str, ...]
    columns: tuple[
        tuple[int, ...], ...
    ]  # for each output, the parameters that it can depend on, ascending

    @cached_property
    def sizes(self) -> tuple[int, ...]:
        """Rows and columns of each output's R-factor: its parameters and the measured value."""
        return tuple(len(columns) + 1 for columns in self.columns)

    def joined(self, other: Layout) -> Layout:
        """The layout of rows of both: of the same outputs and parameters, with all columns that either has.

        Raises
        ------
        InputError
            If outputs or parameters are others.
        """
        if (self.outputs, self.parameters) != (other.outputs, other.parameters):
            raise InputError(
                "observations of different outputs or parameters cannot be merged"
            )
        pairs = zip(self.columns, other.columns, strict=True)
        columns = tuple(tuple(sorted({*a, *b})) for a, b in pairs)
        return Layout(self.outputs, self.parameters, columns)

    def places(self, output: int) -> list[int]:
        """Columns of an output's factor among those of [W y]: its parameters, then y."""
        return [*self.columns[output], len(self.parameters)]


def measured(function: Function, name: str = "y") -> Function:
    """A regressor of shape (m, n) with the measured outputs, an argument of this name, as one more column."""
    if len(function.axes) != 2:
        raise InputError(
            f"{function} is not a regressor: expected a result of shape (outputs, parameters)"
        )
    if any(argument.name == name for argument in function.arguments):
        raise InputError(
            f"{function} already has an argument '{name}': choose another name for the measured outputs"
        )
    outputs, parameters = function.axes
    nodes = tuple(function.program.input(f"{name}[{label}]").node for label in outputs)
    units = function.units or ("",) * len(outputs)
    argument = Argument(name, nodes, outputs, units, "measured outputs")
    entries = dict(function.entries) | {
        (i, len(parameters)): node for i, node in enumerate(nodes)
    }
    axes = (outputs, (*parameters, name))
    return replace(
        function, arguments=(*function.arguments, argument), entries=entries, axes=axes
    )


def layout_of(function: Function) -> tuple[Layout, Integers]:
    """The layout of a regressor with measured outputs, and for each output's columns the entries of the function."""
    outputs, columns = function.axes
    entry = {index: e for e, index in enumerate(function.entries)}
    last = len(columns) - 1
    by_output = [
        sorted(column for row, column in function.entries if row == output)
        for output in range(len(outputs))
    ]
    numbers = [
        entry[output, column]
        for output, some in enumerate(by_output)
        for column in some
    ]
    kept = tuple(
        tuple(column for column in some if column != last) for some in by_output
    )
    return Layout(outputs, columns[:-1], kept), np.array(numbers, dtype=np.int64)


def restricted(
    layout: Layout, parameters: Sequence[int]
) -> tuple[Layout, list[list[int]]]:
    """The layout of some parameters, in the given order, and for each output the places of its columns."""
    count = len(layout.parameters)
    wrong = [p for p in parameters if not 0 <= p < count]
    if wrong or len(set(parameters)) != len(parameters):
        problem = (
            f"there is no parameter {wrong[0]}"
            if wrong
            else "a parameter is given twice"
        )
        raise InputError(f"{problem}; expected different numbers from 0 to {count - 1}")
    kept, places = [], []
    for columns in layout.columns:
        position = {parameter: i for i, parameter in enumerate(columns)}
        new = [k for k, parameter in enumerate(parameters) if parameter in position]
        kept.append(tuple(new))
        places.append([*(position[parameters[k]] for k in new), len(columns)])
    labels = tuple(layout.parameters[p] for p in parameters)
    return Layout(layout.outputs, labels, tuple(kept)), places


_FEWEST_DIGITS = 1e-14  # smaller squares of pivots, with columns of norm 1, are mostly rounding errors


@public
@dataclass(frozen=True, repr=False)
class Observation:
    """R-factors of the outputs' rows of [W y].

    Attributes
    ----------
    layout : Layout
    factors : tuple of array of shape (n_i + 1, n_i + 1)
        For each output the triangle R_i of its own columns and y, with a diagonal that is not negative.
    counts : tuple of int
        Rows of each output: the samples, unless some were left out for some outputs.
    """

    layout: Layout
    factors: tuple[Floats, ...]
    counts: tuple[int, ...]

    @property
    def rows(self) -> int:
        """Rows of W."""
        return sum(self.counts)

    @property
    def samples(self) -> int:
        """Samples, the largest number of rows of any output."""
        return max(self.counts, default=0)

    @cached_property
    def residuals(self) -> Floats:
        """Norm of each output's residual when its own rows alone are fitted, shape (m,)."""
        return np.array([abs(R[-1, -1]) for R in self.factors])

    def misfits(self, values: Sequence[float] | Floats) -> Floats:
        """Norm of each output's rows of W ζ − y.

        Parameters
        ----------
        values : array of shape (n,)
            Parameters ζ.

        Returns
        -------
        array of shape (m,)

        Raises
        ------
        InputError
            If the number of parameters is wrong.
        """
        zeta = np.asarray(values, dtype=float)
        if zeta.shape != (len(self.layout.parameters),):
            raise InputError(
                f"expected {len(self.layout.parameters)} parameters, got an array of shape {zeta.shape}"
            )
        full = np.append(zeta, -1.0)
        return np.array(
            [
                np.linalg.norm(R @ full[self.layout.places(i)])
                for i, R in enumerate(self.factors)
            ]
        )

    def moved(self, change: Floats) -> Observation:
        """The observation of y + W times a change of the parameters (n,), as if they had been so much larger."""
        moves = (
            np.append(change, 1.0)[self.layout.places(i)]
            for i in range(len(self.factors))
        )
        factors = tuple(
            np.column_stack([R[:, :-1], R @ move])
            for R, move in zip(self.factors, moves, strict=True)
        )
        return Observation(self.layout, factors, self.counts)

    # -- combining ---------------------------------------------------------------------------------------------

    def __add__(self, other: Observation) -> Observation:
        """The observation of both sets of samples; refuses other outputs or parameters."""
        if self.layout != other.layout:
            layout = self.layout.joined(other.layout)
            return self.extended(layout) + other.extended(layout)
        pairs = zip(self.factors, other.factors, strict=True)
        factors = tuple(upper_triangle(*pair) for pair in pairs)
        counts = tuple(a + b for a, b in zip(self.counts, other.counts, strict=True))
        return Observation(self.layout, factors, counts)

    def extended(self, layout: Layout) -> Observation:
        """The observation with more columns, of parameters that its rows do not depend on.

        Parameters
        ----------
        layout : Layout
            An observation of the same outputs, with all columns of this one.

        Returns
        -------
        Observation
        """
        factors = []
        for R, old, new in zip(
            self.factors, self.layout.columns, layout.columns, strict=True
        ):
            full = np.zeros((len(R), len(new) + 1))
            full[:, [*(new.index(c) for c in old), len(new)]] = R
            factors.append(upper_triangle(full))
        return Observation(layout, tuple(factors), self.counts)

    def combined(self, weights: Sequence[float] | Floats | None = None) -> Triangle:
        """The R-factor of all outputs' rows together.

        Parameters
        ----------
        weights : array of shape (m,), optional
            Factor of each output's rows, such as 1/σ of its noise; 0 leaves an output out.  All 1 if omitted.

        Returns
        -------
        Triangle

        Raises
        ------
        InputError
            If weights have a wrong shape or are negative or not finite.
        """
        w = checked_weights(self.layout, weights)
        n = len(self.layout.parameters)
        rows = []
        for output, (R, weight) in enumerate(zip(self.factors, w, strict=True)):
            full = np.zeros((len(R), n + 1))
            full[:, self.layout.places(output)] = weight * R
            rows.append(full)
        whole = upper_triangle(np.zeros((0, n + 1)), *rows)
        used = sum(
            count for count, weight in zip(self.counts, w, strict=True) if weight
        )
        return Triangle(
            self.layout.parameters,
            whole[:n, :n],
            whole[:n, n],
            float(abs(whole[n, n])),
            self.samples,
            used,
        )

    def select(self, parameters: Sequence[int]) -> Observation:
        """The observation of some parameters only, the others taken to be zero.

        Parameters
        ----------
        parameters : sequence of int
            Numbers of the parameters to keep, in the order they shall have.

        Raises
        ------
        InputError
            If a parameter does not exist or is given twice.
        """
        layout, places = restricted(self.layout, parameters)
        factors = tuple(
            upper_triangle(R[:, columns])
            for R, columns in zip(self.factors, places, strict=True)
        )
        return Observation(layout, factors, self.counts)

    @staticmethod
    def of(layout: Layout, factors: Sequence[Floats], samples: int) -> Observation:
        """The observation of ``samples`` samples with given triangles, whose diagonals may have any signs."""
        return Observation(
            layout,
            tuple(positive(R) for R in factors),
            (samples,) * len(layout.outputs),
        )

    def __repr__(self) -> str:
        m, n = len(self.layout.outputs), len(self.layout.parameters)
        return f"Observation({self.samples} samples × {m} outputs × {n} parameters)"


@public
@dataclass(frozen=True, repr=False)
class NormalEquations:
    """Gram matrices of the outputs' rows of [W y].

    Attributes
    ----------
    layout : Layout
    grams : tuple of array of shape (n_i + 1, n_i + 1)
        For each output that of its own columns and y.
    samples : int
    """

    layout: Layout
    grams: tuple[Floats, ...]
    samples: int

    def __add__(self, other: NormalEquations) -> NormalEquations:
        """The normal equations of both sets of samples; refuses other outputs or parameters."""
        if self.layout != other.layout:
            raise InputError(
                "normal equations of different outputs or parameters cannot be merged"
            )
        grams = tuple(a + b for a, b in zip(self.grams, other.grams, strict=True))
        return NormalEquations(self.layout, grams, self.samples + other.samples)

    def combined(
        self, weights: Sequence[float] | Floats | None = None
    ) -> tuple[Floats, Floats, float]:
        """WᵀW, Wᵀy and yᵀy of all outputs' rows together.

        Parameters
        ----------
        weights : array of shape (m,), optional
            Factor of each output's rows; all 1 if omitted.

        Returns
        -------
        (array of shape (n, n), array of shape (n,), float)
        """
        n = len(self.layout.parameters)
        total = np.zeros((n + 1, n + 1))
        for output, (gram, weight) in enumerate(
            zip(self.grams, checked_weights(self.layout, weights), strict=True)
        ):
            places = self.layout.places(output)
            total[np.ix_(places, places)] += weight**2 * gram
        return total[:n, :n], total[:n, n], float(total[n, n])

    def solve(self, weights: Sequence[float] | Floats | None = None) -> Floats:
        """The least-squares solution, by Cholesky's method with columns scaled to norm 1.

        Parameters
        ----------
        weights : array of shape (m,), optional
            Factor of each output's rows; all 1 if omitted.

        Returns
        -------
        array of shape (n,)

        Raises
        ------
        InputError
            If the matrix cannot be told from a singular one.
        """
        gram, moment, _ = self.combined(weights)
        scales = np.sqrt(np.diagonal(gram))
        safe = np.where(scales == 0, 1.0, scales)
        try:
            L = np.linalg.cholesky(gram / safe[:, None] / safe)
            singular = np.diagonal(L).min(initial=1.0) ** 2 < _FEWEST_DIGITS * len(L)
        except np.linalg.LinAlgError:
            singular = True
        if singular:
            raise InputError(
                "the normal equations are singular to half the digits of a double; use the R-factors, which keep all"
            )
        return np.linalg.solve(L.T, np.linalg.solve(L, moment / safe)) / safe

    def __repr__(self) -> str:
        m, n = len(self.layout.outputs), len(self.layout.parameters)
        return f"NormalEquations({self.samples} samples × {m} outputs × {n} parameters)"


def checked_weights(layout: Layout, weights: Sequence[float] | Floats | None) -> Floats:
    """Weights of the outputs, shape (m,): finite and not negative, or 1 where none are given."""
    m = len(layout.outputs)
    w = np.ones(m) if weights is None else np.asarray(weights, dtype=float)
    if w.shape != (m,):
        raise InputError(
            f"weights have shape {w.shape}; expected ({m},), one for each of {', '.join(layout.outputs)}"
        )
    if not np.isfinite(w).all() or (w < 0).any():
        raise InputError("weights must be finite numbers that are not negative")
    return w
