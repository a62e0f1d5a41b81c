"""Arguments of public functions, checked where they enter: by their annotations, so that no function can forget one.

``@public`` stands before a public function, or before a class for its public methods.  An argument of another kind
than its annotation says (a text for an array, a fraction for a number of threads) is refused in one line that names the
argument and says what would be valid.  What values may be, such as the shape of an array, functions check themselves.

Annotations are texts that are looked up when a function is first called.  What is only imported for type checkers is
not checked.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cached_property, wraps
from inspect import Parameter, signature
from math import isnan
from numbers import Integral, Real
from types import FunctionType, NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, cast, get_args, get_origin

import numpy as np
import numpy.typing as npt

from echelon.shared.errors import InputError, shortened

Public = TypeVar("Public", bound=Callable[..., Any] | type)


@dataclass(frozen=True)
class AtLeast:
    """The least value that an annotated number may have."""

    least: float


Count = Annotated[int, AtLeast(0)]
NotNegative = Annotated[float, AtLeast(0)]


def public(target: Public) -> Public:
    """A function that checks its arguments; or a class whose public methods do, and whose objects have a hash."""
    if not isinstance(target, type):
        return cast("Public", _door(target))
    for name, member in list(vars(target).items()):
        if name == "__init__" or not name.startswith("_"):
            if isinstance(member, FunctionType):
                setattr(target, name, _door(member))
            elif isinstance(member, classmethod | staticmethod):
                setattr(target, name, type(member)(_door(member.__func__)))
    stated = getattr(target, "__dataclass_params__", None)
    if stated is not None and stated.frozen and stated.eq:
        target.__hash__ = _hash_of_fields  # type: ignore[method-assign, assignment]
    return target


def _hash_of_fields(value: Any) -> int:
    """The hash of those fields that have one; mappings and arrays have none."""
    return hash(
        (
            type(value),
            *(
                _hash_or_none(getattr(value, field.name))
                for field in fields(value)
                if field.compare
            ),
        )
    )


def _hash_or_none(value: object) -> int | None:
    try:
        return hash(value)
    except TypeError:
        return None


def _door(function: Any) -> Any:
    door = _Door(function)

    @wraps(function)
    def entered(*args: Any, **kwargs: Any) -> Any:
        door.check(args, kwargs)
        return function(*args, **kwargs)

    return entered


class _Door:
    """The checks of one function's arguments, by name; made when it is first called."""

    def __init__(self, function: Any) -> None:
        self.function = function

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the arguments that may be given by place."""
        by_place = (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
        return tuple(
            p.name
            for p in signature(self.function).parameters.values()
            if p.kind in by_place
        )

    @cached_property
    def kinds(self) -> dict[str, ValueCheck]:
        """The check of each argument."""
        given = signature(self.function).parameters.values()
        named = [
            p
            for p in given
            if p.kind not in (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
        ]
        found = {
            p.name: self._kind(p.annotation)
            for p in named
            if p.annotation is not Parameter.empty
        }
        return {name: kind for name, kind in found.items() if kind is not None}

    def _kind(self, annotation: Any) -> ValueCheck | None:
        try:
            # the annotation is a text of our own source
            meant = (
                eval(annotation, self.function.__globals__)
                if isinstance(annotation, str)
                else annotation
            )
        except (NameError, AttributeError):  # imported for type checkers only
            return None
        return kind_of(meant)

    def check(self, args: tuple[Any, ...], kwargs: Mapping[str, Any]) -> None:
        for name, value in (*zip(self.parameters, args, strict=False), *kwargs.items()):
            kind = self.kinds.get(name)
            if kind is not None and not kind.accepts(value):
                found = (
                    f"{type(value).__name__} {shortened(repr(value), 40)}"
                    if value is not None
                    else "None"
                )
                element = f"argument '{name}' of {self.function.__name__.strip('_')}"
                raise InputError(f"needs {kind.words}; found {found}", element=element)


# -- kinds -------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ValueCheck:
    """Check and description of the values that an annotation accepts."""

    words: str
    accepts: Callable[[Any], bool]


def kind_of(annotation: Any) -> ValueCheck | None:
    """The check of an annotation; None where it accepts everything."""
    if annotation is Any or annotation is object:
        return None
    origin, parts = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        others = [part for part in parts if part not in _ARRAY_LIKE]
        arrays = len(parts) - len(others) == len(
            _ARRAY_LIKE
        )  # a union that holds all of them, itself a union
        kinds = (
            [_ARRAY, *map(kind_of, others)]
            if arrays
            else [kind_of(part) for part in parts]
        )
        known = [kind for kind in kinds if kind is not None]
        return _any_of(known) if len(known) == len(kinds) else None
    if origin is Annotated:
        return _at_least(kind_of(parts[0]), parts[1:])
    if origin is Literal:
        return ValueCheck(
            f"one of {', '.join(map(repr, parts))}",
            lambda value: isinstance(value, Hashable) and value in parts,
        )
    if isinstance(origin, type):
        return _PLAIN.get(origin) or _container(origin, parts)
    if isinstance(annotation, type):
        return _PLAIN.get(annotation, _instance(annotation))
    return None


def _any_of(kinds: Sequence[ValueCheck]) -> ValueCheck:
    words = list(dict.fromkeys(kind.words for kind in kinds))
    return ValueCheck(
        " or ".join(words), lambda value: any(kind.accepts(value) for kind in kinds)
    )


def _at_least(kind: ValueCheck | None, bounds: Iterable[Any]) -> ValueCheck | None:
    least = max(
        (bound.least for bound in bounds if isinstance(bound, AtLeast)), default=None
    )
    if kind is None or least is None:
        return kind
    return ValueCheck(
        f"{kind.words} from {least:g}",
        lambda value: kind.accepts(value) and value >= least,
    )


def _container(origin: type, parts: tuple[Any, ...]) -> ValueCheck | None:
    inner = [kind_of(part) for part in parts if part is not Ellipsis]
    if issubclass(origin, np.ndarray):
        return _ARRAY
    if issubclass(origin, Mapping):
        named = [kind.words if kind else "anything" for kind in inner]
        words = f"a mapping of {' to '.join(named)}" if named else "a mapping"
        return ValueCheck(
            words,
            lambda value: (
                isinstance(value, Mapping) and _all_accepted(inner, value.items())
            ),
        )
    if issubclass(origin, Iterable) and len(inner) == 1:
        kind = inner[0]
        words = "a list" if kind is None else f"a list, each entry {kind.words}"
        return ValueCheck(
            words,
            lambda value: (
                _is_list(value, origin) and (kind is None or _all_of(kind, value))
            ),
        )
    if origin is _CALLABLE:
        return ValueCheck("a function", callable)
    return _instance(origin)


def _is_list(value: Any, origin: type) -> bool:
    if isinstance(value, str | bytes | Mapping):
        return False
    return isinstance(value, Iterable) and (
        isinstance(value, np.ndarray | Sequence) or not issubclass(origin, Sequence)
    )


def _all_of(kind: ValueCheck, values: Any) -> bool:
    """Whether each entry is accepted; what can be read once only is left alone."""
    if isinstance(values, Sequence | np.ndarray):
        return all(map(kind.accepts, values))
    return True


def _all_accepted(
    kinds: Sequence[ValueCheck | None], pairs: Iterable[tuple[Any, Any]]
) -> bool:
    return all(
        kind is None or kind.accepts(part)
        for pair in pairs
        for kind, part in zip(kinds, pair, strict=False)
    )


def _is_numbers(value: Any) -> bool:
    """Whether NumPy makes an array of numbers of it, or of each number of it, such as fractions."""
    try:
        found = value if isinstance(value, np.ndarray) else np.asarray(value)
        return found.dtype.kind in "biuf" or (
            found.dtype.kind == "O" and all(map(_is_number, found.flat))
        )
    except (ValueError, TypeError):
        return False


def _is_number(value: Any) -> bool:
    try:
        return (
            not isinstance(value, bool) and isinstance(value, Real) and not isnan(value)
        )
    except OverflowError:  # a whole number beyond all doubles
        return False


def _instance(kind: type) -> ValueCheck:
    return ValueCheck(f"a {kind.__name__}", lambda value: isinstance(value, kind))


_ARRAY_LIKE = get_args(npt.ArrayLike)
_ARRAY = ValueCheck("an array of numbers", _is_numbers)
_CALLABLE: Any = get_origin(Callable[..., Any])
_PLAIN: dict[type, ValueCheck] = {
    NoneType: ValueCheck("None", lambda value: value is None),
    bool: ValueCheck("True or False", lambda value: isinstance(value, bool | np.bool_)),
    int: ValueCheck(
        "a whole number",
        lambda value: isinstance(value, Integral) and not isinstance(value, bool),
    ),
    float: ValueCheck("a number", _is_number),
    str: ValueCheck("a text", lambda value: isinstance(value, str)),
    os.PathLike: ValueCheck("a path", lambda value: isinstance(value, os.PathLike)),
}
