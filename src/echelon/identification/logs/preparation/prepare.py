"""States from positions, filtered and differentiated by kind of coordinate, and from them samples for least squares.

A low-pass that took acceleration off the regressor and not off the outputs would make inertias too large.  So it lies
far above the band that both sides keep, and is there only for what products of states would fold into that band.  A
coordinate whose motion ends far below that band, as a coarse encoder can tell, has one of its own as far above its
motion: what it takes away is noise, which would spoil the rows of all outputs.

Positions of a free rotation are quaternions, whose derivatives become the angular velocity in the moved body's axes.
With loops the independent coordinates are enough, and they alone: filtering all of them would open the loops.

At the ends of a segment the filters have nothing to work on: what they spoil there is left out.  Where an output feels
dry friction, rows near rest leave the fit, because the direction of friction is unknown there.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil, inf, isfinite
from typing import Annotated

import numpy as np

from echelon.formats import PreparationEntry
from echelon.identification.logs.columns.column_map import (
    quaternion_columns,
    signal_names,
)
from echelon.identification.logs.columns.conversion import is_contact_input
from echelon.identification.logs.faults.repeated_values import pinned
from echelon.identification.logs.preparation.bristles import bent
from echelon.identification.logs.recording import Samples, Segment
from echelon.identification.signals.clock import shift_reach, shifted
from echelon.identification.signals.filters import (
    NEAR,
    REACH,
    WORTH,
    FirFilter,
    body_rates,
    butterworth,
    continuous,
    derivative,
    derivatives,
    lowpass,
    reduction,
)
from echelon.identification.signals.filters import (
    ORDER as ORDER,
)
from echelon.robot import (
    Force,
    Mechanism,
    Output,
    Side,
    known_values,
    symbol_values,
)
from echelon.shared import Flags, Floats, InputError, WithJsonSchema, extra, optional


class Preparation(PreparationEntry):
    """How a log becomes samples for least squares: the section of a set-up, with what was chosen from the data."""

    reasons: dict[str, str] = optional(
        {}, "For settings that were chosen: why, in a sentence."
    )
    experiments: dict[
        str, Annotated[Preparation, WithJsonSchema({"type": "object"})]
    ] = optional(
        {}, "Preparation of the logs of each experiment, if there are several."
    )

    def of(self, experiment: str) -> Preparation:
        """How logs of an experiment are prepared."""
        return self.experiments.get(experiment, self)


def restricted(given: PreparationEntry, mechanism: Mechanism) -> PreparationEntry:
    """Stated settings without those of coordinates and outputs that an experiment does not have."""
    there = {*mechanism.positions, *(output.name for output in mechanism.outputs)}
    kept: dict[str, object] = {}
    for name in ("lowpass", "still", "delays"):
        value = getattr(given, name)
        if isinstance(value, Mapping):
            kept[name] = {key: some for key, some in value.items() if key in there}
    if given.rest is not None:
        kept["rest"] = tuple(name for name in given.rest if name in there)
    return given.model_copy(update=kept)


States = tuple[Floats, Floats, Floats]

ROOM = 3.0
"""Low-pass over positions, relative to the band of both sides: within the band its gain is right to 2e-4, and to 3 % up
to where the filter of both sides lets nothing pass."""

_ROUNDINGS = 16.0
"""Roundings of a position that add up in its derivatives: one for every weight, and as many for what it was made of."""

MEASURED = ("qd", "qdd")  # derivatives that may be taken from a log


def usable(segment: Segment, mechanism: Mechanism) -> Segment:
    """A segment with the coordinates that states are made of, and quaternions whose sign does not jump."""
    q = segment.signals["q"]
    free = mechanism.independent_positions
    if q.ndim != 2 or q.shape[1] not in (len(mechanism.positions), len(free)):
        raise InputError(
            f"expected positions of {', '.join(mechanism.positions)}",
            source=segment.source,
        )
    signals = dict(segment.signals)
    if q.shape[1] > len(free) and free == mechanism.independent_velocities:
        for name, order in (
            ("q", mechanism.positions),
            *((name, mechanism.velocities) for name in MEASURED),
        ):
            if name in signals and signals[name].shape[1] == len(order):
                signals[name] = signals[name][:, [order.index(c) for c in free]]
    columns = signals["q"].shape[1]
    for first in quaternion_columns(mechanism, "q", columns):
        some = slice(first, first + 4)
        signals["q"] = signals["q"].copy()
        signals["q"][:, some] = continuous(signals["q"][:, some])
    return replace(segment, signals=signals)


def velocity_names(mechanism: Mechanism, columns: int) -> tuple[str, ...]:
    """Names of the velocities that belong to ``columns`` positions of a usable segment."""
    names = signal_names(mechanism, "q", columns)
    return (
        mechanism.velocities
        if names == mechanism.positions
        else mechanism.independent_velocities
    )


def states(segment: Segment, preparation: Preparation, mechanism: Mechanism) -> States:
    """Positions (N, positions), velocities and accelerations (N, velocities) of a usable segment."""
    rate, columns = segment.rate, segment.signals["q"].shape[1]
    positions, names = (
        signal_names(mechanism, "q", columns),
        velocity_names(mechanism, columns),
    )
    _check_names("position", preparation.lowpass or {}, positions, "lowpass")
    x = _smoothed(segment.signals["q"], preparation, rate, positions)
    measured = {
        name: _smoothed(measured_signal(segment, name), preparation, rate, names)
        for name in preparation.measured or ()
    }
    if "qd" not in measured:
        q, qd, qdd = _by_kind(
            x, *_without_rounding(x, *derivatives(x, rate), rate), mechanism
        )
        return q, qd, measured.get("qdd", qdd)
    q, qd = (
        _by_kind(x, x, x, mechanism)[0],
        measured["qd"],
    )  # of unit length, where quaternions are among them
    return q, qd, measured["qdd"] if "qdd" in measured else derivative(qd, rate)


def _check_names(
    what: str, given: Iterable[str], valid: Sequence[str], setting: str
) -> None:
    for name in given:
        if name not in valid:
            raise InputError(
                f"there is no {what} '{name}' (valid: {', '.join(valid)})",
                element=setting,
            )


def states_cutoff(preparation: Preparation, rate: float) -> float:
    """Low-pass over positions, Hz, which leaves the band of both sides as it is; inf where there is no room for one."""
    if preparation.band is None:
        raise InputError(
            "the band is still open: choose the settings from the data first",
            element="band",
        )
    cutoff = ROOM * preparation.band
    return cutoff if cutoff <= WORTH * rate else inf


def cutoffs(preparation: Preparation, rate: float, names: Sequence[str]) -> list[float]:
    """Low-passes over single coordinates, Hz."""
    common, own = states_cutoff(preparation, rate), preparation.lowpass or {}
    return [min(common, own.get(name, inf)) for name in names]


def _smoothed(
    values: Floats, preparation: Preparation, rate: float, names: Sequence[str]
) -> Floats:
    own = cutoffs(preparation, rate, names)
    if len(set(own)) == 1:
        return lowpass(values, own[0], rate)
    return np.hstack(
        [lowpass(values[:, [k]], cutoff, rate) for k, cutoff in enumerate(own)]
    )


def states_reach(rate: float, preparation: Preparation) -> int:
    """Samples at an end of a segment whose states it spoils."""
    cutoff = min(
        [states_cutoff(preparation, rate), *(preparation.lowpass or {}).values()]
    )
    return REACH + (butterworth(cutoff, rate).reach(NEAR) if isfinite(cutoff) else 0)


def _without_rounding(
    x: Floats, xd: Floats, xdd: Floats, rate: float
) -> tuple[Floats, Floats]:
    """Derivatives that are zero where they are no larger than rounding of positions, so that a joint at rest rests.

    What is computed from speeds of 1e-17 rad/s has columns that differ, and so would seem to be identified.
    """
    rounding = _ROUNDINGS * np.finfo(float).eps * np.abs(x)
    for order, values in enumerate((xd, xdd), start=1):
        values[np.abs(values) <= rounding * rate**order] = 0.0
    return xd, xdd


def measured_signal(segment: Segment, name: str) -> Floats:
    """Derivatives of a log as they are; an error where it has none."""
    if name not in MEASURED:
        raise InputError(
            f"'{name}' cannot be taken from a log; expected qd or qdd",
            element="measured",
        )
    if name not in segment.signals:
        raise InputError(
            f"the log has no {name}; leave it out of 'measured', or map its columns",
            source=segment.source,
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
        some = (
            slice(column, column + 4) if column in balls else slice(column, column + 1)
        )
        part = (x[:, some], xd[:, some], xdd[:, some])
        parts.append(body_rates(*part) if column in balls else part)
        column = some.stop
    q, qd, qdd = (np.hstack([part[k] for part in parts]) for k in range(3))
    return q, qd, qdd


def speed_rows(
    mechanism: Mechanism, output: Output, names: Sequence[str]
) -> Floats | None:
    """Speeds of the joints or actuators of an output as combinations (speeds, velocities); None for a wrench.

    Where friction is dry in some of them, of these.
    """
    if output.cuts:
        return None
    forces = [force for force, _ in output.forces]
    forces = [f for f in forces if _is_dry_at(mechanism, f)] or forces
    rows = np.zeros((len(forces), len(names)))
    for row, force in zip(rows, forces, strict=True):
        if force.side is Side.JOINT:
            row[names.index(force.at)] = 1.0
        else:
            actuator = next(
                a for a in mechanism.transmission.actuators if a.name == force.at
            )
            for name, ratio in actuator.terms:
                known = symbol_values(mechanism, sorted(ratio.symbols()))
                row[names.index(name)] = ratio.at(known)
    return rows


def has_dry_friction(mechanism: Mechanism, output: Output) -> bool:
    """Whether an output sees dry friction."""
    own = Force(output.name, Side.OUTPUT)
    seen = [own, *(force for force, _ in output.forces)]
    return any(_is_dry_at(mechanism, force) for force in seen)


def _is_dry_at(mechanism: Mechanism, force: Force) -> bool:
    """Whether a force is one of dry friction among others."""
    dry = {
        (a.at, a.side)
        for effect in mechanism.effects
        for a in effect.actions
        if a.read.is_dry
    }
    if mechanism.dependent_velocities:  # which move with the output, too
        return bool(dry)
    moved = (
        mechanism.transmission.inverse[force.at] if force.side is Side.ACTUATOR else ()
    )
    beyond = {(name, Side.JOINT) for name in moved}
    return bool(dry & {(force.at, force.side), *beyond})


def with_bristles(
    samples: Samples, mechanism: Mechanism, symbols: Mapping[str, float] | None = None
) -> Samples:
    """Samples with the states of LuGre friction among their inputs."""
    found = dict(samples.inputs)
    known = {**known_values(mechanism), **(symbols or {})}
    for effect in mechanism.effects:
        if effect.bristles is None:
            continue
        for action in effect.actions:
            output = Force(action.at, action.side).output("", "")
            names = velocity_names(mechanism, samples.q.shape[1])
            rows = speed_rows(mechanism, output, names)
            assert rows is not None
            speed = samples.qd @ rows[0]
            found[action.at] = bent(speed, samples.rate, effect.bristles, known)
    return replace(samples, inputs=found)


@dataclass(frozen=True, eq=False)
class PreparationPlan:
    """Settings at a rate: the samples that filters need, and the samples that they make of a piece."""

    preparation: Preparation  # without open settings
    mechanism: Mechanism
    rate: float  # samples per second

    @cached_property
    def reduction(self) -> FirFilter | None:
        """The filter over both sides of the equation."""
        if self.preparation.band is None:
            raise InputError(
                "the band is still open: choose the settings from the data first",
                element="band",
            )
        return reduction(self.preparation.band, self.rate)

    @property
    def factor(self) -> int:
        """Samples per row."""
        return self.reduction.factor if self.reduction else 1

    @cached_property
    def delays(self) -> Mapping[str, float]:
        """Samples by which outputs are late."""
        given = self.preparation.delays or {}
        _check_names(
            "output",
            given,
            [output.name for output in self.mechanism.outputs],
            "delays",
        )
        return {name: seconds * self.rate for name, seconds in given.items() if seconds}

    @property
    def shift(self) -> int:
        """Samples that undoing the delays looks ahead or back."""
        return max(
            (shift_reach(samples) for samples in self.delays.values()), default=0
        )

    @cached_property
    def spoilt(self) -> int:
        """Samples at an end of a segment whose states or outputs are spoilt by it, or that are to be trimmed.

        The filter over both sides spoils nothing: near the ends of what it gets it filters both sides alike as well.
        """
        filters = max(states_reach(self.rate, self.preparation), self.shift)
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

    def samples(self, piece: Segment) -> Samples:
        """A usable piece as samples, without what its ends spoil."""
        rows = slice(self.spoilt, len(piece) - self.spoilt)
        inputs = {name: values[rows] for name, values in piece.inputs.items()}
        for name in filter(is_contact_input, piece.inputs):
            inputs[name] = self._landing(piece.inputs[name])[rows]
        q, qd, qdd = states(piece, self.preparation, self.mechanism)
        qd, moving = self._moving(qd, q.shape[1])
        at_limits = self._at_limits(piece)
        measured = "y" in piece.signals
        found = Samples(
            piece.source,
            piece.start + rows.start / piece.rate,
            piece.rate,
            q[rows],
            qd[rows],
            qdd[rows],
            y=self._on_time(piece.signals["y"])[rows] if measured else None,
            inputs=inputs,
            reduction=self.reduction,
            moving=None if moving is None else moving[rows],
            pinned=None if at_limits is None else at_limits[rows],
        )
        return with_bristles(found, self.mechanism)

    def _at_limits(self, piece: Segment) -> Flags | None:
        """Samples (N, outputs) whose sensor is at a limit while the robot moves; None if there are none."""
        y, q = piece.signals.get("y"), piece.signals["q"]
        if y is None:
            return None
        found = np.zeros(y.shape, dtype=bool)
        for column, output in enumerate(self.mechanism.outputs):
            late = round(self.delays.get(output.name, 0.0))
            for _, starts, stops in pinned(y[:, column], np.ones(len(y), dtype=bool)):
                for start, stop in zip(starts, stops, strict=True):
                    if np.ptp(q[start:stop], axis=0).any():
                        found[max(start - late, 0) : max(stop - late, 0), column] = True
        return found if found.any() else None

    def _on_time(self, y: Floats) -> Floats:
        if not self.delays:
            return y
        found = np.array(y, dtype=np.float64)
        for column, output in enumerate(self.mechanism.outputs):
            if output.name in self.delays:
                found[:, column] = shifted(y[:, column], self.delays[output.name])
        return found

    def _landing(self, touch: Floats) -> Floats:
        """Flags of a contact that hold as far around it as filters of the states spread the shock when it lands."""
        with extra("identify"):
            from scipy.ndimage import maximum_filter1d
        lowest = states_cutoff(self.preparation, self.rate)
        reach = ceil(0.5 * self.rate / lowest) if isfinite(lowest) else REACH
        return maximum_filter1d(touch, 2 * reach + 1)

    def _moving(self, qd: Floats, positions: int) -> tuple[Floats, Flags | None]:
        """Velocities, and where outputs move: faster than noise and than what the low-pass smears of starts and stops.

        Velocities of joints that count as at rest below that are zero, so that no dry friction is predicted there.
        """
        still = self._still()
        if not any(still.values()):
            return qd, None
        names = velocity_names(self.mechanism, positions)
        smeared = self._smeared(qd, names)
        flags = np.ones((len(qd), len(self.mechanism.outputs)), dtype=bool)
        slowest = np.full(len(names), inf)
        for column, output in enumerate(self.mechanism.outputs):
            rows = (
                speed_rows(self.mechanism, output, names)
                if still.get(output.name)
                else None
            )
            for row in () if rows is None else rows:
                some, least = np.flatnonzero(row), still[output.name]
                speed, error = (
                    np.abs(qd[:, some] @ row[some]),
                    smeared[:, some] @ np.abs(row[some]),
                )
                flags[:, column] &= speed > least + error
                rests = output.name in (self.preparation.rest or ())
                slowest[some] = np.minimum(
                    slowest[some], least / np.abs(row[some]) if rests else 0.0
                )
        slowest[np.isinf(slowest)] = 0.0
        if not slowest.any():
            return qd, flags
        return np.where(
            (slowest > 0) & (np.abs(qd) <= slowest + smeared), 0.0, qd
        ), flags

    def _smeared(self, qd: Floats, names: Sequence[str]) -> Floats:
        """Parts of velocities that the low-pass would take off again, the largest within half a period of it."""
        with extra("identify"):
            from scipy.ndimage import maximum_filter1d
        taken = np.abs(qd - _smoothed(qd, self.preparation, self.rate, names))
        lowest = min(cutoffs(self.preparation, self.rate, names))
        reach = ceil(0.5 * self.rate / lowest) if isfinite(lowest) else 0
        return maximum_filter1d(taken, 2 * reach + 1, axis=0)

    def _still(self) -> Mapping[str, float]:
        given = self.preparation.still
        if given is None:
            raise InputError(
                "settings are still open: choose 'still' from the data first"
            )
        names = [output.name for output in self.mechanism.outputs]
        if not isinstance(given, Mapping):
            return dict.fromkeys(names, float(given))
        _check_names("output", given, names, "still")
        return given


def prepare(
    segment: Segment, preparation: Preparation, mechanism: Mechanism
) -> Samples:
    """Samples of a segment, without what filters spoil at its ends and what is to be trimmed.

    Settings must not be open; see ``chosen``.
    """
    piece = usable(segment, mechanism)
    plan = PreparationPlan(preparation, mechanism, piece.rate)
    plan.check(piece)
    return plan.samples(piece)
