"""Arguments and options that several commands share, so that each is explained once."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer


class Mimic(StrEnum):
    """What to do with coupled joints."""

    COUPLED = "coupled"
    INDEPENDENT = "independent"


class Measured(StrEnum):
    """What is measured, where a description does not say so."""

    DRIVES = "drives"
    FILE = "file"


class Order(StrEnum):
    """Column orders."""

    BASE_TO_TIP = "base-to-tip"
    TIP_TO_BASE = "tip-to-base"


class SymbolSharing(StrEnum):
    """How numbers of a robot file get symbols."""

    SHARED = "shared"
    SEPARATE = "separate"


Robot = Annotated[Path, typer.Argument(help="URDF, SDF, MJCF or Echelon description (YAML, JSON).")]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="File to write instead of the terminal.")]
Force = Annotated[
    bool, typer.Option("--force", help="Replace files that are read, or that no earlier command wrote, as well.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Machine-readable output.")]
Floating = Annotated[bool, typer.Option(help="Let the root link float.")]
Gravity = Annotated[str, typer.Option(help="'file', 'none', 'generic', or three numbers or expressions: '0,0,-9.81'.")]
Ordering = Annotated[Order, typer.Option(help="Which parameters become representatives.")]
Prefer = Annotated[
    list[str] | None,
    typer.Option(help="A parameter (M7) or kind (MX) wanted as representative; may be repeated."),
]
Tolerance = Annotated[
    float | None,
    typer.Option(
        help="Read angles this near (rad) to multiples of 15° as exact; 0 takes rounded angles literally. "
        "[default: 0.002]"
    ),
]
Numeric = Annotated[bool, typer.Option("--numeric", help="Numbers throughout, for every symbol that has a value.")]
Symbols = Annotated[SymbolSharing, typer.Option(help="Whether equal magnitudes of a robot file share a symbol.")]
Mimicking = Annotated[Mimic, typer.Option(help="Respect mimic joints, or treat them as independent.")]
Measuring = Annotated[Measured, typer.Option(help="Forces of all drives, or the sensors of an MJCF file.")]
EveryLink = Annotated[bool, typer.Option("--every-link", help="Keep links fixed to others as bodies.")]
Massless = Annotated[list[str] | None, typer.Option(help="A link that carries no parameters; may be repeated.")]
Budget = Annotated[
    float,
    typer.Option(
        min=0, help="How much work closed forms may take: 1 is a few seconds, 0 for numbers only, larger for more."
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the random points.")]


def reading(
    floating: bool = False,
    gravity: str = "file",
    tolerance: float | None = None,
    mimic: Mimic = Mimic.COUPLED,
    every_link: bool = False,
    numeric: bool = False,
    massless: list[str] | None = None,
    symbols: SymbolSharing = SymbolSharing.SHARED,
    measured: Measured = Measured.DRIVES,
) -> dict[str, Any]:
    """Keyword arguments of :func:`echelon.load`."""
    return {
        "floating": floating,
        "gravity": gravity,
        "symbolic": not numeric,
        "independent_mimics": mimic is Mimic.INDEPENDENT,
        "every_link": every_link,
        "massless": tuple(massless or ()),
        "separate_symbols": symbols is SymbolSharing.SEPARATE,
        "measured": measured.value,
        **({} if tolerance is None else {"tolerance": tolerance}),
    }
