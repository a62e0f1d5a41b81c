"""JSON schemas of data models, for editors and other programs."""

from __future__ import annotations

from inspect import getdoc
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from echelon.formats.schema.models import (
    BaseModel,
    BeforeValidator,
    Discriminator,
    Field,
    WithJsonSchema,
    without_none,
)

_PLAIN: dict[Any, str] = {
    str: "string",
    int: "integer",
    float: "number",
    bool: "boolean",
    NoneType: "null",
}
_RULES = {
    "gt": "exclusiveMinimum",
    "ge": "minimum",
    "lt": "exclusiveMaximum",
    "le": "maximum",
    "min_length": "minItems",
    "max_length": "maxItems",
}


def schema_of(model: type[BaseModel]) -> dict[str, Any]:
    """The schema of a model; those of models inside it stand under ``$defs``."""
    defined: dict[str, Any] = {}
    schema = _mapping(model, defined)
    if defined:
        schema["$defs"] = defined
    found: dict[str, Any] = _sorted(schema)
    return found


def _mapping(model: type[BaseModel], defined: dict[str, Any]) -> dict[str, Any]:
    config, fields = model.model_config, model.model_fields
    schema = {
        "title": config.get("title", model.__name__),
        "type": "object",
        "additionalProperties": False,
        "properties": {
            name: _property(name, field, defined) for name, field in fields.items()
        },
        **config.get("json_schema_extra", {}),
    }
    needed = [name for name, field in fields.items() if field.is_required]
    if needed:
        schema["required"] = needed
    if model.__doc__:
        schema["description"] = getdoc(model)
    return schema


def _property(name: str, field: Field, defined: dict[str, Any]) -> dict[str, Any]:
    schema = _ruled(_typed(field.annotation, defined), field)
    if not _is_model(field.annotation):
        schema["title"] = name.replace("_", " ").title()
    if field.description:
        schema["description"] = field.description
    if field.examples:
        schema["examples"] = list(field.examples)
    if not field.is_required:
        schema["default"] = _data(field.default)
    return schema


def _is_model(kind: Any) -> bool:
    kind = without_none(kind)
    if get_origin(kind) is Annotated:
        return _is_model(get_args(kind)[0])
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _ruled(schema: dict[str, Any], field: Field) -> dict[str, Any]:
    return {**schema, **{_RULES[name]: bound for name, bound in field.rules.items()}}


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
    if origin is tuple:
        entries = [_typed(part, defined) for part in parts if part is not Ellipsis]
        if Ellipsis in parts:
            return {"type": "array", "items": entries[0]}
        count = len(entries)
        sized = {"minItems": count, "maxItems": count}
        return {"type": "array", "prefixItems": entries, **sized}
    if origin is dict:
        return {
            "type": "object",
            "additionalProperties": _typed(parts[1], defined) or True,
        }
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        if kind.__name__ not in defined:
            defined[kind.__name__] = {}
            defined[kind.__name__] = _mapping(kind, defined)
        return {"$ref": f"#/$defs/{kind.__name__}"}
    return {} if kind is Any else {"type": _PLAIN[kind]}


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
    if any(isinstance(mark, Discriminator) for mark in marks):
        return {"oneOf": schema["anyOf"]}
    for mark in marks:
        if isinstance(mark, Field):
            schema = _ruled(schema, mark)
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
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    return [_data(part) for part in value] if isinstance(value, tuple) else value


def _sorted(value: Any, within: str = "") -> Any:
    """Data whose keys are sorted, but for fields, which have an order of their own."""
    if isinstance(value, list):
        return [_sorted(part) for part in value]
    if not isinstance(value, dict):
        return value
    keys = value if within in ("properties", "default") else sorted(value)
    return {key: _sorted(value[key], key) for key in keys}
