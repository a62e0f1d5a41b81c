"""Data models of descriptions: which keys a mapping may have, and what their values may be.

A model is a class with annotated fields, in the vocabulary of pydantic, by which saved files are checked.  Descriptions
are not: to import pydantic and to prepare these models takes longer than to derive a robot.  Here an annotation is
looked at when a document first states its field.  :mod:`echelon.formats.schema.json_schema` writes JSON schemas.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Self,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
)

from echelon.shared import nearest_of

Check = Callable[[Any], Any]
"""Gives the result for what is stated, or raises a :class:`UnfitError`."""


class UnfitError(ValueError):
    """What is wrong with a value, and where it is in the document."""

    def __init__(
        self, problem: str, *, unknown: str | None = None, missing: str | None = None
    ) -> None:
        super().__init__(problem)
        self.problem = problem
        self.unknown = unknown  # a key that no field has
        self.missing = missing  # a key that the mapping lacks
        self.where: tuple[int | str, ...] = ()


# -- what stands in annotations ----------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class BeforeValidator:
    """Makes the value to check of what is stated."""

    function: Check
    json_schema_input_type: Any = None  # what may be stated, where that is another type

    def around(self, inner: Check) -> Check:
        """The check of a type with this before it."""
        return lambda value: inner(_refusing(self.function, value))


@dataclass(frozen=True, eq=False)
class AfterValidator:
    """Makes the result of a value that was checked."""

    function: Check

    def around(self, inner: Check) -> Check:
        """The check of a type with this behind it."""
        return lambda value: _refusing(self.function, inner(value))


@dataclass(frozen=True, eq=False)
class Discriminator:
    """Gives the tag of the part of a union that a value belongs to."""

    function: Callable[[Any], str]


@dataclass(frozen=True, eq=False)
class Tag:
    """Names a part of a union."""

    name: str


@dataclass(frozen=True, eq=False)
class WithJsonSchema:
    """Stands in the JSON schema in the place of a type."""

    schema: Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class PlainSerializer:
    """Makes what JSON holds of a value."""

    function: Check


_REQUIRED: Any = object()
_BOUNDS: dict[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "gt": ("greater than", lambda value, bound: value > bound),
    "ge": ("greater than or equal to", lambda value, bound: value >= bound),
    "lt": ("less than", lambda value, bound: value < bound),
    "le": ("less than or equal to", lambda value, bound: value <= bound),
}


class Field:
    """A field of a model: its default and its meaning.  In an annotation: the bounds of a number."""

    def __init__(
        self,
        default: Any = _REQUIRED,
        *,
        description: str = "",
        examples: Sequence[Any] | None = None,
        **rules: float,
    ) -> None:
        self.default = default
        self.description = description
        self.examples = examples
        self.rules = rules  # gt, ge, lt, le; others stand in the JSON schema only
        self.text, self.module = "", ""

    @property
    def is_required(self) -> bool:
        """Whether every mapping states it."""
        return self.default is _REQUIRED

    @cached_property
    def annotation(self) -> Any:
        """The type."""
        # the annotation is a text of our own source
        return eval(self.text, vars(sys.modules[self.module]))

    @cached_property
    def check(self) -> Check:
        """The check of its values."""
        return check_of(self.annotation)

    def around(self, inner: Check) -> Check:
        """The check of a number that is within bounds."""

        def checked(value: Any) -> Any:
            found = inner(value)
            for name, bound in self.rules.items():
                words, holds = _BOUNDS[name]
                if not holds(found, bound):
                    raise UnfitError(f"Input should be {words} {bound:g}")
            return found

        return checked


def _refusing(function: Check, value: Any) -> Any:
    """The value of a function, whose errors refuse what is stated."""
    try:
        return function(value)
    except UnfitError:
        raise
    except ValueError as error:
        raise UnfitError(str(error)) from None


# -- checks of types ---------------------------------------------------------------------------------------------------


def kind_of(value: object) -> str:
    """Name of a value in messages."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    return "a list" if isinstance(value, list | tuple) else f"'{value}'"


