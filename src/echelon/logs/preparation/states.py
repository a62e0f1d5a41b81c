"""States from positions: filtered and differentiated, each coordinate by its kind.

Positions of a free rotation are quaternions, whose derivatives become the angular velocity in the moved body's axes.
With loops the independent coordinates are enough, and they alone: filtering all of them would open the loops.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import ceil, isfinite, pi

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.logs.columns.quantities import motion_of, quaternion_columns, signal_names
from echelon.logs.preparation.settings import Preparation
from echelon.logs.recording import Segment
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.derivatives import (
    CENTRAL_REACH,
    body_rates,
    central,
    continuous,
    fourier,
    savitzky_golay,
    savitzky_golay_window,
)
from echelon.signals.filters import FAR, butterworth, lowpass

States = tuple[Floats, Floats, Floats]

_ROUNDINGS = 8.0  # of a position, that add up in its derivatives
MEASURED = ("qd", "qdd")
"""Derivatives that may be taken from a log."""


def usable(segment: Segment, mechanism: Mechanism, before: Mapping[str, Floats] | None = None) -> Segment:
    """A segment with the coordinates that states are made of, and quaternions that continue those of ``before``."""
    q = segment.signals["q"]
    whole, few = len(mechanism.positions), len(mechanism.independent_velocities)
    if q.ndim != 2 or q.shape[1] not in ((whole, few) if mechanism.closures else (whole,)):
        raise InputError(f"expected positions of {', '.join(mechanism.positions)}", source=segment.source)
    signals = dict(segment.signals)
    if mechanism.closures and q.shape[1] == whole and _scalar(mechanism):
        for name, order in (("q", mechanism.positions), *((name, mechanism.velocities) for name in MEASURED)):
            if name in signals and signals[name].shape[1] == len(order):
                signals[name] = signals[name][:, [order.index(c) for c in mechanism.independent_velocities]]
    columns = signals["q"].shape[1]
    for first in quaternion_columns(mechanism, "q", columns):
        some = slice(first, first + 4)
        signals["q"] = signals["q"].copy()
        last = None if before is None else before["q"][-1, some]
        signals["q"][:, some] = continuous(signals["q"][:, some], last)
    return replace(segment, signals=signals)


def _scalar(mechanism: Mechanism) -> bool:
    """Whether every independent velocity has a position of its own."""
    motions = [motion_of(mechanism, name) for name in mechanism.independent_velocities]
    return all(motion is not None and motion.kind is not MotionKind.BALL for motion in motions)


def velocity_names(mechanism: Mechanism, columns: int) -> tuple[str, ...]:
    """Names of the velocities that belong to ``columns`` positions of a usable segment."""
    names = signal_names(mechanism, "q", columns)
    return mechanism.velocities if names == mechanism.positions else mechanism.independent_velocities


def states(segment: Segment, preparation: Preparation, mechanism: Mechanism) -> States:
    """Positions (N, positions), velocities and accelerations (N, velocities) of a usable segment, filtered alike."""
    rate = segment.rate
    x, xd, xdd = _without_rounding(*differentiated(segment.signals["q"], rate, preparation), rate, preparation)
    balls = quaternion_columns(mechanism, "q", x.shape[1])
    q, qd, qdd = _by_kind(x, xd, xdd, balls)
    measured = {name: _measured(segment, name) for name in preparation.measured}
    if "qd" in measured:
        qd, from_velocity, _ = differentiated(measured["qd"], rate, preparation)
        qdd = from_velocity
    if "qdd" in measured:
        qdd = differentiated(measured["qdd"], rate, preparation)[0]
    return q, qd, qdd


def _without_rounding(x: Floats, xd: Floats, xdd: Floats, rate: float, preparation: Preparation) -> States:
    """States in which derivatives no larger than rounding of positions are zero, so that a joint at rest is at rest.

    What is computed from speeds of 1e-17 rad/s has columns that differ, and so would seem to be identified.
    """
    highest = min(rate, 2 * pi * _cutoff(preparation))
    rounding = _ROUNDINGS * np.finfo(float).eps * np.abs(x)
    still, steady = np.abs(xd) <= rounding * highest, np.abs(xdd) <= rounding * highest**2
    return x, np.where(still, 0.0, xd), np.where(steady, 0.0, xdd)


def _measured(segment: Segment, name: str) -> Floats:
    if name not in MEASURED:
        raise InputError(f"'{name}' cannot be taken from a log; expected qd or qdd", element="measured")
    if name not in segment.signals:
        raise InputError(
            f"the log has no {name}; leave it out of 'measured', or map its columns", source=segment.source
        )
    return segment.signals[name]


def _by_kind(x: Floats, xd: Floats, xdd: Floats, balls: tuple[int, ...]) -> States:
    """States in which the rates of quaternions are angular velocities and accelerations."""
    if not balls:
        return x, xd, xdd
    parts: list[States] = []
    column = 0
    while column < x.shape[1]:
        some = slice(column, column + 4) if column in balls else slice(column, column + 1)
        part = (x[:, some], xd[:, some], xdd[:, some])
        parts.append(body_rates(*part) if column in balls else part)
        column = some.stop
    q, qd, qdd = (np.hstack([part[k] for part in parts]) for k in range(3))
    return q, qd, qdd


def differentiated(values: Floats, rate: float, preparation: Preparation) -> States:
    """Filtered values (N, columns) with two derivatives, in the way that settings say."""
    cutoff = _cutoff(preparation)
    if preparation.derivative == "fourier":
        if preparation.period is None:
            raise InputError("a Fourier series needs the period of the motion", element="period")
        return fourier(values, rate, preparation.period, cutoff)
    if preparation.derivative == "savitzky_golay":
        return savitzky_golay(values, rate, cutoff)
    return central(lowpass(values, cutoff, rate, preparation.order), rate)


def states_reach(rate: float, preparation: Preparation, influence: float = FAR) -> int:
    """Samples on either side that a state depends on by more than this share of a signal."""
    cutoff = _cutoff(preparation)
    if preparation.derivative == "fourier":
        return 0
    if preparation.derivative == "savitzky_golay":
        return savitzky_golay_window(cutoff, rate) // 2
    if not isfinite(cutoff):
        return CENTRAL_REACH
    return butterworth(cutoff, rate, preparation.order).reach(influence) + CENTRAL_REACH


def needed(rate: float, preparation: Preparation) -> int:
    """Fewest samples that can be differentiated."""
    if preparation.derivative == "fourier":
        return ceil((preparation.period or 0.0) * rate)
    return max(3, 2 * states_reach(rate, preparation, 1.0) + 1) if preparation.derivative == "savitzky_golay" else 3


def _cutoff(preparation: Preparation) -> float:
    if preparation.cutoff is None:
        raise InputError("the cut-off is still open: choose the settings from the data first", element="cutoff")
    return preparation.cutoff
