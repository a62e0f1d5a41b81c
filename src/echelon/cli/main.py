"""Entry point: commands, exit codes, and one clear line for every error."""

from __future__ import annotations

import os
import sys
from io import TextIOWrapper

from echelon.cli import excite_commands, log_commands, model_commands  # commands put themselves on the application
from echelon.cli.app import app
from echelon.machine.threads import VARIABLES

__all__ = ["app", "excite_commands", "log_commands", "main", "model_commands"]

BAD_INPUT, INTERNAL, INTERRUPTED = 2, 70, 130


def main() -> None:
    """Run the command line and exit with its code."""
    os.environ |= dict.fromkeys(VARIABLES, "1")  # before NumPy is imported; equal commands write equal bytes
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # files and pipes get UTF-8 on every system
            stream.reconfigure(errors="replace") if stream.isatty() else stream.reconfigure(encoding="utf-8")
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
    except Exception as error:
        sys.exit(_report(error))


def _report(error: Exception) -> int:
    """One line for what a user can mend, a traceback for our own mistakes or on request; returns the exit code."""
    from traceback import print_exception

    from echelon.errors import EchelonError, one_line

    expected = isinstance(error, EchelonError | OSError)
    if expected and not os.environ.get("ECHELON_TRACEBACK"):
        print(f"echelon: {one_line(str(error))}", file=sys.stderr)  # noqa: T201
    else:
        print_exception(error)
    return BAD_INPUT if expected else INTERNAL
