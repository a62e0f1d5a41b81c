"""Predictions of a log: what an identified model says the outputs were."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.rows.plan import Plan
from echelon.identification.rows.rows import rows_taken

_ROUNDINGS = 64.0  # of a constant, that filters leave


@dataclass(frozen=True, repr=False)
class Prediction:
    """Predicted outputs of a log, after the filter of both sides.

    Attributes
    ----------
    source : str
    outputs, units : tuple of str
    time : array of shape (N,)
        s.
    predicted : array of shape (N, m)
    measured : array of shape (N, m), optional
        Where the log has outputs; filtered like the prediction.
    """

    source: str
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    time: Floats
    predicted: Floats
    measured: Floats | None

    def scores(self) -> tuple[list[float | None], list[float | None]]:
        """Root mean square of measured − predicted, and R², of every output; None where there is nothing to explain."""
        if self.measured is None:
            return [None] * len(self.outputs), [None] * len(self.outputs)
        squares = np.sum((self.measured - self.predicted) ** 2, axis=0)
        spread = np.sum((self.measured - self.measured.mean(axis=0)) ** 2, axis=0)
        rounding = len(self.measured) * (_ROUNDINGS * np.finfo(float).eps * np.abs(self.measured).max(axis=0)) ** 2
        rms = np.sqrt(squares / len(self.measured))
        r2 = [
            None if total <= least else float(1 - part / total)
            for part, total, least in zip(squares, spread, rounding, strict=True)
        ]
        return [float(value) for value in rms], r2

    def __repr__(self) -> str:
        return f"Prediction({self.source}: {len(self.time)} samples × {len(self.outputs)} outputs)"


def predict_log(plan: Plan, values: npt.ArrayLike, path: str | Path) -> Prediction:
    """Predict the outputs of a log.

    Parameters
    ----------
    plan : Plan
        How the log is read and prepared.
    values : array of shape (r,)
        Base parameters, SI units.
    path : path
        A log of positions; measured outputs need not be there.

    Returns
    -------
    Prediction

    Raises
    ------
    InputError
        If the log cannot be read, or nothing of it is left after its preparation.
    """
    model = plan.rows([path])
    times, predicted, measured = [], [], []
    for samples in plan.samples(path, outputs=False):
        whole = model.predict(samples, values)
        time, rows, _ = rows_taken(samples, whole)
        times.append(time)
        predicted.append(rows)
        if samples.y is not None:
            measured.append(rows_taken(samples, samples.y)[1])
    if not any(len(time) for time in times):
        raise InputError("nothing of this log is left after its preparation", source=str(path))
    outputs = plan.base.mechanism.outputs
    return Prediction(
        str(path),
        tuple(output.name for output in outputs),
        tuple(output.unit for output in outputs),
        np.concatenate(times),
        np.concatenate(predicted),
        np.concatenate(measured) if measured else None,
    )
