"""Preparation: from segments of a log to samples for least squares, whole or window by window.

Everything here is a filter with a finite memory, so a long log is prepared in windows that overlap by that memory,
and the rows are those of the whole.  At the ends of a segment the filters of positions have nothing to work on: what
they spoil there is cut off before regressor and outputs pass theirs.  Periodic motions are the exception: all their
periods vote, so they are held whole.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.logs.choices import at_rate
from echelon.logs.plan import Plan
from echelon.logs.preparation import Preparation
from echelon.logs.recording import Segment
from echelon.logs.samples import Samples
from echelon.logs.states import usable
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.periods import Average, average

Floats = npt.NDArray[np.float64]

WINDOW = 1 << 15
"""Samples per window, besides those that it shares with its neighbours."""

_LATE = 0.01
"""Samples by which the clock of a piece may differ from that of the piece it continues."""


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
    plan = Plan(preparation, mechanism, piece.rate)
    plan.check(len(piece), piece.source)
    inside = slice(plan.spoilt, len(piece) - plan.spoilt)
    return plan.samples(piece, inside, inside)


def prepare_windows(
    segments: Iterable[Segment], preparation: Preparation, mechanism: Mechanism, window: int = WINDOW
) -> Iterator[Samples]:
    """Samples of segments that arrive piece by piece, in constant memory.

    Together the windows have the rows, after reduction, of each uninterrupted stretch prepared as a whole.  Averages
    over periods and Fourier series need a whole stretch, which is then held in memory.

    Parameters
    ----------
    segments : iterable of Segment
        In order; one that begins where the last one ended continues it.
    preparation : Preparation
        Without open settings.
    mechanism : Mechanism
    window : int
        Samples per window, besides those that it shares with its neighbours.

    Yields
    ------
    Samples

    Raises
    ------
    InputError
        If a segment does not fit the mechanism or lacks what settings ask for, or no stretch is long enough; shorter
        ones are left out.
    """
    if window < 1:
        raise InputError(f"windows of {window} samples: expected at least 1")
    found = False
    problem: InputError | None = None
    for stretch, pieces in _stretches(segments, preparation, mechanism, window):
        for samples in stretch.windows(pieces):
            found = True
            yield samples
        problem = problem or stretch.problem
    if problem is not None and not found:
        raise problem


def _stretches(
    segments: Iterable[Segment], preparation: Preparation, mechanism: Mechanism, window: int
) -> Iterator[tuple[_Stretch, Iterator[Segment]]]:
    """Uninterrupted stretches, each with its pieces as they arrive; these are to be used up before the next one."""
    source = iter(segments)
    following = next(source, None)
    while following is not None:
        stretch = _Stretch(following, preparation, mechanism, window)
        left: list[Segment] = []

        def pieces(stretch: _Stretch = stretch, left: list[Segment] = left) -> Iterator[Segment]:
            for segment in source:
                if not stretch.continues(segment):
                    left.append(segment)
                    return
                yield segment

        yield stretch, pieces()
        following = left[0] if left else None


class _Stretch:
    """The part of an uninterrupted stretch that is held in memory, and how far its windows have come.

    Attributes
    ----------
    held : Segment
        The samples in memory.
    begin : int
        Number of the first of them, counted from the beginning of the stretch.
    done : int
        Where the next window begins.
    problem : InputError or None
        Why nothing came of it.
    """

    def __init__(self, first: Segment, preparation: Preparation, mechanism: Mechanism, window: int) -> None:
        self.plan = Plan(at_rate(preparation, first.rate), mechanism, first.rate)
        self.held = usable(first, mechanism)
        self.origin = first.start
        self.begin, self.done = 0, self.plan.spoilt
        self.problem: InputError | None = None
        self.whole = preparation.average or preparation.derivative == "fourier"
        self.window = -(-window // self.plan.factor) * self.plan.factor

    @property
    def count(self) -> int:
        """Samples that have arrived."""
        return self.begin + len(self.held)

    def continues(self, segment: Segment) -> bool:
        """Whether a segment begins where this stretch ends."""
        rate = self.held.rate
        late = (segment.start - self.origin) * rate - self.count
        return segment.rate == rate and abs(late) < _LATE and segment.signals.keys() == self.held.signals.keys()

    def windows(self, pieces: Iterator[Segment]) -> Iterator[Samples]:
        """All windows of the stretch, as soon as what they need has arrived."""
        yield from self._ready()
        for piece in pieces:
            self._add(piece)
            yield from self._ready()
        try:
            self.plan.check(self.count, self.held.source)
        except InputError as problem:
            self.problem = problem
            return
        if self.whole:
            yield prepare(self.held, self.plan.preparation, self.plan.mechanism)
            return
        last = self.count - self.plan.spoilt
        while self.done < last:
            yield from self._next(last)

    def _ready(self) -> Iterator[Samples]:
        plan = self.plan
        while not self.whole and self.count >= self.done + self.window + plan.outer + plan.inner:
            yield from self._next(self.count - plan.inner)

    def _next(self, last: int) -> Iterator[Samples]:
        """The next window of a stretch whose samples are good up to one; nothing if it has no rows."""
        plan, counts = self.plan, slice(self.done, min(self.done + self.window, last))
        rows = slice(max(plan.spoilt, counts.start - plan.outer), min(counts.stop + plan.outer, last))
        read = slice(max(self.begin, rows.start - plan.inner), min(self.count, rows.stop + plan.inner))
        piece = _rows(self.held, read.start - self.begin, read.stop - self.begin)
        yield plan.samples(piece, _moved(rows, read.start), _moved(counts, read.start))
        self.done += self.window
        gone = max(0, self.done - plan.outer - plan.inner - self.begin)
        self.held = _rows(self.held, gone, len(self.held))
        self.begin += gone

    def _add(self, piece: Segment) -> None:
        new = usable(piece, self.plan.mechanism, self.held.signals if len(self.held) else None)
        signals = {name: np.concatenate([old, new.signals[name]]) for name, old in self.held.signals.items()}
        inputs = {name: np.concatenate([old, new.inputs[name]]) for name, old in self.held.inputs.items()}
        self.held = replace(self.held, signals=signals, inputs=inputs)


def _moved(rows: slice, start: int) -> slice:
    return slice(rows.start - start, rows.stop - start)


def _rows(segment: Segment, start: int, stop: int) -> Segment:
    """Some samples of a segment."""
    signals = {name: values[start:stop] for name, values in segment.signals.items()}
    inputs = {name: values[start:stop] for name, values in segment.inputs.items()}
    return replace(segment, start=segment.start + start / segment.rate, signals=signals, inputs=inputs)


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
    plan = Plan(preparation, mechanism, rate)
    states, both = -(-plan.inner // count), -(-plan.outer // count)
    copies = states + both

    def tiled(mean: Average) -> Floats:
        return np.concatenate([mean.mean] * (2 * copies + 1))

    signals = {name: tiled(mean) for name, mean in means.items()}
    start = segment.start - copies * preparation.period
    piece = Segment(segment.source, start, rate, signals, {name: tiled(mean) for name, mean in inputs.items()})
    rows = slice(states * count, (copies + both + 1) * count)
    return plan.samples(piece, rows, slice(copies * count, (copies + 1) * count))
