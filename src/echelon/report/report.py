"""The report of an identification: a list of sections, each a template and a function that says what it shows."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import isfinite, isinf
from typing import Any

from echelon.errors import one_line
from echelon.identification.result import Identification
from echelon.identification.scores import Score
from echelon.inputs import plain_data
from echelon.logs.finding import Finding, Severity
from echelon.logs.preparation.prepare import Preparation
from echelon.report.drawing import seen_links
from echelon.report.matrix_picture import matrix_picture, mergings
from echelon.report.page import Context, html_page
from echelon.report.parameters import conditioning, parameters, physics
from echelon.report.signals import buckets_for, outputs_of, payload

TITLES = {
    "summary": "Fit of each output",
    "parameters": "Base parameters",
    "traces": "Measured and predicted",
    "residuals": "Residuals",
    "conditioning": "What the data show",
    "links": "What the sensors see of each link",
    "structure": "Which parameters merge where",
    "physics": "Physical consistency",
    "preparation": "Preparation and settings",
}
"""Sections below the header, in order."""

_OPEN = 12  # plots that are open when the page is
_SAME = 0.01  # relative difference of rms below which two models count as equal
_WHITE = 0.01  # probability below which a residual is called coloured
_CHOSEN = {
    "estimate": "the estimate of all base parameters",
    "essential": "the essential base parameters only",
    "physical": "the physically consistent fit",
}
_SETTINGS = {
    "band": ("kept of both sides, up to", "Hz"),
    "lowpass": ("low-pass over single positions", "Hz"),
    "measured": ("derivatives from the log", ""),
    "still": ("left out below the speed", ""),
    "delays": ("delays undone", "s"),
    "trim": ("left out at both ends", "s"),
    "rate": ("resampled to", "Hz"),
}
"""Titles and units of settings of the preparation; others go by their names."""


def report_html(identification: Identification) -> str:
    """A report about an identification, as one HTML file.

    The same identification gives the same text.  Names that come from files are escaped; nothing is loaded from
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
        "parameters": parameters(identification),
        "traces": _traces(identification),
        "residuals": {"outputs": _outputs(identification), "open": _OPEN},
        "conditioning": conditioning(identification),
        "links": seen_links(identification.base),
        "structure": {"picture": matrix_picture(identification.base), "mergings": mergings(identification.base)},
        "physics": physics(identification),
        "preparation": _preparation(identification),
    }
    return html_page(
        f"Identification of {one_line(identification.base.mechanism.name)}",
        "",
        TITLES,
        contexts,
        payload(identification.validations),
        data_id="plot-data",
        styles=["report.css"],
        scripts=["report.js"],
        without_script="Plots, sorting and searching need JavaScript, which is off.",
    )


def findings_of(findings: tuple[Finding, ...]) -> Context:
    """Findings, warnings first, and how many of these there are."""
    ordered = sorted(findings, key=lambda finding: finding.severity is not Severity.WARNING)
    return {"findings": ordered, "warnings": sum(finding.severity is Severity.WARNING for finding in findings)}


def _header(run: Identification) -> Context:
    mechanism = run.base.mechanism
    return {
        "robot": mechanism.name,
        "verdict": run.verdict,
        "logs": run.logs,
        "validated": [v.source for v in run.validations if v.role == "validation"],
        **findings_of(run.findings),
        "predict_with": _CHOSEN.get(run.predict_with, run.predict_with),
        "method": run.estimate.method,
        "facts": [
            ("base parameters", run.base.rank),
            ("standard parameters", len(run.base.parameters)),
            ("outputs", len(mechanism.outputs)),
            ("rows", sum(run.estimate.rows)),
        ],
    }


def _summary(run: Identification) -> Context:
    """How well every output is predicted, on data the fit saw and on data it did not, beside the prior model."""
    tables = []
    together = [v for v in run.pooled if v not in run.validations]
    every = [*together, *run.validations]
    for validation in sorted(every, key=lambda v: v.role != "validation"):  # unseen data say more
        beside = {"prior": validation.prior_scores, "no friction": validation.plain_scores}
        models = {name: scores for name, scores in beside.items() if scores}
        rows = [
            _scored(score, [scores[k] for scores in models.values()], "prior" in models)
            for k, score in enumerate(validation.scores)
        ]
        tables.append({"validation": validation, "rows": rows, "beside": list(models), "prior": "prior" in models})
    return {"tables": tables, "unseen": any(v.role == "validation" for v in run.validations)}


def _scored(score: Score, beside: Sequence[Score], has_prior: bool) -> Context:
    """One output: its score, those of other models, what a reader should notice, and R² as the length of a bar."""
    prior = beside[0] if has_prior else None
    remarks = ["a constant would predict better"] * (score.r2 < 0)
    remarks += ["it varies less than the noise of its sensor"] * score.is_below_noise
    remarks += ["residual is not white"] * (score.whiteness < _WHITE)
    against = ""
    if prior is not None and isfinite(prior.rms) and isfinite(score.rms):
        gain = score.rms - prior.rms
        against = "equal" if abs(gain) <= _SAME * prior.rms else "better" if gain < 0 else "worse"
    bar = 100 * min(max(score.r2, 0.0), 1.0) if isfinite(score.r2) else 0.0
    return {"score": score, "beside": beside, "against": against, "remarks": remarks, "bar": bar}


def _outputs(run: Identification) -> list[dict[str, str]]:
    return [{"name": name, "unit": unit} for name, unit in outputs_of(run.validations)]


def _traces(run: Identification) -> Context:
    """Measured against predicted, every output over time."""
    traces = [trace for validation in run.validations for trace in validation.traces]
    return {
        "logs": [{"number": i, "source": v.source, "role": v.role} for i, v in enumerate(run.validations) if v.traces],
        "selected": next((i for i, v in enumerate(run.validations) if v.role == "validation" and v.traces), 0),
        "outputs": _outputs(run),
        "open": _OPEN,
        "buckets": buckets_for(run.validations),
        "samples": max((len(trace.time) for trace in traces), default=0),
        "prior": any(trace.prior is not None for trace in traces),
    }


def _preparation(run: Identification) -> Context:
    """Every setting with its reason, and what is needed to repeat the run."""
    return {
        "ranges": run.ranges if run.validations else (),
        "settings": [_setting(run.preparation, name) for name in Preparation.model_fields if name != "reasons"],
        "diagnostics": _json(run.estimate.diagnostics),
        "repeat": _json(run.settings),
        "certificate": str(run.base.certificate),
        "seed": run.base.seed,
    }


def _setting(preparation: Preparation, name: str) -> dict[str, str]:
    title, unit = _SETTINGS.get(name, (name.replace("_", " "), ""))
    value = _in_words(getattr(preparation, name), unit)
    return {"key": name, "title": title, "value": value, "reason": preparation.reasons.get(name, "")}


def _in_words(value: Any, unit: str) -> str:
    if value is None or value in ((), "") or (isinstance(value, Mapping) and not value):
        return "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_in_words(part, unit)}" for name, part in value.items())
    if isinstance(value, tuple | list):
        return ", ".join(_in_words(part, unit) for part in value)
    if isinstance(value, float):
        return "none" if isinf(value) else f"{value:.6g} {unit}".strip()
    return f"{value}".replace("_", " ")


def _json(value: Any) -> str:
    return json.dumps(plain_data(value), indent=2, ensure_ascii=False, default=str)
