"""Messages about descriptions that do not fit their schema, with the line to write instead."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, get_args

from echelon.formats.schema.robot_schema import RobotDescription
from echelon.formats.schema.schema_outputs import SENSORS
from echelon.formats.schema.schema_types import kind_of
from echelon.shared import dump_flow, nearest_of, nearest_word, step_into

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails


def explained(data: Any, problems: list[ErrorDetails]) -> tuple[str, str]:
    """Path and description of the first problem; a misspelt key comes before the key that is missing because of it."""
    first = min(problems, key=lambda p: p["type"] == "missing")
    location = first["loc"]
    path, value = _locate(data, location)
    if isinstance(first["input"], dict) and not isinstance(value, dict):
        # the last part is no key but the branch of a union, which has the name of one
        location = location[:-1]
        path, value = _locate(data, location)
    unknown = first["type"] == "unknown_key"
    place = (*location, first["ctx"]["key"]) if unknown else location
    if unknown:
        path = step_into(path, first["ctx"]["key"])
    line = _line(place)
    return path, _message(first, value) + (f"; write  {line}" if line else "")


def _line(location: tuple[int | str, ...]) -> str:
    """The line that states the last key of a location, or the one nearest to it, by the example of the schema."""
    models: list[Any] = [RobotDescription]
    found: tuple[str, Any] | None = None
    for place, part in enumerate(location):
        fields = {
            name: field
            for model in models
            for name, field in model.model_fields.items()
        }
        last = place == len(location) - 1
        key = (
            str(part)
            if part in fields
            else nearest_word(str(part), fields)
            if last and models
            else ""
        )
        if key:
            field = fields[key]
            models = _models(field.annotation)
            found = (key, field.examples[0] if field.examples else _parts(models))
    return "" if found is None else dump_flow({found[0]: found[1]})


def _parts(models: list[Any]) -> dict[str, Any]:
    """The first keys of a mapping with their examples."""
    fields = list(models[0].model_fields.items())[:2] if models else []
    return {
        name: field.examples[0] if field.examples else _parts(_models(field.annotation))
        for name, field in fields
    }


def _models(annotation: Any) -> list[Any]:
    """The data models inside a type."""
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for inner in get_args(annotation) for model in _models(inner)]


def _locate(data: Any, location: tuple[int | str, ...]) -> tuple[str, Any]:
    """Path and value of an element; a location also names the branches of unions, which the data does not have."""
    path = ""
    for part in location:
        known = isinstance(data, dict) and part in data
        if known or (
            isinstance(data, list | tuple)
            and isinstance(part, int)
            and part < len(data)
        ):
            data, path = data[part], step_into(path, part)
    return path, data


def _message(problem: ErrorDetails, value: Any) -> str:
    context = problem.get("ctx", {})
    match problem["type"]:
        case "missing":
            return f"the key '{problem['loc'][-1]}' is missing"
        case "literal_error":
            valid = re.findall(r"'([^']*)'", str(context["expected"]))
            given = problem["input"]
            return f"{kind_of(given)} is not valid{nearest_of(str(given), valid)}"
        case "union_tag_invalid":
            valid = re.findall(r"'([^']*)'", str(context["expected_tags"]))
            tag = str(context["tag"])
            return f"unknown joint type '{tag}'{nearest_of(tag, valid)}"
        case "union_tag_not_found":
            if problem["loc"][0] == "outputs":
                *keys, last = SENSORS
                return f"needs one of the keys {', '.join(keys)} and {last}, which name the measurement"
            return "the key 'type' is missing: a joint has a type such as revolute"
        case "model_attributes_type":
            return f"needs a mapping such as {{type: revolute, axis: z}}, found {kind_of(value)}"
        case "dict_type":
            return f"needs a mapping 'name: value', found {kind_of(value)}"
        case "string_type":
            return f"needs a text, found {kind_of(value)}"
    return problem["msg"]
