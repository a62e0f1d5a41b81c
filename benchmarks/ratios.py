"""Ratios of times from interleaved runs: every round gives one, so a slow spell of the machine cancels out."""

from __future__ import annotations

import gc
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from statistics import median
from time import perf_counter
from typing import Any, Self

Timer = Callable[[], float]
"""Runs a job once and says how many seconds it took."""


@dataclass(frozen=True)
class Spread:
    """Minimum, median and maximum over some rounds."""

    minimum: float
    median: float
    maximum: float

    @classmethod
    def of(cls, values: list[float]) -> Self:
        return cls(min(values), median(values), max(values))

    def scaled(self, factor: float) -> Spread:
        return Spread(
            self.minimum * factor, self.median * factor, self.maximum * factor
        )

    def as_dict(self) -> dict[str, float]:
        return {name: float(f"{value:.6g}") for name, value in asdict(self).items()}

    def __str__(self) -> str:
        return " / ".join(
            short(value) for value in (self.minimum, self.median, self.maximum)
        )


def short(value: float) -> str:
    """Three significant digits without exponents for common sizes."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:.3g}"


def timed(job: Callable[[], Any]) -> Timer:
    """A job timed from Python."""

    def timer() -> float:
        start = perf_counter()
        job()
        return perf_counter() - start

    return timer


def settled(timer: Timer) -> Timer:
    """A job that runs once untimed before it is timed: memory that others have pushed out is back in its place."""

    def second() -> float:
        timer()
        return timer()

    return second


@dataclass(frozen=True)
class Rounds:
    """Seconds of several jobs, round by round.

    Attributes
    ----------
    seconds : mapping of str to list of float
    counts : mapping of str to int
        Samples that a job works on.
    """

    seconds: Mapping[str, list[float]]
    counts: Mapping[str, int]

    def per_sample(self, name: str) -> Spread:
        """Nanoseconds per sample of one job."""
        return Spread.of(self._per_sample(name)).scaled(1e9)

    def ratio(self, slower: str, faster: str) -> Spread:
        """How many times faster one job is per sample than another of the same round."""
        return Spread.of(
            [
                a / b
                for a, b in zip(
                    self._per_sample(slower), self._per_sample(faster), strict=True
                )
            ]
        )

    def _per_sample(self, name: str) -> list[float]:
        return [s / self.counts[name] for s in self.seconds[name]]


def interleaved_rounds(timers: Mapping[str, tuple[int, Timer]], repeats: int) -> Rounds:
    """Run all jobs in turn, again and again.

    Parameters
    ----------
    timers : mapping of str to (int, callable)
        How many samples a job works on, and the job.
    repeats : int
        Rounds that count; one more before them warms caches and compiles.
    """
    seconds: dict[str, list[float]] = {name: [] for name in timers}
    for round_ in range(repeats + 1):
        for name, (_, timer) in timers.items():
            gc.collect()
            taken = timer()
            if round_:
                seconds[name].append(taken)
    return Rounds(seconds, {name: count for name, (count, _) in timers.items()})
