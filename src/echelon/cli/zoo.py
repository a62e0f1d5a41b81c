"""The command ``zoo build``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from echelon.cli.screen import json_text, show, steps
from echelon.errors import InputError
from echelon.zoo.build import build_zoo

_MARK = "zoo.json"
UNANSWERED = 1
"""Exit code where a robot got no answer; the others have their pages."""


def run_zoo(
    folder: Path, sources: Sequence[Path], only: str, jobs: int, seconds: float, *, force: bool, as_json: bool
) -> int:
    """Build, telling the robots that are done, and say what was built and what failed; returns the exit code."""
    if (
        folder.exists()
        and not force
        and not (folder / _MARK).exists()
        and (not folder.is_dir() or any(folder.iterdir()))
    ):
        problem = "there is something else already; choose another place, or write into it with --force"
        raise InputError(problem, source=str(folder))
    with steps("looking for robots") as say:

        def step(done: int, total: int, row: Mapping[str, Any] | None) -> None:
            last = "" if row is None else f": {row['name']}{' failed' * ('failed' in row)}"
            say(f"{done} of {total} robots{last}")

        rows = build_zoo(folder, sources, only, jobs, seconds, step)
    failed = [row for row in rows if "failed" in row]
    if as_json:
        show(json_text({"schema": "echelon.zoo/1", "folder": str(folder), "robots": rows}))
    else:
        for row in failed:
            show(f"{row['place']}{' (floating)' if row['floating'] else ''}: {row['failed']}")
        show(f"{len(rows) - len(failed)} robots in {folder / 'index.html'}, {len(failed)} without an answer")
    return UNANSWERED if failed else 0
