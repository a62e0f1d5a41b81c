"""The ``identify`` command."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from echelon.cli.destination import Destination
from echelon.cli.progress import say_time, steps
from echelon.cli.show import show
from echelon.errors import InputError
from echelon.identification.identify import identify
from echelon.identification.setup import load_setup

if TYPE_CHECKING:
    from echelon.identification.result import Identification
    from echelon.identification.settings import Setup

NO_CODE = "none"
MODEL, REPORT = "model.json", "report.html"


@dataclass(frozen=True)
class IdentifyRequest:
    """Arguments of the command."""

    setup: Path
    logs: tuple[Path, ...]
    validate: tuple[Path, ...]
    output: Destination | None  # directory for what is written
    prior: Path | None
    changed: Mapping[str, Any]  # settings that replace those of the set-up
    reading: Mapping[str, Any]  # keyword arguments of ``load``
    target: str  # language of the source code, or ``"none"``
    dask: str | None  # address of a scheduler, or a number of processes


def run_identify(request: IdentifyRequest, *, as_json: bool) -> None:
    """Identify, write all files, and print the summary."""
    started = perf_counter()
    _check_target(request.target)
    if request.output is not None:
        request.output.check((MODEL, REPORT))
    setup = load_setup(request.setup, prior=request.prior, **request.reading)
    setup = replace(setup, settings=replace(setup.settings, **request.changed))
    with steps() as step, _cluster(request.dask) as client:
        result = identify(setup, request.logs, request.validate, client=client, on_step=step)
        step("writing")
        files = {} if request.output is None else _files(result, setup, request.target)
    paths = [] if request.output is None else request.output.write_into(files)
    if as_json:
        from echelon.results.identified import identification_to_json

        document = json.loads(identification_to_json(result))
        show(json.dumps({**document, "files": [str(path) for path in paths]}, indent=1, ensure_ascii=False))
        return
    from echelon.cli.identify_terminal import print_identification

    print_identification(result)
    if paths:
        show(f"wrote {', '.join(map(str, paths))}")
    say_time(started)


def _check_target(target: str) -> None:
    from echelon.codegen.targets import TARGETS
    from echelon.hints import nearest_of

    if target != NO_CODE and target not in TARGETS:
        raise InputError(f"there is no language '{target}'{nearest_of(target, [*TARGETS, NO_CODE])}")


def _cluster(where: str | None) -> Any:
    from contextlib import nullcontext

    if where is None:
        return nullcontext()
    from echelon.identification.cluster import connect

    return connect(where)


def _files(result: Identification, setup: Setup, target: str) -> dict[str, str]:
    """Everything that is written, by name, so that nothing is written unless all of it can be."""
    from echelon.formats.write_robot import identified_robot
    from echelon.report.page import report_html
    from echelon.results.identified import identification_to_json

    files = {MODEL: identification_to_json(result), REPORT: report_html(result)}
    if result.physical is not None:
        source = setup.robot_file or setup.source
        for robot in identified_robot(result.base.mechanism, result.physical.standard, source):
            files[robot.name] = robot.text
    if target != NO_CODE:
        from echelon.codegen.generate import generate

        names = [expression.name for expression in result.base.expressions]
        values = dict(zip(names, map(float, result.values), strict=True))
        files |= generate(result.base, target, name="model", parameters=values)
    return files
