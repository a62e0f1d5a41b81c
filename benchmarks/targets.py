"""Targets: what a run must reach, and whether it did."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ratios import short
from timing import seconds_text


@dataclass(frozen=True)
class Target:
    """One target.

    Attributes
    ----------
    target : str
        What is measured.
    median : float
        What was reached, the median where there are several runs.
    limit : float
    unit : str
        ``"s"``, ``"×"`` a ratio, ``"MB"``, or nothing for a plain number.
    at_least : bool
        Whether more is better.
    """

    target: str
    median: float
    limit: float
    unit: str = "s"
    at_least: bool = False

    @property
    def passed(self) -> bool:
        return self.median >= self.limit if self.at_least else self.median <= self.limit

    def as_dict(self) -> dict[str, Any]:
        common = {
            "target": self.target,
            "median": self.median,
            "limit": self.limit,
            "passed": self.passed,
        }
        return (
            common
            if self.unit == "s"
            else common | {"unit": self.unit, "at_least": self.at_least}
        )

    def cells(self) -> list[str]:
        """A row of the table."""
        sign = "≥" if self.at_least else "≤"
        verdict = "pass" if self.passed else "**FAIL**"
        return [
            self.target,
            self._text(self.median),
            f"{sign} {self._text(self.limit)}",
            verdict,
        ]

    def _text(self, value: float) -> str:
        if self.unit == "s":
            return seconds_text(value)
        return f"{short(value)}{'' if self.unit in ('', '×') else ' '}{self.unit}"


def from_dict(stored: dict[str, Any]) -> Target:
    """A target as it was written."""
    return Target(**{name: value for name, value in stored.items() if name != "passed"})
