"""Base parameters and identifications on a terminal, with rich."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from rich.console import Console, JustifyMethod
from rich.table import Table
from rich.text import Text

from echelon.base import (
    BaseModel,
    Identifiability,
    body_names,
    classification_rows,
    facts,
    headline,
    legend,
    shown_expressions,
)
from echelon.identification import Finding, Judgement, Severity, counted
from echelon.shared import PARAMETERS, one_line

if TYPE_CHECKING:
    from echelon.comparison import Comparison
    from echelon.identification import (
        BodyMass,
        Estimate,
        Identification,
        Judged,
        ServoFit,
        Validation,
    )

_COLOURS = {
    Identifiability.ALONE: "green",
    Identifiability.COMBINATION: "yellow",
    Identifiability.UNIDENTIFIABLE: "red",
}

_PARAMETERS = 24
"""Parameters of bodies that are listed, and of effects; the rest is in the report and in model.json."""


def print_comparison(found: Comparison) -> None:
    """Print what differs, and outputs as a table."""
    console = Console()
    title, *lines = found.heading()
    console.print(Text(one_line(title), style="bold green" if found else "bold red"))
    for line in lines:
        console.print(Text(one_line(line)))
    for table in _differences(console, found):
        console.print(table)
    for line in found.closing():
        console.print(Text(one_line(line)))


def _differences(console: Console, found: Comparison) -> Iterator[Table]:
    """Differences of outputs and of their parts: in two tables where one would break the outputs' names."""
    table = found.table()
    together = _difference_table(found, table)
    if _fits(console, together):
        yield together
        return
    parts = table[0].index("tolerance") + 1  # gravity, acceleration and so on
    yield _difference_table(found, [row[:parts] for row in table])
    yield _difference_table(found, [(row[0], *row[parts:]) for row in table])


def _difference_table(found: Comparison, rows: Sequence[Sequence[str]]) -> Table:
    head, *rest = rows
    table = plain_table(*head, left=head[:1])
    for output, row in zip(found.outputs, rest, strict=True):
        alike = output.total.attained <= output.tolerance
        cells = (Text(one_line(cell)) for cell in row)
        table.add_row(*cells, style="dim" if alike else None)
    return table


def print_model(model: BaseModel, *, full: bool = False) -> None:
    """Print count, closed forms, classification and facts."""
    console = Console()
    console.print(Text(headline(model), style="bold"))
    table = Table(show_header=True, header_style="bold", box=None, padding=(0, 2, 0, 0))
    table.add_column("#", justify="right", style="dim")
    table.add_column("base parameter", overflow="fold")
    table.add_column("unit", style="dim")
    for i, expression in enumerate(shown_expressions(model, full=full)):
        table.add_row(str(i + 1), Text(str(expression)), expression.unit)
    console.print(table)
    if model.parameters:
        console.print(_classification(model))
        console.print(Text(legend(model)))
    for label_text, text in facts(model, full=full):
        console.print(Text.assemble((f"{label_text}: ", "cyan"), text))


def _classification(model: BaseModel) -> Table:
    """One row per body, one mark per parameter."""
    table = Table(show_header=True, header_style="bold", box=None, padding=(0, 1, 0, 0))
    table.add_column("body", overflow="fold")
    for name in PARAMETERS:
        table.add_column(name, justify="center")
    for title, marks in classification_rows(model):
        table.add_row(
            Text(title),
            *(Text(mark, style=_COLOURS[kind] if kind else "") for mark, kind in marks),
        )
    return table


def print_identification(result: Identification) -> None:
    """Print what a user needs to know before opening the report."""
    console, estimate = Console(), result.estimate
    console.print(Text(_headline(result), style="bold"))
    print_findings(console, result.findings)
    if result.hypotheses:
        console.print(_hypotheses(result.hypotheses))
    if remark := result.unit_remark:
        console.print(Text(f"tables: {remark}", style="yellow"))
    for validation in result.pooled:
        for table in _scores(console, validation):
            console.print(table)
    console.print(_parameters(result.base, estimate, result.level))
    if named := body_names(result.base):
        console.print(Text(f"numbers of bodies: {named}"))
    if masses := result.masses:
        console.print(_masses(masses, result.level))
    console.print(Text(_conditioning(result)))
    if result.feasibility is not None:
        console.print(Text(result.feasibility.evidence))
    _print_judgement(console, result.judgement)


