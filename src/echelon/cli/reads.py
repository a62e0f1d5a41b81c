"""Which files this process reads.

Python itself is asked to tell: so no reader can forget to say so, and files that other files name are among them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

_WRITING = os.O_WRONLY | os.O_RDWR

_paths: set[str] = set()
_state = {"watching": False}


def watch_reads() -> None:
    """Forget what was read so far, and note every file that is opened for reading from now on."""
    _install()
    _paths.clear()
    _state["watching"] = True


def was_read(path: Path) -> bool:
    """Whether a file was opened for reading."""
    with unwatched():
        return os.fspath(path) in {os.path.realpath(found) for found in _paths}


@contextmanager
def unwatched() -> Iterator[None]:
    """For looking into files that are about to be replaced."""
    before, _state["watching"] = _state["watching"], False
    try:
        yield
    finally:
        _state["watching"] = before


@cache  # a hook stays until the process ends
def _install() -> None:
    sys.addaudithook(_note)


def _note(event: str, arguments: tuple[object, ...]) -> None:
    if event != "open" or not _state["watching"]:
        return
    path, _, flags = arguments
    if isinstance(path, str | bytes) and isinstance(flags, int) and not flags & _WRITING:
        _paths.add(os.fsdecode(path))
