"""The ``excite`` and ``check-trajectory`` commands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import typer

from echelon.cli.destination import Destination
from echelon.cli.screen import say_time, show, steps
from echelon.errors import InputError
from echelon.identification.setup import load_setup

if TYPE_CHECKING:
    from echelon.excite.exciting_trajectory import ExcitingTrajectory

TRAJECTORY, PREVIEW = "trajectory.json", "preview.html"
FORMATS = ("csv", "parquet", "yaml")
BROKEN = 1
"""Exit code where a limit is broken."""


@dataclass(frozen=True)
class ExciteRequest:
    """Arguments of the command.

    Attributes
    ----------
    setup : Path
    output : Destination, optional
        Directory for what is written.
    prior : Path, optional
    logs : tuple of Path
        Logs that the trajectory is to complement.
    changed : mapping
        Fields of the section ``excitation``.
    reading : mapping
        Keyword arguments of ``load``.
    formats : tuple of str
        Of the samples.
    sampling : float
        Hz.
    repeats : int
    jobs : int, optional
    """

    setup: Path
    output: Destination | None
    prior: Path | None
    logs: tuple[Path, ...]
    changed: Mapping[str, Any]
    reading: Mapping[str, Any]
    formats: tuple[str, ...]
    sampling: float
    repeats: int
    jobs: int | None


def run_excite(request: ExciteRequest, *, as_json: bool) -> None:
    """Design a trajectory, write all files, and print the summary."""
    from echelon.excite.excite import exciting_trajectory
    from echelon.excite.problem.prior_information import information_of_logs

    started = perf_counter()
    _check_formats(request.formats)
    if request.output is not None:
        request.output.check((TRAJECTORY, PREVIEW, *(f"trajectory.{name}" for name in request.formats)))
    setup = load_setup(request.setup, prior=request.prior, **request.reading)
    with steps() as step:
        step("reading logs")
        known = information_of_logs(setup, request.logs) if request.logs else None
        found = exciting_trajectory(setup, known=known, jobs=request.jobs, on_step=step, **request.changed)
        step("writing")
        files = {} if request.output is None else _files(found, request)
    paths = [] if request.output is None else request.output.write_into(files)
    _say(found, paths, started, as_json=as_json)


def run_check(
    setup_path: Path,
    path: Path,
    output: Destination | None,
    prior: Path | None,
    changed: Mapping[str, Any],
    reading: Mapping[str, Any],
    *,
    as_json: bool,
) -> None:
    """Judge a trajectory made elsewhere; exit with 1 if it breaks a limit."""
    from echelon.excite.excite import judged_trajectory
    from echelon.excite.files.read_trajectory import read_trajectory
    from echelon.excite.problem.task import changed as changed_entry
    from echelon.excite.problem.task import task_of
    from echelon.report.preview import preview_html

    started = perf_counter()
    setup = load_setup(setup_path, prior=prior, **reading)
    with steps() as step:
        step("reading")
        task = task_of(setup, changed_entry(setup.excitation, changed, setup.source))
        trajectory = read_trajectory(path, task.mechanism.independent_velocities, task.units)
        step("checking all limits at every time")
        found = judged_trajectory(setup, trajectory, **changed)
    if output is not None:
        output.write(preview_html(found))
    _say(found, [] if output is None else [output.path], started, as_json=as_json)
    if not found.safe:
        raise typer.Exit(BROKEN)


def _check_formats(formats: Sequence[str]) -> None:
    from echelon.hints import nearest_of

    for name in formats:
        if name not in FORMATS:
            raise InputError(f"there is no format '{name}'{nearest_of(name, FORMATS)}")


def _files(found: ExcitingTrajectory, request: ExciteRequest) -> dict[str, str | bytes]:
    """Everything that is written, by name, so that nothing is written unless all of it can be."""
    from echelon.excite.files.coefficients import text_of
    from echelon.excite.files.write_trajectory import design_to_json, trajectory_content
    from echelon.report.preview import preview_html

    files: dict[str, str | bytes] = {
        TRAJECTORY: text_of(design_to_json(found)),
        PREVIEW: preview_html(found),
    }
    for name in request.formats:
        kind = f".{name}"
        files[f"trajectory{kind}"] = trajectory_content(found.trajectory, kind, request.sampling, request.repeats)
    return files


def _say(found: ExcitingTrajectory, paths: Sequence[Path], started: float, *, as_json: bool) -> None:
    if as_json:
        import json

        from echelon.excite.files.write_trajectory import design_to_json

        document = {**design_to_json(found), "files": [str(path) for path in paths]}
        show(json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False))
        return
    from echelon.cli.excite_terminal import print_trajectory

    print_trajectory(found)
    if paths:
        show(f"wrote {', '.join(map(str, paths))}")
    say_time(started)
