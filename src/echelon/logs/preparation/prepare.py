"""Preparation: from segments of a log to samples for least squares.

At the ends of a segment the filters have nothing to work on: what they spoil there is left out.  Where an output feels
dry friction, rows near rest leave the fit, because the direction of friction is unknown there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.errors import InputError
from echelon.logs.preparation.states import Preparation, states, states_reach, usable, velocity_names
from echelon.logs.recording import Samples, Segment
from echelon.mechanism.effect import Side
from echelon.mechanism.mechanism import ActuatorForce, Cut, JointForce, Mechanism, Output
from echelon.mechanism.stated import symbol_values
from echelon.signals.clock import shift_reach, shifted
from echelon.signals.filters import NEAR, FirFilter, reduction


def speed_rows(mechanism: Mechanism, output: Output, names: Sequence[str]) -> Floats | None:
    """Speeds of the joints or actuators of an output as combinations (speeds, velocities); None for a wrench."""
    if any(isinstance(channel, Cut) for channel, _ in output.terms):
        return None
    rows = np.zeros((len(output.terms), len(names)))
    for row, (channel, _) in zip(rows, output.terms, strict=True):
        if isinstance(channel, JointForce):
            row[names.index(channel.coordinate)] = 1.0
        elif isinstance(channel, ActuatorForce):
            actuator = next(a for a in mechanism.transmission.actuators if a.name == channel.actuator)
            for name, ratio in actuator.terms:
                known = symbol_values(mechanism, sorted(ratio.symbols()))
                row[names.index(name)] = ratio.at(known)
    return rows


def rubs(mechanism: Mechanism, output: Output) -> bool:
    """Whether dry friction is in an output: an effect with a sign that it can see."""
    dry = {(a.at, a.side) for effect in mechanism.effects for a in effect.actions if "sign(" in a.term}
    for channel, _ in output.terms:
        if isinstance(channel, Cut):
            continue
        if mechanism.closures:
            return bool(dry)
        if isinstance(channel, JointForce):
            if (channel.coordinate, Side.JOINT) in dry:
                return True
        else:
            moved = mechanism.transmission.inverse[channel.actuator]
            if (channel.actuator, Side.ACTUATOR) in dry or any((name, Side.JOINT) in dry for name in moved):
                return True
    return False


@dataclass(frozen=True, eq=False)
class PreparationPlan:
    """What settings mean at a rate: how many samples filters need, and what they make of a piece."""

    preparation: Preparation  # without open settings
    mechanism: Mechanism
    rate: float  # samples per second

    @cached_property
    def reduction(self) -> FirFilter | None:
        """The filter over both sides of the equation."""
        if self.preparation.band is None:
            raise InputError("the band is still open: choose the settings from the data first", element="band")
        return reduction(self.preparation.band, self.rate)

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

    @property
    def needed(self) -> int:
        """Fewest samples of which one row remains."""
        return 2 * self.spoilt + self.factor

    def is_short(self, segment: Segment) -> bool:
        """Whether filters and what is trimmed leave nothing of a segment."""
        return len(segment) < self.needed

    def check(self, segment: Segment) -> None:
        """Refuse a segment that is too short."""
        if self.is_short(segment):
            raise InputError(
                f"an uninterrupted stretch has {len(segment)} samples; the filters and the time left out at the ends "
                f"need {self.needed:.6g} ({self.needed / self.rate:.3g} s)",
                source=segment.source,
            )

    def samples(self, piece: Segment, rows: slice) -> Samples:
        """Some rows of a usable piece as samples."""
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


def prepare(segment: Segment, preparation: Preparation, mechanism: Mechanism) -> Samples:
    """Samples of a segment, without what filters spoil at its ends and what is to be trimmed.

    Settings must not be open; see ``chosen``.
    """
    piece = usable(segment, mechanism)
    plan = PreparationPlan(preparation, mechanism, piece.rate)
    plan.check(piece)
    inside = slice(plan.spoilt, len(piece) - plan.spoilt)
    return plan.samples(piece, inside)
