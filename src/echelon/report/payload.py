"""The numbers behind the interactive plots, packed for a page: as 32-bit floats in base 64.

Seven digits are more than a screen shows, and a third of the size of decimal text.  Stretches get wider where a page
with many outputs would become too large to open quickly.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Sequence
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import one_line
from echelon.identification.validation.validation import Trace, Validation
from echelon.report.downsampling import Envelope, envelope
from echelon.report.residuals import residual

_BUCKETS, _FEWEST = 1200, 100  # stretches of one plot
_BYTES = 2_400_000  # of all plots together
_PER_SAMPLE = 2 * 4 * 4 / 3  # bytes of time and value in base 64
_EPOCH = 1e6  # s; larger times are those of a calendar, and count from the first sample


def outputs_of(validations: Sequence[Validation]) -> list[tuple[str, str]]:
    """Names and units of all outputs with traces, in order."""
    return list({trace.output: (trace.output, trace.unit) for v in validations for trace in v.traces}.values())


def buckets_for(validations: Sequence[Validation]) -> int:
    """Stretches into which every plotted signal is cut."""
    signals = sum(3 + (trace.prior is not None) for v in validations for trace in v.traces)
    return int(np.clip(_BYTES / (2 * _PER_SAMPLE * max(signals, 1)), _FEWEST, _BUCKETS))


def payload(validations: Sequence[Validation]) -> str:
    """All plots as JSON that is safe inside a script element."""
    places = {name: i for i, (name, _) in enumerate(outputs_of(validations))}
    buckets = buckets_for(validations)
    traces = {
        f"{number}/{places[trace.output]}": _packed(trace, buckets)
        for number, validation in enumerate(validations)
        for trace in validation.traces
    }
    return script_safe({"buckets": buckets, "traces": traces})


def script_safe(data: Any) -> str:
    r"""JSON in which no text can end a script element.

    >>> script_safe({"name": "</script>"})
    '{"name":"\\u003c/script\\u003e"}'
    """
    text = json.dumps(data, ensure_ascii=True, allow_nan=False, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _packed(trace: Trace, buckets: int) -> dict[str, Any]:
    first = trace.time[np.isfinite(trace.time)][:1]
    start = float(first[0]) if len(first) else 0.0
    difference = trace.measured - trace.predicted
    signals = {"measured": trace.measured, "predicted": trace.predicted, "residual": difference}
    if trace.prior is not None:
        signals["prior"] = trace.prior
    kept = {name: envelope(trace.time, values, buckets) for name, values in signals.items()}
    return {
        "unit": one_line(trace.unit),
        "start": start if abs(start) <= _EPOCH else 0.0,
        "since": None if abs(start) <= _EPOCH else start,
        "samples": len(trace.time),
        "lost": max(e.lost for e in kept.values()),
        "drawn": max(int(np.isfinite(e.values).sum()) for e in kept.values()),
        "signals": {name: _signal(e, start) for name, e in kept.items()},
        "residual": _residual(trace.time, difference),
    }


def _signal(kept: Envelope, start: float) -> list[str]:
    return [_base64(kept.time - start), _base64(kept.values)]


def _residual(time: Floats, values: Floats) -> dict[str, Any] | None:
    found = residual(time, values)
    if found is None:
        return None
    arrays = {
        "edges": found.edges,
        "density": found.density,
        "normal": found.normal,
        "lags": found.lags,
        "correlation": found.correlation,
        "frequency": found.frequency,
        "amplitude": found.amplitude,
    }
    return {name: _base64(array) for name, array in arrays.items()} | {"band": found.band, "white": found.white}


def _base64(values: Floats) -> str:
    with np.errstate(over="ignore"):
        return b64encode(values.astype("<f4").tobytes()).decode("ascii")
