"""Friction with a state: bristles of LuGre's law, which bend along the measured velocity.

While the velocity stays, the state goes to its steady value exponentially, so that it is found without error of
integration for velocities that are constant from sample to sample.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import accumulate

import numpy as np

from echelon.algebra import parse
from echelon.robot import Bristles
from echelon.shared import Floats


def bent(
    speed: Floats, rate: float, bristles: Bristles, known: Mapping[str, float]
) -> Floats:
    """Force of bristles by that of Coulomb friction, (samples,), steady at the first of the speeds, rad/s or m/s."""
    stiffness, velocity, ratio = (
        parse(text).at(known)
        for text in (bristles.stiffness, bristles.velocity, bristles.ratio)
    )
    mean = np.append(speed[0], (speed[:-1] + speed[1:]) / 2)
    size = 1 + (ratio - 1) * np.exp(-((mean / velocity) ** 2))
    steady = np.sign(mean) * size
    kept = np.exp(-stiffness * np.abs(mean) / (rate * size))
    pairs = zip(steady.tolist(), kept.tolist(), strict=True)
    states = accumulate(
        pairs, lambda x, pair: pair[0] + (x - pair[0]) * pair[1], initial=steady[0]
    )
    return np.fromiter(states, float)[1:]
