"""The application, on which commands put themselves, and options that several of them share, each explained once."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from inspect import Parameter, Signature, signature
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from typer.core import TyperGroup

from echelon.cli.screen import set_verbosity
from echelon.shared import Measured, Order


class _Commands(TyperGroup):
    """All commands; the exit code is 0 when the reader of a pipe goes away (typer would exit with 1)."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:  # prints the help
        with _readers_may_leave():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        with _readers_may_leave():
            return super().invoke(ctx)


Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose", "-v", help="Say on standard error what is done, and when."
    ),
]


class _Application(typer.Typer):
    """An application all of whose commands take ``--verbose``."""

    def command(  # type: ignore[override]  # what it passes on is typer's affair
        self, name: str | None = None, **options: Any
    ) -> Callable[[Command], Command]:
        register: Callable[[Command], Command] = super().command(name, **options)
        return lambda command: register(_with_verbosity(command))


def _with_verbosity(command: Command) -> Command:
    def run(verbose: bool, **given: Any) -> Any:
        from echelon.shared import READ

        set_verbosity(verbose)
        READ.clear()
        READ.update(_files(value for name, value in given.items() if name != "output"))
        return command(**given)

    own = signature(command, eval_str=True).parameters.values()
    last = Parameter(
        "verbose", Parameter.KEYWORD_ONLY, annotation=Verbose, default=False
    )
    return with_parameters(run, command, [*own, last])


def _files(values: Iterable[Any]) -> Iterator[str]:
    """Paths of files among the arguments of a command."""
    for value in values:
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, str | Path) and os.path.isfile(one):
                yield str(one)


@contextmanager
def _readers_may_leave() -> Iterator[None]:
    try:
        yield
    except (
        BrokenPipeError
    ):  # nothing more can be written, not even what is still in the buffer
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None


def application(name: str, text: str, **more: Any) -> typer.Typer:
    """The application, or a group of its commands."""
    more |= {
        "add_completion": False,
        "pretty_exceptions_enable": False,
        "rich_markup_mode": None,
        # commands inherit it
        "context_settings": {"help_option_names": ["-h", "--help"]},
    }
    return _Application(
        name=name, cls=_Commands, help=text, no_args_is_help=True, **more
    )


app = application(
    "echelon",
    "Exact base inertial parameters of robots, in closed form, with a certificate.",
    epilog="Exit codes: 0 success, 1 a claim was refuted or a check failed, "
    "2 bad input or usage.",
)


def _version(show: bool) -> None:
    if show:
        from echelon.shared import __version__

        typer.echo(f"echelon {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    traceback: Annotated[
        bool, typer.Option("--traceback", help="Show the full traceback of errors.")
    ] = False,
    _: Annotated[
        bool, typer.Option("--version", help="Show the version.", callback=_version)
    ] = False,
) -> None:
    if traceback:
        os.environ["ECHELON_TRACEBACK"] = "1"


Robot = Annotated[
    Path, typer.Argument(help="URDF, SDF, MJCF or Echelon description (YAML, JSON).")
]
Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="File to write instead of the terminal."),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        help="Replace files that no earlier command wrote, too; never files that are read.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Machine-readable output.")]
Ordering = Annotated[
    Order, typer.Option(help="Which parameters become representatives.")
]
Prefer = Annotated[
    list[str] | None,
    typer.Option(
        help="A parameter (M7) or kind (MX) wanted as representative; may be repeated."
    ),
]
Budget = Annotated[
    float,
    typer.Option(
        min=0,
        help="Work for closed forms (0: numbers only) or sensor subsets; 1 is a few seconds.",
    ),
]
Seed = Annotated[int | None, typer.Option(min=0, help="Seed of the random points.")]

Floating = Annotated[bool, typer.Option(help="Let the root link float.")]
Gravity = Annotated[
    str,
    typer.Option(
        help="'file', 'none', 'generic', or three numbers or expressions: '0,0,-9.81'."
    ),
]
SnapTolerance = Annotated[
    float | None,
    typer.Option(
        "--snap-tolerance",
        help="Read angles this near (rad) to multiples of 15° as exact; 0 takes rounded angles literally. "
        "[default: 0.002]",
    ),
]
KeepFixedLinks = Annotated[
    bool,
    typer.Option("--keep-fixed-links", help="Keep links fixed to others as bodies."),
]
Massless = Annotated[
    list[str] | None,
    typer.Option(help="A link that carries no parameters; may be repeated."),
]

