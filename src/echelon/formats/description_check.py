"""Check a description against its schema and say what is wrong in the words of the format."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from echelon.errors import InputError
from echelon.formats.description_text import Document
from echelon.hints import nearest_of
from echelon.inputs.yaml_text import step_into

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

    from echelon.formats.schema import RobotDescription

_START = "a description is a mapping that begins with 'echelon: 1'"


def check_document(document: Document) -> RobotDescription:
    """The description as a model of the published schema."""
    from pydantic import ValidationError

    from echelon.formats.schema import RobotDescription

    if not isinstance(document.data, dict):
        found = "a list" if isinstance(document.data, list) else "nothing" if document.data is None else "a text"
        raise document.error("", f"{_START}; this is {found}")
    if "echelon" not in document.data:
        raise document.error("", f"the key 'echelon' is missing: {_START}")
    try:
        return RobotDescription.model_validate(document.data)
    except ValidationError as error:
        raise _explained(document, error.errors(include_url=False)) from None


def _explained(document: Document, problems: list[ErrorDetails]) -> InputError:
    """The first problem; a misspelt key comes before the key that is missing because of it."""
    first = min(problems, key=lambda p: p["type"] == "missing")
    path, value = _locate(document.data, first["loc"])
    if first["type"] == "unknown_key":
        path = step_into(path, first["ctx"]["key"])
    return document.error(path, _message(first, value))


def _locate(data: Any, location: tuple[int | str, ...]) -> tuple[str, Any]:
    """Path and value of an element; a location also names the branches of unions, which the data does not have."""
    path = ""
    for part in location:
        known = isinstance(data, dict) and part in data
        if known or (isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)):
            data, path = data[part], step_into(path, part)
    return path, data


def _message(problem: ErrorDetails, value: Any) -> str:
    from echelon.formats.schema_types import kind_of

    context = problem.get("ctx", {})
    match problem["type"]:
        case "missing":
            return f"the key '{problem['loc'][-1]}' is missing"
        case "literal_error":
            valid = re.findall(r"'([^']*)'", str(context["expected"]))
            return f"{kind_of(value)} is not valid{nearest_of(str(value), valid)}"
        case "union_tag_invalid":
            valid = re.findall(r"'([^']*)'", str(context["expected_tags"]))
            tag = str(context["tag"])
            return f"unknown joint type '{tag}'{nearest_of(tag, valid)}"
        case "union_tag_not_found":
            return "the key 'type' is missing: a joint has a type such as revolute"
        case "model_attributes_type":
            return f"needs a mapping such as {{type: revolute, axis: z}}, found {kind_of(value)}"
        case "dict_type":
            return f"needs a mapping 'name: value', found {kind_of(value)}"
        case "string_type":
            return f"needs a text, found {kind_of(value)}"
    return problem["msg"]
