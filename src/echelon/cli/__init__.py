"""The command line: a thin shell over the library."""

from __future__ import annotations

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its code."""
    from echelon.cli.process import leave_signals, prepare  # nothing slow, so that signals find an answer early

    prepare()
    try:
        from echelon.cli.commands import run

        run()
    finally:
        leave_signals()
