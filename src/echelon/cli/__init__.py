"""The command line: a thin shell over the library."""

from echelon.cli.main import main

__all__ = ["main"]
