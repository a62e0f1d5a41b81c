"""Cases of a parametrised test that run every time, the others being slow; and numbers of drawn examples."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest
from hypothesis import settings


def slow_unless(
    quick: Callable[[Any], bool] | Iterable[Any], cases: Iterable[Any]
) -> list[Any]:
    """Cases with the mark ``slow`` on those that are not among the quick ones."""
    if not callable(quick):
        quick = frozenset(quick).__contains__
    return [case if quick(case) else _slow(case) for case in cases]


def one_in(step: int, cases: Iterable[Any]) -> list[Any]:
    """Cases of which the first of every few is quick."""
    return [_slow(case) if k % step else case for k, case in enumerate(cases)]


def examples(count: int) -> settings:
    """Settings with a number of examples if the profile asks for 40; other profiles give the same share of theirs."""
    return settings(max_examples=max(1, count * settings().max_examples // 40))


def _slow(case: Any) -> Any:
    if hasattr(case, "marks"):
        return pytest.param(
            *case.values, id=case.id, marks=[*case.marks, pytest.mark.slow]
        )
    return pytest.param(
        *(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow
    )
