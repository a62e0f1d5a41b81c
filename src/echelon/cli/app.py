"""The application: commands put themselves on it."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from inspect import Parameter, signature
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from echelon.cli.options import Command, with_parameters
from echelon.cli.screen import set_verbosity


class _Commands(TyperGroup):
    """All commands; the exit code is 0 when the reader of a pipe goes away (typer would exit with 1)."""

    def make_context(self, *arguments: Any, **options: Any) -> Any:  # prints the help
        with _readers_may_leave():
            return super().make_context(*arguments, **options)

    def invoke(self, ctx: Any) -> Any:
        with _readers_may_leave():
            return super().invoke(ctx)


Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Say on standard error what is done, and when.")]


class _Application(typer.Typer):
    """An application all of whose commands take ``--verbose``."""

    def command(  # type: ignore[override]  # what it passes on is typer's affair
        self, name: str | None = None, **options: Any
    ) -> Callable[[Command], Command]:
        register: Callable[[Command], Command] = super().command(name, **options)
        return lambda command: register(_with_verbosity(command))


def _with_verbosity(command: Command) -> Command:
    def run(verbose: bool, **given: Any) -> Any:
        set_verbosity(verbose)
        return command(**given)

    own = signature(command, eval_str=True).parameters.values()
    last = Parameter("verbose", Parameter.KEYWORD_ONLY, annotation=Verbose, default=False)
    return with_parameters(run, command, [*own, last])


@contextmanager
def _readers_may_leave() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError:  # nothing more can be written, not even what is still in the buffer
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit from None


def application(name: str, text: str, **more: Any) -> typer.Typer:
    """The application, or a group of its commands."""
    more |= {"add_completion": False, "pretty_exceptions_enable": False, "rich_markup_mode": None}
    return _Application(name=name, cls=_Commands, help=text, no_args_is_help=True, **more)


app = application(
    "echelon",
    "Exact base inertial parameters of robots, in closed form, with a certificate.",
    epilog="Exit codes: 0 success, 1 a claim was refuted or a model failed its check, 2 bad input or usage.",
)


def _version(show: bool) -> None:
    if show:
        from echelon.version import __version__

        typer.echo(f"echelon {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    traceback: Annotated[bool, typer.Option("--traceback", help="Show the full traceback of errors.")] = False,
    _: Annotated[bool, typer.Option("--version", help="Show the version.", callback=_version)] = False,
) -> None:
    if traceback:
        os.environ["ECHELON_TRACEBACK"] = "1"
