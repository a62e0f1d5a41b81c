"""JSON schemas of records, for editors and other programs."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from inspect import getdoc
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from echelon.shared.inputs import plain_data, published_schema
from echelon.shared.records import (
    BeforeValidator,
    ByValue,
    Discriminator,
    Field,
    Record,
    Within,
    WithJsonSchema,
    record_of_type,
)

_PLAIN: dict[Any, str] = {
    str: "string",
    int: "integer",
    float: "number",
    bool: "boolean",
    NoneType: "null",
    None: "null",
}
_RULES = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "lt": "exclusiveMaximum",
    "le": "maximum",
    "min_length": "minItems",
    "max_length": "maxItems",
}


def schema_of(kind: type) -> dict[str, Any]:
    """The schema of a record or a dataclass; those of others inside it stand under ``$defs``."""
    defined: dict[str, Any] = {}
    schema = _mapping(record_of_type(kind), defined)
    if defined:
        schema["$defs"] = defined
    found: dict[str, Any] = _sorted(schema)
    return found


def file_schema(kind: type[Record]) -> dict[str, Any]:
    """The published schema of a file that names its schema."""
    schema = schema_of(kind)
    name, _, _ = schema["properties"]["schema"]["const"].partition("/")
    return published_schema(name.removeprefix("echelon."), schema)


def _mapping(record: type[Record], defined: dict[str, Any]) -> dict[str, Any]:
    fields = record.model_fields
    schema = {
        "title": record.title or record.__name__,
        "type": "object",
        "additionalProperties": record.other_keys,
        "properties": {
            name: _property(name, field, defined) for name, field in fields.items()
        },
        **record.schema_extra,
    }
    needed = [name for name, field in fields.items() if field.is_required]
    if needed:
        schema["required"] = needed
    if record.__doc__:
        schema["description"] = getdoc(record)
    return schema


def _property(name: str, field: Field, defined: dict[str, Any]) -> dict[str, Any]:
    schema = _typed(field.annotation, defined)
    if not _refers(schema):
        schema["title"] = name.replace("_", " ").title()
    if field.description:
        schema["description"] = field.description
    if field.examples:
        schema["examples"] = list(field.examples)
    if not field.is_required:
        schema["default"] = _data(field.default)
    return schema


def _refers(schema: Mapping[str, Any]) -> bool:
    """Whether it is the schema of a record, which has a title, or of one that may be null."""
    parts = [part for part in schema.get("anyOf", [schema]) if part != {"type": "null"}]
    return len(parts) == 1 and "$ref" in parts[0]


def _typed(kind: Any, defined: dict[str, Any]) -> dict[str, Any]:
    """The schema of a type."""
    origin, parts = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _annotated(parts[0], parts[1:], defined)
    if origin in (Union, UnionType):
        return {"anyOf": _flat([_typed(part, defined) for part in parts])}
    if origin is Literal:
        chosen = {"const": parts[0]} if len(parts) == 1 else {"enum": list(parts)}
        return {**chosen, "type": _PLAIN[type(parts[0])]}
    if origin is list:
        return {"type": "array", "items": _typed(parts[0], defined)}
    if origin is tuple:
        entries = [_typed(part, defined) for part in parts if part is not Ellipsis]
        if Ellipsis in parts:
            return {"type": "array", "items": entries[0]}
        count = len(entries)
        sized = {"minItems": count, "maxItems": count}
        return {"type": "array", "prefixItems": entries, **sized}
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {
            "type": "object",
            "additionalProperties": _typed(parts[1], defined) or True,
        }
    if kind is Any:
        return {}
    if kind in _PLAIN:
        return {"type": _PLAIN[kind]}
    if issubclass(kind, Enum):
        return {"enum": [one.value for one in kind], "type": "string"}
    if kind.__name__ not in defined:
        defined[kind.__name__] = {}
        defined[kind.__name__] = _mapping(record_of_type(kind), defined)
    return {"$ref": f"#/$defs/{kind.__name__}"}


def _annotated(kind: Any, marks: Any, defined: dict[str, Any]) -> dict[str, Any]:
    schema: dict[str, Any] | None = None
    for mark in marks:
        if isinstance(mark, WithJsonSchema):
            schema = dict(mark.schema)
        elif isinstance(mark, BeforeValidator) and mark.json_schema_input_type:
            schema = _typed(mark.json_schema_input_type, defined)
    if schema is not None:
        return schema
    schema = _typed(kind, defined)
    if any(isinstance(mark, Discriminator | ByValue) for mark in marks):
        return {"oneOf": schema["anyOf"]}
    for mark in marks:
        if isinstance(mark, Within):
            schema |= {_RULES[name]: bound for name, bound in mark.rules.items()}
    return schema


def _flat(schemas: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Alternatives, with those inside one of them in its place."""
    found: list[dict[str, Any]] = []
    for schema in schemas:
        inner = schema["anyOf"] if schema.keys() == {"anyOf"} else [schema]
        found += [one for one in inner if one not in found]
    return found


def _data(value: Any) -> Any:
    """A default as JSON holds it."""
    return plain_data(value.model_dump() if isinstance(value, Record) else value)


def _sorted(value: Any, within: str = "") -> Any:
    """Data whose keys are sorted, but for fields, which have an order of their own."""
    if isinstance(value, list):
        return [_sorted(part) for part in value]
    if not isinstance(value, dict):
        return value
    keys = value if within in ("properties", "default") else sorted(value)
    return {key: _sorted(value[key], key) for key in keys}