Ignore = Annotated[
    list[str] | None,
    typer.Option(
        metavar="NAME",
        help="An element (loop, gazebo/joint) or attribute (@quat, origin@quat) of a robot file that counts as if it "
        "were not there, though it may change how the robot moves; may be repeated.",
    ),
]

_READING: dict[str, tuple[Any, Any]] = {
    "floating": (Floating, False),
    "gravity": (Gravity, "file"),
    "snap_tolerance": (SnapTolerance, None),
    "numeric": (
        Annotated[
            bool,
            typer.Option(
                "--numeric",
                help="Numbers throughout, for every symbol that has a value.",
            ),
        ],
        False,
    ),
    "mimic": (
        Annotated[
            Literal["coupled", "independent"],
            typer.Option(help="Respect mimic joints, or treat them as independent."),
        ],
        "coupled",
    ),
    "keep_fixed_links": (KeepFixedLinks, False),
    "massless": (Massless, None),
    "symbols": (
        Annotated[
            Literal["shared", "separate"],
            typer.Option(
                help="Whether equal magnitudes of a robot file share a symbol."
            ),
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
    "ignore": (Ignore, None),
    "experiment": (
        Annotated[
            str,
            typer.Option(help="Name of the one of several experiments that is meant."),
        ],
        "",
    ),
    "model": (
        Annotated[
            str,
            typer.Option(
                "--model",
                help="Name of the model, if several of an SDF file have joints.",
            ),
        ],
        "",
    ),
}
"""How a robot is read: options by name, with their defaults."""


_AS_THEY_ARE = (
    "floating",
    "gravity",
    "keep_fixed_links",
    "measured",
    "experiment",
    "model",
)
"""Options that are keywords of ``echelon.load`` themselves."""


Command = Callable[..., Any]


AS_READ = (
    "floating",
    "gravity",
    "snap_tolerance",
    "keep_fixed_links",
    "massless",
    "ignore",
)
"""Options of reading that all commands have which need the whole robot."""


def reads_robot(*names: str) -> Callable[[Command], Command]:
    """Put options of reading in the place of a command's argument ``read``, which gets keywords of ``echelon.load``."""
    options = [
        Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            annotation=_READING[name][0],
            default=_READING[name][1],
        )
        for name in _READING
        if name in names
    ]

    def extended(command: Command) -> Command:
        def run(**given: Any) -> Any:
            read = reading(**{name: given.pop(name) for name in names})
            return command(**given, read=read)

        own = signature(command, eval_str=True).parameters.values()
        return with_parameters(
            run,
            command,
            [o for p in own for o in (options if p.name == "read" else [p])],
        )

    return extended


def with_parameters(
    run: Command, command: Command, parameters: Iterable[Parameter]
) -> Command:
    """A function that shows other parameters than it has, with the name and documentation of a command."""
    shown = [parameter.replace(kind=Parameter.KEYWORD_ONLY) for parameter in parameters]
    run.__name__, run.__doc__ = command.__name__, command.__doc__
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in shown}
    run.__signature__ = Signature(shown)  # type: ignore[attr-defined]
    return run


def reading(**given: Any) -> dict[str, Any]:
    """Keyword arguments of :func:`echelon.load`; what is not given is read as usual."""
    chosen = {name: default for name, (_, default) in _READING.items()} | given
    tolerance = chosen["snap_tolerance"]
    return {
        **{name: chosen[name] for name in _AS_THEY_ARE},
        "symbolic": not chosen["numeric"],
        "independent_mimics": chosen["mimic"] == "independent",
        "massless": tuple(chosen["massless"] or ()),
        "ignore": tuple(chosen["ignore"] or ()),
        "separate_symbols": chosen["symbols"] == "separate",
        **({} if tolerance is None else {"snap_tolerance": tolerance}),
    }
