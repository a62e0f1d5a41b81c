"""The application, on which commands put themselves, and options that several of them share, each explained once."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from inspect import Parameter, getdoc, signature
from pathlib import Path
from typing import Annotated, Any, Literal

import click

from echelon.cli.parameters import Command, Option, Positional, click_parameter
from echelon.cli.screen import set_verbosity
from echelon.shared import Measured, Order, nearest_of

Run = Callable[..., Any]
"""A function that is a command: it has the command's name, documentation and parameters."""


class CommandGroup(click.Group):
    """All commands.  Only a command that is asked for is built."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.functions: dict[str, tuple[Run, str]] = {}

    def command(self, *, epilog: str) -> Callable[[Run], Run]:  # type: ignore[override]
        """Put a function among the commands; the epilog ends its help."""

        def registered(function: Run) -> Run:
            name = function.__name__.replace("_", "-")
            self.functions[name] = (function, epilog)
            return function

        return registered

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Names of the commands in the order in which they were registered."""
        return list(self.functions)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002
        """The command of a name, if there is one."""
        if cmd_name not in self.functions:
            return None
        function, epilog = self.functions[cmd_name]
        return _built(cmd_name, function, epilog)

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """The command that the arguments name; the error suggests the nearest name."""
        name = args[0]
        if name not in self.functions and not name.startswith("-"):
            hint = nearest_of(name, self.functions)
            raise click.UsageError(f"there is no command '{name}'{hint}", ctx)
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; the exit code is 0 when the reader of a pipe goes away."""
        with _readers_may_leave():
            return super().invoke(ctx)

    def make_context(self, *arguments: Any, **options: Any) -> Any:
        """Parse the arguments, and print the help."""
        with _readers_may_leave():
            return super().make_context(*arguments, **options)


def _built(name: str, function: Run, epilog: str) -> click.Command:
    """A command that reads its arguments as the annotations of a function say."""
    stated = _with_options_of_reading(function)
    parameters = [click_parameter(one) for one in [*stated, _VERBOSE]]

    def run(verbose: bool, **given: Any) -> Any:
        from echelon.shared import READ

        set_verbosity(verbose)
        READ.clear()
        READ.update(_files(value for key, value in given.items() if key != "output"))
        names = _READS.get(function)
        if names is not None:
            given["read"] = reading(**{key: given.pop(key) for key in names})
        return function(**given)

    text = getdoc(function) or ""
    return Command(
        name,
        callback=run,
        params=parameters,
        help=text,
        short_help=text.partition("\n\n")[0],
        epilog=epilog,
        context_settings=app.context_settings,
    )


def _with_options_of_reading(function: Run) -> list[Parameter]:
    """The parameters of a command, where options of reading stand for ``read``."""
    own = signature(function, eval_str=True).parameters.values()
    names = _READS.get(function, ())
    found: list[Parameter] = []
    for parameter in own:
        if parameter.name != "read":
            found.append(parameter)
            continue
        for name, (annotation, default) in _READING.items():
            if name in names:
                kind = Parameter.KEYWORD_ONLY
                found.append(
                    Parameter(name, kind, annotation=annotation, default=default)
                )
    return found


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
        raise click.exceptions.Exit(0) from None


def _version(ctx: click.Context, _: click.Parameter, show: bool) -> None:
    if show and not ctx.resilient_parsing:
        from echelon.shared import __version__

        click.echo(f"echelon {__version__}")
        ctx.exit()


def _root(traceback: bool) -> None:
    if traceback:
        os.environ["ECHELON_TRACEBACK"] = "1"


app = CommandGroup(
    name="echelon",
    help="Exact base inertial parameters of robots, in closed form, with a certificate.",
    callback=_root,
    params=[
        click.Option(
            ["--traceback"], is_flag=True, help="Show the full traceback of errors."
        ),
        click.Option(
            ["--version"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_version,
            help="Show the version.",
        ),
    ],
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 success, 1 a claim was refuted or a check failed, "
    "2 bad input or usage.",
)


TARGETS = "c, cpp, cuda, python, jax, casadi, matlab, julia, rust"
"""Languages of generated code, for the help, which imports none of them."""

Robot = Annotated[
    Path, Positional(help="URDF, SDF, MJCF or Echelon description (YAML, JSON).")
]
Output = Annotated[
    Path | None,
    Option("--output", "-o", help="File to write instead of the terminal."),
]
Force = Annotated[
    bool,
    Option(
        "--force",
        help="Replace files that no earlier command wrote, too; never files that are read.",
    ),
]
AsJson = Annotated[bool, Option("--json", help="Machine-readable output.")]
Ordering = Annotated[Order, Option(help="Which parameters become representatives.")]
Prefer = Annotated[
    list[str] | None,
    Option(
        metavar="PARAMETER",
        help="A parameter (M7) or kind (MX) wanted as representative; may be repeated.",
    ),
]
Budget = Annotated[
    float,
    Option(
        min=0,
        help="Work for closed forms (0: numbers only) or sensor subsets; 1 is a few seconds.",
    ),
]
Seed = Annotated[int | None, Option(min=0, help="Seed of the random points.")]

Floating = Annotated[bool, Option(help="Let the root link float.")]
Gravity = Annotated[
    str,
    Option(
        metavar="GRAVITY",
        help="'file', 'none', 'generic', or three numbers or expressions: '0,0,-9.81'.",
    ),
]
SnapTolerance = Annotated[
    float | None,
    Option(
        "--snap-tolerance",
        help="Read angles this near (rad) to multiples of 15° as exact; 0 takes rounded angles literally. "
        "[default: 0.002]",
    ),
]
KeepFixedLinks = Annotated[
    bool,
    Option("--keep-fixed-links", help="Keep links fixed to others as bodies."),
]
Massless = Annotated[
    list[str] | None,
    Option(metavar="LINK", help="A link without inertial parameters; may be repeated."),
]

Ignore = Annotated[
    list[str] | None,
    Option(
        metavar="NAME",
        help="An element (loop, gazebo/joint) or attribute (@quat, origin@quat) of the robot file to ignore, although it may change how the robot moves; may be repeated.",
    ),
]

_READING: dict[str, tuple[Any, Any]] = {
    "floating": (Floating, False),
    "gravity": (Gravity, "file"),
    "snap_tolerance": (SnapTolerance, None),
    "numeric": (
        Annotated[
            bool,
            Option(
                "--numeric",
                help="Numbers throughout, for every symbol that has a value.",
            ),
        ],
        False,
    ),
    "mimic": (
        Annotated[
            Literal["coupled", "independent"],
            Option(help="Respect mimic joints, or treat them as independent."),
        ],
        "coupled",
    ),
    "keep_fixed_links": (KeepFixedLinks, False),
    "massless": (Massless, None),
    "symbols": (
        Annotated[
            Literal["shared", "separate"],
            Option(help="Whether equal magnitudes of a robot file share a symbol."),
        ],
        "shared",
    ),
    "measured": (
        Annotated[
            Measured,
            Option(help="Forces of all drives, or the sensors of an MJCF file."),
        ],
        "drives",
    ),
    "ignore": (Ignore, None),
    "experiment": (
        Annotated[
            str,
            Option(metavar="NAME", help="Which of several experiments to use."),
        ],
        "",
    ),
    "model": (
        Annotated[
            str,
            Option(
                "--model",
                metavar="NAME",
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


AS_READ = (
    "floating",
    "gravity",
    "snap_tolerance",
    "keep_fixed_links",
    "massless",
    "ignore",
)
"""Options of reading that all commands have which need the whole robot."""


_READS: dict[Run, tuple[str, ...]] = {}
"""Options of reading that a command has, by its function."""


def reads_robot(*names: str) -> Callable[[Run], Run]:
    """Put options of reading in the place of a command's argument ``read``, which gets keywords of ``echelon.load``."""

    def marked(function: Run) -> Run:
        _READS[function] = names
        return function

    return marked


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


_VERBOSE = Parameter(
    "verbose",
    Parameter.KEYWORD_ONLY,
    annotation=Annotated[
        bool,
        Option(
            "--verbose", "-v", help="Log every step and its time to standard error."
        ),
    ],
    default=False,
)
"""An option of all commands."""
