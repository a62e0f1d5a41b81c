"""A BaseModel on a terminal, with rich."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from echelon.base.display import by_class, compact_names, facts, headline
from echelon.base.model import BaseModel, Identifiability

_COLOURS = {
    Identifiability.ALONE: "green",
    Identifiability.COMBINATION: "yellow",
    Identifiability.UNIDENTIFIABLE: "red",
}


def print_model(model: BaseModel, elapsed: float) -> None:
    """Print count, closed forms, classification, facts and time."""
    console = Console()
    console.print(Text(headline(model), style="bold"))
    table = Table(show_header=True, header_style="bold", box=None, padding=(0, 2, 0, 0))
    table.add_column("#", justify="right", style="dim")
    table.add_column("base parameter", overflow="fold")
    table.add_column("unit", style="dim")
    for i, expression in enumerate(model.expressions):
        table.add_row(str(i + 1), Text(str(expression)), expression.unit)
    console.print(table)
    for kind, names in by_class(model):
        label = Text(f"{kind.value} ({len(names)}): ", style=_COLOURS[kind])
        console.print(label + Text(compact_names(names)))
    for label_text, text in facts(model):
        console.print(Text(f"{label_text}: ", style="cyan") + Text(text))
    console.print(Text("time: ", style="cyan") + Text(f"{elapsed:.2f} s"))
