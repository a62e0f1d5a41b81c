"""False sets that are made as honest ones are: nothing is valid but what is true."""

from __future__ import annotations

import pytest

from support.false_sets import ATTACKS, false_sets, is_accepted, is_true
from support.selection import slow_unless


@pytest.mark.parametrize("rounds", slow_unless([1], [1, 2]))
def test_no_false_set_is_accepted(rounds: int) -> None:
    for false in false_sets(rounds * len(ATTACKS), 0):
        assert not is_accepted(false) or is_true(false), (
            false.kind,
            false.truth.text,
            false.model,
        )


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 120))
def test_a_thousand_false_sets_are_refused(seed: int) -> None:
    for false in false_sets(50, seed):
        assert not is_accepted(false) or is_true(false), (
            false.kind,
            false.truth.text,
            false.model,
        )
