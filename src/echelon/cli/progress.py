"""Progress on a terminal, silence in a pipe."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from time import perf_counter

from echelon.errors import one_line


def progress(message: str) -> AbstractContextManager[object]:
    """A spinner on a terminal, nothing in a pipe."""
    if not sys.stderr.isatty():
        return nullcontext()
    from rich.console import Console
    from rich.text import Text

    return Console(stderr=True).status(Text(one_line(message)))


def say_time(started: float) -> None:
    """How long it took since a time of ``perf_counter``, on a terminal; files and pipes get the same every time."""
    if sys.stderr.isatty():
        sys.stderr.write(f"time: {perf_counter() - started:.2f} s\n")


@contextmanager
def steps() -> Iterator[Callable[[str], None]]:
    """A spinner whose message changes from step to step; nothing in a pipe."""
    if not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status("") as status:
        yield lambda message: status.update(Text(one_line(message)))
