"""Records: mappings whose keys and values are declared once, as a class with annotated fields.

Descriptions, set-ups and saved files are records; :mod:`echelon.shared.record_schemas` writes their JSON schemas.  A
check gives the record, or says what is wrong and where: unknown and missing keys, values of another type or out of
bounds, and whatever a type's own function refuses.  Numbers are finite, and no text counts as a number.

Pydantic does all this.  But to import it and to prepare the records of descriptions took 0.33 of the 0.76 s in which a
description was read (CPU time).  Here an annotation is looked at when a document first states its field.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import cache, cached_property
from math import isfinite
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    ClassVar,
    Literal,
    Self,
    TypeVar,
    Union,
    dataclass_transform,
    get_args,
    get_origin,
)

from echelon.shared.errors import InputError
from echelon.shared.hints import nearest, nearest_of

Check = Callable[[Any], Any]
"""Gives the result for what is stated, or raises a :class:`UnfitError`."""


class UnfitError(ValueError):
    """An error in a value of a document, with its place."""

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
class PlainValidator:
    """Makes the result of what is stated, which is not checked again."""

    function: Check

    def around(self, _inner: Check) -> Check:
        """The check of a type that this reads."""
        return lambda value: _refusing(self.function, value)


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

    def parts(self, union: Any) -> dict[str, Any]:
        """Parts of a union by their tags."""
        return {
            mark.name: part
            for part in get_args(union)
            for mark in part.__metadata__
            if isinstance(mark, Tag)
        }

    def tag(self, value: Any, _: Mapping[str, Any]) -> str:
        """The tag of the part that a value belongs to."""
        return self.function(value)


@dataclass(frozen=True, eq=False)
class Tag:
    """Names a part of a union."""

    name: str


@dataclass(frozen=True, eq=False)
class ByValue:
    """Tells the records of a union by the value of one key, of which each record lists its own."""

    key: str
    example: str  # of a mapping that fits, for messages

    def parts(self, union: Any) -> dict[str, Any]:
        """Records by the values of the key."""
        return {
            value: record
            for record in get_args(union)
            for value in get_args(record.model_fields[self.key].annotation)
        }

    def tag(self, value: Any, parts: Mapping[str, Any]) -> str:
        """The value of the key in a mapping."""
        if not isinstance(value, dict):
            found = kind_of(value)
            raise UnfitError(f"needs a mapping such as {self.example}, found {found}")
        if self.key not in value:
            raise UnfitError(f"the key '{self.key}' is missing, as in {self.example}")
        stated = str(value[self.key])
        if stated not in parts:
            hint = nearest_of(stated, parts)
            raise UnfitError(f"there is no {self.key} '{stated}'{hint}")
        return stated


@dataclass(frozen=True, eq=False)
class WithJsonSchema:
    """Stands in the JSON schema in the place of a type."""

    schema: Mapping[str, Any]


_BOUNDS: dict[str, tuple[str, Callable[[Any, Any], bool]]] = {
    "gt": ("a number greater than {}", lambda value, bound: value > bound),
    "ge": ("a number greater than or equal to {}", lambda value, bound: value >= bound),
    "lt": ("a number less than {}", lambda value, bound: value < bound),
    "le": ("a number less than or equal to {}", lambda value, bound: value <= bound),
    "min_length": ("entries, at least {}", lambda value, bound: len(value) >= bound),
    "max_length": ("entries, at most {}", lambda value, bound: len(value) <= bound),
}


class Within:
    """Bounds of a number (gt, ge, lt, le), or of how many entries a list has (min_length, max_length)."""

    def __init__(self, **rules: float) -> None:
        self.rules = rules

    def around(self, inner: Check) -> Check:
        """The check of a value that is within bounds."""

        def checked(value: Any) -> Any:
            found = inner(value)
            for name, bound in self.rules.items():
                words, holds = _BOUNDS[name]
                if not holds(found, bound):
                    raise UnfitError(f"needs {words.format(f'{bound:g}')}")
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
    if origin is list:
        entries = check_of(parts[0])
        return lambda value: list(_each(_listed(value), entries))
    if origin is tuple:
        return _tuple(parts)
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key, inner = map(check_of, parts)
        return lambda value: {
            key(name): _within(name, inner, part)
            for name, part in _mapping(value).items()
        }
    if kind is Any:
        return lambda value: value
    if kind in _PLAIN:
        return lambda value: _plain(kind, value)
    return _record_check(kind)


def _record_check(kind: type) -> Check:
    record = record_of_type(kind)
    if record is kind:
        return record.model_validate
    return lambda value: kind(**record.checked(value))


def _annotated(kind: Any, *marks: Any) -> Check:
    choices = (mark for mark in marks if isinstance(mark, Discriminator | ByValue))
    choice = next(choices, None)
    check = check_of(kind) if choice is None else _chosen(kind, choice)
    for mark in marks:
        if isinstance(mark, BeforeValidator | PlainValidator | AfterValidator | Within):
            check = mark.around(check)
    return check


def _chosen(union: Any, choice: Discriminator | ByValue) -> Check:
    parts, checks = choice.parts(union), dict[str, Check]()

    def checked(value: Any) -> Any:
        tag = _refusing(lambda value: choice.tag(value, parts), value)
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
    if any(type(value) is type(one) and value == one for one in valid):
        return value
    if isinstance(valid[0], str):
        hint = nearest_of(str(value), valid)
        raise UnfitError(f"{kind_of(value)} is not valid{hint}")
    raise UnfitError(f"needs {' or '.join(map(repr, valid))}, found {value!r}")


def _tuple(parts: tuple[Any, ...]) -> Check:
    if Ellipsis in parts:
        entry = check_of(parts[0])
        return lambda value: tuple(_each(_listed(value), entry))
    checks = [check_of(part) for part in parts]

    def checked(value: Any) -> Any:
        if len(_listed(value)) != len(checks):
            problem = f"needs {len(checks)} entries, found {len(value)}"
            raise UnfitError(problem)
        pairs = enumerate(zip(checks, value, strict=True))
        return tuple(_within(k, check, part) for k, (check, part) in pairs)

    return checked


def _each(values: Sequence[Any], check: Check) -> Iterator[Any]:
    return (_within(k, check, part) for k, part in enumerate(values))


def _within(place: int | str, check: Check, value: Any) -> Any:
    """The result for a part of a value; a refusal says which part."""
    try:
        return check(value)
    except UnfitError as error:
        error.where = (place, *error.where)
        raise


def _listed(value: Any) -> Sequence[Any]:
    if not isinstance(value, list | tuple):
        raise UnfitError(f"needs a list, found {kind_of(value)}")
    return value


def _mapping(value: Any) -> Mapping[Any, Any]:
    if not isinstance(value, Mapping):
        raise UnfitError(f"needs a mapping 'name: value', found {kind_of(value)}")
    return value


_PLAIN = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    NoneType: "nothing",
    None: "nothing",
}


def _plain(kind: Any, value: Any) -> Any:
    if kind is float and isinstance(value, int | float) and type(value) is not bool:
        return _finite(value)
    if type(value) is not kind and value is not kind:
        raise UnfitError(f"needs {_PLAIN[kind]}, found {kind_of(value)}")
    return value


def _finite(value: float) -> float:
    try:
        found = float(value)
    except OverflowError:
        found = float("inf")
    if not isfinite(found):
        raise UnfitError(f"needs a finite number, found {found}")
    return found


# -- records -----------------------------------------------------------------------------------------------------------

_REQUIRED: Any = object()


@dataclass
class Field:
    """A key of a record: its default and its meaning."""

    default: Any
    description: str = ""
    examples: Sequence[Any] = ()
    text: str = ""  # the annotation, as it stands in the class
    module: str = ""

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


def required(meaning: str, *examples: Any) -> Any:
    """A key that a mapping must have: what it means, with its unit, and examples."""
    return Field(_REQUIRED, meaning, examples)


def optional(default: Any, meaning: str, *examples: Any) -> Any:
    """A key that a mapping may have: the value without it, what it means, with its unit, and examples."""
    return Field(default, meaning, examples)


@dataclass(frozen=True)
class ModelCheck:
    """A check of a whole record, whose values were checked one by one."""

    function: Callable[[Any], object]


def model_check(function: Any) -> Any:
    """Make a method the check of a whole record."""
    return ModelCheck(function)


@dataclass_transform(kw_only_default=True, frozen_default=True)
class Record:
    """A mapping whose keys are known; the result of a check, which is frozen."""

    title: ClassVar[str] = ""
    other_keys: ClassVar[bool] = False  # whether a mapping may have unknown ones
    schema_extra: ClassVar[Mapping[str, Any]] = {}
    model_fields: ClassVar[dict[str, Field]] = {}
    model_checks: ClassVar[tuple[ModelCheck, ...]] = ()
    model_fields_set: frozenset[str]

    def __init_subclass__(cls) -> None:
        own = dict(vars(cls))
        found = dict(cls.model_fields)
        for name, text in own.get("__annotations__", {}).items():
            stated = own.get(name, _REQUIRED)
            field = stated if isinstance(stated, Field) else Field(stated)
            field.text, field.module = text, cls.__module__
            found[name] = field
            if name in own:
                delattr(cls, name)
        cls.model_fields = found
        checks = [check for check in own.values() if isinstance(check, ModelCheck)]
        cls.model_checks = (*cls.model_checks, *checks)

    def __init__(self, /, **stated: Any) -> None:
        vars(self).update(vars(self.model_validate(stated)))

    @classmethod
    def valid_keys(cls) -> list[str]:
        """Keys in the order of messages."""
        return list(cls.model_fields)

    @classmethod
    def hint_at(cls, key: str) -> str:
        """A hint at what was meant by an unknown key."""
        return nearest(key, cls.valid_keys())

    @classmethod
    def checked(cls, data: Any) -> dict[str, Any]:
        """Values of the keys that a mapping states."""
        valid = cls.valid_keys()
        if not isinstance(data, Mapping):
            problem = f"needs a mapping with the keys {', '.join(valid)}"
            raise UnfitError(f"{problem}; found {kind_of(data)}")
        for key in data:
            if key not in cls.model_fields and not cls.other_keys:
                hint = cls.hint_at(str(key))
                problem = f"unknown key{hint} (valid: {', '.join(valid)})"
                raise UnfitError(problem, unknown=str(key))
        stated = {
            name: _within(name, field.check, data[name])
            for name, field in cls.model_fields.items()
            if name in data
        }
        for name, field in cls.model_fields.items():
            if field.is_required and name not in stated:
                raise UnfitError(f"the key '{name}' is missing", missing=name)
        return stated

    @classmethod
    def model_validate(cls, data: Any) -> Self:
        """The record of a mapping; raises a :class:`UnfitError` if it does not fit."""
        made = cls.model_construct(**cls.checked(data))
        for check in cls.model_checks:
            _refusing(check.function, made)
        return made

    @classmethod
    def model_construct(cls, **stated: Any) -> Self:
        """A record of values that are not checked; defaults stand for the others."""
        made = cls.__new__(cls)
        defaults = {
            name: copy.copy(field.default)
            for name, field in cls.model_fields.items()
            if not field.is_required
        }
        vars(made).update(defaults, **stated, model_fields_set=frozenset(stated))
        return made

    def model_copy(self, *, update: Mapping[str, Any]) -> Self:
        """The record with some values replaced, which are not checked."""
        stated = {name: getattr(self, name) for name in self.model_fields_set}
        return self.model_construct(**stated | dict(update))

    def model_dump(self, *, exclude_unset: bool = False) -> dict[str, Any]:
        """The values by key, with mappings for records."""

        def dumped(value: Any) -> Any:
            if isinstance(value, Record):
                return value.model_dump(exclude_unset=exclude_unset)
            if isinstance(value, dict):
                return {key: dumped(part) for key, part in value.items()}
            if isinstance(value, tuple | list):
                return type(value)(map(dumped, value))
            return value

        chosen = self.model_fields_set if exclude_unset else self.model_fields
        return {
            name: dumped(getattr(self, name))
            for name in self.model_fields
            if name in chosen
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


@cache
def record_of_type(kind: type) -> type[Record]:
    """The record with the fields of a dataclass; a record is its own."""
    if issubclass(kind, Record):
        return kind
    if not is_dataclass(kind):
        raise TypeError(f"{kind.__name__} is no type of a record's field")
    found: dict[str, Any] = {"__doc__": kind.__doc__, "__module__": kind.__module__}
    for field in fields(kind):
        if field.default is not MISSING:
            found[field.name] = field.default
        elif field.default_factory is not MISSING:
            found[field.name] = field.default_factory()
    texts = {field.name: field.type for field in fields(kind)}
    return type(kind.__name__, (Record,), {**found, "__annotations__": texts})


# -- files -------------------------------------------------------------------------------------------------------------

Kept = TypeVar("Kept", bound=Record)


def record_from(kind: type[Kept], data: Any, source: str, what: str) -> Kept:
    """The record of a file's data; an InputError names the element that does not fit."""
    try:
        return kind.model_validate(data)
    except UnfitError as error:
        ends = (end for end in (error.unknown, error.missing) if end is not None)
        where = ".".join(map(str, (*error.where, *ends)))
        problem = f"not {what}: {error.problem}"
        raise InputError(problem, source=source, element=where or None) from None


def record_data(kind: type[Record], found: object, **given: Any) -> dict[str, Any]:
    """Data of a record: each field as given, or the attribute of its name, as a record where that is one."""
    return {
        name: given[name]
        if name in given
        else _inside(field.annotation, getattr(found, name))
        for name, field in kind.model_fields.items()
    }


def _inside(kind: Any, value: Any) -> Any:
    kinds = (kind, *get_args(kind))
    records = [k for k in kinds if isinstance(k, type) and issubclass(k, Record)]
    if not records or value is None:
        return value
    if isinstance(value, tuple):
        return [record_data(records[0], one) for one in value]
    return record_data(records[0], value)
