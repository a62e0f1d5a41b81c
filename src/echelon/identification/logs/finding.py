"""Findings: what is wrong with a log, or worth knowing, and where; and the wording that they share."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum

from echelon.shared import MOST_NAMED


class Severity(StrEnum):
    """Importance of a finding."""

    NOTE = "note"
    WARNING = "warning"


@dataclass(frozen=True)
class Finding:
    """Something that was found."""

    severity: Severity
    kind: str  # a short fixed name such as ``"gap"``, ``"stuck"``, ``"saturation"``, ``"jitter"``, ``"units"``
    where: str  # file, channel and time
    text: str  # what was found, how much of it, and what was done or can be done about it: one sentence

    def __str__(self) -> str:
        return f"{self.where}: {self.text}" if self.where else self.text


def note(kind: str, where: str, text: str) -> Finding:
    """A finding that is worth knowing."""
    return Finding(Severity.NOTE, kind, where, text)


def warning(kind: str, where: str, text: str) -> Finding:
    """A finding about something wrong."""
    return Finding(Severity.WARNING, kind, where, text)


def listed(names: Iterable[str]) -> str:
    """Some names, cut short where they are many."""
    words = list(dict.fromkeys(names))
    return (
        ", ".join(words[:MOST_NAMED])
        + (f", … ({len(words)} in all)" if len(words) > MOST_NAMED else "")
    ) or "none"


def enumerated(names: Sequence[str], separator: str = ", ") -> str:
    """Some names, the first ones if they are many."""
    shown = [*names[:MOST_NAMED], *(["others"] if len(names) > MOST_NAMED else [])]
    if len(shown) == 1:
        return shown[0]
    return f"{separator.join(shown[:-1])} and {shown[-1]}"


def counted(count: int, one: str, many: str = "") -> str:
    """A number with its noun: ``1 sample``, ``3 samples``."""
    return f"{count} {one if count == 1 else many or one + 's'}"


def seconds(time: float) -> str:
    """A time stamp to the microsecond, also where it counts from 1970."""
    return f"{time:.6f}".rstrip("0").rstrip(".")
