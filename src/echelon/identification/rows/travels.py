"""Travels: how far and how fast coordinates went in some logs, and where another log goes far beyond.

A model says least where no data were.  Friction at higher speeds, springs, and parameters that a motion hardly excites
show in no score of a log without outputs, and a wrong unit or a wrong column shows there as a motion that was never
fitted.  Accelerations are those that both sides of the equation keep, so that noise of encoders is no motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import inf, nan, pi

import numpy as np

from echelon.algebra import Op, operands
from echelon.base import BaseModel
from echelon.identification.logs.columns.column_map import signal_names
from echelon.identification.logs.faults.locked_joints import STILL
from echelon.identification.logs.finding import enumerated
from echelon.identification.logs.recording import Samples
from echelon.identification.rows.rows import rows_filtered
from echelon.robot import Mechanism, MotionKind
from echelon.shared import Floats

BEYOND = 2.0
"""Ratio to the fitted travel from which on a motion is another one: logs of one kind differ by less, as motions within
the same limits do, and forces that grow with the square of the speed are four times as large."""

UNKNOWN = (
    "motions beyond the fitted ones are not named, because the plan does not hold them: predict with the plan of a "
    "saved model"
)


@dataclass(frozen=True)
class Travel:
    """Range, speed and acceleration of a coordinate; nan where it has none, as components of a ball joint."""

    coordinate: str
    low: float  # rad or m
    high: float
    speed: float  # largest, rad/s or m/s
    acceleration: float  # largest in the band of both sides, rad/s² or m/s²

    @property
    def rests(self) -> bool:
        """Whether the position changes by no more than noise and play of a joint at rest."""
        return self.high - self.low <= STILL

    def __or__(self, other: Travel) -> Travel:
        """The travel of both; what is nan in one is that of the other."""
        return Travel(
            self.coordinate,
            float(np.fmin(self.low, other.low)),
            float(np.fmax(self.high, other.high)),
            float(np.fmax(self.speed, other.speed)),
            float(np.fmax(self.acceleration, other.acceleration)),
        )


def travels_of(mechanism: Mechanism, samples: Samples) -> Iterator[Travel]:
    """Travels of all coordinates in the samples that count."""
    inside = slice(samples.first, samples.stop)
    q, qd = samples.q[inside], samples.qd[inside]
    qdd = rows_filtered(samples, samples.qdd)
    positions = signal_names(mechanism, "q", q.shape[1])
    rates = signal_names(mechanism, "qd", qd.shape[1])
    lows = _by_name(positions, q.min(axis=0, initial=inf))
    highs = _by_name(positions, q.max(axis=0, initial=-inf))
    speeds = _by_name(rates, np.abs(qd).max(axis=0, initial=0.0))
    accelerations = _by_name(rates, np.abs(qdd).max(axis=0, initial=0.0))
    for name in dict.fromkeys((*positions, *rates)):
        yield Travel(
            name,
            *(some.get(name, nan) for some in (lows, highs, speeds, accelerations)),
        )


def _by_name(names: Sequence[str], values: Floats) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=True))


def joined(travels: Iterable[Travel]) -> tuple[Travel, ...]:
    """One travel for every coordinate."""
    found: dict[str, Travel] = {}
    for some in travels:
        before = found.get(some.coordinate)
        found[some.coordinate] = some if before is None else before | some
    return tuple(found.values())


# -- beyond what was fitted -------------------------------------------------------------------------------------------


def beyond(
    base: BaseModel, fitted: Sequence[Travel], travels: Iterable[Travel]
) -> Iterator[str]:
    """Sentences about coordinates that go far beyond the fitted travels, in quantities that outputs depend on."""
    experiments = base.mechanism.experiments
    models = [base.experiment(name) for name in experiments] or [base]
    read = set[tuple[str, str]]().union(*map(_read, models))
    known = {some.coordinate: some for some in fitted}
    motions = {
        name: motion
        for model in models
        for motion in model.mechanism.motions
        for name in (*motion.positions, *motion.velocities)
    }
    for some in travels:
        name = some.coordinate
        before = known.get(name, Travel(name, nan, nan, 0.0, 0.0))
        repeats = (_STRAIGHT, name) not in read
        compared = _compared(motions[name].kind, some, before, repeats=repeats)
        parts = [words for quantity, words in compared if (quantity, name) in read]
        if parts:
            yield (
                f"{name} {enumerated(parts)}, so that friction and inertia are extrapolated there: check unit and "
                "column, or fit to motions that go as far"
            )


_STRAIGHT = "q itself"
"""Positions that enter otherwise than by sine and cosine, so that they do not repeat after a turn."""


def _read(base: BaseModel) -> set[tuple[str, str]]:
    """Quantities and coordinates that outputs depend on; with loops all, as dependent ones follow the others."""
    # forces at contacts are unknown, and so are outputs there, but not the rows of the regressor
    touching = bool(base.mechanism.contacts)
    function = base.function("regressor" if touching else "inverse_dynamics")
    program, needed = function.program, set(function.needed)
    loops = bool(base.mechanism.dependent_velocities)
    straight = {
        operand
        for node in needed
        if program.ops[node] not in (Op.SIN, Op.COS)
        for operand in operands(program, node)
    }
    found = set[tuple[str, str]]()
    for argument in function.arguments:
        for node, label in zip(argument.nodes, argument.labels, strict=True):
            if loops or node in needed:
                found.add((argument.name, label))
            if argument.name == "q" and node in straight:
                found.add((_STRAIGHT, label))
    return found


def _compared(
    kind: MotionKind, some: Travel, fitted: Travel, *, repeats: bool
) -> Iterator[tuple[str, str]]:
    """Quantities that go far beyond, with both travels in words."""
    unit = "m" if kind is MotionKind.TRANSLATION else "rad"
    for quantity, verb, value, before, per in (
        ("qd", "moves", some.speed, fitted.speed, "/s"),
        ("qdd", "accelerates", some.acceleration, fitted.acceleration, "/s²"),
    ):
        if not some.rests and value > BEYOND * before:
            words = f"{verb} up to {value:.3g} {unit}{per}"
            yield quantity, f"{words} (fitted: up to {before:.3g} {unit}{per})"
    turns = kind is MotionKind.ROTATION
    if kind is not MotionKind.BALL and _is_outside(
        some, fitted, repeats=turns and repeats
    ):
        words = f"goes from {some.low:.3g} to {some.high:.3g} {unit}"
        yield (
            "q",
            f"{words} (fitted: from {fitted.low:.3g} to {fitted.high:.3g} {unit})",
        )


def _is_outside(some: Travel, fitted: Travel, *, repeats: bool) -> bool:
    """Whether positions are far outside the fitted ones, also after the turns after which those of a joint repeat."""
    middle, half = (fitted.low + fitted.high) / 2, (fitted.high - fitted.low) / 2
    low, high = some.low - middle, some.high - middle
    if repeats and half >= pi:
        return False
    if repeats:
        turns = 2 * pi * np.round((low + high) / (4 * pi))
        low, high = low - turns, high - turns
    return max(-low, high) > BEYOND * max(half, STILL)
