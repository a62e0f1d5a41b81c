"""Templates filled in.

jinja2 is imported here only, and only when code is generated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.program.function import Argument

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).with_name("templates")


def render(template: str, context: Mapping[str, Any]) -> str:
    """A template with its names filled in; a name without value is an error."""
    return _environment().get_template(template).render(context)


@cache
def _environment() -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        autoescape=False,  # source code, not pages
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"each": _each, "padded": _padded, "listed": _listed, "renamed": _renamed, "owned": _owned}
    return environment


def _each(arguments: Sequence[Argument], pattern: str) -> list[str]:
    """A pattern with ``{name}`` and ``{size}`` of every argument."""
    return [pattern.format(name=argument.name, size=len(argument)) for argument in arguments]


def _owned(arguments: Sequence[Argument]) -> list[str]:
    """Names of arguments, those that vary from sample to sample as copies of one sample."""
    return [argument.name if argument.uniform else f"own_{argument.name}" for argument in arguments]


def _renamed(names: Sequence[str], other: Mapping[str, str]) -> list[str]:
    """Names, some of them replaced."""
    return [other.get(name, name) for name in names]


def _padded(items: Sequence[str], length: int, filler: str) -> list[str]:
    """A list made longer."""
    return [*items, *[filler] * (length - len(items))]


def _listed(items: Sequence[str], indent: int, width: int = 110) -> str:
    """Items with commas, in lines that are not too long."""
    lines = [""]
    for item in items:
        if lines[-1] and len(lines[-1]) + len(item) > width - indent:
            lines.append("")
        lines[-1] += f"{item}, "
    return ("\n" + " " * indent).join(line.rstrip() for line in lines).rstrip(",")