def _print_judgement(console: Console, told: Judgement) -> None:
    """Print a badge with the first sentence of a verdict, then why, then the rest."""
    colour = "green" if told.is_good else "red"
    badge = f" {told.badge.upper()} ", f"bold white on {colour}"
    console.print(Text.assemble(badge, " ", (one_line(told.sentence), "bold")))
    for reason in told.beside:
        console.print(Text(f"  reason: {one_line(reason)}", style=colour))
    for remark in told.remarks:
        console.print(Text(f"  {one_line(remark)}"))


def _hypotheses(hypotheses: Sequence[Judged]) -> Table:
    """Table of hypotheses about the model and the log, scored on held-out blocks."""
    table = plain_table(
        "hypothesis",
        "residuals",
        "",
        "",
        left=("hypothesis",),
        title="possible errors of model and logs",
    )
    for some in hypotheses:
        where = (
            f" ({', '.join(some.places)})"
            if any(some.places) and some.places[0] not in some.words
            else ""
        )
        shrinkage = f"−{some.shrinkage:.3g} %", f"± {100 * some.gain.error:.2g}"
        table.add_row(
            Text(one_line(some.words + where)),
            *shrinkage,
            "explains" if some.taken else "",
        )
    return table


def print_servos(fit: ServoFit) -> None:
    """Print what a fit of servos found."""
    console = Console()
    headline = f"{one_line(fit.base.mechanism.name)}: {fit.base.rank} parameters from positions and commands"
    console.print(Text(headline, style="bold"))
    for reason in fit.reasons:
        console.print(Text(f"do not use it: {one_line(reason)}", style="bold red"))
    print_findings(console, fit.findings)
    for title, scores in (
        ("fitted rows", fit.fitted),
        ("held-out rows", fit.held_out),
    ):
        table = plain_table(
            "joint", "rms", "R²", "R² of the lag", left=("joint",), title=title
        )
        for score in scores:
            table.add_row(
                Text(one_line(score.joint)),
                f"{score.rms:.2g}",
                f"{score.r2:.5f}",
                f"{score.lag_r2:.4f}",
            )
        if scores:
            console.print(table)
    console.print(_parameters(fit.base, fit.estimate, 0.95))
    console.print(
        Text(f"commands come {1e3 * fit.delay:.1f} ± {2e3 * fit.delay_std:.1f} ms late")
    )
    for sentence in fit.hidden:
        console.print(Text(f"hidden: {one_line(sentence)}", style="yellow"))


def print_findings(console: Console, findings: Sequence[Finding]) -> None:
    """Print findings, warnings in colour."""
    for finding in findings:
        style = "yellow" if finding.severity is Severity.WARNING else "dim"
        console.print(
            Text(f"{finding.severity.value}: {one_line(str(finding))}", style=style)
        )


