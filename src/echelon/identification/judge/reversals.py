"""Columns of reversals, made on the clock of the log: dry friction that is smooth near zero speed, or seen late.

What tells smooth from Coulomb friction are pulses at reversals that last milliseconds, far less than a sample of the
slow clock on which hypotheses are judged.  So they pass the low-pass of the outputs before the clock is slowed.
A sensor that sees Coulomb friction late, or smeared in time, leaves pulses as well, but equally long ones however
quickly the motion reverses.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from echelon.identification.judge.places import Place, places
from echelon.identification.logs.recording import Samples
from echelon.identification.signals.clock import low_passed
from echelon.robot import Mechanism
from echelon.shared import Floats

_WIDTHS = tuple(
    float(f"{digit}e{power}") for power in range(-4, 1) for digit in (1, 2, 5)
)
"""Widths that are tried, rad/s or m/s."""
_NARROWEST, _WIDEST = 0.005, 0.25
"""Widths by the largest speed: narrower ones show in a few samples only, wider ones in most of the motion, as other
friction does."""
_BY_STILL = 2.0
"""Least width by the speed ``still``, two standard deviations of the velocity's noise: noise alone makes the direction
as uncertain as a width of 1.3 standard deviations does."""

_LATE = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1)
"""Times by which outputs may see the direction early and late, s: two together are any smear of about that length."""


@dataclass(frozen=True)
class Reversal:
    """Friction at one output, in place of Coulomb friction of the same size."""

    output: int
    width: float = 0.0  # rad/s or m/s; of smooth friction
    late: float = 0.0  # s, by which the direction is seen late; early if negative


@dataclass(frozen=True)
class Reversals:
    """Columns that are tried for a mechanism, by the speeds of its outputs, rad/s or m/s."""

    mechanism: Mechanism
    fastest: Mapping[str, float]  # largest speeds
    still: Mapping[str, float]  # speeds that may be noise

    def tried(self, samples: Samples) -> list[Reversal]:
        """Widths and delays at all places."""
        found = []
        for place in self._places(samples):
            name = self.mechanism.outputs[place.output].name
            speed = self.fastest.get(name, 0.0)
            least = max(_NARROWEST * speed, _BY_STILL * self.still.get(name, 0.0))
            for width in _WIDTHS:
                if least <= width <= _WIDEST * speed:
                    found += [Reversal(place.output, width=width)]
            for late in _LATE:
                found += [Reversal(place.output, late=s) for s in (late, -late)]
        return found

    def columns(self, samples: Samples, factor: int) -> Floats:
        """Friction of unit size less Coulomb friction at one in ``factor`` samples, shape (N / factor, columns)."""

        def slowed(friction: Floats) -> Floats:
            return friction if factor == 1 else low_passed(friction, 1 / factor)

        speeds = {
            place.output: place.state(samples.motion)[1]
            for place in self._places(samples)
        }
        coulomb = {output: slowed(np.sign(qd)) for output, qd in speeds.items()}
        tried = self.tried(samples)
        kept = np.arange(0, len(samples), factor)
        found = np.empty((len(kept), len(tried)))
        for column, some in enumerate(tried):
            own = coulomb[some.output]
            if some.width:
                friction = slowed(np.tanh(speeds[some.output] / some.width))[kept]
            else:
                seen = kept - round(some.late * samples.rate)
                friction = own[np.clip(seen, 0, len(own) - 1)]
            found[:, column] = friction - own[kept]
        return found

    def _places(self, samples: Samples) -> Iterator[Place]:
        return places(self.mechanism, samples.q.shape[1], samples.qd.shape[1])
