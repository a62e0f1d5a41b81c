"""A BaseModel on a terminal, with rich."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from echelon.base.base_set import Identifiability
from echelon.base.display import classification_rows, facts, headline, legend
from echelon.base.model import BaseModel
from echelon.conventions import PARAMETERS

_COLOURS = {
    Identifiability.ALONE: "green",
    Identifiability.COMBINATION: "yellow",
    Identifiability.UNIDENTIFIABLE: "red",
}


def print_model(model: BaseModel) -> None:
    """Print count, closed forms, classification and facts."""
    console = Console()
    console.print(Text(headline(model), style="bold"))
    table = Table(show_header=True, header_style="bold", box=None, padding=(0, 2, 0, 0))
    table.add_column("#", justify="right", style="dim")
    table.add_column("base parameter", overflow="fold")
    table.add_column("unit", style="dim")
    for i, expression in enumerate(model.expressions):
        table.add_row(str(i + 1), Text(str(expression)), expression.unit)
    console.print(table)
    if model.parameters:
        console.print(_classification(model))
        console.print(Text(legend(model)))
    for label_text, text in facts(model):
        console.print(Text.assemble((f"{label_text}: ", "cyan"), text))


def _classification(model: BaseModel) -> Table:
    """One row per body, one mark per parameter."""
    table = Table(show_header=True, header_style="bold", box=None, padding=(0, 1, 0, 0))
    table.add_column("body", overflow="fold")
    for name in PARAMETERS:
        table.add_column(name, justify="center")
    for title, marks in classification_rows(model):
        table.add_row(Text(title), *(Text(mark, style=_COLOURS[kind] if kind else "") for mark, kind in marks))
    return table
