"""Identification: all that one run found out, from the logs to the verdict, and what a user must know of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.arrays import Floats
from echelon.doors import public
from echelon.errors import InputError, one_line
from echelon.extras import extra
from echelon.identification.conditioning import Conditioning
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.judge.judge import Judged
from echelon.identification.physics.feasibility import Feasibility
from echelon.identification.physics.fit import PhysicalFit
from echelon.identification.scores import Validation, by_role
from echelon.logs.finding import Finding, Severity, counted, note, warning
from echelon.logs.preparation.prepare import Preparation

if TYPE_CHECKING:
    from echelon.base.model import BaseModel


@dataclass(frozen=True)
class FittedRange:
    """What an output was fitted to; elsewhere the model extrapolates."""

    output: str
    band: float  # highest frequency, Hz
    slowest: float  # speed of its joint or actuator, rad/s or m/s; nan for a wrench
    fastest: float
    unit: str  # of the speeds
    rows: int  # of the band
    left_out: int  # how many of them were left out near standstill

    @property
    def speeds(self) -> str:
        """Such as ``j1 at 0.01 to 2 rad/s, without 3 of 900 rows near standstill``."""
        at = (
            f" at {self.slowest:.2g} to {self.fastest:.3g} {self.unit}"
            if np.isfinite(self.fastest)
            else ""
        )
        left_out = (
            f", without {self.left_out} of {self.rows} rows near standstill"
            if self.left_out
            else ""
        )
        return f"{self.output}{at}{left_out}"

    def __str__(self) -> str:
        return f"{self.speeds}, up to {self.band:.3g} Hz"


def fitted_ranges(
    preparation: Preparation, fitted: Validation
) -> tuple[FittedRange, ...]:
    """What every output was fitted to, by the scores of all fitted logs together."""
    still, band = preparation.still or 0.0, preparation.band or np.inf
    slowest = (
        still
        if isinstance(still, Mapping)
        else {score.output: still for score in fitted.scores}
    )
    return tuple(
        FittedRange(
            score.output,
            band,
            slowest.get(score.output, 0.0),
            score.fastest,
            "m/s" if score.unit == "N" else "rad/s",
            score.rows,
            score.rows - score.moving.rows,
        )
        for score in fitted.scores
    )


def predicting(
    values: str,
    estimate: Estimate,
    essential: Estimate | None,
    physical: PhysicalFit | None,
) -> Floats:
    """Base parameters that predictions use, shape (r,)."""
    found = {
        "estimate": estimate.values,
        "essential": None if essential is None else essential.values,
        "physical": None if physical is None else physical.base,
    }[values]
    if found is None:
        raise InputError(
            f"predictions shall use the {values} values, which were not computed: switch them on"
        )
    return found


_SHOWN = 30  # base parameters in a notebook
_MEASURED, _PREDICTED = "#4477aa", "#ee6677"


@public
@dataclass(frozen=True, repr=False)
class Identification:
    """A fitted model with its evidence.

    Attributes
    ----------
    base : BaseModel
        The base parameters in closed form; ``base.mechanism`` is the robot.
    logs : tuple of str
        Sources of the data it was fitted to.
    preparation : Preparation
        As used: every choice is filled in and gives its reason.
    estimate : Estimate
        Base parameters; the one that predictions use unless ``physical`` does.
    essential : Estimate, optional
        The smaller model after backward elimination; values of eliminated parameters are 0.
    conditioning : Conditioning
    feasibility : Feasibility, optional
        Of ``estimate``.
    physical : PhysicalFit, optional
    validations : tuple of Validation
        Identification data first, then data that the fit did not see.
    findings : tuple of Finding
        What is wrong with the logs or the fit; warnings first.
    predict_with : str
        Which values predictions use: ``"estimate"``, ``"essential"`` or ``"physical"``.
    settings : mapping
        Everything needed to repeat the run: seed, versions, options.
    verdict : str
        The whole in words.
    reasons : tuple of str
        Why the model should not be used; empty if nothing speaks against it.
    hypotheses : tuple of Judged
        What may be wrong or lacking, as it was judged: those that explain what the model leaves, and the next best.
    """

    base: BaseModel
    logs: tuple[str, ...]
    preparation: Preparation
    estimate: Estimate
    essential: Estimate | None
    conditioning: Conditioning
    feasibility: Feasibility | None
    physical: PhysicalFit | None
    validations: tuple[Validation, ...]
    findings: tuple[Finding, ...]
    predict_with: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    verdict: str = ""
    reasons: tuple[str, ...] = ()
    hypotheses: tuple[Judged, ...] = ()

    @property
    def pooled(self) -> tuple[Validation, ...]:
        """Scores over all logs that were fitted, and over all that were not, if there are any."""
        return by_role(self.validations)

    @property
    def ranges(self) -> tuple[FittedRange, ...]:
        """Band, speeds and left-out rows of every output; elsewhere the model extrapolates."""
        return fitted_ranges(self.preparation, self.pooled[0])

    @property
    def values(self) -> Floats:
        """Base parameters that predictions use, shape (r,)."""
        return predicting(
            self.predict_with, self.estimate, self.essential, self.physical
        )

    def to_dataframe(self) -> Any:
        """The base parameters as a data frame of pandas.

        Returns
        -------
        pandas.DataFrame
            Closed form, unit, the value that predictions use, and the estimate with its standard deviation and
            interval, by base parameter.

        Raises
        ------
        MissingExtraError
            If pandas is not installed.
        """
        with extra("notebook"):
            import pandas as pd
        return pd.DataFrame(_columns(self)).set_index("parameter")

    def plot(self) -> Any:
        """Measured and predicted outputs of the last validation.

        Returns
        -------
        plotly.graph_objects.Figure
            One diagram per output.

        Raises
        ------
        MissingExtraError
            If plotly is not installed.
        """
        with extra("identify"):
            from plotly.graph_objects import Scattergl
            from plotly.subplots import make_subplots
        traces = self.validations[-1].traces
        found = make_subplots(len(traces), 1, shared_xaxes=True, vertical_spacing=0.02)
        for row, trace in enumerate(traces, start=1):
            for name, values, colour in (
                ("measured", trace.measured, _MEASURED),
                ("predicted", trace.predicted, _PREDICTED),
            ):
                line = Scattergl(
                    x=trace.time,
                    y=values,
                    name=name,
                    legendgroup=name,
                    showlegend=row == 1,
                )
                found.add_trace(
                    line.update(line={"color": colour, "width": 1}), row=row, col=1
                )
            found.update_yaxes(
                title_text=f"{_safe(trace.output)}, {_safe(trace.unit)}", row=row, col=1
            )
        found.update_xaxes(title_text="time, s", row=len(traces), col=1)
        return found.update_layout(height=160 * len(traces) + 80, margin={"t": 30})

    def _repr_html_(self) -> str:
        """The verdict, the scores and the first parameters."""
        judged = self.pooled[-1]
        scores = [
            (score.output, f"{score.rms:.4g} {score.unit}", f"{score.r2:.4f}")
            for score in judged.scores
        ]
        columns = _columns(self)
        shown = zip(
            *(
                columns[name][:_SHOWN]
                for name in ("expression", "value", "low", "high", "unit")
            ),
            strict=True,
        )
        rows = [
            (name, f"{value:.5g}", f"{low:.4g} … {high:.4g}", unit)
            for name, value, low, high, unit in shown
        ]
        left = len(self.base.pivots) - len(rows)
        unseen = (
            "rows the fit did not see" if judged.role == "validation" else "fitted rows"
        )
        return (
            f"<b>{_safe(self.base.mechanism.name)}</b>: {_safe(self.verdict)}"
            + _table(("output", "rms", f"R² of {unseen}"), scores)
            + _table(
                ("base parameter", "value", "interval of the estimate", "unit"), rows
            )
            + (f"… {left} more" if left else "")
        )

    def __repr__(self) -> str:
        logs = counted(len(self.logs), "log")
        return f"Identification({self.base.mechanism.name}: {self.base.rank} base parameters, {logs})"


def _columns(result: Identification) -> dict[str, Sequence[Any]]:
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


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    cells = "".join(f"<th>{_safe(cell)}</th>" for cell in head)
    body = "".join(
        f"<tr>{''.join(f'<td>{_safe(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return f"<table><tr>{cells}</tr>{body}</table>"


def _safe(text: str) -> str:
    return escape(one_line(text))


_MOST = (
    12  # findings of one kind that are shown; of more the first ones and their number
)
_STRANGER = (
    0.3  # R² below which, for every output, the model has nothing to do with the data
)
FAR = 5.0  # standard deviations to the nearest robot that noise alone does not bring about
IMPOSSIBLE = 30.0
"""Standard deviations from which on the model contradicts physics: what filters and unmodelled effects do is below."""
_COSTLY = 1.5  # ratio of misfits from which on physical consistency costs more than noise does


def contradictions(
    feasible: Feasibility | None,
    findings: Sequence[Finding],
    measured: Sequence[str] | None = (),
) -> list[str]:
    """Facts that contradict a model however well it predicts; rates do where they are taken as ``measured``."""
    facts = []
    if (
        feasible is not None
        and feasible.feasible is False
        and feasible.distance > IMPOSSIBLE
    ):
        away = f"{feasible.distance:.2g} standard deviations away"
        facts.append(f"no robot can have its parameters, the nearest is {away}")
    told = ("contradiction", "rates") if measured else ("contradiction",)
    facts += [str(finding) for finding in findings if finding.kind in told]
    return facts


def fit_findings(
    estimate: Estimate,
    seen: Conditioning,
    feasible: Feasibility | None,
    physical: PhysicalFit | None,
    validations: Sequence[Validation],
) -> list[Finding]:
    """What is wrong with a fit, or worth knowing."""
    return [
        *_of_scores(validations),
        *_of_estimate(estimate, seen),
        *_of_physics(feasible, physical, estimate),
    ]


def limited(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings with warnings first, each once, and of one kind not more than can be read."""
    unique = list(dict.fromkeys(findings))
    unique.sort(key=lambda finding: finding.severity is not Severity.WARNING)
    shown: list[Finding] = []
    kinds = list(dict.fromkeys((f.severity, f.kind) for f in unique))
    for severity, kind in kinds:
        same = [
            finding
            for finding in unique
            if (finding.severity, finding.kind) == (severity, kind)
        ]
        shown += same[:_MOST]
        if len(same) > _MOST:
            shown.append(
                Finding(
                    severity,
                    kind,
                    "",
                    f"{len(same) - _MOST} more findings of this kind ({kind})",
                )
            )
    return tuple(shown)


