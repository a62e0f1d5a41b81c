"""The command line: a thin shell over the library."""

from __future__ import annotations

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its code."""
    try:
        from echelon.cli.process import (
            leave,
            prepare,
        )  # nothing slow, so that signals find an answer early

        prepare()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    try:
        from echelon.cli.commands import run

        run()
    finally:
        leave()
