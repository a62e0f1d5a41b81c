"""The ``identify`` command; of robots whose joints are servos, an output-error fit of positions."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from echelon.cli.destination import Destination
from echelon.cli.screen import json_text, say_time, say_written, show, steps
from echelon.cli.terminal import print_identification, print_servos
from echelon.codegen import TARGETS
from echelon.errors import InputError
from echelon.hints import nearest_of
from echelon.identification.identify import identify
from echelon.identification.servos.servo_fit import fit_servos
from echelon.identification.servos.servo_start import servo_joints
from echelon.results.identified import servo_document, servo_to_json
from echelon.setup.setup import Setup, load_setup

if TYPE_CHECKING:
    from echelon.identification.result import Identification


NO_CODE = "none"
MODEL, REPORT, SERVOS = "model.json", "report.html", "servos.json"


def run_identify(
    setup_file: Path,
    logs: Sequence[Path],
    validate: Sequence[Path],
    output: Destination | None,
    prior: Path | None,
    changed: dict[str, Any],
    read: Mapping[str, Any],
    target: str,
    dask: str | None,
    *,
    as_json: bool,
) -> tuple[str, ...]:
    """Identify with changed settings, write all files, print the summary; why the model should not be used."""
    started = perf_counter()
    if target not in (NO_CODE, *TARGETS):
        raise InputError(f"there is no language '{target}'{nearest_of(target, [*TARGETS, NO_CODE])}")
    if output is not None:
        output.check((MODEL, REPORT))
    setup = load_setup(setup_file, prior=prior, **read)
    setup = replace(setup, seed=changed.pop("seed", setup.seed)).with_settings(**changed)
    if servo_joints(setup.mechanism):
        return run_servos(setup, [*logs, *validate], output, as_json=as_json)
    with steps() as step, _cluster(dask) as client:
        result = identify(setup, tuple(logs), tuple(validate), client=client, on_step=step)
        step("writing")
        files = {} if output is None else _files(result, setup, target)
    paths = [] if output is None else output.write_into(files)
    if as_json:
        from echelon.results.identified import identification_to_json

        show(json_text({**json.loads(identification_to_json(result)), "files": [str(path) for path in paths]}))
        return result.reasons
    print_identification(result)
    say_written(paths)
    say_time(started)
    return result.reasons


def _cluster(where: str | None) -> Any:
    from contextlib import nullcontext

    if where is None:
        return nullcontext()
    from echelon.identification.cluster import connect

    return connect(where)


def _files(result: Identification, setup: Setup, target: str) -> dict[str, str]:
    """Everything that is written, by name, so that nothing is written unless all of it can be."""
    from echelon.formats.writers.robot_writer import identified_robot
    from echelon.identification.physics.fit import KIND as FAR_FROM_PRIOR
    from echelon.report.report import report_html
    from echelon.results.identified import identification_to_json

    files = {MODEL: identification_to_json(result), REPORT: report_html(result)}
    if result.physical is not None:
        remarks = [finding.text for finding in result.findings if finding.kind == FAR_FROM_PRIOR]
        for robot in identified_robot(result.base.mechanism, result.physical.standard, setup.robot_file, remarks):
            files[robot.name] = robot.text
    if target != NO_CODE:
        from echelon.codegen import generate

        names = [expression.name for expression in result.base.expressions]
        values = dict(zip(names, map(float, result.values), strict=True))
        remarks = ["The values were fitted to", *(f"  {found}" for found in result.ranges)]
        files |= generate(result.base, target, name="model", parameters=values, remarks=remarks)
    return files


def run_servos(setup: Setup, logs: Sequence[Path], output: Destination | None, *, as_json: bool) -> tuple[str, ...]:
    """Fit, write the model, and print the summary; why the model should not be used."""
    if output is not None:
        output.check((SERVOS,))
    with steps() as step:
        fit = fit_servos(setup, tuple(logs), on_step=step)
    paths = [] if output is None else output.write_into({SERVOS: servo_to_json(fit)})
    if as_json:
        show(json_text({**servo_document(fit), "files": [str(path) for path in paths]}))
        return fit.reasons
    print_servos(fit)
    say_written(paths)
    return fit.reasons
