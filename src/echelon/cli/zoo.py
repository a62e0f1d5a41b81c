"""The command ``zoo build``.

Only typer is imported here; the command imports what it needs when it runs, so that ``--help`` is instant.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from echelon.cli.app import AsJson, app, application
from echelon.cli.screen import json_text, show, steps
from echelon.errors import InputError

_MARK = "zoo.json"
UNANSWERED = 1  # exit code where a robot got no answer; the others have their pages

group = application("zoo", "Pages about many robots at once.")
app.add_typer(group)


@group.command(epilog="Example: echelon zoo build zoo/ --only 'ur*' --jobs 4")
def build(
    folder: Annotated[
        Path, typer.Argument(help="Directory for the pages; open its index.html.")
    ],
    sources: Annotated[
        list[Path] | None,
        typer.Option(
            "--from",
            help="A folder with URDF, SDF, MJCF or descriptions; may be repeated. "
            "[default: the packages example-robot-data and robot_descriptions]",
        ),
    ] = None,
    only: Annotated[
        str, typer.Option(help="A pattern of names or paths, such as 'ur*'.")
    ] = "*",
    jobs: Annotated[
        int, typer.Option(min=1, help="Robots that are derived at the same time.")
    ] = 2,
    seconds: Annotated[
        float, typer.Option(min=1, help="Time that a robot may take, s.")
    ] = 300.0,
    force: Annotated[
        bool, typer.Option("--force", help="Write into a directory that is no zoo.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Derive every robot of some folders, and write a page for each with an index.

    What is there already, of the same file and by the same program, is left as it is. A robot without an answer is
    listed with its reason and does not stop the others; the exit code is then 1.
    """
    from echelon.zoo.build import build_zoo

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
            last = (
                "" if row is None else f": {row['name']}{' failed' * ('failed' in row)}"
            )
            say(f"{done} of {total} robots{last}")

        rows = build_zoo(folder, sources or (), only, jobs, seconds, step)
    failed = [row for row in rows if "failed" in row]
    if as_json:
        show(
            json_text(
                {"schema": "echelon.zoo/1", "folder": str(folder), "robots": rows}
            )
        )
    else:
        for row in failed:
            show(
                f"{row['place']}{' (floating)' if row['floating'] else ''}: {row['failed']}"
            )
        show(
            f"{len(rows) - len(failed)} robots in {folder / 'index.html'}, {len(failed)} without an answer"
        )
    raise typer.Exit(UNANSWERED if failed else 0)
