"""Commands about logs: ``identify``, and ``predict``, ``check`` and ``setup``, which fit nothing."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from io import BytesIO
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.cli.destination import Destination
from echelon.cli.screen import json_text, say_doubts, say_time, say_written, show, steps
from echelon.cli.terminal import print_identification, print_servos
from echelon.codegen import TARGETS
from echelon.identification import (
    FirstLook,
    Prediction,
    Score,
    Setup,
    connect,
    counted,
    explained_rate,
    first_look,
    fit_servos,
    identification_to_json,
    identify,
    limited,
    load_identified,
    load_setup,
    predict_log,
    score_record,
    servo_document,
    servo_joints,
    servo_to_json,
    with_logs,
)
from echelon.shared import FileTarget, InputError, extra, nearest_of, one_line

if TYPE_CHECKING:
    from echelon.identification import Identification


NO_CODE = "none"
MODEL, REPORT, SERVOS = "model.json", "report.html", "servos.json"
SCHEMA = "robot.schema.json"


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
        raise InputError(
            f"there is no language '{target}'{nearest_of(target, [*TARGETS, NO_CODE])}"
        )
    if output is not None:
        output.check((MODEL, REPORT))
    setup = load_setup(setup_file, prior=prior, **read)
    setup = replace(setup, seed=changed.pop("seed", setup.seed)).with_settings(
        **changed
    )
    if servo_joints(setup.mechanism):
        return run_servos(setup, [*logs, *validate], output, as_json=as_json)
    with steps() as step, nullcontext() if dask is None else connect(dask) as client:
        result = identify(
            setup, tuple(logs), tuple(validate), client=client, on_step=step
        )
        step("writing")
        files, doubts = ({}, []) if output is None else _files(result, setup, target)
    paths = [] if output is None else output.write_into(files)
    say_doubts(doubts)
    if as_json:
        show(
            json_text(
                {
                    **json.loads(identification_to_json(result)),
                    "files": [str(path) for path in paths],
                }
            )
        )
        return result.reasons
    print_identification(result)
    say_written(paths)
    say_time(started)
    return result.reasons


def _files(
    result: Identification, setup: Setup, target: str
) -> tuple[dict[str, str], list[str]]:
    """Everything that is written, by name, so that nothing is written unless all of it can be; and doubts about it."""
    from echelon.formats import identified_robot
    from echelon.identification import KIND as FAR_FROM_PRIOR
    from echelon.identification import inertia_origins
    from echelon.report import report_html

    files = {MODEL: identification_to_json(result), REPORT: report_html(result)}
    doubts: list[str] = []
    if result.physical is not None:
        remarks = [
            inertia_origins(result),
            *(
                finding.text
                for finding in result.findings
                if finding.kind in (FAR_FROM_PRIOR, "currents")
            ),
        ]
        fit, mechanism = result.physical, result.robot
        known = dict(zip(fit.parameters, fit.standard, strict=True))
        standard = [known[name] for name in mechanism.parameters]
        for robot in identified_robot(mechanism, standard, setup.robot_file, remarks):
            files[robot.name] = robot.text
            doubts += [f"{robot.name}: {doubt}" for doubt in robot.doubts]
    base, experiments = result.base, result.base.mechanism.experiments
    base = base.experiment(experiments[0]) if experiments else base
    # in contact base parameters determine no forces of drives
    if target != NO_CODE and not base.mechanism.contacts:
        from echelon.codegen import generate

        names = [expression.name for expression in result.base.expressions]
        values = dict(zip(names, map(float, result.values), strict=True))
        remarks = [
            "The values were fitted to",
            *(f"  {found}" for found in result.ranges),
        ]
        files |= generate(
            base, target, name="model", parameters=values, remarks=remarks
        )
    return files, doubts


def run_servos(
    setup: Setup, logs: Sequence[Path], output: Destination | None, *, as_json: bool
) -> tuple[str, ...]:
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


# -- predict -----------------------------------------------------------------------------------------------------------

SUMMARY = "echelon.prediction/1"
_FORMATS = (".csv", ".parquet")


def run_predict(
    model: Path, log: Path, output: Destination | None, *, as_json: bool
) -> None:
    """Predict, write the signals, and say how well they fit where the log has outputs."""
    suffix = "" if output is None else output.path.suffix.lower()
    if output is not None and suffix not in _FORMATS:
        raise InputError(
            f"unknown format '{suffix}' (valid: {', '.join(_FORMATS)})",
            source=str(output.path),
        )
    with steps(f"predicting {log.name}"):
        identified = load_identified(model)
        found = predict_log(identified.plan, identified.values, log)
    if output is not None:
        output.write(_csv(found) if suffix == ".csv" else _parquet(found))
    summary = _summary(found, None if output is None else output.path)
    if as_json:
        show(json_text(summary))
        return
    for finding in found.findings:
        show(one_line(f"{finding.severity.value}: {finding}"))
    for score in found.scores:
        show(f"{score.output}: {_fit(score)}")
    known = int(np.isfinite(found.predicted).all(axis=1).sum())
    ends = int(found.near_ends.sum())
    text = f"{known} of {counted(len(found.time), 'row')} predicted"
    if ends:
        text += f"; {ends} are near the ends of stretches, where filters and derivatives lack neighbours"
    if faulty := len(found.time) - known - ends:
        text += f"; faulty or in gaps: {faulty}"
    show(text)
    if output is not None:
        show(f"wrote {output.path}")


def _fit(score: Score) -> str:
    """How well an output fits, after the filter of both sides and as it was measured; R² where it varies."""
    explained = (
        f"R² {score.r2:.4f}, unfiltered {score.raw.r2:.4f}"
        if isfinite(score.r2)
        else "no R², because it does not vary"
    )
    return f"rms {score.rms:.4g} {score.unit} ({score.percent:.2f} % of its range), {explained}"


def _columns(found: Prediction) -> dict[str, Any]:
    columns = {"time": found.time}
    for k, name in enumerate(found.outputs):
        columns[f"{name}.predicted"] = found.predicted[:, k]
        if found.measured is not None:
            columns[f"{name}.measured"] = found.measured[:, k]
    return columns


def _csv(found: Prediction) -> str:
    columns = _columns(found)
    names = ",".join(
        f'"{name.replace(chr(34), chr(34) * 2)}"' if set(name) & set(',"\n') else name
        for name in columns
    )
    rows = (
        ",".join(map(repr, row))
        for row in np.column_stack(list(columns.values())).tolist()
    )
    return "\n".join([names, *rows]).replace("nan", "") + "\n"


def _parquet(found: Prediction) -> bytes:
    with extra("identify"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    sink = BytesIO()
    pq.write_table(pa.table(_columns(found)), sink)
    return sink.getvalue()


def _summary(found: Prediction, output: Path | None) -> dict[str, Any]:
    scores = {score.output: score for score in found.scores}
    outputs = {
        name: {
            "unit": unit,
            **({} if name not in scores else score_record(scores[name])),
        }
        for name, unit in zip(found.outputs, found.units, strict=True)
    }
    return {
        "schema": SUMMARY,
        "source": found.source,
        "samples": int(found.time.size),
        "near_ends": int(found.near_ends.sum()),
        "outputs": outputs,
        "findings": [asdict(finding) for finding in found.findings],
        "file": None if output is None else str(output),
    }


# -- check and setup ---------------------------------------------------------------------------------------------------


def run_check(
    setup_file: Path, logs: Sequence[Path], read: Mapping[str, Any], *, as_json: bool
) -> None:
    """Look at logs and print what they can show, and what is missing."""
    started = perf_counter()
    with steps("looking at the logs"):
        setup, paths, _ = with_logs(load_setup(setup_file, **read), logs, ())
        found = first_look(setup, paths)
    if as_json:
        show(json_text(_record(found)))
        return
    for line in (*setup.unmeasured, *setup.assumed, *_lines(found, len(paths))):
        show(one_line(line))
    say_time(started)


def _lines(found: FirstLook, logs: int) -> Iterator[str]:
    of, seen = found.base.mechanism, found.conditioning
    outputs = counted(len(of.outputs), "output")
    looked = f"{found.seconds:.4g} s of {counted(logs, 'log')} examined"
    yield f"{of.name}: {counted(found.base.rank, 'base parameter')}, {outputs}; {looked}"
    for columns in found.columns:
        for kind, channels in columns.channels.items():
            if channels:
                shown = ", ".join(
                    f"{name} ← '{channel.column}'" for name, channel in channels.items()
                )
                yield f"{kind}: {shown}"
    for finding in limited(found.survey.findings):
        yield f"{finding.severity.value}: {finding}"
    for travel in found.travels:
        speed = f", up to {travel.speed:.3g}/s" if isfinite(travel.speed) else ""
        yield f"{travel.coordinate}: from {travel.low:.4g} to {travel.high:.4g}{speed}"
    for name, reason in found.survey.preparation.reasons.items():
        yield f"{name.replace('_', ' ')}: {reason}"
    yield seen.verdict
    for text in found.missing:
        yield f"missing: {text}"


def _record(found: FirstLook) -> dict[str, Any]:
    seen = found.conditioning
    return {
        "schema": "echelon.check/1",
        "robot": found.base.mechanism.name,
        "base_parameters": found.base.rank,
        "determined": seen.rank,
        "seconds": found.seconds,
        "columns": [asdict(columns) for columns in found.columns],
        "travels": [asdict(travel) for travel in found.travels],
        "preparation": dict(found.survey.preparation.reasons),
        "findings": [asdict(finding) for finding in limited(found.survey.findings)],
        "verdict": seen.verdict,
        "missing": list(found.missing),
    }


def _write_setup(text: str, output: Destination) -> list[Path]:
    """Write a set-up, and beside it the schema that its first line names, for editors that complete and check it."""
    from echelon.formats import json_schema

    if FileTarget.of(output.path).stream:
        output.write(text)
        return [output.path]
    folder = Destination(output.path.parent, output.force)
    schema = json.dumps(json_schema(), indent=2) + "\n"
    files = {output.path.name: f"# yaml-language-server: $schema={SCHEMA}\n{text}"}
    there = folder.path / SCHEMA
    if not there.is_file() or there.read_text(encoding="utf-8") != schema:
        files[SCHEMA] = schema
    return folder.write_into(files)


def run_setup(robot: Path, logs: Sequence[Path], output: Destination | None) -> None:
    """Write a set-up for a robot and its logs, and say what it leaves open."""
    from echelon.identification import skeleton

    with steps(f"reading {logs[0]}"):
        found = skeleton(
            robot,
            logs,
            Path() if output is None else output.path.parent,
            explained_rate,
        )
    if output is None:
        show(found.text.rstrip())
        return
    written = " and ".join(map(str, _write_setup(found.text, output)))
    for line in found.report:
        show(line)
    for question in found.undecided:
        show(f"open: {question}")
    if not found.is_complete:
        show(f"wrote {written}; answer the open questions in it before you identify")
        return
    show(
        f"wrote {written}; next:  echelon identify {output.path} {' '.join(map(str, logs))} -o result/"
    )
