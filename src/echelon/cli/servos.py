"""What ``identify`` does with robots whose joints are servos: an output-error fit of positions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from echelon.cli.destination import Destination
from echelon.cli.screen import json_text, show, steps
from echelon.errors import one_line
from echelon.identification.servos.servo_fit import ServoFit, ServoScore, fit_servos
from echelon.results.servo import servo_document, servo_to_json
from echelon.setup.setup import Setup

MODEL = "servos.json"


def run_servos(setup: Setup, logs: Sequence[Path], output: Destination | None, *, as_json: bool) -> tuple[str, ...]:
    """Fit, write the model, and print the summary; why the model should not be used."""
    if output is not None:
        output.check((MODEL,))
    with steps() as step:
        fit = fit_servos(setup, tuple(logs), on_step=step)
    paths = [] if output is None else output.write_into({MODEL: servo_to_json(fit)})
    if as_json:
        show(json_text({**servo_document(fit), "files": [str(path) for path in paths]}))
        return fit.reasons
    _print(fit)
    if paths:
        show(f"wrote {', '.join(map(str, paths))}")
    return fit.reasons


def _print(fit: ServoFit) -> None:
    console = Console()
    headline = f"{one_line(fit.base.mechanism.name)}: {fit.base.rank} parameters from positions and commands"
    console.print(Text(headline, style="bold"))
    for reason in fit.reasons:
        console.print(Text(f"do not use it: {one_line(reason)}", style="bold red"))
    for finding in fit.findings:
        console.print(Text(one_line(str(finding)), style="dim"))
    console.print(_scores("fitted rows", fit.fitted))
    if fit.held_out:
        console.print(_scores("rows the fit did not see", fit.held_out))
    console.print(_parameters(fit))
    console.print(Text(f"commands come {1e3 * fit.delay:.1f} ± {2e3 * fit.delay_std:.1f} ms late"))
    for sentence in fit.hidden:
        console.print(Text(f"hidden: {one_line(sentence)}", style="yellow"))


def _scores(title: str, scores: Sequence[ServoScore]) -> Table:
    table = Table(title=Text(title), title_justify="left", box=None, padding=(0, 2, 0, 0))
    for column in ("joint", "rms", "R²", "R² of the lag"):
        table.add_column(column, justify="left" if column == "joint" else "right")
    for score in scores:
        table.add_row(Text(one_line(score.joint)), f"{score.rms:.2g}", f"{score.r2:.5f}", f"{score.lag_r2:.4f}")
    return table


def _parameters(fit: ServoFit) -> Table:
    table = Table(box=None, padding=(0, 2, 0, 0))
    for column in ("parameter", "value", "95% interval", "unit"):
        table.add_column(column, justify="right" if column == "value" else "left", overflow="fold")
    estimate = fit.estimate
    rows = zip(fit.base.expressions, estimate.values, estimate.interval(), estimate.units, strict=True)
    for expression, value, (low, high), unit in rows:
        table.add_row(Text(str(expression)), f"{value:.4g}", f"{low:.3g} … {high:.3g}", unit)
    return table
