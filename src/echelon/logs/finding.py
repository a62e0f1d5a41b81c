"""Findings: what is wrong with a log, or worth knowing, and where."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Severity(StrEnum):
    """How much a finding matters."""

    NOTE = "note"
    WARNING = "warning"


@dataclass(frozen=True)
class Finding:
    """Something that was found.

    Attributes
    ----------
    severity : Severity
    kind : str
        A short fixed name such as ``"gap"``, ``"stuck"``, ``"saturation"``, ``"jitter"``, ``"units"``.
    where : str
        File, channel and time.
    text : str
        What was found, how much of it, and what was done or can be done about it: one sentence.
    """

    severity: Severity
    kind: str
    where: str
    text: str

    def __str__(self) -> str:
        return f"{self.where}: {self.text}" if self.where else self.text
