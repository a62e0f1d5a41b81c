"""How many harmonics, or which degree, show all that any motion shows."""

from __future__ import annotations

import numpy as np
import pytest

import echelon as ec
from echelon.base.motion_ranks import Family
from support.paths import EXAMPLES
from support.stacked_rows import GAP


def sampled(robot: ec.Mechanism, terms: int, family: str) -> np.ndarray:
    """Rows along a series with random coefficients, in doubles."""
    rng = np.random.default_rng(terms)
    t = rng.uniform(-2, 2, 400)[:, None]
    shape = (terms, len(robot.velocities))
    a, b = rng.normal(size=(2, *shape))
    q = np.tile(rng.normal(size=shape[1]), (len(t), 1))
    qd, qdd = np.zeros((2, *q.shape))
    for k in range(1, terms + 1):
        if family == "fourier":
            c, s = np.cos(k * t), np.sin(k * t)
            q = q + a[k - 1] * c + b[k - 1] * s
            qd = qd + k * (b[k - 1] * c - a[k - 1] * s)
            qdd = qdd - k * k * (a[k - 1] * c + b[k - 1] * s)
        else:
            q = q + a[k - 1] * t**k
            qd = qd + k * a[k - 1] * t ** (k - 1)
            qdd = qdd + k * (k - 1) * a[k - 1] * t ** max(k - 2, 0)
    base = ec.base_parameters(robot)
    return base.regressor(q, qd, qdd).reshape(-1, base.rank)


@pytest.mark.parametrize("family", ["fourier", "polynomial"])
@pytest.mark.parametrize("name", ["panda", "ur10", "double_pendulum", "cart_pole"])
def test_ranks_are_those_of_sampled_series(name: str, family: Family) -> None:
    robot = ec.load(EXAMPLES / f"{name}.yaml")
    ranks = ec.motion_ranks(robot, family)
    assert ranks[-1] == ec.base_structure(robot).rank
    for terms, rank in enumerate(ranks, start=1):
        sizes = np.linalg.svd(sampled(robot, terms, family), compute_uv=False)
        clear = rank == len(sizes) or sizes[rank - 1] > GAP * sizes[rank]
        assert clear, (terms, rank, sizes[rank - 1 : rank + 1])


def test_one_harmonic_does_not_tell_a_spring_from_a_rotor() -> None:
    text = (
        "{echelon: 1, gravity: none, modified_dh: [{joint: prismatic}],"
        " effects: [{type: spring, at: j1}, {type: viscous, at: j1}]}"
    )
    assert ec.motion_ranks(text) == (3, 4)


def test_what_is_no_series_is_refused() -> None:
    with pytest.raises(ec.InputError, match="loops or contacts"):
        ec.motion_ranks(EXAMPLES / "loops/four_bar.yaml")
    with pytest.raises(ec.InputError, match="not a series"):
        ec.motion_ranks(EXAMPLES / "floating_tree.yaml")


def test_dry_friction_is_refused() -> None:
    text = "{echelon: 1, modified_dh: [{joint: revolute}], effects: [{type: coulomb, at: j1}]}"
    with pytest.raises(ec.InputError, match="leave out effects with signs"):
        ec.motion_ranks(text)
