"""Recorded computations against the same ones in Python integers."""

from __future__ import annotations

import numpy as np

from echelon.exact.straight_line import MINUS_ONE, ONE, ZERO, Recorder
from support.strategies import SMALL_FIELD

P = SMALL_FIELD.p


def test_sums_and_inverses_are_repeated_on_other_samples():
    recorder = Recorder(SMALL_FIELD, [2, 3, 5])
    a, b, c = recorder.inputs
    inverse = recorder.minus_inverse(recorder.sum([(a, b), (b, c), (ONE, c)]))
    recorder.sum([(a, a), (b, b)])  # not needed
    program = recorder.program([inverse, recorder.sum([(inverse, c), (MINUS_ONE, a)]), b, ZERO])
    inputs = np.random.default_rng(0).integers(0, P, (3, 50))
    follows, outputs = program.run(inputs, SMALL_FIELD)
    assert follows.all()
    for x, y, z, *found in np.concatenate([inputs, outputs]).T.tolist():
        expected = -pow(x * y + y * z + z, -1, P) % P
        assert found == [expected, (expected * z - x) % P, y, 0]


def test_only_samples_with_the_same_zeros_follow():
    recorder = Recorder(SMALL_FIELD, [2, 4, 0])
    a, b, c = recorder.inputs
    assert c == ZERO
    assert recorder.sum([(a, a), (MINUS_ONE, b)]) == ZERO
    recorder.require(recorder.minus_inverse(a))
    follows, _ = recorder.program([]).run(np.array([[3, 9, 0], [3, 8, 0], [3, 9, 1], [0, 0, 0]]).T, SMALL_FIELD)
    assert follows.tolist() == [True, False, False, False]


def test_trivial_sums_are_not_recorded():
    recorder = Recorder(SMALL_FIELD, [7])
    (a,) = recorder.inputs
    assert recorder.sum([(ONE, a)]) == recorder.sum([(a, ONE)]) == a
    assert recorder.sum([(ONE, ZERO)]) == ZERO
    assert recorder.minus_inverse(ONE) == MINUS_ONE
    assert recorder.minus_inverse(MINUS_ONE) == ONE
    assert recorder.program([a]).size == 4


def test_large_batches_are_treated_in_parts(monkeypatch):
    recorder = Recorder(SMALL_FIELD, [7])
    (a,) = recorder.inputs
    program = recorder.program([recorder.sum([(a, a)])])
    inputs = np.arange(100)[None]
    monkeypatch.setattr("echelon.exact.straight_line._CACHED", 64)
    assert program.run(inputs, SMALL_FIELD)[1][0].tolist() == [x * x for x in range(100)]
