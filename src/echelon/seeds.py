"""Seeds of random points: recorded in results, so that the same input gives the same output."""

from __future__ import annotations

import numpy as np

from echelon.errors import InputError

DEFAULT_SEED = 2015


def random_generator(seed: int) -> np.random.Generator:
    """A random generator."""
    if seed < 0:
        raise InputError(f"the seed {seed} is negative; give a whole number from 0 on")
    return np.random.default_rng(seed)
