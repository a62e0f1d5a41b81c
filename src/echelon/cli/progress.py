"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

import sys
from contextlib import AbstractContextManager, nullcontext


def progress(message: str) -> AbstractContextManager[object]:
    """A spinner on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        return nullcontext()
    from rich.console import Console

    return Console(stderr=True).status(message)
