"""A mechanism with what is known about it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Case:
    """A mechanism with its numbers of degrees of freedom and of base parameters."""

    freedom: int
    rank: int
    text: str
    slow: bool = False