def check_of(kind: Any) -> Check:
    """The check of a type, or of an annotated one."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _annotated(*parts)
    if origin in (Union, UnionType):
        return _any_of([check_of(part) for part in parts])
    if origin is Literal:
        return lambda value: _one_of(value, parts)
    if origin is tuple:
        return _entries(parts)
    if origin is dict:
        key, inner = map(check_of, parts)
        return lambda value: {
            key(name): _within(name, inner, part)
            for name, part in _mapping(value).items()
        }
    if kind is Any:
        return lambda value: value
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind.model_validate
    return lambda value: _plain(kind, value)


def _annotated(kind: Any, *marks: Any) -> Check:
    choice = next((mark for mark in marks if isinstance(mark, Discriminator)), None)
    check = check_of(kind) if choice is None else _chosen(kind, choice)
    for mark in marks:
        if isinstance(mark, BeforeValidator | AfterValidator | Field):
            check = mark.around(check)
    return check


def tags_of(union: Any) -> dict[str, Any]:
    """Parts of a union by their tags."""
    found = {}
    for part in get_args(union):
        for mark in getattr(part, "__metadata__", ()):
            if isinstance(mark, Tag):
                found[mark.name] = part
    return found


def _chosen(union: Any, choice: Discriminator) -> Check:
    parts, checks = tags_of(union), dict[str, Check]()

    def checked(value: Any) -> Any:
        tag = choice.function(value)
        if tag not in checks:
            checks[tag] = check_of(parts[tag])
        return checks[tag](value)

    return checked


def _any_of(checks: Sequence[Check]) -> Check:
    def checked(value: Any) -> Any:
        refused = None
        for check in checks:
            try:
                return check(value)
            except UnfitError as error:
                refused = refused or error
        raise refused or UnfitError("needs something else")

    return checked


def _one_of(value: Any, valid: tuple[Any, ...]) -> Any:
    if not any(type(value) is type(one) and value == one for one in valid):
        given = kind_of(value)
        raise UnfitError(
            f"{given} is not valid{nearest_of(str(value), map(str, valid))}"
        )
    return value


def _entries(parts: tuple[Any, ...]) -> Check:
    checks = [check_of(part) for part in parts if part is not Ellipsis]
    several = Ellipsis in parts

    def checked(value: Any) -> Any:
        if not isinstance(value, tuple):
            raise UnfitError(f"needs a list, found {kind_of(value)}")
        if not several and len(value) != len(checks):
            problem = f"needs {len(checks)} entries, found {len(value)}"
            raise UnfitError(problem)
        each = checks * len(value) if several else checks
        pairs = enumerate(zip(each, value, strict=True))
        return tuple(_within(k, check, part) for k, (check, part) in pairs)

    return checked


def _within(place: int | str, check: Check, value: Any) -> Any:
    """The result for a part of a value; a refusal says which part."""
    try:
        return check(value)
    except UnfitError as error:
        error.where = (place, *error.where)
        raise


def _mapping(value: Any) -> dict[Any, Any]:
    if not isinstance(value, dict):
        raise UnfitError(f"needs a mapping 'name: value', found {kind_of(value)}")
    return value


_PLAIN = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    NoneType: "nothing",
}


def _plain(kind: Any, value: Any) -> Any:
    if kind is float and type(value) is int:
        return float(value)
    if type(value) is not kind:
        raise UnfitError(f"needs {_PLAIN[kind]}, found {kind_of(value)}")
    return value


# -- models ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ModelCheck:
    """A check of a whole mapping: of what is stated, or of the model that was made of it."""

    function: Callable[..., Any]
    before: bool


def model_validator(*, mode: Literal["before", "after"]) -> Callable[[Any], Any]:
    """Make a method the check of a whole mapping."""

    def marked(function: Any) -> ModelCheck:
        return ModelCheck(getattr(function, "__func__", function), mode == "before")

    return marked


def without_none(kind: Any) -> Any:
    """A type that may be None, without this."""
    if get_origin(kind) not in (Union, UnionType):
        return kind
    others = [part for part in get_args(kind) if part is not NoneType]
    return others[0] if len(others) == 1 else kind


def _entry(kind: Any) -> Any:
    """The type of the entries of a list or a mapping."""
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    inner = [part for part in get_args(kind) if part is not Ellipsis]
    return inner[-1] if inner else Any


@dataclass_transform(kw_only_default=True, frozen_default=True)
class BaseModel:
    """A mapping whose keys are known; the result of a check, which is frozen."""

    model_config: ClassVar[Mapping[str, Any]] = {}  # of the JSON schema
    model_fields: ClassVar[dict[str, Field]] = {}
    model_checks: ClassVar[tuple[ModelCheck, ...]] = ()
    model_fields_set: frozenset[str]

    def __init_subclass__(cls) -> None:
        own = dict(vars(cls))
        fields = dict(cls.model_fields)
        for name, text in own.get("__annotations__", {}).items():
            if name.startswith("_"):
                continue
            stated = own.get(name, _REQUIRED)
            field = stated if isinstance(stated, Field) else Field(stated)
            field.text, field.module = text, cls.__module__
            fields[name] = field
            if name in own:
                delattr(cls, name)
        cls.model_fields = fields
        checks = [check for check in own.values() if isinstance(check, ModelCheck)]
        cls.model_checks = (*cls.model_checks, *checks)

    def __init__(self, /, **stated: Any) -> None:
        vars(self).update(vars(self.model_validate(stated)))

    @classmethod
    def model_validate(cls, data: Any) -> Self:
        """The model of a mapping; raises a :class:`UnfitError` if it does not fit."""
        for check in reversed(cls.model_checks):
            if check.before:
                data = check.function(cls, data)
        stated = {
            name: _within(name, field.check, data[name])
            for name, field in cls.model_fields.items()
            if name in data
        }
        for name, field in cls.model_fields.items():
            if field.is_required and name not in stated:
                raise UnfitError(f"the key '{name}' is missing", missing=name)
        made = cls.model_construct(**stated)
        for check in cls.model_checks:
            if not check.before:
                _refusing(check.function, made)
        return made

    @classmethod
    def model_construct(cls, **stated: Any) -> Self:
        """A model of values that are not checked; defaults stand for the others."""
        made = cls.__new__(cls)
        defaults = {
            name: copy.copy(field.default)
            for name, field in cls.model_fields.items()
            if not field.is_required
        }
        vars(made).update(defaults, **stated, model_fields_set=frozenset(stated))
        return made

    def model_copy(self, *, update: Mapping[str, Any]) -> Self:
        """The model with some values replaced, which are not checked."""
        stated = {name: getattr(self, name) for name in self.model_fields_set}
        return self.model_construct(**stated | dict(update))

    def model_dump(
        self,
        *,
        mode: Literal["python", "json"] = "python",
        exclude_unset: bool = False,
        exclude_none: bool = False,
    ) -> dict[str, Any]:
        """The values by key; in the mode ``json``, as JSON holds them."""

        def dumped(value: Any, kind: Any) -> Any:
            if isinstance(value, BaseModel):
                return value.model_dump(
                    mode=mode, exclude_unset=exclude_unset, exclude_none=exclude_none
                )
            if value is None:
                return None
            kind = without_none(kind)
            for mark in getattr(kind, "__metadata__", ()) if mode == "json" else ():
                if isinstance(mark, PlainSerializer):
                    return mark.function(value)
            if isinstance(value, dict):
                return {key: dumped(part, _entry(kind)) for key, part in value.items()}
            if isinstance(value, tuple | list):
                made = [dumped(part, _entry(kind)) for part in value]
                return made if mode == "json" else type(value)(made)
            return value

        chosen = self.model_fields_set if exclude_unset else self.model_fields
        return {
            name: dumped(getattr(self, name), field.annotation)
            for name, field in self.model_fields.items()
            if name in chosen and not (exclude_none and getattr(self, name) is None)
        }

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"{type(self).__name__} is frozen")

    def _state(self) -> tuple[Any, ...]:
        return tuple(getattr(self, name) for name in self.model_fields)

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and self._state() == other._state()

    def __hash__(self) -> int:
        return hash((type(self), self._state()))

    def __repr__(self) -> str:
        values = (f"{name}={getattr(self, name)!r}" for name in self.model_fields)
        return f"{type(self).__name__}({', '.join(values)})"