def _of_scores(validations: Sequence[Validation]) -> Iterable[Finding]:
    for validation in validations:
        scores = [score.r2 for score in validation.scores if np.isfinite(score.r2)]
        if validation.role == "identification" and scores and max(scores) < _STRANGER:
            text = (
                f"the model explains no output (R² at most {max(scores):.2f}): is this log of another robot, or are "
                "columns exchanged, or their signs or units wrong?"
            )
            yield warning("stranger", validation.source, text)
    told = [
        score
        for validation in validations
        for score in validation.scores
        if score.raw.deviation > 0
    ]
    if told and all(score.is_computed for score in told):
        noise = max(score.noise / score.raw.deviation for score in told)
        text = (
            f"all outputs are predicted without a filter, and their noise is {noise:.1g} of their deviation: they look "
            "computed from a model or commanded, not measured, so the fit repeats that model"
        )
        yield warning("computed", "", text)


def _of_estimate(estimate: Estimate, seen: Conditioning) -> Iterable[Finding]:
    for output, rows in zip(estimate.outputs, estimate.rows, strict=True):
        if not rows:
            text = "no row of it is left: it never moves faster than 'still', so nothing was fitted to it"
            yield warning("silent", f"output '{output}'", text)
    n, course = len(estimate.values), estimate.diagnostics
    if seen.rank < n:
        text = f"the data determine {seen.rank} of {n} base parameters, though the sensors could see all of them"
        yield warning("conditioning", "", text)
    for direction in seen.weak:
        yield warning("conditioning", "", direction.advice)
    if course.get("converged") is False:
        text = f"the estimator {estimate.method} did not converge in {course.get('iterations')} iterations"
        yield warning("convergence", "", text)


def _of_physics(
    feasible: Feasibility | None, physical: PhysicalFit | None, estimate: Estimate
) -> Iterable[Finding]:
    if feasible is not None and feasible.feasible is False:
        away = f"{feasible.distance:.2g} standard deviations away"
        text = f"no physical robot has the estimated base parameters; the nearest one is {away}"
        if feasible.distance <= FAR:
            yield note("feasibility", "", f"{text}, as noise does")
        else:
            wrong = "columns are exchanged, or their signs or units wrong, or " * (
                feasible.distance > IMPOSSIBLE
            )
            yield warning(
                "feasibility", "", f"{text}: {wrong}the model lacks something"
            )
    rows = max(sum(estimate.rows), 1)
    if physical is not None and physical.misfit > _COSTLY * max(
        physical.unconstrained_misfit, rows
    ):
        more = (physical.misfit - physical.unconstrained_misfit) / rows
        text = f"physical consistency raises the squares by {more:.2g} noise variances per row: is the model complete?"
        yield warning("physics", "", text)
