"""Scalars and lists of the description format, and what is said about unsuitable ones.

YAML would turn ``0.0825`` into a float, ``1e-3`` into a string, ``010`` into eight and ``y`` into a truth value.  So
scalars are read as text, and the types here say what each text may be; numbers and booleans are accepted as well, for
documents that come from JSON or from Python.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, WithJsonSchema
from pydantic_core import PydanticCustomError

from echelon.exact.expressions import PI, parse
from echelon.exact.numbers import is_whole
from echelon.formats.reading_options import NOT_FINITE
from echelon.hints import nearest

_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)
_FLAGS = {"true": True, "false": False}
_SHARED = ("label", "massless", "parameters", "separate", "inertial")
_RENAMED = {
    "r": ("alpha", "Khalil's r is d here, and Khalil's d is a"),
    "sigma": ("alpha", "write joint: revolute, prismatic or fixed"),
    "type": ("alpha", "write joint: revolute, prismatic or fixed"),
    "rpy": ("origin", "it belongs into origin: {rpy: …}"),
    "xyz": ("origin", "it belongs into origin: {xyz: …}"),
}
"""Keys of other conventions: a key of the mapping where they are found, and what to write instead."""


def kind_of(value: object) -> str:
    """What a value is called in messages."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    return "a list" if isinstance(value, list | tuple) else f"'{value}'"


def refusal(problem: str) -> PydanticCustomError:
    """An error with a message of ours."""
    return PydanticCustomError("refused", "{problem}", {"problem": problem})


