"""Arguments and options that several commands share, so that each is explained once and means one thing everywhere."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from echelon.choices import Measured, Order

Robot = Annotated[Path, typer.Argument(help="URDF, SDF, MJCF or Echelon description (YAML, JSON).")]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="File to write instead of the terminal.")]
Force = Annotated[
    bool, typer.Option("--force", help="Replace files that are read, or that no earlier command wrote, as well.")
]
AsJson = Annotated[bool, typer.Option("--json", help="Machine-readable output.")]
Ordering = Annotated[Order, typer.Option(help="Which parameters become representatives.")]
Prefer = Annotated[
    list[str] | None,
    typer.Option(help="A parameter (M7) or kind (MX) wanted as representative; may be repeated."),
]
Budget = Annotated[
    float, typer.Option(min=0, help="Work for closed forms (0: numbers only) or sensor subsets; 1 is a few seconds.")
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the random points.")]

Floating = Annotated[bool, typer.Option(help="Let the root link float.")]
Gravity = Annotated[str, typer.Option(help="'file', 'none', 'generic', or three numbers or expressions: '0,0,-9.81'.")]
SnapTolerance = Annotated[
    float | None,
    typer.Option(
        "--snap-tolerance",
        help="Read angles this near (rad) to multiples of 15° as exact; 0 takes rounded angles literally. "
        "[default: 0.002]",
    ),
]
KeepFixedLinks = Annotated[bool, typer.Option("--keep-fixed-links", help="Keep links fixed to others as bodies.")]
Massless = Annotated[list[str] | None, typer.Option(help="A link that carries no parameters; may be repeated.")]

_READING: dict[str, tuple[Any, Any]] = {
    "floating": (Floating, False),
    "gravity": (Gravity, "file"),
    "snap_tolerance": (SnapTolerance, None),
    "keep_fixed_links": (KeepFixedLinks, False),
    "massless": (Massless, None),
    "mimic": (
        Annotated[
            Literal["coupled", "independent"],
            typer.Option(help="Respect mimic joints, or treat them as independent."),
        ],
        "coupled",
    ),
    "numeric": (
        Annotated[bool, typer.Option("--numeric", help="Numbers throughout, for every symbol that has a value.")],
        False,
    ),
    "symbols": (
        Annotated[
            Literal["shared", "separate"],
            typer.Option(help="Whether equal magnitudes of a robot file share a symbol."),
        ],
        "shared",
    ),
    "measured": (
        Annotated[
            Measured,
            typer.Option(help="Forces of all drives, or the sensors of an MJCF file."),
        ],
        "drives",
    ),
}
"""How a robot is read: options by name, with their defaults."""


Command = Callable[..., Any]


def reads_robot(*names: str) -> Callable[[Command], Command]:
    """Put options of reading in the place of a command's argument ``read``, which gets keywords of ``echelon.load``."""
    options = [
        Parameter(name, Parameter.KEYWORD_ONLY, annotation=_READING[name][0], default=_READING[name][1])
        for name in names
    ]

    def extended(command: Command) -> Command:
        def run(**given: Any) -> Any:
            read = reading(**{name: given.pop(name) for name in names})
            return command(**given, read=read)

        own = signature(command, eval_str=True).parameters.values()
        return with_parameters(run, command, [o for p in own for o in (options if p.name == "read" else [p])])

    return extended


def with_parameters(run: Command, command: Command, parameters: Iterable[Parameter]) -> Command:
    """A function that shows other parameters than it has, with the name and documentation of a command."""
    shown = [parameter.replace(kind=Parameter.KEYWORD_ONLY) for parameter in parameters]
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in shown}
    run.__signature__ = Signature(shown)  # type: ignore[attr-defined]
    return run


def reading(
    floating: bool = False,
    gravity: str = "file",
    snap_tolerance: float | None = None,
    mimic: str = "coupled",
    keep_fixed_links: bool = False,
    numeric: bool = False,
    massless: list[str] | None = None,
    symbols: str = "shared",
    measured: str = "drives",
) -> dict[str, Any]:
    """Keyword arguments of :func:`echelon.load`."""
    return {
        "floating": floating,
        "gravity": gravity,
        "symbolic": not numeric,
        "independent_mimics": mimic == "independent",
        "keep_fixed_links": keep_fixed_links,
        "massless": tuple(massless or ()),
        "separate_symbols": symbols == "separate",
        "measured": measured,
        **({} if snap_tolerance is None else {"snap_tolerance": snap_tolerance}),
    }
