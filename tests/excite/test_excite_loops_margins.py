"""Between samples: boxes and margins of mechanisms with loops contain whatever the motion meets."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.excite.problem.closed_loops import loop_limits
from echelon.excite.problem.loop_motion import LoopMotion
from echelon.excite.verify.loop_enclosures import LoopEnclosures, WholeMotion, loop_margins
from echelon.excite.verify.margins import ranges
from support.excitation_loops import limited, mechanism, motion_of


@pytest.mark.parametrize(
    "name", ["four-bar", "slider-crank", "delta", pytest.param("gough_stewart", marks=pytest.mark.slow)]
)
def test_whole_states_stay_in_their_boxes(name: str) -> None:
    limits = loop_limits(LoopMotion(mechanism(name)))
    size = 0.03 if name == "gough_stewart" else 0.15  # its legs slide
    trajectory, enclosures = motion_of(limits, size), LoopEnclosures(limits.motion)
    edges = np.linspace(0, 2, {"four-bar": 100, "slider-crank": 100}.get(name, 2000))
    cells = ranges(trajectory, (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2)
    located = enclosures.located(cells)
    some = located.found
    assert some.mean() > 0.9
    boxes, openness = enclosures.states(located, cells), enclosures.openness(located)
    for share in np.random.default_rng(5).random(10):
        closed = limits.motion.at(*trajectory.states((1 - share) * edges[:-1] + share * edges[1:]))
        for key, values in (("q", closed.q), ("qd", closed.qd), ("qdd", closed.qdd)):
            slack = 1e-9 * np.abs(values).max()
            assert np.all((values >= boxes[key][0] - slack)[some])
            assert np.all((values <= boxes[key][1] + slack)[some])
        assert np.all((closed.openness >= openness[0] * (1 - 1e-9))[some])
        assert np.all((closed.openness <= openness[1] * (1 + 1e-9))[some])


@pytest.mark.parametrize("name", ["four-bar", "slider-crank", pytest.param("delta", marks=pytest.mark.slow)])
def test_margins_of_loops_contain_all_samples(name: str) -> None:
    limits = limited(name, np.random.default_rng(2))
    trajectory = motion_of(limits, 0.15)
    margins = loop_margins(trajectory, limits)
    assert [margin.label for margin in margins] == list(limits.labels)
    values = limits.values(*trajectory.states(np.linspace(0, 2, 20_001)))
    for margin, samples in zip(margins, values.T, strict=True):
        slack = 1e-9 * np.abs(samples).max()
        assert -np.inf < margin.least <= samples.min() + slack
        assert samples.max() - slack <= margin.largest < np.inf


@pytest.mark.parametrize("name", ["four-bar", pytest.param("delta", marks=pytest.mark.slow)])
def test_speeds_of_all_coordinates_are_bounded(name: str) -> None:
    limits = limited(name, np.random.default_rng(2))
    trajectory = motion_of(limits, 0.15)
    whole = WholeMotion(limits.motion, trajectory)
    t = np.linspace(0, 2, 5000)
    closed = limits.motion.at(*trajectory.states(t))
    np.testing.assert_array_equal(whole(t), closed.q)
    np.testing.assert_array_equal(whole(t, 1), closed.qd)
    for order, values in ((1, closed.qd), (2, closed.qdd)):
        most = np.abs(values).max(axis=0)
        assert np.all(whole.bounds(order) >= most)
        assert np.all(whole.bounds(order) <= 2.1 * most + 1e-2)
