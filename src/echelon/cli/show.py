"""What commands write to standard output: only characters that a terminal shows, none that it obeys."""

from __future__ import annotations

import json
import re

import typer

_NOT_ASCII = re.compile(r"[^\n\x20-\x7e]")


def show(text: str) -> None:
    """Print text or JSON, with a line break at its end."""
    typer.echo(visible(text.removesuffix("\n")))


def visible(text: str) -> str:
    r"""Lines in which what is not printable stands as ``\u009b``, which is what JSON calls it, too.

    >>> print(visible('{"name": "é\x9b31m"}'))
    {"name": "é\u009b31m"}
    """
    return _NOT_ASCII.sub(lambda c: c[0] if c[0].isprintable() else json.dumps(c[0])[1:-1], text)
