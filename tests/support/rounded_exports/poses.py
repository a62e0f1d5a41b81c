"""Mechanisms at other closed poses than the one they were drawn at."""

from __future__ import annotations

import numpy as np
from flint import arb

from support.loop_linkage import Linkage, doubles, number
from support.loop_oracle import pivots
from support.rounded_exports.mechanism import Exact


def independent_closures(linkage: Linkage) -> int:
    still = linkage.state([arb(0)] * len(linkage.start), [arb(0)] * len(linkage.start))
    return len(pivots(linkage.jacobian(still)).sizes)


def elsewhere(
    exact: Exact, rng: np.random.Generator, steps: int = 8, step: float = 0.05
) -> Exact:
    """The mechanism where a few random steps along its free motions lead."""
    linkage = exact.linkage()
    constraints = independent_closures(linkage)
    q = [arb(0)] * len(linkage.start)
    for _ in range(steps):
        slopes = doubles(linkage.jacobian(linkage.state(q, [arb(0)] * len(q))))
        free = np.linalg.svd(slopes)[2][constraints:]
        moved_on = free.T @ rng.normal(scale=step, size=len(free))
        q = linkage.closed(
            [a + number(float(d)) for a, d in zip(q, moved_on, strict=True)],
            constraints,
        )
    return exact.moved(q)
