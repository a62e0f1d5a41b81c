"""Long signals as few points that look the same: the smallest and the largest value of every stretch of time.

Taking every k-th sample loses peaks, and averaging flattens them; both make a fit look better than it is.  When each
stretch is no wider than a pixel, its extremes are all that a plot of the full signal would show there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats

_GAP = 4.0  # times the usual step


@dataclass(frozen=True)
class Envelope:
    """What remains of a signal."""

    time: Floats  # shape (k,): samples that remain, in order; nan where a line must not be drawn
    values: Floats  # shape (k,): samples that remain, in order; nan where a line must not be drawn
    samples: int  # how many there were
    lost: int  # how many of these were not finite


def envelope(time: Floats, values: Floats, buckets: int) -> Envelope:
    """The extremes of a signal in stretches of equal time; the signal itself if it is short.

    Lines break at gaps: where neighbours are further apart than four usual steps, and than a stretch is wide.

    >>> import numpy as np
    >>> y = np.zeros(10_000)
    >>> y[1234] = 5.0
    >>> found = envelope(np.arange(10_000) / 100, y, 50)
    >>> len(found.values) <= 102, found.values.max()
    (True, np.float64(5.0))
    """
    finite = np.isfinite(values) & np.isfinite(time)
    kept = np.flatnonzero(finite)
    t, y = time[kept], values[kept]
    if len(t) > 2 * buckets:
        places = np.minimum((t - t[0]) * (buckets / max(t[-1] - t[0], 1e-300)), buckets - 1).astype(np.intp)
        chosen = _extremes(y, places)
        width = float(t[-1] - t[0]) / buckets
    else:
        chosen, width = np.arange(len(t)), 0.0
    broken = _after_gaps(kept, t, width)
    return Envelope(*_with_breaks(t, y, chosen, broken), len(values), int(len(values) - len(kept)))


def _extremes(y: Floats, places: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """First places of the smallest and largest value of every bucket, and the ends, ascending."""
    starts = np.flatnonzero(np.diff(places, prepend=-1))
    number = np.cumsum(np.diff(places, prepend=places[0]) != 0)  # buckets without samples do not count
    found = [np.array([0, len(y) - 1])]
    for extreme in (np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)):
        hits = np.flatnonzero(y == extreme[number])
        found.append(hits[np.unique(number[hits], return_index=True)[1]])
    return np.unique(np.concatenate(found))


def _after_gaps(kept: npt.NDArray[np.intp], t: Floats, width: float) -> npt.NDArray[np.bool_]:
    """Which samples have a gap or a value that is not finite before them."""
    steps = np.diff(t)
    usual = float(np.median(steps)) if len(steps) else 0.0
    far = steps > max(_GAP * usual, width)
    lost = (np.diff(kept) > 1) & (width == 0)
    return np.concatenate([[False], far | lost]) if len(t) else np.zeros(0, dtype=bool)


def _with_breaks(
    t: Floats, y: Floats, chosen: npt.NDArray[np.intp], broken: npt.NDArray[np.bool_]
) -> tuple[Floats, Floats]:
    """The chosen samples, with nan between those that a gap separates."""
    count = np.cumsum(broken)[chosen] if len(chosen) else np.zeros(0, dtype=np.intp)
    breaks = np.flatnonzero(np.diff(count) > 0) + 1
    return (
        np.insert(t[chosen], breaks, t[chosen[breaks]] if len(breaks) else []),
        np.insert(y[chosen], breaks, np.nan),
    )
