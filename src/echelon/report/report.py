"""The report of an identification: a list of sections, each a template and a function that says what it shows."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from math import ceil, floor, isfinite, isinf, log10
from typing import Any

import numpy as np

from echelon.base import body_names
from echelon.identification import (
    CLEAR,
    Feasibility,
    Finding,
    Identification,
    PhysicalFit,
    Preparation,
    Score,
    Severity,
    all_usable,
)
from echelon.report.drawing import seen_links
from echelon.report.matrix_picture import matrix_picture, mergings
from echelon.report.page import (
    VAGUE_PERCENT,
    ClosedForms,
    Context,
    html_page,
    thousands,
    to_place,
    with_uncertainty,
)
from echelon.report.signals import buckets_for, outputs_of, payload
from echelon.robot import Mechanism, about_centre
from echelon.shared import (
    MOST_NAMED,
    PARAMETERS,
    PER_BODY,
    InputError,
    one_line,
    plain_data,
    public,
)

TITLES = {
    "summary": "Fit of each output",
    "hypotheses": "Possible errors of model and logs",
    "parameters": "Base parameters",
    "traces": "Measured and predicted",
    "residuals": "Residuals",
    "conditioning": "What the data show",
    "links": "Identifiable parameters of each link",
    "structure": "How parameters combine",
    "physics": "Physical consistency",
    "preparation": "Preparation and settings",
}
"""Sections below the header, in order."""

OPEN_PLOTS = 12
"""Plots that are open when the page opens: more of them slow a browser down."""
SAME_RMS = 0.01
"""Relative difference of root mean squares below which two models count as equal: a page shows two digits."""
NO_BIAS = 1e-3
"""Share of an rms below which a bias is shown as zero: it adds a millionth to the mean square."""
COLOURED = 0.01
"""Probability of a residual, were it white noise, below which it is called coloured: less than one output in a hundred
is called so by chance."""
_CHOSEN = {
    "estimate": "the estimate of all base parameters",
    "essential": "the essential base parameters only",
    "physical": "the physically consistent fit",
}
_SETTINGS = {
    "band": ("pass band of both sides", "Hz"),
    "lowpass": ("low-pass of single positions", "Hz"),
    "measured": ("derivatives from the log", ""),
    "still": ("least speed of the fit", ""),
    "rest": ("outputs at rest below it", ""),
    "delays": ("corrected delays", "s"),
    "trim": ("left out at both ends", "s"),
    "rate": ("resampled to", "Hz"),
}
"""Titles and units of settings of the preparation; others go by their names."""


_WITH_UNITS = ("summary", "parameters", "traces", "residuals", "physics")
"""Sections that show values in units of outputs or parameters."""


@public
def report_html(identification: Identification) -> str:
    """A report about an identification, as one HTML file.

    Equal identifications give equal texts.  Names that come from files are escaped; nothing is loaded from
    anywhere.

    Parameters
    ----------
    identification : Identification

    Returns
    -------
    str
        To be written as UTF-8.

    Raises
    ------
    MissingExtraError
        If plotly is not installed.
    """
    contexts = {
        "header": _header(identification),
        "summary": _summary(identification),
        "hypotheses": {
            "hypotheses": identification.hypotheses,
            "untested": identification.untested,
        },
        "parameters": parameters(identification),
        "traces": _traces(identification),
        "residuals": {"outputs": _outputs(identification), "open": OPEN_PLOTS},
        "conditioning": conditioning(identification),
        "links": seen_links(identification.base),
        "structure": {
            "picture": matrix_picture(identification.base),
            "mergings": mergings(identification.base),
        },
        "physics": physics(identification),
        "preparation": _preparation(identification),
    }
    remarks = dict.fromkeys(_WITH_UNITS, identification.unit_remark)
    return html_page(
        f"Identification of {one_line(identification.base.mechanism.name)}",
        "",
        TITLES,
        contexts,
        payload(identification.validations),
        styles=[],
        scripts=["report.js"],
        remarks=remarks,
        without_script="Plots, sorting and searching need JavaScript, which is switched off.",
    )


def findings_of(findings: tuple[Finding, ...]) -> Context:
    """Findings, warnings first, and how many of these there are."""
    ordered = sorted(
        findings, key=lambda finding: finding.severity is not Severity.WARNING
    )
    return {
        "findings": ordered,
        "warnings": sum(finding.severity is Severity.WARNING for finding in findings),
    }


def _header(run: Identification) -> Context:
    mechanism = run.base.mechanism
    return {
        "robot": mechanism.name,
        "verdict": run.judgement,
        "logs": run.logs,
        "validated": [v.source for v in run.validations if v.role == "validation"],
        **findings_of(run.findings),
        "predict_with": _CHOSEN.get(run.predict_with, run.predict_with),
        "method": run.estimate.method,
        "facts": [
            ("base parameters", run.base.rank),
            ("standard parameters", len(run.base.parameters)),
            ("outputs", len(mechanism.outputs)),
            ("rows of the fit", sum(run.estimate.rows)),
        ],
        "rows": _rows_in_words(run),
    }


def _rows_in_words(run: Identification) -> str:
    """The rows of the fit by output, and the measured samples that they are made of; empty without validations."""
    if not run.validations:
        return ""
    scores, ranges = run.pooled[0].scores, run.ranges
    rows = _between([found.rows - found.left_out for found in ranges])
    samples = _between([score.raw.rows for score in scores])
    text = f"Each output has {rows} rows in the fit, made of {samples} measured samples"
    reduction = sum(s.raw.rows for s in scores) / max(sum(s.rows for s in scores), 1)
    bands = sorted({found.band for found in ranges if isfinite(found.band)})
    if not bands or reduction <= 1:
        return f"{text} without a filter."
    filtered = " to ".join(
        f"{band:.3g}" for band in dict.fromkeys([bands[0], bands[-1]])
    )
    return f"{text}: these are filtered to {filtered} Hz, and one row stays of about {reduction:.2g} samples."


def _between(counts: Sequence[int]) -> str:
    """A count, or the least and the largest of several."""
    ends = dict.fromkeys([min(counts), max(counts)])
    return " to ".join(map(thousands, ends))


def _summary(run: Identification) -> Context:
    """How well every output is predicted, on data the fit saw and on data it did not, beside the prior model."""
    tables = []
    together = [v for v in run.pooled if v not in run.validations]
    every = [*together, *run.validations]
    for validation in sorted(
        every, key=lambda v: v.role != "validation"
    ):  # unseen data say more
        beside = {
            "prior": validation.prior_scores,
            "no friction": validation.plain_scores,
        }
        models = {name: scores for name, scores in beside.items() if scores}
        rows = [
            _scored(score, [scores[k] for scores in models.values()], "prior" in models)
            for k, score in enumerate(validation.scores)
        ]
        tables.append(
            {
                "validation": validation,
                "rows": rows,
                "beside": list(models),
                "prior": "prior" in models,
            }
        )
    return {
        "tables": tables,
        "unseen": any(v.role == "validation" for v in run.validations),
    }


def _scored(score: Score, beside: Sequence[Score], has_prior: bool) -> Context:
    """One output: its score, those of other models, and what a reader should notice."""
    prior = beside[0] if has_prior else None
    remarks = [score.silence] if score.silence else []
    if not remarks and score.r2 < 0:
        remarks.append("a constant would predict better")
    if score.whiteness < COLOURED:
        remarks.append("residual is not white")
    against = ""
    if prior is not None and isfinite(prior.rms) and isfinite(score.rms):
        gain = score.rms - prior.rms
        against = (
            "equal"
            if abs(gain) <= SAME_RMS * prior.rms
            else "better"
            if gain < 0
            else "worse"
        )
    return {
        "score": score,
        "beside": beside,
        "against": against,
        "remarks": remarks,
        "bias": 0.0 if abs(score.bias) < NO_BIAS * score.rms else score.bias,
    }


def _outputs(run: Identification) -> list[dict[str, str]]:
    return [{"name": name, "unit": unit} for name, unit in outputs_of(run.validations)]


def _traces(run: Identification) -> Context:
    """Measured against predicted, every output over time."""
    traces = [trace for validation in run.validations for trace in validation.traces]
    raw = [trace.raw for trace in traces if trace.raw is not None]
    stretches = buckets_for(run.validations)
    longest = max((len(trace.time) for trace in [*traces, *raw]), default=0)
    bands = {found.band for found in run.ranges} if run.validations else set()
    return {
        "logs": [
            {"number": i, "source": v.source, "role": v.role}
            for i, v in enumerate(run.validations)
            if v.traces
        ],
        "selected": next(
            (
                i
                for i, v in enumerate(run.validations)
                if v.role == "validation" and v.traces
            ),
            0,
        ),
        "outputs": _outputs(run),
        "open": OPEN_PLOTS,
        "stretches": stretches if longest > 2 * stretches else None,
        "raw": bool(raw),
        "band": f"{min(bands):.3g} Hz" if len(bands) == 1 else "its band",
        "prior": any(trace.prior is not None for trace in traces),
    }


def _preparation(run: Identification) -> Context:
    """Every setting with its reason, and what is needed to repeat the run."""
    return {
        "ranges": run.ranges if run.validations else (),
        "settings": [
            _setting(run.preparation, name)
            for name in Preparation.model_fields
            if name != "reasons"
        ],
        "diagnostics": _json(run.estimate.diagnostics),
        "repeat": _json(run.settings),
        "certificate": str(run.base.certificate),
        "seed": run.base.seed,
    }


def _setting(preparation: Preparation, name: str) -> dict[str, str]:
    title, unit = _SETTINGS.get(name, (name.replace("_", " "), ""))
    value = _in_words(getattr(preparation, name), unit)
    return {
        "key": name,
        "title": title,
        "value": value,
        "reason": preparation.reasons.get(name, ""),
    }


def _in_words(value: Any, unit: str) -> str:
    if value is None or value in ((), "") or (isinstance(value, Mapping) and not value):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(
            f"{name}: {_in_words(part, unit)}" for name, part in value.items()
        )
    if isinstance(value, tuple | list):
        return ", ".join(_in_words(part, unit) for part in value)
    if isinstance(value, float):
        return "none" if isinf(value) else f"{value:.6g} {unit}".strip()
    return f"{value}".replace("_", " ")


def _json(value: Any) -> str:
    return json.dumps(plain_data(value), indent=2, ensure_ascii=False, default=str)


# -- parameters: values, how far these can be trusted, conditioning, physical consistency ------------------------------


@dataclass(frozen=True)
class _BarPlot:
    """Measures of the plot of singular values, px."""

    width: float = 900.0
    height: float = 220.0
    left: float = 64.0
    right: float = 892.0
    top: float = 12.0
    floor: float = 186.0
    widest_bar: float = 36.0
    decades: int = 16  # at most; smaller singular values stand at the floor


def parameters(run: Identification) -> Context:
    """Every base parameter in closed form, its value and its uncertainty; numbers have a text and a key to sort by."""
    others = _other_values(run)
    rows = [
        _row(run, k, form, [values for _, values in others])
        for k, form in enumerate(ClosedForms(run.base).all())
    ]
    return {
        "rows": rows,
        "bodies": body_names(run.base),
        "masses": [_mass_row(row) for body in run.masses for row in body.rows],
        "others": [name for name, _ in others],
        "level": f"{100 * run.level:g}",
        "essential": None
        if run.essential is None
        else sum(row["essential"] for row in rows),
        "predict_with": run.predict_with,
        "method": run.estimate.method,
    }


def _mass_row(row: tuple[str, float, float, float, str]) -> Context:
    name, value, low, high, unit = row
    half = (high - low) / 2
    low_text, value_text, high_text = (to_place(x, half) for x in (low, value, high))
    return {
        "name": name,
        "value": value_text,
        "low": low_text,
        "high": high_text,
        "unit": unit,
    }


def _other_values(run: Identification) -> list[tuple[str, Any]]:
    """Base parameters of other models that a reader may want to compare with."""
    found: list[tuple[str, Any]] = []
    if run.essential is not None:
        found.append(("essential only", run.essential.values))
    if run.physical is not None:
        found.append(("physical fit", run.physical.base))
    with suppress(InputError):  # the file states no inertia, or a length has no value
        found.append(("robot file", run.base.values()))
    return found


def _row(run: Identification, k: int, form: Any, others: list[Any]) -> Context:
    estimate = run.estimate
    value, std, relative = (
        float(estimate.values[k]),
        float(estimate.std[k]),
        float(estimate.relative_std[k]),
    )
    low, high = (float(end) for end in estimate.interval(run.level)[k])
    text, deviation = with_uncertainty(value, std)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = [
            float(np.divide(abs(float(values[k]) - value), std)) for values in others
        ]
    return {
        "form": form,
        "unit": estimate.units[k],
        "value": {"text": text, "key": value},
        "std": {"text": deviation, "key": std},
        "low": to_place(low, std),
        "high": to_place(high, std),
        "relative": relative,
        "independent_share": float(run.conditioning.independent_share[k]),
        "essential": None
        if run.essential is None
        else bool(run.essential.values[k] != 0),
        "others": [
            {"text": to_place(float(values[k]), std), "key": float(values[k])}
            for values in others
        ],
        "deviations": apart,  # of the others, in standard deviations
        "vague": not relative <= VAGUE_PERCENT,
    }


def conditioning(run: Identification) -> Context:
    """Combinations of parameters that the data show well, and those that they hardly show."""
    forms = ClosedForms(run.base)
    weak = []
    for direction in run.conditioning.weak:
        terms = [(weight, forms.name(name)) for name, weight in direction.weights]
        value = direction.singular_value
        weak.append({"value": value, "terms": terms, "advice": direction.advice})
    return {
        "conditioning": run.conditioning,
        "total": run.base.rank,
        "weak": weak,
        "plot": _plot(run),
    }


def _plot(run: Identification) -> Context | None:
    """Bars of the singular values on a logarithmic scale; None if there are none."""
    values = np.asarray(run.conditioning.singular_values, dtype=float)
    positive = values[np.isfinite(values) & (values > 0)]
    if not len(positive):
        return None
    high = ceil(log10(positive.max()) - 1e-9)
    plot = _BarPlot()
    low = max(min(floor(log10(positive.min())), high - 1), high - plot.decades)
    room = plot.floor - plot.top
    step = (plot.right - plot.left) / len(values)

    def height(value: float) -> float:
        return (
            room * min(max((log10(value) - low) / (high - low), 0.01), 1.0)
            if value > 0
            else 0.0
        )

    rank = run.conditioning.rank
    bars = [
        {
            "x": plot.left + step * k,
            "y": plot.floor - height(v),
            "height": height(v),
            "value": v,
            "seen": k < rank,
        }
        for k, v in enumerate(values.tolist())
    ]
    every = max(1, ceil((high - low) / 6))
    ticks = [
        {"y": plot.top + room * (high - k) / (high - low), "exponent": k}
        for k in range(high, low - 1, -every)
    ]
    return {
        **asdict(plot),
        "bar": min(max(0.7 * step, 0.5), plot.widest_bar),
        "bars": bars,
        "ticks": ticks,
        "count": len(values),
    }


def physics(run: Identification) -> Context:
    """Whether a robot with these base parameters can exist, and which one was chosen."""
    feasibility, fit = run.feasibility, run.physical
    least = 0.0 if fit is None else fit.unconstrained_misfit
    return {
        "feasibility": feasibility,
        "is_noise": feasibility is not None and not feasibility.is_beyond(CLEAR),
        "fits_well": all_usable(run.validations),
        "physical": fit,
        "moved": [] if feasibility is None else _moved(run, feasibility),
        "bodies": [] if fit is None else _bodies(run.base.mechanism, fit),
        "effects": [] if fit is None else _effects(run, fit),
        "excess": 100 * (fit.misfit / least - 1)
        if fit is not None and least > 0
        else None,
        "used": run.predict_with == "physical",
    }


def _moved(run: Identification, feasibility: Feasibility) -> list[Context]:
    """Base parameters by which the nearest physical robot differs most, in standard deviations."""
    if feasibility.nearest is None:
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = (feasibility.nearest - run.estimate.values) / run.estimate.std
    order = [
        k
        for k in np.argsort(-np.abs(shift), kind="stable")
        if np.isfinite(shift[k]) and shift[k] != 0
    ]
    forms = ClosedForms(run.base)
    return [
        {
            "name": forms.name(run.base.pivots[k]),
            "value": float(run.estimate.values[k]),
            "nearest": float(feasibility.nearest[k]),
            "shift": float(shift[k]),
            "unit": run.base.units[k],
        }
        for k in order[:MOST_NAMED]
    ]


def _bodies(mechanism: Mechanism, fit: PhysicalFit) -> list[Context]:
    values = dict(zip(fit.parameters, fit.standard.tolist(), strict=True))
    rows = []
    for index in mechanism.carriers:
        body, first = mechanism.bodies[index], mechanism.first_column[index]
        names = mechanism.parameters[first : first + len(body.carried)]
        own = {
            k: values[name]
            for k, name in zip(body.carried, names, strict=True)
            if name in values
        }
        whole = len(own) == PER_BODY
        rows.append(
            {
                "name": mechanism.carrier_name(index),
                "label": body.label,
                # smallest eigenvalue of its pseudo-inertia, relative to its scale
                "margin": fit.margins.get(body.name, fit.margins.get(body.label)),
                "fitted": _about_centre([own[k] for k in range(PER_BODY)])
                if whole
                else None,
                "stated": None
                if body.inertial is None
                else _about_centre(list(body.inertial)),
                "carried": []
                if whole
                else [(PARAMETERS[k], value) for k, value in own.items()],
            }
        )
    return rows


def _about_centre(standard: list[float]) -> list[float] | None:
    """Mass, centre of mass and six moments about it; None without mass."""
    if not standard[-1] > 0:
        return None
    mass, centre, moments = about_centre(np.array(standard))
    return [mass, *centre.tolist(), *moments.tolist()]


def _effects(run: Identification, fit: PhysicalFit) -> list[Context]:
    values = dict(zip(fit.parameters, fit.standard.tolist(), strict=True))
    forms = ClosedForms(run.base)
    return [
        {
            "name": forms.name(effect.parameter),
            "value": values[effect.parameter],
            "stated": effect.value,
            "unit": effect.unit,
        }
        for effect in run.base.mechanism.effects
        if effect.parameter in values
    ]
