"""Parameters of commands, stated as annotations: ``seed: Annotated[int | None, Option(min=0, help="…")] = None``.

A command's function says once what it takes.  Its annotations become parameters of click when the command is asked
for, so that no command waits until all others are built.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from inspect import Parameter
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

import click


class Stated:
    """Names, help and limits of a parameter, as its annotation states them beside the type."""

    def __init__(
        self,
        *names: str,
        help: str,
        metavar: str | None = None,
        complete: Sequence[str] = (),
        min: float | None = None,
        max: float | None = None,
        show_default: str | None = None,
    ) -> None:
        self.names = names  # as they are written: --output, -o
        self.help = help
        self.metavar = metavar  # stands for the value in the help
        self.complete = complete  # values that shells propose
        self.min, self.max = min, max  # of a number
        self.show_default = show_default  # shown instead of the default


class Option(Stated):
    """A parameter with a name, such as ``--seed``."""


class Positional(Stated):
    """A parameter that stands at its place."""


class Command(click.Command):
    """A command whose help lists arguments apart from options."""

    def format_options(
        self, ctx: click.Context, formatter: click.HelpFormatter
    ) -> None:
        """Write what the arguments and the options mean."""
        arguments = [
            (one.make_metavar(ctx), one.meaning)
            for one in self.params
            if isinstance(one, _Argument)
        ]
        options = [
            record
            for one in self.get_params(ctx)
            if not isinstance(one, _Argument)
            and (record := one.get_help_record(ctx)) is not None
        ]
        for title, records in (("Arguments", arguments), ("Options", options)):
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


class _Argument(click.Argument):
    """An argument with a meaning."""

    meaning: str


def click_parameter(parameter: Parameter) -> click.Parameter:
    """The parameter of click that an annotation ``Annotated[type, Option(…)]`` describes."""
    kind, stated = get_args(parameter.annotation)
    if get_origin(kind) in (Union, UnionType):  # with None
        kind = get_args(kind)[0]
    several = get_origin(kind) is list
    if several:
        kind = get_args(kind)[0]
    required = parameter.default is Parameter.empty
    common: dict[str, Any] = {
        "type": _type(kind, stated),
        "required": required,
        "callback": _as_list if several else None,
        "metavar": stated.metavar,
    }
    if stated.complete:
        common["shell_complete"] = _proposals(stated.complete)
    if not required:
        common["default"] = parameter.default
    if isinstance(stated, Positional):
        argument = _Argument([parameter.name], nargs=-1 if several else 1, **common)
        argument.meaning = stated.help
        return argument
    if kind is bool:
        del common["type"]
    elif stated.metavar is None and get_origin(kind) is not Literal:
        common["metavar"] = _METAVARS[kind]
    name = parameter.name.replace("_", "-")
    plain = f"--{name}/--no-{name}" if kind is bool else f"--{name}"
    declarations = [*(stated.names or [plain]), parameter.name]
    return click.Option(
        declarations,
        help=stated.help,
        multiple=several,
        is_flag=kind is bool,
        show_default=stated.show_default or _is_shown(parameter.default, declarations),
        **common,
    )


_METAVARS = {Path: "FILE", int: "N", float: "NUMBER", str: "TEXT"}
"""What stands for a value in the help, by its type."""


def _type(kind: Any, stated: Stated) -> Any:
    """The type of click that reads a value."""
    if get_origin(kind) is Literal:
        return click.Choice(get_args(kind))
    if kind is Path:
        return click.Path(path_type=Path)
    if stated.min is None and stated.max is None:
        return kind
    limited: Any = click.IntRange if kind is int else click.FloatRange
    return limited(stated.min, stated.max)


def _proposals(values: Sequence[str]) -> Callable[..., list[str]]:
    """A function that gives a shell the values that begin with the typed text."""

    def begun(_: click.Context, __: click.Parameter, typed: str) -> list[str]:
        return [value for value in values if value.startswith(typed)]

    return begun


def _as_list(
    _: click.Context, parameter: click.Parameter, values: tuple[Any, ...]
) -> list[Any] | None:
    """Values of a parameter that may be repeated, or its default."""
    return list(values) or (None if not parameter.required else [])


def _is_shown(default: Any, names: list[str]) -> bool:
    """Whether the help states the default; that a switch is off needs no word."""
    return default not in (None, "", Parameter.empty) and (
        default is not False or any("/" in name for name in names)
    )
