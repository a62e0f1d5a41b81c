"""Angles that were logged within one turn, and quaternions: where they are in a signal, and how they become smooth."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.logs.finding import Finding, Severity
from echelon.logs.quantities import SIGNALS, motion_of, signal_names
from echelon.logs.recording import Recording
from echelon.logs.wording import seconds
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import Mechanism

WRAP = 5.5
"""Jump of an angle between two samples, rad, that can only be a full turn taken off."""

_POSITIONS = ("q", "reference")


def quaternion_columns(mechanism: Mechanism, signal: str, columns: int) -> tuple[int, ...]:
    """First columns of the quaternions in a signal of a recording.

    Parameters
    ----------
    mechanism : Mechanism
    signal : str
        Name in a recording; only positions hold quaternions.
    columns : int
        As many as the signal has.
    """
    if signal not in _POSITIONS:
        return ()
    balls = {motion.positions[0] for motion in mechanism.motions if motion.kind is MotionKind.BALL}
    names = signal_names(mechanism, signal, columns)
    return tuple(column for column, name in enumerate(names) if name in balls)


def angle_columns(mechanism: Mechanism, signal: str, columns: int) -> tuple[int, ...]:
    """Columns of the angles of turning joints in a signal of a recording.

    Parameters
    ----------
    mechanism : Mechanism
    signal : str
        Name in a recording; only positions hold angles.
    columns : int
        As many as the signal has.
    """
    if signal not in _POSITIONS:
        return ()
    motions = [motion_of(mechanism, name) for name in signal_names(mechanism, signal, columns)]
    return tuple(k for k, motion in enumerate(motions) if motion is not None and motion.kind is MotionKind.ROTATION)


def unwrapped(
    recording: Recording, mechanism: Mechanism, pieces: Sequence[Integers]
) -> tuple[dict[str, Floats], tuple[Finding, ...]]:
    """Signals of a recording with the turns of its angles added up within each stretch.

    Parameters
    ----------
    recording : Recording
        Finite.
    mechanism : Mechanism
    pieces : sequence of array of int
        Samples of the uninterrupted stretches.

    Returns
    -------
    signals : dict of str to array
    findings : tuple of Finding
        ``wrapped``, for every angle that jumps.
    """
    signals, findings = dict(recording.signals), []
    for signal in _POSITIONS:
        if signal not in signals:
            continue
        values = signals[signal].copy()
        names = signal_names(mechanism, signal, values.shape[1])
        for column in angle_columns(mechanism, signal, values.shape[1]):
            jumps = [piece[np.flatnonzero(np.abs(np.diff(values[piece, column])) > WRAP) + 1] for piece in pieces]
            found = np.concatenate([np.zeros(0, dtype=np.intp), *jumps])
            if not len(found):
                continue
            for piece in pieces:
                values[piece, column] = np.unwrap(values[piece, column], discont=WRAP)
            when = f"from {seconds(recording.time[found[0]])} s"
            where = f"{recording.source}, {SIGNALS[signal]} of '{names[column]}', {when}"
            text = f"jumps by a full turn {len(found)} times; the turns were added up"
            findings.append(Finding(Severity.NOTE, "wrapped", where, text))
        signals[signal] = values
    return signals, tuple(findings)
