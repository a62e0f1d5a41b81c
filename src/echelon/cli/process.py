"""The process around a command: its standard streams, and what it does when it is told to stop.

A signal that stops the process becomes ``SystemExit``, so that everything that is open is put away on the way out:
temporary files, processes that were started.  Only in the middle of an import the process ends at once, since Python's
import machinery swallows exceptions there, and prints them.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from io import TextIOWrapper
from types import FrameType
from typing import Any

from echelon.shared import AssemblyWarning, DoubtWarning, SlowWarning, one_line

_STOPPING = ("SIGINT", "SIGTERM", "SIGHUP")
_SIGNALLED = 128  # added to a signal's number, the exit code of a process that it ended


class Exit(IntEnum):
    """Exit codes; the first ones are those of the independent verifier, too."""

    VALID = 0
    REFUTED = 1  # a set is not valid, a claim is wrong, or a limit is broken
    BAD_INPUT = 2
    NOT_COVERED = 3  # by the checks of a set
    INTERNAL = 70
    INTERRUPTED = _SIGNALLED + signal.SIGINT


_SHOW_CURSOR = b"\x1b[?25h"


def prepare() -> None:
    """Make standard streams usable, and answer signals."""
    for number in _signals():
        if signal.getsignal(number) is not signal.SIG_IGN:  # as under nohup
            signal.signal(number, _stop)
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        # closed: without a substitute, the next file that is opened would take its place
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, mode, encoding="utf-8"))  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(
            stream, TextIOWrapper
        ):  # files and pipes get UTF-8 on every system
            stream.reconfigure(
                errors="replace"
            ) if stream.isatty() else stream.reconfigure(encoding="utf-8")
    warnings.showwarning = _said_plainly(warnings.showwarning)


@dataclass
class Asked:
    """The signal that asked to stop, 0 if none did."""

    number: int = 0
    heard: bool = False  # whether somebody asks for it yet; before, a signal ends the command as any other

    @property
    def code(self) -> int:
        """Exit code of a command that a signal stopped."""
        return _SIGNALLED + self.number

    def stopped(self) -> bool:
        """Whether a signal asked to stop."""
        self.heard = True
        return self.number > 0


@contextmanager
def stop_asked(answer: str) -> Iterator[Asked]:
    """Let the first signal ask a command to stop, which is said with an answer; the second one ends the process."""
    asked, before = Asked(), {number: signal.getsignal(number) for number in _signals()}

    def ask(number: int, frame: FrameType | None) -> None:
        if not asked.heard:
            _stop(number, frame)
        if asked.number:
            if os.isatty(2):
                os.write(2, _SHOW_CURSOR)
            os._exit(_SIGNALLED + number)
        asked.number = number
        if os.isatty(2):
            os.write(2, f"{answer}\n".encode())

    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, ask)
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def leave() -> None:
    """From now on nothing is left to put away, and signals end the process at once."""
    for number in _signals():
        if signal.getsignal(number) is _stop:
            signal.signal(number, _end)


def _said_plainly(show: Callable[..., None]) -> Callable[..., None]:
    """Our own warnings are one line, without where in the program they were found."""
    said: set[str] = set()

    def warn(
        message: Warning | str, category: type[Warning], *where: Any, **options: Any
    ) -> None:
        if issubclass(category, AssemblyWarning | DoubtWarning | SlowWarning):
            text = one_line(str(message))
            if text not in said:  # it may come up in several places
                said.add(text)
                sys.stderr.write(f"warning: {text}\n")
        else:
            show(message, category, *where, **options)

    return warn


def _signals() -> list[int]:
    return [getattr(signal, name) for name in _STOPPING if hasattr(signal, name)]


def _stop(number: int, frame: FrameType | None) -> None:
    if os.isatty(2):
        os.write(
            2, _SHOW_CURSOR
        )  # who hid it may be interrupted before they know that they did
    inner = frame
    while inner is not None:
        if inner.f_code.co_filename.startswith("<frozen importlib"):
            _end(number, frame)
        inner = inner.f_back
    raise SystemExit(_SIGNALLED + number)


def _end(number: int, _frame: FrameType | None) -> None:
    os._exit(_SIGNALLED + number)