def _scalar(what: str, value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        found = str(value).lower() if isinstance(value, bool) else kind_of(value)
        raise refusal(f"needs {what}, found {found}")
    text = value.strip() if isinstance(value, str) else repr(value)
    if not text:
        raise refusal(f"needs {what}, found an empty text")
    return text


_name = partial(_scalar, "a name")


def _flag(value: object) -> object:
    text = value.lower() if isinstance(value, str) else value
    if isinstance(text, str) and text in _FLAGS:
        return _FLAGS[text]
    if isinstance(value, bool):
        return value
    raise refusal(f"needs true or false, found {kind_of(value)}")


def _version(value: object) -> object:
    if isinstance(value, bool) or str(value) != "1":
        raise refusal(f"this is version {kind_of(value)} of the format; this program reads version 1: 'echelon: 1'")
    return 1


def _items(value: object) -> tuple[object, ...]:
    if not isinstance(value, list | tuple):
        raise refusal(f"needs a list, found {kind_of(value)}")
    return tuple(value)


def _rows(value: object) -> tuple[object, ...]:
    if value == [] or value == ():
        raise refusal("the table is empty; it needs at least one row")
    return _items(value)


def of_size(value: object, size: int, what: str) -> tuple[object, ...]:
    """The entries of a list of known size; refuses everything else as not being what it needs."""
    if not isinstance(value, list | tuple):
        raise refusal(f"needs {what}, found {kind_of(value)}")
    if len(value) != size:
        raise refusal(f"needs {what}, found {len(value)} entries")
    return tuple(value)


def sized(size: int, what: str) -> BeforeValidator:
    """A list of known size."""
    return BeforeValidator(lambda value: of_size(value, size, f"a list of {what}"))


Expression = Annotated[
    str,
    BeforeValidator(partial(_scalar, "an expression such as 0.333, pi/2 or -l1/2")),
    WithJsonSchema({"type": ["number", "string"]}),
]
"""The text of an exact expression."""

Name = Annotated[str, BeforeValidator(_name), WithJsonSchema({"type": ["string", "integer"]})]
Flag = Annotated[bool, BeforeValidator(_flag)]
Version = Annotated[Literal[1], BeforeValidator(_version)]
Triple = Annotated[tuple[Expression, Expression, Expression], sized(3, "three expressions such as [0, 0, 0.333]")]
Matrix = Annotated[tuple[Triple, Triple, Triple], sized(3, "three rows such as [[1, 0, 0], [0, 0, -1], [0, 1, 0]]")]
Ten = Annotated[tuple[Expression, ...], sized(10, "ten numbers: XX XY XZ YY YZ ZZ MX MY MZ M")]
Part = Annotated[
    str | None,
    BeforeValidator(lambda value: None if value is None else _name(value)),
    WithJsonSchema({"type": ["string", "integer", "null"]}),
]
PairOfParts = Annotated[tuple[Part, Part], sized(2, "two names of bodies such as [coupler, rocker]")]

AS_LIST = BeforeValidator(_items)
AS_ROWS = BeforeValidator(_rows)


# -- numbers of set-ups, which no symbol of the geometry belongs into --------------------------------------------------


def number(value: object) -> float:
    """A finite number: an expression of numbers and pi, since data sheets state ``2*pi`` as often as ``6.28``."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise refusal(f"needs a number such as 0.5 or 2*pi, found {kind_of(value)}")
    text = str(value).strip()
    if NOT_FINITE.fullmatch(text):
        raise refusal(f"'{text}' is not a finite number")
    try:
        expression = parse(text)
        if expression.symbols() not in ([], [PI]):
            raise refusal(f"needs a number or an expression of numbers and pi, found '{text}'")
        return expression.at({PI: math.pi})
    except ValueError as error:
        raise refusal(str(error)) from None


def _real(value: object) -> float:
    return float(str(value)) if _INFINITE.fullmatch(str(value).strip()) else number(value)


def _whole(value: object) -> int:
    text = str(value)
    if not is_whole(text.removeprefix("-")):
        raise refusal(f"needs a whole number, found {kind_of(value)}")
    return int(text)


SCALAR: dict[str, Any] = {"type": ["number", "string"]}
Number = Annotated[float, BeforeValidator(number), WithJsonSchema(SCALAR)]
Real = Annotated[float, BeforeValidator(_real), WithJsonSchema(SCALAR)]
"""A number or ``inf``."""
Whole = Annotated[int, BeforeValidator(_whole), WithJsonSchema({"type": ["integer", "string"]})]


# -- which of several forms a value has -----------------------------------------------------------------------------


_FORMS: dict[str, Any] = {"mapping": dict, "list": (list, tuple), "null": type(None)}


def by_form(usual: str, *others: str) -> Discriminator:
    """Tells apart values that may be a mapping, a list or null; what is none of the others has the usual form."""
    return Discriminator(lambda value: next((form for form in others if isinstance(value, _FORMS[form])), usual))


def by_key(key: str, usual: str) -> Discriminator:
    """Tells mappings that have a key, which is their tag, from the usual ones."""
    return Discriminator(lambda value: key if isinstance(value, dict) and key in value else usual)


# -- keys -----------------------------------------------------------------------------------------------------------


def required(meaning: str, *examples: Any, **rules: Any) -> Any:
    """A key that a mapping must have: what it means, with its unit, and examples; rules are those of pydantic."""
    return Field(description=meaning, examples=list(examples) or None, **rules)


def optional(default: Any, meaning: str, *examples: Any) -> Any:
    """A key that a mapping may have: the value without it, what it means, with its unit, and examples."""
    return Field(default, description=meaning, examples=list(examples) or None)


def check_keys(data: object, valid: Sequence[str]) -> None:
    """Refuse what is not a mapping, and the first key that is not valid, with a hint at what was meant."""
    # what rows and bodies share is listed last, behind what distinguishes them
    valid = sorted(valid, key=lambda key: key in _SHARED)
    if not isinstance(data, dict):
        raise refusal(f"needs a mapping with the keys {', '.join(valid)}; found {kind_of(data)}")
    for key in data:
        if key not in valid:
            renamed = _RENAMED.get(str(key), ("", ""))
            hint = f"; {renamed[1]}" if renamed[0] in valid else nearest(str(key), valid)
            problem = f"unknown key{hint} (valid: {', '.join(valid)})"
            raise PydanticCustomError("unknown_key", "{problem}", {"problem": problem, "key": str(key)})
