"""Validation: measured against predicted outputs, on data the fit did not see."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """One output of one log, after the filter of both sides.

    Attributes
    ----------
    output, unit : str
    time, measured, predicted : arrays of shape (k,)
    prior : array of shape (k,), optional
        Prediction of the model one had before.
    """

    output: str
    unit: str
    time: Floats
    measured: Floats
    predicted: Floats
    prior: Floats | None = None


@dataclass(frozen=True)
class Score:
    """How well a prediction fits one output.

    Attributes
    ----------
    output, unit : str
    rows : int
    rms : float
        Root mean square of measured − predicted, unit of the output.
    percent : float
        The same in per cent of the range of the measured values.
    r2 : float
        Coefficient of determination 1 − Σ(y − ŷ)² / Σ(y − ȳ)²; nan where y is constant.
    bias : float
        Mean of measured − predicted.
    correlation_time : float
        Integrated autocorrelation time of the residual, s: how far it is from white.
    whiteness : float
        Probability that white noise has autocorrelations this large (Ljung–Box).
    """

    output: str
    unit: str
    rows: int
    rms: float
    percent: float
    r2: float
    bias: float
    correlation_time: float
    whiteness: float


@dataclass(frozen=True)
class Validation:
    """A model's predictions of one log.

    Attributes
    ----------
    source : str
        The log.
    role : str
        ``"identification"`` or ``"validation"``: whether the fit saw it.
    scores : tuple of Score
        Of the model, one per output.
    prior_scores : tuple of Score
        Of the prior model on the same data; empty without one.
    traces : tuple of Trace
    verdict : str
        In words.
    """

    source: str
    role: str
    scores: tuple[Score, ...]
    prior_scores: tuple[Score, ...]
    traces: tuple[Trace, ...]
    verdict: str
