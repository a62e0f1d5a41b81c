"""Sine, cosine and tangent of kernels against ball arithmetic, in units in the last place."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from fractions import Fraction

import flint
import numpy as np
import pytest

from echelon.machine.kernel import Kernel
from echelon.machine.operations_text import LARGEST_ANGLE
from echelon.machine.target import host
from support.small_kernels import LANES, FloatArray, function, same_bits

FUNCTIONS = {"sin": flint.arb.sin, "cos": flint.arb.cos, "tan": flint.arb.tan}
REACHED = {"sin": 1.3, "cos": 1.3, "tan": 2.8}
"""Largest errors found over the angles of this file, rounded up; 750 000 others reached 1.48, 1.43 and 2.77."""


@pytest.fixture(scope="module", params=LANES)
def kernel(request: pytest.FixtureRequest) -> Kernel:
    made = function(lambda x: [x[0].sin(), x[0].cos(), x[0].tan()], {"x": 1})
    return Kernel(made, target=host(request.param))


def column(kernel: Kernel, angles: FloatArray) -> FloatArray:
    return kernel({"x": angles[:, None]}).T


def errors(angles: FloatArray, values: FloatArray, exact: Callable[[flint.arb], flint.arb]) -> FloatArray:
    """Distance from the exact values in units in the last place."""
    found = []
    with flint.ctx.workprec(1300):  # 1e300 has a thousand bits before the point
        for angle, value in zip(angles.tolist(), values.tolist(), strict=True):
            truth = exact(flint.arb(angle))
            found.append(float(abs(truth - value)) / np.spacing(abs(float(truth))))
    return np.array(found)


def nearest_to_quarter_turns() -> Iterator[float]:
    """The doubles that come closest to multiples of π/2: best rational approximations, for every binary exponent."""
    with flint.ctx.workprec(400):
        quarter = Fraction(int((flint.arb.pi() * 2**300).floor().unique_fmpz()), 2**301)
    for exponent in range(-52, -22):
        step = Fraction(2) ** exponent
        ratio, (before, last) = step / quarter, (1, 0)
        while last < 2**53:
            whole = ratio.numerator // ratio.denominator
            before, last = last, whole * last + before
            if 0 < last < 2**53 and last * step < LARGEST_ANGLE:
                yield float(last * step)
            ratio = 1 / (ratio - whole)


def quarter_turns() -> FloatArray:
    turns = np.concatenate([np.arange(1000), np.random.default_rng(1).integers(0, 2**29, 2000)]) * (np.pi / 2)
    return np.concatenate([turns, np.nextafter(turns, np.inf), np.nextafter(turns, -np.inf)])


def uniform(size: float, count: int = 2000) -> FloatArray:
    return np.random.default_rng(2).uniform(-size, size, count)


ANGLES = {
    "robots": uniform(4),
    "many turns": uniform(1e3),
    "odd eighths": (np.arange(-1000, 1000) + 0.5) * (np.pi / 2),
    "up to the limit": np.append(uniform(LARGEST_ANGLE), np.nextafter(LARGEST_ANGLE, 0)),
    "multiples of a quarter turn": quarter_turns(),
    "worst cases": np.array(list(nearest_to_quarter_turns())),
    "tiny": 10.0 ** np.random.default_rng(3).uniform(-323, -1, 2000),
    "beyond": np.append(10.0 ** np.random.default_rng(4).uniform(9, 308, 300), [1e9, 1e12, 1e22, 1e300]),
}


@pytest.mark.parametrize("angles", ANGLES.values(), ids=ANGLES.keys())
def test_errors_in_the_last_place(kernel: Kernel, angles: FloatArray) -> None:
    for values, (name, exact) in zip(column(kernel, angles), FUNCTIONS.items(), strict=True):
        assert errors(angles, values, exact).max() < REACHED[name], name


def test_worst_cases_are_bad() -> None:
    """Their sine or cosine is nine digits below the spacing of doubles there."""
    angles = ANGLES["worst cases"]
    assert len(angles) > 300
    smallest = np.minimum(np.abs(np.sin(angles)), np.abs(np.cos(angles)))
    assert (smallest / angles).min() < 1e-24


def test_zero_keeps_its_sign(kernel: Kernel) -> None:
    zeros = np.array([0.0, -0.0])
    assert same_bits(column(kernel, zeros), np.stack([zeros, [1.0, 1.0], zeros]))


def test_symmetry_is_exact(kernel: Kernel) -> None:
    angles = np.concatenate(list(ANGLES.values()))
    signs = np.array([[-1.0], [1.0], [-1.0]])
    assert same_bits(column(kernel, -angles), signs * column(kernel, angles))


@pytest.mark.parametrize("bad", [np.inf, -np.inf, np.nan, -np.nan])
def test_what_is_no_angle_gives_nan(kernel: Kernel, bad: float) -> None:
    assert np.isnan(column(kernel, np.array([bad]))).all()


def test_every_lane_gives_the_same(kernel: Kernel) -> None:
    angles = np.concatenate([a[:8] for a in ANGLES.values()] + [[np.nan]])
    alone = np.stack([column(kernel, np.array([angle]))[:, 0] for angle in angles], axis=1)
    for shift in range(kernel.target.lanes):
        moved = np.roll(angles, shift)
        assert same_bits(column(kernel, moved), np.roll(alone, shift, axis=1))


def test_all_widths_give_the_same() -> None:
    made = function(lambda x: [x[0].sin(), x[0].cos()], {"x": 1})
    angles = np.concatenate(list(ANGLES.values()))
    first, *others = (column(Kernel(made, target=host(lanes)), angles) for lanes in LANES)
    assert all(same_bits(first, other) for other in others)
