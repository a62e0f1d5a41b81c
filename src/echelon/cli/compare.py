"""The command that compares two robots."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from echelon.cli.destination import Destination, deliver
from echelon.cli.screen import json_text, steps
from echelon.comparison import Equality, compare
from echelon.formats import load

EXIT_CODES = {Equality.EQUAL: 0, Equality.DIFFERENT: 1, Equality.UNDECIDED: 3}


def run_compare(
    first: Path,
    second: Path,
    read: Mapping[str, Any],
    options: Mapping[str, Any],
    output: Destination | None,
    *,
    as_json: bool,
) -> int:
    """Compare two robots, print or write what was found, and return the exit code."""
    with steps(f"comparing {first.name} and {second.name}"):
        found = compare(load(first, **read), load(second, **read), **options)
    if output is None and not as_json and sys.stdout.isatty():
        from echelon.cli.terminal import print_comparison

        print_comparison(found)
    else:
        deliver(json_text(found.to_dict()) if as_json else found.to_text(), output)
    return EXIT_CODES[found.verdict]
