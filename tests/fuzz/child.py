"""One run in a child process with limits, forked from a parent that has imported everything."""

from __future__ import annotations

import os
import resource
import signal
import sys
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

SECONDS = 20
"""Of the processor, that no run may take."""

MEMORY = 1 << 30
"""Bytes that no run may hold, those of the parent included."""

_ROOM = 8 << 30
_PATIENCE = 300
_CRASHED = 99


@dataclass(frozen=True)
class Outcome:
    """What became of a run.

    Attributes
    ----------
    code : int
        Exit code; minus the number of the signal that ended it.
    seconds : float
        Of the processor.
    memory : int
        Bytes, at most.
    text : str
        What it printed.
    """

    code: int
    seconds: float
    memory: int
    text: str

    @property
    def fault(self) -> str:
        """What is wrong with it, if anything."""
        if self.code == -signal.SIGXCPU or self.seconds > SECONDS:
            return f"more than {SECONDS} s"
        if self.memory > MEMORY:
            return f"{self.memory >> 20} MB"
        if self.code not in (0, 1, 2):
            return f"exit code {self.code}"
        return "a traceback" if "Traceback (most recent call last)" in self.text else ""


def run_alone(act: Callable[[], int | None], log: Path) -> Outcome:
    """Run a function in a child process.

    Parameters
    ----------
    act : callable
        Returns an exit code.
    log : Path
        Where what it prints is kept meanwhile.
    """
    child = os.fork()
    if not child:
        _become(act, log)
    _, status, usage = os.wait4(child, 0)
    code = -os.WTERMSIG(status) if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)
    text = log.read_text(encoding="utf-8", errors="replace")
    return Outcome(code, usage.ru_utime + usage.ru_stime, usage.ru_maxrss << 10, text)


def _become(act: Callable[[], int | None], log: Path) -> None:
    code = _CRASHED
    try:
        _limit()
        output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        for stream in (1, 2):
            os.dup2(output, stream)
        sys.stdout, sys.stderr = (
            os.fdopen(stream, "w", encoding="utf-8", errors="replace")
            for stream in (1, 2)
        )
        try:
            code = act() or 0
        except SystemExit as end:
            code = (
                end.code if isinstance(end.code, int) else 0 if end.code is None else 1
            )
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def _limit() -> None:
    """Of the processor's time, because other work on the machine does not matter; in the end by the wall's clock."""
    os.setpgid(0, 0)
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 2))
    resource.setrlimit(resource.RLIMIT_AS, (_ROOM, _ROOM))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.alarm(_PATIENCE)
