"""Real points where signs are not yet known: random ones, and descent to wanted signs, many points at once.

No descent has to succeed: what is found is checked before it counts.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from echelon.algebra.program.surfaces import RealValues
from echelon.shared import Floats, Integers

SPREAD = 1.5
"""Standard deviation of the logarithm of random values: most lie between 1/20 and 20."""
DECADES = 6.0
"""Orders of magnitude above and below one from which random values come."""
PATIENCE = 40
"""Steps within which some point of a descent has to come nearer to its signs."""
MOST_STEPS = 4 * PATIENCE
"""Steps of a descent."""
STAGNANT = 0.95
"""Share of the violation before, beyond which a point has not come nearer."""
UNREAL = 1e6
"""Violation, in units of a surface's first value, that counts for a value that is not finite."""


def random_points(rng: np.random.Generator, variables: int, count: int) -> Floats:
    """Random points of either sign: of order one, of one random order of magnitude each, and of many."""
    # shapes: returns (variables, count)
    magnitude = np.exp(SPREAD * rng.standard_normal((variables, count)))
    size = 10 ** rng.uniform(-DECADES, DECADES, (variables, count))
    kind = np.arange(count) % 4
    magnitude = np.where(
        kind == 2, magnitude * size[:1], np.where(kind == 3, size, magnitude)
    )
    return np.asarray(
        magnitude * rng.choice([-1.0, 1.0], magnitude.shape), dtype=np.float64
    )


def descended(
    values: RealValues, points: Floats, wanted: Floats, rng: np.random.Generator
) -> Floats:
    """Points moved towards wanted signs, by random steps of all sizes that violate them less."""
    # shapes: points (variables, points); wanted (surfaces, points); returns (variables, points)
    points = points.copy()
    table = values.at(points)
    others = [len(values.surfaces.positive), len(values.surfaces.nonzero)]
    wanted = np.concatenate(
        [
            wanted,
            *(
                np.full((n, points.shape[1]), w)
                for n, w in zip(others, (1, 0), strict=True)
            ),
        ]
    )
    scale = np.abs(table)
    scale[~(scale > 0) | ~np.isfinite(scale)] = 1.0
    cost = _violation(table, wanted, scale)
    before = cost.copy()
    for step in range(MOST_STEPS):
        left = np.flatnonzero(cost > 0)
        if step % PATIENCE == 0 and step:
            if (cost[left] > STAGNANT * before[left]).all():
                break
            before = cost.copy()
        if not len(left):
            break
        tried = _stepped(values, points[:, left], table[:, left], wanted[:, left], rng)
        found = values.at(values.normal(tried))
        better = _violation(found, wanted[:, left], scale[:, left])
        kept = better < cost[left]
        chosen = left[kept]
        points[:, chosen] = tried[:, kept]
        table[:, chosen] = found[:, kept]
        cost[chosen] = better[kept]
    return points


def _violation(table: Floats, wanted: Floats, scale: Floats) -> Floats:
    """Distance of points from the wanted signs, in units of the surfaces' first values."""
    with np.errstate(all="ignore"):
        wrong = np.where(wanted * table > 0, 0.0, 1e-12 + np.abs(table) / scale)
    wrong = np.where(np.isfinite(wrong), wrong, UNREAL)
    return np.asarray(np.where(wanted == 0, 0.0, wrong).sum(axis=0), dtype=np.float64)


def _stepped(
    values: RealValues,
    points: Floats,
    table: Floats,
    wanted: Floats,
    rng: np.random.Generator,
) -> Floats:
    """Each point with one step: to a root or an extreme value of a surface on the wrong side, or by chance."""
    count, variables = points.shape[1], len(points)
    each = np.arange(count)
    wrong = (wanted != 0) & ~(wanted * table > 0)
    surface = np.argmax(wrong * rng.random(wrong.shape), axis=0)
    axis = _chosen_axes(values.cones, surface, rng)
    direction = np.zeros(points.shape)
    direction[axis, each] = 1.0
    several = rng.random(count) < 0.4
    direction[:, several] = rng.standard_normal(
        (variables, int(np.count_nonzero(several)))
    )
    size = 10 ** rng.uniform(-9, 1, count) * np.where(
        rng.random(count) < 0.5, 1.0, np.abs(points[axis, each]) + 1e-3
    )
    step = size * rng.choice([-1.0, 1.0], count)
    h = 10 ** rng.uniform(-6, -1, count) * (np.abs(points[axis, each]) + 1e-3)
    here = table[surface, each]
    ahead = values.at(points + h * direction)[surface, each]
    behind = values.at(points - h * direction)[surface, each]
    with np.errstate(all="ignore"):
        root = -here * h / (ahead - here) * (1 + 10 ** rng.uniform(-10, 0.5, count))
        vertex = (
            h / 2 * (behind - ahead) / (ahead - 2 * here + behind)
        )  # of the parabola: exact for squares
    kind = rng.integers(0, 3, count)
    step = np.where((kind == 0) & np.isfinite(root), root, step)
    step = np.where((kind == 1) & np.isfinite(vertex), vertex, step)
    return np.asarray(points + step * direction, dtype=np.float64)


def _chosen_axes(
    cones: Sequence[Sequence[int]], surface: Integers, rng: np.random.Generator
) -> Integers:
    """A random variable of each surface."""
    sizes = np.array([max(1, len(cone)) for cone in cones])
    table = np.zeros((len(cones), sizes.max()), dtype=np.intp)
    for k, cone in enumerate(cones):
        table[k, : len(cone)] = cone
    chosen: Integers = table[
        surface, (rng.random(len(surface)) * sizes[surface]).astype(np.intp)
    ]
    return chosen
