"""Tables in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A table whose first column is text; None becomes a dash."""
    lines = [f"| {' | '.join(head)} |", f"|---|{'--:|' * (len(head) - 1)}"]
    lines += [
        f"| {' | '.join('–' if cell is None else str(cell) for cell in row)} |"
        for row in rows
    ]
    return "\n".join(lines)
