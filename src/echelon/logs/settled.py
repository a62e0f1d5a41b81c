"""What settings of the preparation mean at a rate: how many samples filters need, and what they make of a piece."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.errors import InputError
from echelon.logs.preparation import Preparation
from echelon.logs.recording import Segment
from echelon.logs.samples import Samples
from echelon.logs.speeds import speed_rows
from echelon.logs.states import needed, states, states_reach, velocity_names
from echelon.mechanism.mechanism import Mechanism
from echelon.signals.delays import shift_reach, shifted
from echelon.signals.filters import FAR, NEAR
from echelon.signals.reduction import Reduction, reduction

MEMORY = 2.0
"""Times the filters' reach that windows overlap: what is forgotten to 1e-18 survives two differentiations."""


@dataclass(frozen=True, eq=False)
class Settled:
    """Settings with a mechanism and a rate.

    Attributes
    ----------
    preparation : Preparation
        Without open settings.
    mechanism : Mechanism
    rate : float
        Samples per second.
    """

    preparation: Preparation
    mechanism: Mechanism
    rate: float

    @cached_property
    def reduction(self) -> Reduction | None:
        """The filter over both sides of the equation."""
        made = self.preparation
        if made.output_cutoff is None or made.decimation is None:
            raise InputError("settings are still open: choose output_cutoff and decimation from the data first")
        return reduction(made.output_filter, made.output_cutoff, self.rate, made.decimation)

    @property
    def factor(self) -> int:
        """Samples per row."""
        return self.reduction.factor if self.reduction else 1

    @cached_property
    def delays(self) -> Mapping[str, float]:
        """Samples by which outputs are late."""
        names = [output.name for output in self.mechanism.outputs]
        given = self.preparation.delays or {}
        strange = next((name for name in given if name not in names), None)
        if strange is not None:
            raise InputError(f"there is no output '{strange}' (valid: {', '.join(names)})", element="delays")
        return {name: seconds * self.rate for name, seconds in given.items() if seconds}

    @property
    def shift(self) -> int:
        """Samples that undoing the delays looks ahead or back."""
        return max((shift_reach(samples) for samples in self.delays.values()), default=0)

    @cached_property
    def spoilt(self) -> int:
        """Samples at an end of a segment whose states or outputs are spoilt by it, or that are to be trimmed.

        The filter over both sides spoils nothing: near the ends of what it gets it filters both sides alike as well.
        """
        filters = max(states_reach(self.rate, self.preparation, NEAR), self.shift)
        return filters + ceil(self.preparation.trim * self.rate - 1e-9)

    @cached_property
    def inner(self) -> int:
        """Samples on either side that states and outputs depend on."""
        return max(ceil(MEMORY * max(states_reach(self.rate, self.preparation, FAR), self.shift)), self.spoilt)

    @cached_property
    def outer(self) -> int:
        """Samples on either side that rows depend on; a multiple of the factor."""
        samples = ceil(MEMORY * self.reduction.reach) if self.reduction else 0
        return -(-samples // self.factor) * self.factor

    @property
    def needed(self) -> int:
        """Fewest samples of which one row remains."""
        return max(2 * self.spoilt + self.factor, needed(self.rate, self.preparation))

    def check(self, count: int, source: str) -> None:
        """Refuse a segment that is too short."""
        if count < self.needed:
            raise InputError(
                f"an uninterrupted stretch has {count} samples; the filters and the time left out at the ends need "
                f"{self.needed:.6g} ({self.needed / self.rate:.3g} s)",
                source=source,
            )

    def samples(self, piece: Segment, rows: slice, counts: slice) -> Samples:
        """Some rows of a usable piece as samples, of which some count; both are numbers of rows of the piece."""
        q, qd, qdd = (some[rows] for some in states(piece, self.preparation, self.mechanism))
        y = piece.signals.get("y")
        return Samples(
            source=piece.source,
            start=piece.start + rows.start / piece.rate,
            rate=piece.rate,
            q=q,
            qd=qd,
            qdd=qdd,
            y=None if y is None else self._on_time(y)[rows],
            inputs={name: values[rows] for name, values in piece.inputs.items()},
            reduction=self.reduction,
            first=counts.start - rows.start,
            stop=counts.stop - rows.start,
            moving=self._moving(qd, q.shape[1]),
        )

    def _on_time(self, y: Floats) -> Floats:
        if not self.delays:
            return y
        found = np.array(y, dtype=np.float64)
        for column, output in enumerate(self.mechanism.outputs):
            if output.name in self.delays:
                found[:, column] = shifted(y[:, column], self.delays[output.name])
        return found

    def _moving(self, qd: Floats, positions: int) -> Flags | None:
        still = self._still()
        if not any(still.values()):
            return None
        names = velocity_names(self.mechanism, positions)
        flags = np.ones((len(qd), len(self.mechanism.outputs)), dtype=bool)
        for column, output in enumerate(self.mechanism.outputs):
            rows = speed_rows(self.mechanism, output, names) if still.get(output.name) else None
            if rows is not None:
                speeds = (sum(row[k] * qd[:, k] for k in np.flatnonzero(row)) for row in rows)
                for speed in speeds:
                    flags[:, column] &= np.abs(speed) > still[output.name]
        return flags

    def _still(self) -> Mapping[str, float]:
        given = self.preparation.still
        if given is None:
            raise InputError("settings are still open: choose 'still' from the data first")
        names = [output.name for output in self.mechanism.outputs]
        if not isinstance(given, Mapping):
            return dict.fromkeys(names, float(given))
        strange = next((name for name in given if name not in names), None)
        if strange is not None:
            raise InputError(f"there is no output '{strange}' (valid: {', '.join(names)})", element="still")
        return given
