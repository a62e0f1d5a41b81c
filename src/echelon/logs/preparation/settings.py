"""Settings of the preparation of logs: what is filtered, how it is differentiated, and what is left out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

Derivative = Literal["central", "savitzky_golay", "fourier"]
FilterKind = Literal["fir", "butterworth", "chebyshev"]


@dataclass(frozen=True)
class Preparation:
    """How a log becomes samples for least squares.  What is None is chosen from the data.

    Attributes
    ----------
    cutoff : float, optional
        Cut-off of the zero-phase low-pass over positions before they are differentiated, Hz; ``inf`` for none.
    order : int
        Order of that Butterworth filter, run forwards and backwards.
    derivative : str
        ``"central"`` differences, ``"savitzky_golay"`` (smooths and differentiates; ``cutoff`` says how much), or
        ``"fourier"`` for periodic motions.
    measured : tuple of "qd", "qdd"
        Which derivatives are taken from the log, where it has them, instead of from positions.
    period : float, optional
        Of a periodic motion, s, for ``"fourier"``; found from the data if None.
    average : bool
        Average a periodic motion over its periods first.
    output_cutoff : float, optional
        Cut-off of the filter that goes over both sides of the equation, regressor and outputs, Hz; ``inf`` for none.
    output_filter : str
        Its kind: ``"fir"`` (symmetric, finite), ``"butterworth"`` or ``"chebyshev"`` (forwards and backwards).
    decimation : tuple of int, optional
        Factors by which both sides are decimated, one stage after another; ``()`` for none.
    still : float or mapping of str to float, optional
        Speed below which an output's rows are left out (of all outputs, or by output), because dry friction is
        undetermined near rest; 0 for none.
    delays : mapping of str to float, optional
        Delay of outputs behind positions, s, which is undone; None to estimate.
    trim : float
        Time left out at both ends of a segment, s, besides what the filters spoil.
    rate : float, optional
        Rate to which segments are resampled, Hz; that of the log if None.
    chosen_at : float, optional
        Rate of the logs that choices were made from, Hz.  A log of another rate is decimated to the same density of
        rows, and not filtered above its own band.
    reasons : mapping of str to str
        For settings that were chosen: why, in a sentence.
    """

    cutoff: float | None = None
    order: int = 4
    derivative: Derivative = "central"
    measured: tuple[str, ...] = ()
    period: float | None = None
    average: bool = False
    output_cutoff: float | None = None
    output_filter: FilterKind = "fir"
    decimation: tuple[int, ...] | None = None
    still: float | Mapping[str, float] | None = None
    delays: Mapping[str, float] | None = None
    trim: float = 0.0
    rate: float | None = None
    chosen_at: float | None = None
    reasons: Mapping[str, str] = field(default_factory=dict)