def plain_table(*columns: str, left: Sequence[str], title: str = "") -> Table:
    """A table without lines: numbers at the right, and columns that are named at the left.

    The first column alone breaks lines in a narrow terminal, so that units stay beside their numbers.
    """
    table = Table(
        title=Text(title) if title else None,
        title_justify="left",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for k, column in enumerate(columns):
        side: JustifyMethod = "left" if column in left else "right"
        table.add_column(column, justify=side, overflow="fold", no_wrap=k > 0)
    return table


def _headline(result: Identification) -> str:
    estimate, name = result.estimate, one_line(result.base.mechanism.name)
    logs = counted(len(result.logs), "log")
    rows = f"{sum(estimate.rows)} rows of {counted(len(estimate.outputs), 'output')} in {logs}"
    return (
        f"{name}: {result.base.rank} base parameters by {estimate.method} from {rows}"
    )


def _scores(console: Console, validation: Validation) -> Iterator[Table]:
    """Scores of every output, and of other models: in a table of their own where one would break the outputs' names."""
    beside = {
        "prior": validation.prior_scores,
        "no\nfriction": validation.plain_scores,
    }
    others = {
        name: [_number(score.r2, 5) for score in scores]
        for name, scores in beside.items()
        if scores
    }
    title = f"{validation.role}: {one_line(validation.source)}"
    names = [Text(one_line(score.output)) for score in validation.scores]
    own = _score_columns(validation)
    together = _score_table(title, {"output": names, **own, **others})
    if not others or _fits(console, together):
        yield together
        return
    yield _score_table(title, {"output": names, **own})
    yield _score_table("R² of other models", {"output": names, **others})


def _score_columns(validation: Validation) -> dict[str, list[Text]]:
    """Columns of the scores of the identified model, by their heads."""
    columns: dict[str, list[Text]] = {}
    for score in validation.scores:
        known = math.isfinite(score.rms)
        cells = {
            "rms": Text(f"{score.rms:.4g}" if known else "–"),
            "unit": Text(score.unit if known else ""),
            "% of\nrange": _number(score.percent, 2),
            "R²": _number(score.r2, 5),
            "moving": _number(score.moving.r2, 5),
            "un-\nfiltered": _number(score.raw.r2, 5),
        }
        for head, cell in cells.items():
            columns.setdefault(head, []).append(cell)
    return columns


def _score_table(title: str, columns: dict[str, list[Text]]) -> Table:
    table = plain_table(*columns, left=("output", "unit"), title=title)
    for cells in zip(*columns.values(), strict=True):
        table.add_row(*cells)
    return table


def _fits(console: Console, table: Table) -> bool:
    """Whether no cell of a table must break in this terminal."""
    unbounded = console.options.update(max_width=1000)
    return console.measure(table, options=unbounded).maximum <= console.width


def _number(value: float, digits: int) -> Text:
    return Text(f"{value:.{digits}f}" if math.isfinite(value) else "–")


def _parameters(base: BaseModel, estimate: Estimate, level: float) -> Table:
    interval = f"{level:.0%} interval"
    table = plain_table(
        "base parameter",
        "value",
        interval,
        "unit",
        left=("base parameter", interval, "unit"),
    )
    columns = base.mechanism.columns
    rows: dict[bool, list[tuple[Text | str, ...]]] = {False: [], True: []}
    for pivot, expression, value, (low, high), unit in zip(
        base.matrix.pivots,
        base.readable,
        estimate.values,
        estimate.interval(level),
        estimate.units,
        strict=True,
    ):
        is_effect = columns[pivot].body is None
        interval = f"{low:.4g} … {high:.4g}"
        rows[is_effect].append((Text(str(expression)), f"{value:.5g}", interval, unit))
    # many parameters of bodies would hide all friction
    for is_effect, some in rows.items():
        for cells in some[:_PARAMETERS]:
            table.add_row(*cells)
        if more := len(some[_PARAMETERS:]):
            what = "friction, springs or drives" if is_effect else "bodies"
            table.add_row(Text(f"… and {more} more of {what}"), "", "", "")
    return table


def _masses(masses: Sequence[BodyMass], level: float) -> Table:
    interval = f"{level:.0%} interval"
    table = plain_table(
        "body", "value", interval, "unit", left=("body", interval, "unit")
    )
    for some in masses:
        for name, value, low, high, unit in some.rows:
            cells = f"{value:.5g}", f"{low:.5g} … {high:.5g}", unit
            table.add_row(Text(one_line(name)), *cells)
    return table


def _conditioning(result: Identification) -> str:
    found = result.conditioning
    text = f"condition number {found.condition:.3g}, with columns of norm 1 {found.scaled_condition:.3g}"
    return text if not found.weak else f"{text}; weakest: {found.weak[0].advice}"
