"""Timing that can be trusted on a busy machine: repeated, interleaved, with the spread shown."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from dataclasses import asdict
from time import perf_counter
from typing import Any

from ratios import Spread

MORE = 5
"""How many times as many repeats short jobs get."""

SHORT = 0.3
"""Seconds per wanted repeat within which more repeats are made."""


class Times(Spread):
    """Seconds over some repeats."""

    def as_dict(self) -> dict[str, float]:
        return {name: round(value, 6) for name, value in asdict(self).items()}

    def __str__(self) -> str:
        return f"{seconds_text(self.minimum)} / {seconds_text(self.median)} / {seconds_text(self.maximum)}"


def seconds_text(seconds: float) -> str:
    """Three significant digits, in s or ms."""
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1000 * seconds:.3g} ms"


def interleaved(
    jobs: Mapping[str, Callable[[], Any]], repeats: int
) -> tuple[dict[str, Times], dict[str, Any]]:
    """Run all jobs in turn, again and again, so that a slow spell of the machine hits all of them alike.

    Short jobs are repeated more often, up to :data:`MORE` times.  A first round is not counted.

    Returns the times and the last result of every job.
    """
    seconds: dict[str, list[float]] = {name: [] for name in jobs}
    results = {name: job() for name, job in jobs.items()}
    begin = perf_counter()
    rounds = 0
    while rounds < repeats or (
        rounds < MORE * repeats and perf_counter() - begin < SHORT * repeats
    ):
        for name, job in jobs.items():
            gc.collect()
            start = perf_counter()
            results[name] = job()
            seconds[name].append(perf_counter() - start)
        rounds += 1
    return {name: Times.of(values) for name, values in seconds.items()}, results
