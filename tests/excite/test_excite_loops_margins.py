"""Margins of mechanisms with loops: extremes of many more samples than they look at, and how they say so."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.excite.verify.margins import loop_margins, when_kept
from support.excitation_loops import limited, motion_of


@pytest.mark.parametrize("name", ["four-bar", "slider-crank", pytest.param("delta", marks=pytest.mark.slow)])
def test_margins_of_loops_are_extremes_of_dense_samples(name: str) -> None:
    limits = limited(name, np.random.default_rng(2))
    trajectory = motion_of(limits, 0.15)
    margins = loop_margins(trajectory, limits)
    assert [margin.label for margin in margins] == list(limits.labels)
    assert all(margin.sampled for margin in margins)
    assert "at samples" in when_kept(margins)
    values = limits.values(*trajectory.states(np.linspace(0, 2, 20_001)))
    for margin, samples in zip(margins, values.T, strict=True):
        near = 1e-5 * np.ptp(samples) + 1e-12
        assert margin.least == pytest.approx(samples.min(), abs=near)
        assert margin.largest == pytest.approx(samples.max(), abs=near)
