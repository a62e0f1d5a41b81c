"""Predictions of a log: what an identified model says the outputs were, row by row of the log.

States are known on the clocks of the log's stretches; what is predicted there is interpolated to the log's own time
stamps.  Rows near the ends of a stretch, where filters and derivatives lack neighbours, are left out here as they are
left out of every fit and score.  The scores are those of validation: of the same log they are the same numbers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.finding import Finding, note, warning
from echelon.identification.logs.preparation.prepare import (
    Preparation,
    PreparationPlan,
    states,
    states_reach,
    usable,
    with_bristles,
)
from echelon.identification.logs.read_log import LogPiece, read_log
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.plan import LogPlan
from echelon.identification.rows.rows import ModelRows
from echelon.identification.rows.travels import (
    UNKNOWN,
    Travel,
    beyond,
    joined,
    travels_of,
)
from echelon.identification.scores import Score
from echelon.identification.validation import validated
from echelon.shared import Flags, Floats, InputError, public


@dataclass(frozen=True, repr=False)
class Prediction:
    """Predicted outputs of a log, at every row of it.

    Attributes
    ----------
    source : str
    outputs, units : tuple of str
    time : array of shape (N,)
        Time stamps of the log, s.
    predicted : array of shape (N, m)
        nan where nothing can be predicted: near the ends of stretches, and in rows that were left out as faulty.
    near_ends : array of bool, shape (N,)
        Rows without prediction because filters and derivatives of positions lack neighbours there.
    measured : array of shape (N, m), optional
        As logged, where the log has outputs.
    scores : tuple of Score
        One per output, where the log has outputs; those of :func:`echelon.identify` for the same log.
    findings : tuple of Finding
        Motions far beyond those that the model was fitted to, or a note that these are not known.
    """

    source: str
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    time: Floats
    predicted: Floats
    near_ends: Flags
    measured: Floats | None
    scores: tuple[Score, ...] = ()
    findings: tuple[Finding, ...] = ()

    def __repr__(self) -> str:
        return f"Prediction({self.source}: {len(self.time)} samples × {len(self.outputs)} outputs)"


@public
def predict_log(plan: LogPlan, values: npt.ArrayLike, path: str | Path) -> Prediction:
    """Predict the outputs of a log, at every row of it.

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
        If the log cannot be read, or nothing of it can be predicted.
    """
    model, zeta = plan.rows([path]), np.asarray(values, dtype=float)
    recordings, predicted, near_ends = [], [], []
    travels: list[Travel] = []
    rate, own = plan.preparation.rate, ""
    mechanism = plan.base.mechanism
    for piece in read_log(
        path, plan.base.mechanism, plan.columns, rate=rate, outputs=False
    ):
        mechanism, own = piece.mechanism, piece.experiment
        if mechanism.contacts:
            raise InputError(
                "the outputs hold forces at contacts that nobody knows, so that they cannot be predicted: give the log to "
                "identify with --validate, which scores what no contact force enters",
                source=str(path),
            )
        recordings.append(piece.recording)
        outputs, ends = _at_rows(plan, model, zeta, piece, travels)
        predicted.append(outputs)
        near_ends.append(ends)
    if not any(np.isfinite(some).any() for some in predicted):
        problem = "nothing of this log can be predicted: its stretches without gaps are too short"
        raise InputError(problem, source=str(path))
    measured = [some.signals["y"] for some in recordings if "y" in some.signals]
    names = [output.name for output in mechanism.outputs]
    return Prediction(
        str(path),
        tuple(f"{own}.{name}" if own else name for name in names),
        tuple(output.unit for output in mechanism.outputs),
        np.concatenate([some.time for some in recordings]),
        np.concatenate(predicted),
        np.concatenate(near_ends),
        np.concatenate(measured) if measured else None,
        validated(model, plan.samples(path), {"model": zeta}, role="validation").scores
        if measured
        else (),
        tuple(_beyond(plan, travels, str(path))),
    )


def _beyond(plan: LogPlan, travels: Sequence[Travel], source: str) -> Iterator[Finding]:
    """Where the log goes far beyond what the model was fitted to."""
    if plan.travels is None:
        yield note("beyond", source, UNKNOWN)
        return
    for text in beyond(plan.base, plan.travels, travels):
        yield warning("beyond", source, text)


def _at_rows(
    plan: LogPlan,
    model: ModelRows,
    values: Floats,
    piece: LogPiece,
    travels: list[Travel],
) -> tuple[Floats, Flags]:
    """Predicted outputs at the time stamps of a piece, shape (N, m), and which rows are near ends of stretches.

    The travels of the piece join the others.
    """
    time, outputs = piece.recording.time, piece.mechanism.outputs
    preparation = plan.preparation.of(piece.experiment)
    found = np.full((len(time), len(outputs)), np.nan)
    near_ends = np.zeros(len(time), dtype=bool)
    delays = [(preparation.delays or {}).get(output.name, 0.0) for output in outputs]
    for samples in _stretches(preparation, piece):
        start, rate = samples.start, samples.rate
        travels[:] = joined([*travels, *travels_of(piece.mechanism, samples)])
        guess = model.predict(samples, values)
        guess[: samples.first] = guess[samples.end :] = np.nan
        clock = start + np.arange(len(guess)) / rate
        rows = np.flatnonzero(
            (time > clock[0] - 0.5 / rate) & (time < clock[-1] + 0.5 / rate)
        )
        # what was predicted shows in an output that is late
        for k, delay in enumerate(delays):
            found[rows, k] = np.interp(time[rows] - delay, clock, guess[:, k])
        near_ends[rows] = np.isnan(found[rows]).any(axis=1)
    return found, near_ends


def _stretches(preparation: Preparation, piece: LogPiece) -> Iterator[Samples]:
    """Samples of the stretches of a piece, of which those count whose states the ends do not spoil."""
    mechanism = piece.mechanism
    for segment in piece.segments:
        part = usable(segment, mechanism)
        plan = PreparationPlan(preparation, mechanism, part.rate)
        spoilt = min(states_reach(part.rate, preparation), len(part))
        samples = Samples(
            part.source,
            part.start,
            part.rate,
            *states(part, preparation, mechanism),
            None,
            part.inputs,
            plan.reduction,
            spoilt,
            max(len(part) - spoilt, spoilt),
            experiment=piece.experiment,
        )
        yield with_bristles(samples, mechanism)
