"""Identification: all that one run found out, from the logs to the verdict, and what a user must know of it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.identification.conditioning import DataConditioning
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.judge.judge import Judged
from echelon.identification.logs.finding import Finding, counted
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.masses import BodyMass, body_masses
from echelon.identification.physics.feasibility import Feasibility
from echelon.identification.physics.fit import PhysicalFit
from echelon.identification.rows.travels import Travel
from echelon.identification.scores import Score, Validation
from echelon.identification.verdict import Judgement, by_role
from echelon.robot import Experiment, Mechanism, mechanism_of
from echelon.shared import Floats, InputError, extra, one_line, public

if TYPE_CHECKING:
    import pandas
    import plotly.graph_objects

    from echelon.base import BaseModel


@dataclass(frozen=True)
class FittedRange:
    """Band and speeds that an output was fitted to; elsewhere the model extrapolates."""

    output: str
    band: float  # highest frequency, Hz
    slowest: float  # speed of its joint or actuator below which rows are left out, rad/s or m/s
    fastest: float  # nan for a wrench
    unit: str  # of the speeds
    rows: int  # of the band
    left_out: int  # how many of them were left out near standstill

    @property
    def speeds(self) -> str:
        """Such as ``j1 up to 2 rad/s, without 3 of 900 rows near standstill (below 0.01 rad/s)``."""
        moves = np.isfinite(self.fastest)
        up_to = f" up to {self.fastest:.3g} {self.unit}" if moves else ""
        left_out = (
            f", without {self.left_out} of {self.rows} rows near standstill (below {self.slowest:.2g} {self.unit})"
            if self.left_out
            else ""
        )
        return f"{self.output}{up_to}{left_out}"

    def __str__(self) -> str:
        return f"{self.speeds}, up to {self.band:.3g} Hz"


def fitted_ranges(
    preparation: Preparation, fitted: Validation
) -> tuple[FittedRange, ...]:
    """Ranges of all outputs, by the scores of all fitted logs together."""
    return tuple(_range(preparation, score) for score in fitted.scores)


def _range(preparation: Preparation, score: Score) -> FittedRange:
    experiment, _, name = score.output.partition(".")
    own = preparation.experiments.get(experiment)
    name = score.output if own is None else name
    own = own or preparation
    still = own.still or 0.0
    return FittedRange(
        score.output,
        own.band or np.inf,
        still.get(name, 0.0) if isinstance(still, Mapping) else still,
        score.fastest,
        "m/s" if score.unit == "N" else "rad/s",
        score.rows,
        score.rows - score.moving.rows,
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


UNSCALED = (
    "units may be wrong: columns with names of currents are read as torques; if they are in A, N·m stands for A, and "
    "kg, kg·m² and units of friction hold up to the torque per ampere"
)
SHOWN_PARAMETERS = 30  # in a notebook: one screen; a data frame has all
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
        Identification data first, then unseen data.
    findings : tuple of Finding
        Faults of the logs or the fit; warnings first.
    predict_with : str
        Which values predictions use: ``"estimate"``, ``"essential"`` or ``"physical"``.
    judgement : Judgement
        The verdict in parts: a badge, a sentence, reasons not to use the model, and remarks.
    settings : mapping
        Everything needed to repeat the run: seed, versions, options.
    hypotheses : tuple of Judged
        Possible errors of model and logs: those that explain residuals, and the next best.
    untested : tuple of str
        Hypotheses that these data do not let be tested, and why.
    experiments : tuple of Experiment
        The experiments that the logs belong to; none for one robot in one set-up.
    """

    base: BaseModel
    logs: tuple[str, ...]
    preparation: Preparation
    estimate: Estimate
    essential: Estimate | None
    conditioning: DataConditioning
    feasibility: Feasibility | None
    physical: PhysicalFit | None
    validations: tuple[Validation, ...]
    findings: tuple[Finding, ...]
    predict_with: str
    judgement: Judgement
    settings: Mapping[str, Any] = field(default_factory=dict)
    hypotheses: tuple[Judged, ...] = ()
    untested: tuple[str, ...] = ()
    experiments: tuple[Experiment, ...] = ()

    @property
    def verdict(self) -> str:
        """The whole in words."""
        return self.judgement.text

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons not to use the model; empty if there are none."""
        return self.judgement.reasons

    @property
    def pooled(self) -> tuple[Validation, ...]:
        """Scores over all logs that were fitted, and over all that were not, if there are any."""
        return by_role(self.validations)

    @property
    def ranges(self) -> tuple[FittedRange, ...]:
        """Band, speeds and left-out rows of every output; elsewhere the model extrapolates."""
        return fitted_ranges(self.preparation, self.pooled[0])

    @property
    def travels(self) -> tuple[Travel, ...]:
        """Ranges, speeds and accelerations of all coordinates in the fitted data; elsewhere the model extrapolates."""
        return self.pooled[0].travels

    @property
    def unit_remark(self) -> str:
        """A remark on tables whose units hold for torques where outputs are currents; else empty."""
        kinds = {finding.kind for finding in self.findings}
        return UNSCALED if "currents" in kinds else ""

    @property
    def masses(self) -> tuple[BodyMass, ...]:
        """Mass and centre of mass, with intervals, of bodies that the data tell alone."""
        if not self.conditioning.is_complete:
            return ()
        return body_masses(self.base, self.estimate, self.level)

    @property
    def robot(self) -> Mechanism:
        """The robot; of experiments that of the first one."""
        if not self.experiments:
            return self.base.mechanism
        return mechanism_of(self.experiments[0].robot)

    @property
    def values(self) -> Floats:
        """Base parameters that predictions use, shape (r,)."""
        return predicting(
            self.predict_with, self.estimate, self.essential, self.physical
        )

    def to_dataframe(self) -> pandas.DataFrame:
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

    def plot(self) -> plotly.graph_objects.Figure:
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
                columns[name][:SHOWN_PARAMETERS]
                for name in ("expression", "value", "low", "high", "unit")
            ),
            strict=True,
        )
        rows = [
            (name, f"{value:.5g}", f"{low:.4g} … {high:.4g}", unit)
            for name, value, low, high, unit in shown
        ]
        left = len(self.base.pivots) - len(rows)
        unseen = "held-out rows" if judged.role == "validation" else "fitted rows"
        return (
            f"<b>{_safe(self.base.mechanism.name)}</b>: {_safe(self.verdict)}"
            + _table(("output", "rms", f"R² of {unseen}"), scores)
            + _table(
                ("base parameter", "value", "interval of the estimate", "unit"), rows
            )
            + (f"… {left} more" if left else "")
        )

    @property
    def level(self) -> float:
        """Probability with which an interval contains the true value of its parameter."""
        return float(self.settings.get("level", 0.95))

    def __repr__(self) -> str:
        logs = counted(len(self.logs), "log")
        return f"Identification({self.base.mechanism.name}: {self.base.rank} base parameters, {logs})"


def _columns(result: Identification) -> dict[str, Sequence[Any]]:
    """Base parameters by column: name, closed form, unit, the value of predictions, and the estimate's interval."""
    low, high = result.estimate.interval(result.level).T
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
