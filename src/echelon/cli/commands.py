"""All commands, their exit codes, and one clear line for every error."""

from __future__ import annotations

import os
import sys

from echelon.cli import excite_commands, log_commands, model_commands  # commands put themselves on the application
from echelon.cli.app import app
from echelon.machine.threads import VARIABLES

__all__ = ["app", "excite_commands", "log_commands", "model_commands", "run"]

BAD_INPUT, INTERNAL, INTERRUPTED = 2, 70, 130


def run() -> None:
    """Run the command that the arguments name, and exit with its code."""
    os.environ |= dict.fromkeys(VARIABLES, "1")  # before NumPy is imported; equal commands write equal bytes
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
