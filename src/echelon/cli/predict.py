"""The ``predict`` command."""

from __future__ import annotations

from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from echelon.cli.destination import Destination
from echelon.cli.screen import json_text, show, steps
from echelon.errors import InputError
from echelon.extras import extra
from echelon.identification.predict import Prediction, predict_log
from echelon.identification.validation import Score
from echelon.logs.finding import counted
from echelon.results.identified import load_identified, score_record

SUMMARY = "echelon.prediction/1"
_FORMATS = (".csv", ".parquet")


def run_predict(model: Path, log: Path, output: Destination | None, *, as_json: bool) -> None:
    """Predict, write the signals, and say how well they fit where the log has outputs."""
    suffix = "" if output is None else output.path.suffix.lower()
    if output is not None and suffix not in _FORMATS:
        raise InputError(f"unknown format '{suffix}' (valid: {', '.join(_FORMATS)})", source=str(output.path))
    with steps(f"predicting {log.name}"):
        identified = load_identified(model)
        found = predict_log(identified.plan, identified.values, log)
    if output is not None:
        output.write(_csv(found) if suffix == ".csv" else _parquet(found))
    summary = _summary(found, None if output is None else output.path)
    if as_json:
        show(json_text(summary))
        return
    for score in found.scores:
        show(f"{score.output}: {_fit(score)}")
    rows = len(found.time)
    unknown = rows - int(np.isfinite(found.predicted).all(axis=1).sum())
    show(f"{counted(rows, 'row')} predicted" + f", {unknown} of them unknown: faulty, or between gaps" * bool(unknown))
    if output is not None:
        show(f"wrote {output.path}")


def _fit(score: Score) -> str:
    """How well an output fits, after the filter of both sides and as it was measured; R² where it varies."""
    explained = f"R² {score.r2:.4f}, unfiltered {score.raw.r2:.4f}" if isfinite(score.r2) else "no R²: it does not vary"
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
    names = ",".join(f'"{name.replace(chr(34), chr(34) * 2)}"' if set(name) & set(',"\n') else name for name in columns)
    rows = (",".join(map(repr, row)) for row in np.column_stack(list(columns.values())).tolist())
    return "\n".join([names, *rows]).replace("nan", "") + "\n"


def _parquet(found: Prediction) -> bytes:
    with extra("identify"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(_columns(found)), sink)
    return bytes(sink.getvalue().to_pybytes())


def _summary(found: Prediction, output: Path | None) -> dict[str, Any]:
    scores = {score.output: score for score in found.scores}
    outputs = {
        name: {"unit": unit, **({} if name not in scores else score_record(scores[name]))}
        for name, unit in zip(found.outputs, found.units, strict=True)
    }
    return {
        "schema": SUMMARY,
        "source": found.source,
        "samples": int(found.time.size),
        "outputs": outputs,
        "file": None if output is None else str(output),
    }
