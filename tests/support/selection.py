"""Which cases of a parametrised test run every time; the others are slow."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TypeVar

import pytest

T = TypeVar("T")


def slow_unless(quick: Callable[[T], bool] | Iterable[T], cases: Iterable[T]) -> list[object]:
    """Cases with the mark ``slow`` on those that are not among the quick ones."""
    if not callable(quick):
        quick = frozenset(quick).__contains__
    return [case if quick(case) else pytest.param(case, marks=pytest.mark.slow) for case in cases]
