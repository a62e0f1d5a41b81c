"""Terminal output of commands: text with control characters removed, and progress, which pipes do not get."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

import click

from echelon.shared import one_line

if TYPE_CHECKING:
    import logging

_NOT_ASCII = re.compile(r"[^\n\x20-\x7e]")
_state = {"verbose": False}


def set_verbosity(verbose: bool) -> None:
    """Choose whether every step of this command is a line on standard error, also in a pipe."""
    _state["verbose"] = verbose


def show(text: str) -> None:
    """Print text or JSON, with a line break at its end."""
    click.echo(visible(text.removesuffix("\n")))


def visible(text: str) -> str:
    r"""Text in which a character that cannot be printed is written as JSON writes it: ``\u009b``.

    >>> print(visible('{"name": "é\x9b31m"}'))
    {"name": "é\u009b31m"}
    """
    return _NOT_ASCII.sub(
        lambda c: c[0] if c[0].isprintable() else json.dumps(c[0])[1:-1], text
    )


def json_text(record: object) -> str:
    """A record as JSON text that ends with a line break."""
    return json.dumps(record, indent=1, ensure_ascii=False) + "\n"


def say_written(paths: Iterable[Path]) -> None:
    """Print which files were written, if any were."""
    if written := ", ".join(map(str, paths)):
        show(f"wrote {written}")


def say_doubts(doubts: Iterable[str]) -> None:
    """Print doubts about what was written, on standard error as other warnings."""
    for doubt in doubts:
        click.echo(visible(f"warning: {one_line(doubt)}"), err=True)


def say_time(started: float) -> None:
    """Print the time since a value of ``perf_counter``; only on a terminal, so that equal runs write equal bytes."""
    if sys.stderr.isatty():
        sys.stderr.write(f"time: {perf_counter() - started:.2f} s\n")


def _logger() -> logging.Logger:
    """The logger ``echelon``, which writes messages and the time since now to standard error."""
    import logging

    started = perf_counter()

    class Since(logging.Formatter):
        def format(self, record: logging.LogRecord) -> str:
            return f"{perf_counter() - started:8.2f} s  {record.getMessage()}"

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(Since())
    log = logging.getLogger("echelon")
    log.handlers, log.propagate = [handler], False
    log.setLevel(logging.INFO)
    return log


@contextmanager
def steps(title: str = "") -> Iterator[Callable[[str], None]]:
    """A spinner that says which step of a command runs; nothing in a pipe."""
    if _state["verbose"]:
        log = _logger()

        def say(message: str) -> None:
            log.info("%s", one_line(message))

        if title:
            say(title)
        yield say
    elif not sys.stderr.isatty():
        yield lambda _: None
    else:
        from rich.console import Console
        from rich.text import Text

        with Console(stderr=True).status(Text(one_line(title))) as status:
            yield lambda message: status.update(Text(one_line(message)))
