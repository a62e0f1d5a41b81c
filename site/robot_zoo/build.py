"""The job: every robot in a process of its own, so that neither a crash nor a long derivation stops the others."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from fnmatch import fnmatch
from math import log10
from multiprocessing.connection import Connection, wait
from pathlib import Path
from threading import Thread
from time import monotonic
from typing import Any

from echelon.report.page import Context, render, script_safe
from echelon.shared.errors import EchelonError, InputError, one_line
from echelon.shared.files import write_atomically
from echelon.shared.version import __version__
from robot_zoo.exhibit import (
    TEMPLATES,
    Found,
    Row,
    ZooTask,
    build_exhibit,
    robot_files,
    usual_folders,
)

Progress = Callable[
    [int, int, Row | None], None
]  # told how many robots are done, of how many, and the last one's row

_DESCRIPTIONS = (".yaml", ".yml")


def build_zoo(
    folder: Path,
    sources: Sequence[Path] = (),
    only: str = "*",
    jobs: int = 1,
    seconds: float = 300.0,
    progress: Progress = lambda *_: None,
    site: str = "",
) -> list[Row]:
    """Build or complete a zoo, and return the rows of the robots that were asked for, also of those that failed.

    ``only`` is a pattern of names or paths; a robot gets ``seconds`` at most.  The index also has what was there.
    ``site`` leads from the folder to documentation and explorer, such as "../"; without it no page leads there.
    """
    searched = list(sources) or usual_folders()
    if not searched:
        raise InputError(
            "no robots are installed: pip install example-robot-data, or name folders with --from"
        )
    tasks = [
        task for found in robot_files(searched) for task in _tasks(found, folder, site)
    ]
    chosen = {
        t.slug
        for t in tasks
        if fnmatch(t.found.slug, only) or fnmatch(t.found.place, only)
    }
    if not chosen:
        raise InputError(
            f"no robot file matches '{only}' in {', '.join(map(str, searched))}"
        )
    rows = {task.slug: task.finished() for task in tasks}
    waiting = [
        task for task in tasks if task.slug in chosen and rows[task.slug] is None
    ]
    write_index(
        folder, [row for row in rows.values() if row is not None], site
    )  # a build that is stopped can go on
    progress(0, len(waiting), None)
    for done, (task, row) in enumerate(_built(waiting, jobs, seconds), 1):
        rows[task.slug] = row
        progress(done, len(waiting), row)
    write_index(folder, [row for row in rows.values() if row is not None], site)
    return [row for slug, row in rows.items() if row is not None and slug in chosen]


def _tasks(found: Found, folder: Path, site: str) -> list[ZooTask]:
    """A description states its base itself; other files are read with a fixed and with a floating one."""
    stated = found.path.suffix.lower() in _DESCRIPTIONS
    return [
        ZooTask(found, floating, folder, site)
        for floating in ((False,) if stated else (False, True))
    ]


# -- processes ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Running:
    task: ZooTask
    process: Any
    answer: Connection
    until: float


def _built(
    tasks: Sequence[ZooTask], jobs: int, seconds: float
) -> Iterator[tuple[ZooTask, Row | None]]:
    """Rows as they are done."""
    context: Any = multiprocessing.get_context(
        "spawn" if os.name == "nt" else "forkserver"
    )
    if os.name != "nt":
        context.set_forkserver_preload([__name__])
    waiting, running = list(reversed(tasks)), list[_Running]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                running.append(_started(context, waiting.pop(), seconds))
            rest = max(min(one.until for one in running) - monotonic(), 0.0)
            ready = wait([one.answer for one in running], timeout=rest)
            for one in [
                one for one in running if one.answer in ready or monotonic() > one.until
            ]:
                running.remove(one)
                yield one.task, _ended(one, seconds)
    finally:
        for one in running:
            one.process.kill()


def _started(context: Any, task: ZooTask, seconds: float) -> _Running:
    answer, far = context.Pipe(duplex=False)
    process = context.Process(target=_work, args=(task, far), daemon=True)
    process.start()
    far.close()
    return _Running(task, process, answer, monotonic() + seconds)


def _work(task: ZooTask, answer: Connection) -> None:
    """In a process of its own, which ends with the one that started it."""
    signal.signal(
        signal.SIGINT, signal.SIG_IGN
    )  # Ctrl-C reaches all processes; the first of them ends the others
    Thread(target=_end_with_parent, daemon=True).start()
    try:
        row = build_exhibit(task)
    except EchelonError as error:
        row = _failed(task, str(error).replace(str(task.found.path), task.found.place))
    except Exception as error:  # a mistake of ours: the others go on
        row = _failed(task, f"{type(error).__name__}: {error}")
    with suppress(OSError):  # nobody waits for it any more
        answer.send(row)


def _end_with_parent() -> None:
    """End this process at once, without a word, when the one that started it is gone."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _ended(one: _Running, seconds: float) -> Row | None:
    try:
        if one.answer.poll():
            row: Row | None = one.answer.recv()
            return row
        late = monotonic() > one.until
        return _failed(
            one.task,
            f"not done within {seconds:g} s"
            if late
            else "its process ended without an answer",
        )
    except EOFError:
        return _failed(one.task, "its process ended without an answer")
    finally:
        one.process.kill()
        one.process.join()
        one.answer.close()


def _failed(task: ZooTask, reason: str) -> Row:
    return {**task.start, "name": task.found.path.stem, "failed": one_line(reason)}


# -- the index ---------------------------------------------------------------------------------------------------------


def write_index(folder: Path, rows: Sequence[Row], site: str = "") -> None:
    """The page that leads to all others, and its rows as ``zoo.json``."""
    good = [row for row in rows if "failed" not in row]
    failed = [row for row in rows if "failed" in row]
    shown = {
        "rows": good,
        "failed": failed,
        "plot": _plot(good),
        "version": __version__,
        "site": site,
    }
    folder.mkdir(parents=True, exist_ok=True)
    write_atomically(
        folder / "zoo.json",
        script_safe({"version": __version__, "robots": list(rows)}) + "\n",
    )
    write_atomically(
        folder / "index.html", render("index.html.j2", shown, TEMPLATES) + "\n"
    )


_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 720.0, 420.0, 56.0, 44.0  # of the plot, px


def _plot(rows: Sequence[Row]) -> Context | None:
    """Base against standard parameters, both on logarithmic scales."""
    points = [row for row in rows if row["rank"] > 0]
    if not points:
        return None
    low, high = 1.0, max(row["standard"] for row in points) * 1.15

    def place(value: float, start: float, end: float) -> float:
        return start + (end - start) * log10(value / low) / log10(high / low)

    def x(value: float) -> float:
        return place(value, _LEFT, _WIDTH - 12)

    def y(value: float) -> float:
        return place(value, _HEIGHT - _BOTTOM, 12)

    ticks = [t for e in range(4) for t in (10**e, 3 * 10**e) if t < high]
    dots = [
        {"x": x(row["standard"]), "y": y(row["rank"]), "row": row} for row in points
    ]
    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "left": _LEFT,
        "floor": _HEIGHT - _BOTTOM,
        "right": _WIDTH - 12,
        "dots": dots,
        "ticks": [{"value": t, "x": x(t), "y": y(t)} for t in ticks],
        "equal": (x(low), y(low), x(high), y(high)),
    }
