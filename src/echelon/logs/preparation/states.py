"""Settings of the preparation of logs; and states from positions: filtered and differentiated by kind of coordinate.

A low-pass that took acceleration off the regressor and not off the outputs would make inertias too large.  So it lies
far above the band that both sides keep, and is there only for what products of states would fold into that band.  A
coordinate whose motion ends far below that band, as a coarse encoder can tell, has one of its own as far above its
motion: what it takes away is noise, which would spoil the rows of all outputs.

Positions of a free rotation are quaternions, whose derivatives become the angular velocity in the moved body's axes.
With loops the independent coordinates are enough, and they alone: filtering all of them would open the loops.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf, isfinite

import numpy as np
from pydantic import Field

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.formats.schema.schema_log import PreparationEntry
from echelon.logs.columns.column_map import motion_of, quaternion_columns, signal_names
from echelon.logs.recording import Segment
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.filters import (
    FAR,
    REACH,
    WORTH,
    body_rates,
    butterworth,
    continuous,
    derivative,
    derivatives,
    lowpass,
)


class Preparation(PreparationEntry):
    """How a log becomes samples for least squares: the section of a set-up, with what was chosen from the data."""

    reasons: dict[str, str] = Field({}, description="For settings that were chosen: why, in a sentence.")


States = tuple[Floats, Floats, Floats]

ROOM, ORDER = 3.0, 4
"""Low-pass over positions, relative to the band of both sides: within the band its gain is right to 2e-4, and to 3 % up
to where the filter of both sides lets nothing pass."""
_ROUNDINGS = 16.0  # of a position, that add up in its derivatives
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
    """Positions (N, positions), velocities and accelerations (N, velocities) of a usable segment."""
    rate, columns = segment.rate, segment.signals["q"].shape[1]
    positions, names = signal_names(mechanism, "q", columns), velocity_names(mechanism, columns)
    strange = next((name for name in preparation.lowpass or {} if name not in positions), None)
    if strange is not None:
        raise InputError(f"there is no position '{strange}' (valid: {', '.join(positions)})", element="lowpass")
    x = _smoothed(segment.signals["q"], preparation, rate, positions)
    measured = {
        name: _smoothed(measured_signal(segment, name), preparation, rate, names) for name in preparation.measured or ()
    }
    if "qd" not in measured:
        q, qd, qdd = _by_kind(x, *_without_rounding(x, *derivatives(x, rate), rate), mechanism)
        return q, qd, measured.get("qdd", qdd)
    q, qd = _by_kind(x, x, x, mechanism)[0], measured["qd"]  # of unit length, where quaternions are among them
    return q, qd, measured["qdd"] if "qdd" in measured else derivative(qd, rate)


def states_cutoff(preparation: Preparation, rate: float) -> float:
    """Low-pass over positions, Hz, which leaves the band of both sides as it is; inf where there is no room for one."""
    if preparation.band is None:
        raise InputError("the band is still open: choose the settings from the data first", element="band")
    cutoff = ROOM * preparation.band
    return cutoff if cutoff <= WORTH * rate else inf


def cutoffs(preparation: Preparation, rate: float, names: Sequence[str]) -> list[float]:
    """Low-passes over single coordinates, Hz."""
    common, own = states_cutoff(preparation, rate), preparation.lowpass or {}
    return [min(common, own.get(name, inf)) for name in names]


def _smoothed(values: Floats, preparation: Preparation, rate: float, names: Sequence[str]) -> Floats:
    own = cutoffs(preparation, rate, names)
    if len(set(own)) == 1:
        return lowpass(values, own[0], rate, ORDER)
    return np.hstack([lowpass(values[:, [k]], cutoff, rate, ORDER) for k, cutoff in enumerate(own)])


def states_reach(rate: float, preparation: Preparation, influence: float = FAR) -> int:
    """Samples on either side that a state depends on by more than this share of a signal."""
    cutoff = min([states_cutoff(preparation, rate), *(preparation.lowpass or {}).values()])
    return REACH + (butterworth(cutoff, rate, ORDER).reach(influence) if isfinite(cutoff) else 0)


def _without_rounding(x: Floats, xd: Floats, xdd: Floats, rate: float) -> tuple[Floats, Floats]:
    """Derivatives that are zero where they are no larger than rounding of positions, so that a joint at rest rests.

    What is computed from speeds of 1e-17 rad/s has columns that differ, and so would seem to be identified.
    """
    rounding = _ROUNDINGS * np.finfo(float).eps * np.abs(x)
    return np.where(np.abs(xd) <= rounding * rate, 0.0, xd), np.where(np.abs(xdd) <= rounding * rate**2, 0.0, xdd)


def measured_signal(segment: Segment, name: str) -> Floats:
    """Derivatives of a log as they are; an error where it has none."""
    if name not in MEASURED:
        raise InputError(f"'{name}' cannot be taken from a log; expected qd or qdd", element="measured")
    if name not in segment.signals:
        raise InputError(
            f"the log has no {name}; leave it out of 'measured', or map its columns", source=segment.source
        )
    return segment.signals[name]


def _by_kind(x: Floats, xd: Floats, xdd: Floats, mechanism: Mechanism) -> States:
    """States in which the rates of quaternions are angular velocities and accelerations."""
    balls = quaternion_columns(mechanism, "q", x.shape[1])
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
