"""An identification in a notebook: tables in HTML, a data frame of its parameters, and measured beside predicted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from echelon.errors import one_line
from echelon.extras import extra

if TYPE_CHECKING:
    from echelon.identification.result import Identification

_SHOWN = 30
_MEASURED, _PREDICTED = "#4477aa", "#ee6677"


def parameter_columns(result: Identification) -> dict[str, Sequence[Any]]:
    """Base parameters by column: name, closed form, unit, the value of predictions, and the estimate's interval."""
    level = float(result.settings.get("level", 0.95))
    low, high = result.estimate.interval(level).T
    return {
        "parameter": list(result.base.pivots),
        "expression": [str(expression) for expression in result.base.expressions],
        "unit": list(result.estimate.units),
        "value": result.values.tolist(),
        "estimate": result.estimate.values.tolist(),
        "std": result.estimate.std.tolist(),
        "low": low.tolist(),
        "high": high.tolist(),
    }


def data_frame(result: Identification) -> Any:
    """The base parameters as a data frame of pandas."""
    with extra("notebook"):
        import pandas as pd
    return pd.DataFrame(parameter_columns(result)).set_index("parameter")


def html(result: Identification) -> str:
    """The verdict, the scores and the first parameters."""
    judged = result.pooled[-1]
    scores = [(score.output, f"{score.rms:.4g} {score.unit}", f"{score.r2:.4f}") for score in judged.scores]
    columns = parameter_columns(result)
    shown = zip(*(columns[name][:_SHOWN] for name in ("expression", "value", "low", "high", "unit")), strict=True)
    rows = [(name, f"{value:.5g}", f"{low:.4g} … {high:.4g}", unit) for name, value, low, high, unit in shown]
    left = len(result.base.pivots) - len(rows)
    unseen = "rows the fit did not see" if judged.role == "validation" else "fitted rows"
    return (
        f"<b>{_safe(result.base.mechanism.name)}</b>: {_safe(result.verdict)}"
        + _table(("output", "rms", f"R² of {unseen}"), scores)
        + _table(("base parameter", "value", "interval of the estimate", "unit"), rows)
        + (f"… {left} more" if left else "")
    )


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    cells = "".join(f"<th>{_safe(cell)}</th>" for cell in head)
    body = "".join(f"<tr>{''.join(f'<td>{_safe(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"


def _safe(text: str) -> str:
    return escape(one_line(text))


def figure(result: Identification) -> Any:
    """Measured and predicted outputs of the last validation, one below another, as a figure of plotly."""
    with extra("identify"):
        from plotly.graph_objects import Scattergl
        from plotly.subplots import make_subplots
    traces = result.validations[-1].traces
    found = make_subplots(len(traces), 1, shared_xaxes=True, vertical_spacing=0.02)
    for row, trace in enumerate(traces, start=1):
        for name, values, colour in (
            ("measured", trace.measured, _MEASURED),
            ("predicted", trace.predicted, _PREDICTED),
        ):
            line = Scattergl(x=trace.time, y=values, name=name, legendgroup=name, showlegend=row == 1)
            found.add_trace(line.update(line={"color": colour, "width": 1}), row=row, col=1)
        found.update_yaxes(title_text=f"{_safe(trace.output)}, {_safe(trace.unit)}", row=row, col=1)
    found.update_xaxes(title_text="time, s", row=len(traces), col=1)
    return found.update_layout(height=160 * len(traces) + 80, margin={"t": 30})
