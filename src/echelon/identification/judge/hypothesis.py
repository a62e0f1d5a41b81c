"""Hypotheses: what a model lacks or a set-up may have wrong, as columns of a fit or as another reading of the logs.

Small ones are columns of the fit: the forces of an effect per unit of its parameters, or what the prediction changes by
a small gain, tilt or compliance.  Large ones, such as exchanged columns, are other readings of the states.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from math import inf

from echelon.identification.judge.evidence import States
from echelon.shared import Floats


class Usual(IntEnum):
    """How often a hypothesis is true; of hypotheses that predict alike the most usual one is taken."""

    EVERYWHERE = 0  # of most robots
    OFTEN = 1
    RARELY = 2


class Kind(StrEnum):
    """Subjects of hypotheses."""

    EFFECT = "effect"  # a force that the model lacks
    ROTOR = "rotor"  # such a force: the inertia of rotors
    CHANGE = "change"  # parameters that change along the logs
    GRAVITY = "gravity"
    GAIN = "gain"  # of an output
    DELAY = "delay"  # of outputs behind positions
    RATE = "rate"
    ZERO = "zero"  # of a position
    JOINT = "joint"  # that gives way
    READING = "reading"  # other columns, signs, units, clocks, mounting
    UNIT = "unit"  # of all outputs, by a prior


CONTINUOUS = (Kind.GRAVITY, Kind.GAIN, Kind.DELAY, Kind.RATE, Kind.ZERO, Kind.JOINT)
"""Kinds of hypotheses that are knobs, with sizes that a fit finds."""


@dataclass(frozen=True)
class Knob:
    """A continuous change of what is read, whose sizes a fit finds."""

    step: float  # of a derivative by central differences
    count: int  # of sizes
    moved: Callable[
        [States, Floats, Floats], States
    ]  # states with sizes (count,), by loads (samples, outputs)
    says: Callable[
        [Floats, Floats], tuple[str, str]
    ]  # words and lines of a set-up, by sizes and standard errors
    sign: float = 1.0  # of the first gain, where sizes are logarithms
    least: float = 0.0  # size up to which it is not told
    by_measured_load: bool = False  # whether loads are what was measured, less friction, not what the model predicts


@dataclass(frozen=True)
class Term:
    """A small hypothesis at one place: columns of the fit."""

    kind: Kind
    words: str  # what residuals follow, or what is wrong; terms of the same words are tried together
    place: str  # where it acts: a drive, joint, output or body
    write: str  # the line of a set-up that states it, with {at} for places
    usual: Usual
    signals: Mapping[int, Floats]  # by output, shape (samples, k): its k columns
    knob: Knob | None = None  # what to turn, where the columns are a derivative
    of_position: bool = False  # whether it is a function of the position at its place
    sizes: tuple[float, float] = (-inf, inf)  # between which sizes make sense
    instead: str = ""  # type of effect whose place it takes

    @property
    def width(self) -> int:
        """Number of its columns."""
        return int(next(iter(self.signals.values())).shape[1])


@dataclass(frozen=True)
class OtherReading:
    """A large hypothesis: another reading of the logs."""

    words: str
    read: Callable[[States], States]
    usual: Usual = Usual.EVERYWHERE
    rate: float = 1.0  # times the rate that was taken
    gravity: Floats | None = None  # where it is about gravity, m/s²
