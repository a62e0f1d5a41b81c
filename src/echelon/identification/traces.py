"""Traces: the rows of an output that are kept to look at, in memory that does not grow with the log.

Neighbouring rows form buckets, of which the rows with the extremes of what is measured, of what is predicted and of
their difference stay: every peak survives, at its time, and no value is invented.
"""

from __future__ import annotations

import numpy as np

from echelon.shared import Floats

LIMIT = 200_000  # rows of an output that are kept; more than any screen shows
BUCKET = 12  # rows that are thinned together: twice the six extremes that stay, so that a pass halves them at least


def thinned(rows: Floats) -> Floats:
    """Half of the rows or fewer, with all extremes; shape (at most k/2 + 6, columns)."""
    full = len(rows) // BUCKET
    starts = BUCKET * np.arange(full)
    signals = np.stack([rows[:, 1], rows[:, 2], rows[:, 1] - rows[:, 2]])
    buckets = signals[:, : BUCKET * full].reshape(3, full, BUCKET)
    places = [starts + pick(buckets, axis=2) for pick in (np.argmin, np.argmax)]
    rest = signals[:, BUCKET * full :]
    if rest.shape[1]:
        places += [
            BUCKET * full + pick(rest, axis=1) for pick in (np.argmin, np.argmax)
        ]
    kept: Floats = rows[np.unique(np.concatenate([some.ravel() for some in places]))]
    return kept


class TraceKeeper:
    """Rows of one output, thinned evenly whenever they become too many."""

    def __init__(self, limit: int = LIMIT) -> None:
        self._limit = limit
        self._parts: list[Floats] = []
        self._count = self._passes = 0

    def add(self, rows: Floats) -> None:
        """Take in rows of shape (k, columns), thinned as often as those that are kept already."""
        for _ in range(self._passes):
            rows = thinned(rows)
        self._parts.append(rows)
        self._count += len(rows)
        while self._count > self._limit:
            whole = thinned(np.concatenate(self._parts))
            if len(whole) == self._count:  # nothing but extremes
                break
            self._parts, self._count, self._passes = (
                [whole],
                len(whole),
                self._passes + 1,
            )

    def rows(self, columns: int) -> Floats:
        """Rows that are kept, shape (k, columns)."""
        return np.concatenate(self._parts) if self._parts else np.zeros((0, columns))
