"""Preparation: from segments of a log to samples for least squares.

At the ends of a segment the filters have nothing to work on: what they spoil there is left out.  Of a periodic motion
that is to be averaged one mean period remains, continued on both sides for the filters.
"""

from __future__ import annotations

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.logs.choices import at_rate
from echelon.logs.preparation import Preparation
from echelon.logs.recording import Segment
from echelon.logs.samples import Samples
from echelon.logs.settled import Settled
from echelon.logs.states import usable
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.periods import Average, average


def prepare(segment: Segment, preparation: Preparation, mechanism: Mechanism) -> Samples:
    """Samples of a segment.

    Parameters
    ----------
    segment : Segment
    preparation : Preparation
        Without open settings; see :func:`echelon.logs.choices.chosen`.
    mechanism : Mechanism

    Returns
    -------
    Samples
        Of the segment without what filters spoil at its ends and what is to be trimmed; all of them count.  With
        ``average``, of one period, which is continued on both sides for the reduction.

    Raises
    ------
    InputError
        If the segment does not fit the mechanism, is too short for its filters, or lacks what settings ask for.
    """
    piece = usable(segment, mechanism)
    preparation = at_rate(preparation, piece.rate)
    if preparation.average:
        return _mean_period(piece, preparation, mechanism)
    plan = Settled(preparation, mechanism, piece.rate)
    plan.check(len(piece), piece.source)
    inside = slice(plan.spoilt, len(piece) - plan.spoilt)
    return plan.samples(piece, inside, inside)


def _mean_period(segment: Segment, preparation: Preparation, mechanism: Mechanism) -> Samples:
    """One mean period as samples that count, between as many copies as the filters need."""
    if preparation.period is None:
        raise InputError("averaging needs the period of the motion", source=segment.source, element="period")
    try:
        means = {name: average(values, segment.rate, preparation.period) for name, values in segment.signals.items()}
        inputs = {name: average(values, segment.rate, preparation.period) for name, values in segment.inputs.items()}
    except InputError as error:
        raise error.located(segment.source) from None
    count, rate = len(means["q"].mean), means["q"].rate
    plan = Settled(preparation, mechanism, rate)
    states, both = -(-plan.inner // count), -(-plan.outer // count)
    copies = states + both

    def tiled(mean: Average) -> Floats:
        return np.concatenate([mean.mean] * (2 * copies + 1))

    signals = {name: tiled(mean) for name, mean in means.items()}
    start = segment.start - copies * preparation.period
    piece = Segment(segment.source, start, rate, signals, {name: tiled(mean) for name, mean in inputs.items()})
    rows = slice(states * count, (copies + both + 1) * count)
    return plan.samples(piece, rows, slice(copies * count, (copies + 1) * count))
