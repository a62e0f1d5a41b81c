"""The command ``zoo build``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from echelon.cli.screen import json_text, show
from echelon.errors import InputError, one_line
from echelon.zoo.build import build_zoo

_MARK = "zoo.json"


def run_zoo(
    folder: Path, sources: Sequence[Path], only: str, jobs: int, seconds: float, *, force: bool, as_json: bool
) -> None:
    """Build, with a bar on a terminal, and say what was built and what failed."""
    if (
        folder.exists()
        and not force
        and not (folder / _MARK).exists()
        and (not folder.is_dir() or any(folder.iterdir()))
    ):
        problem = "there is something else already; choose another place, or write into it with --force"
        raise InputError(problem, source=str(folder))
    with _Bar() as bar:
        rows = build_zoo(folder, sources, only, jobs, seconds, bar.step)
    failed = [row for row in rows if "failed" in row]
    if as_json:
        show(json_text({"schema": "echelon.zoo/1", "folder": str(folder), "robots": rows}))
        return
    for row in failed:
        show(f"{row['place']}{' (floating)' if row['floating'] else ''}: {row['failed']}")
    show(f"{len(rows) - len(failed)} robots in {folder / 'index.html'}, {len(failed)} without an answer")


class _Bar:
    """A bar of progress on standard error; nothing in a pipe."""

    def __enter__(self) -> _Bar:
        self._bar: Any = None
        if sys.stderr.isatty():
            from rich.console import Console
            from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

            columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
            self._bar = Progress(*columns, console=Console(stderr=True))
            self._bar.start()
            self._task = self._bar.add_task("looking for robots")
        return self

    def step(self, done: int, total: int, row: dict[str, Any] | None) -> None:
        """Another robot is done."""
        if self._bar is not None:
            from rich.markup import escape

            text = "" if row is None else escape(one_line(row["name"])) + (" failed" if "failed" in row else "")
            self._bar.update(self._task, completed=done, total=total, description=text)

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.stop()
