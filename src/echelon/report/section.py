"""A section of a page: its title, its template and what the template shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

Shown = TypeVar("Shown")


@dataclass(frozen=True)
class Section(Generic[Shown]):
    """A part of a page."""

    key: str  # its anchor, and with the page's prefix before it the name of its template
    title: str
    context: Callable[[Shown], Mapping[str, Any]]  # from what the page is about to what the template shows
