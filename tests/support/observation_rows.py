"""Rows of an observation matrix that lie in memory, for tests of what comes after the logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.compute.observe.observation import Layout, Observation
from echelon.compute.observe.triangle import upper_triangle
from echelon.identification.rows.rows import RowBlock
from echelon.identification.scores import Fit, Validation
from echelon.identification.validation import Predicted, PredictedOutput, validate

Floats = npt.NDArray[np.float64]


class ArrayRows:
    """Rows from arrays; every output has its own number of rows.

    Parameters
    ----------
    matrices : sequence of array of shape (k_i, n_i)
        For each output, its columns of the regressor; of shape (k_i, n) if ``columns`` is omitted.
    y : sequence of array of shape (k_i,)
    columns : sequence of sequence of int, optional
        For each output, the parameters that it can depend on; all of them if omitted.
    times : sequence of array of shape (k_i,), optional
        Ascending, s; 1 ms apart if omitted.
    parameters, outputs, units, output_units : sequence of str, optional
        ``p1``, ``p2``, … in kg·m² and ``joint1``, … in N·m if omitted.
    breaks : sequence of float
        Times at which a new uninterrupted stretch begins.
    seconds : float, optional
        Length of a block; every stretch is one block if omitted.
    source : str
    """

    def __init__(
        self,
        matrices: Sequence[npt.ArrayLike],
        y: Sequence[npt.ArrayLike],
        *,
        columns: Sequence[Sequence[int]] | None = None,
        times: Sequence[npt.ArrayLike] | None = None,
        parameters: Sequence[str] | None = None,
        outputs: Sequence[str] | None = None,
        units: Sequence[str] | None = None,
        output_units: Sequence[str] | None = None,
        breaks: Sequence[float] = (),
        seconds: float | None = None,
        source: str = "arrays",
    ) -> None:
        self.matrices = tuple(np.asarray(some, dtype=float) for some in matrices)
        self.y = tuple(np.asarray(some, dtype=float) for some in y)
        if columns is None:
            columns = [range(matrix.shape[1]) for matrix in self.matrices]
        if parameters is None:
            parameters = [
                f"p{j + 1}"
                for j in range(1 + max(max(some, default=-1) for some in columns))
            ]
        if outputs is None:
            outputs = [f"joint{i + 1}" for i in range(len(self.y))]
        self.layout = Layout(
            tuple(outputs),
            tuple(parameters),
            tuple(tuple(map(int, some)) for some in columns),
        )
        self.units = tuple(units or ["kg·m²"] * len(parameters))
        self.output_units = tuple(output_units or ["N·m"] * len(outputs))
        given = (
            [1e-3 * np.arange(len(some)) for some in self.y] if times is None else times
        )
        self.times = tuple(np.asarray(some, dtype=float) for some in given)
        for matrix, some, measured, when in zip(
            self.matrices, columns, self.y, self.times, strict=True
        ):
            assert matrix.shape == (len(measured), len(some))
            assert when.shape == measured.shape
        self.breaks, self.seconds, self.source = tuple(sorted(breaks)), seconds, source

    @staticmethod
    def of(
        W: npt.ArrayLike,
        y: npt.ArrayLike,
        pattern: npt.ArrayLike | None = None,
        *,
        keep: npt.ArrayLike | None = None,
        times: npt.ArrayLike | None = None,
        **options: object,
    ) -> ArrayRows:
        """Rows of W of shape (N, m, n) and y of shape (N, m).

        Parameters
        ----------
        W, y : array
        pattern : array of bool of shape (m, n), optional
            Entries that are not structurally zero.
        keep : array of bool of shape (N, m), optional
            Rows to take; all if omitted.
        times : array of shape (N,), optional
        options
            As for the constructor.
        """
        W, y = np.asarray(W, dtype=float), np.asarray(y, dtype=float)
        N, m, n = W.shape
        shape = (
            np.ones((m, n), dtype=bool)
            if pattern is None
            else np.asarray(pattern, dtype=bool)
        )
        taken = (
            np.ones((N, m), dtype=bool)
            if keep is None
            else np.asarray(keep, dtype=bool)
        )
        when = 1e-3 * np.arange(N) if times is None else np.asarray(times, dtype=float)
        named: dict[str, object] = {
            "parameters": [f"p{j + 1}" for j in range(n)],
            **options,
        }
        return ArrayRows(
            [W[taken[:, i], i][:, shape[i]] for i in range(m)],
            [y[taken[:, i], i] for i in range(m)],
            columns=[np.flatnonzero(shape[i]).tolist() for i in range(m)],
            times=[when[taken[:, i]] for i in range(m)],
            **named,  # type: ignore[arg-type]
        )

    def blocks(self) -> Iterator[RowBlock]:
        """All rows, in the order of time."""
        start = min((some[0] for some in self.times if some.size), default=0.0)
        end = max((some[-1] for some in self.times if some.size), default=0.0)
        stretches = [start, *(b for b in self.breaks if start < b <= end), np.inf]
        for segment, (first, last) in enumerate(pairwise(stretches)):
            edges = [first, last]
            if self.seconds is not None:
                count = 1 + int((min(last, end) - first) / self.seconds)
                inner = first + self.seconds * np.arange(1, count)
                edges = [first, *inner[inner < last], last]
            for low, high in pairwise(edges):
                inside = [(some >= low) & (some < high) for some in self.times]
                yield RowBlock(
                    self.source,
                    segment,
                    tuple(some[k] for some, k in zip(self.times, inside, strict=True)),
                    tuple(
                        some[k] for some, k in zip(self.matrices, inside, strict=True)
                    ),
                    tuple(some[k] for some, k in zip(self.y, inside, strict=True)),
                )

    def observation(self) -> Observation:
        """The R-factors of all rows."""
        pairs = zip(self.matrices, self.y, strict=True)
        factors = tuple(
            upper_triangle(np.column_stack([matrix, y])) for matrix, y in pairs
        )
        return Observation(self.layout, factors, tuple(len(some) for some in self.y))


def judged_rows(
    rows: ArrayRows,
    values: npt.ArrayLike,
    prior: npt.ArrayLike | None = None,
    **options: Any,
) -> Validation:
    """Validation of a model with given parameters on rows."""
    models = {"model": values, **({} if prior is None else {"prior": prior})}
    outputs = list(zip(rows.layout.outputs, rows.output_units, strict=True))
    return validate(
        _signals(rows, list(models.values())), outputs, tuple(models), **options
    )


def _signals(rows: ArrayRows, models: Sequence[npt.ArrayLike]) -> Iterator[Predicted]:
    values = np.array(models, dtype=float).T
    for block in rows.blocks():
        parts = zip(
            block.times, block.y, block.matrices, rows.layout.columns, strict=True
        )
        outputs = (
            PredictedOutput(t, y, M @ values[list(k)], np.ones(len(y), dtype=bool))
            for t, y, M, k in parts
        )
        yield Predicted(block.source, block.segment, tuple(outputs))


def fit_of(
    rms: float, r2: float, bias: float = 0.0, rows: int = 100, percent: float = 1.0
) -> Fit:
    """A fit with given figures, of values around zero."""
    deviation = 0.0 if np.isnan(r2) else rms / np.sqrt(1 - r2) if r2 < 1 else 1.0
    return Fit(rows, rms, bias, 0.0, deviation, 0.0, 100 * rms / percent)
