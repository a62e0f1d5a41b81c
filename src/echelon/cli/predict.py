"""The ``predict`` command."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from echelon.cli.destination import Destination
from echelon.cli.screen import json_text, show, steps
from echelon.errors import InputError, MissingExtraError
from echelon.identification.predict import Prediction, predict_log
from echelon.results.identified import load_identified

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
    for name, score in summary["outputs"].items():
        show(f"{name}: {found.time.size} samples{_fit(score)}")
    if output is not None:
        show(f"wrote {output.path}")


def _fit(score: Mapping[str, Any]) -> str:
    """How well an output fits, where it was measured; R² where it varies."""
    if score["rms"] is None:
        return ""
    explained = "no R², because it does not vary" if score["r2"] is None else f"R² {score['r2']:.4f}"
    return f" rms {score['rms']:.4g} {score['unit']}, {explained}"


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
    return "\n".join([names, *rows]) + "\n"


def _parquet(found: Prediction) -> bytes:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError:
        raise MissingExtraError("pyarrow", "identify") from None
    sink = pa.BufferOutputStream()
    pq.write_table(pa.table(_columns(found)), sink)
    return bytes(sink.getvalue().to_pybytes())


def _summary(found: Prediction, output: Path | None) -> dict[str, Any]:
    scores = {
        name: {"unit": unit, "rms": rms, "r2": r2}
        for name, unit, rms, r2 in zip(found.outputs, found.units, *found.scores(), strict=True)
    }
    return {
        "schema": SUMMARY,
        "source": found.source,
        "samples": int(found.time.size),
        "outputs": scores,
        "file": None if output is None else str(output),
    }
