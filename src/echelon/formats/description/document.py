"""Descriptions as plain data: parsed scalar by scalar as written, with the line of every element, and checked.

A list of frame pairs beside a URDF, as collections of parallel robots publish them, is read as the description that
says the same.  ``closed_loop`` lists pairs of links that are held together, ``type`` whether in 6 or in 3 directions,
``name_mot`` the joints with motors.  ``joint_name`` and ``joint_type`` say which joints of the URDF stand for others: a
ball, or turns about x and then y of the joint's frame (CARDAN), or about other axes of it (UJOINT_ZY).  The URDF has
the name of the list.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, get_args

from echelon.errors import InputError
from echelon.formats.schema.schema_types import kind_of
from echelon.hints import nearest_of, nearest_word
from echelon.inputs import DESCRIPTION_NODES, decoded, dump_flow, parse_json, parse_yaml, step_into

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

    from echelon.formats.schema.robot_schema import RobotDescription


_LONGEST_MESSAGE = 600


@dataclass(frozen=True)
class Document:
    """A description as plain data: mappings, lists, texts, None (and, from JSON, truth values)."""

    data: Any
    source: str  # name of the file, for messages
    # line, counted from 1, of every element by its path; empty for JSON
    lines: Mapping[str, int] = field(default_factory=dict)
    # what the file calls elements, by the beginnings of their paths, where it is of another layout
    names: Mapping[str, str] = field(default_factory=dict)

    def error(self, path: str, problem: str) -> InputError:
        """An error about the element at a path such as ``modified_dh[3].alpha``."""
        begun = max((name for name in self.names if path.startswith(name)), key=len, default="")
        path = known = self.names.get(begun, "") + path.removeprefix(begun)
        while known and known not in self.lines:
            known = known[: max(known.rfind("."), known.rfind("["), 0)]
        line = f" (line {self.lines[known]})" if known else ""
        problem, path = " ".join(problem.split()), " ".join(path.split())
        if len(problem) > _LONGEST_MESSAGE:
            problem = f"{problem[:_LONGEST_MESSAGE]}…"
        return InputError(f"{problem}{line}", source=self.source, element=path or None)


def read_text(text: str | bytes, source: str) -> Document:
    """Parse YAML or JSON without interpreting scalars."""
    text = decoded(text, source)
    is_json = source.lower().endswith(".json")
    # YAML may begin with a brace as well, so JSON that fails is tried as YAML unless the file's name says JSON
    if is_json or text.lstrip().startswith("{"):
        try:
            return Document(parse_json(text, source, DESCRIPTION_NODES, as_text=True), source)
        except InputError:
            if is_json:
                raise
    found = parse_yaml(text, source, DESCRIPTION_NODES, lines=True)
    if len(found) > 1:
        line = found[1].lines.get("", 1)
        problem = f"one document describes one robot, but a second document begins (line {line})"
        raise InputError(f"not well-formed YAML: {problem}", source=source)
    if not found:
        raise InputError("the document is empty; a description begins with 'echelon: 1'", source=source)
    return Document(found[0].data, source, found[0].lines)


_START = "a description is a mapping that begins with 'echelon: 1'"


def check_document(document: Document) -> RobotDescription:
    """The description as a model of the published schema."""
    from pydantic import ValidationError

    from echelon.formats.schema.robot_schema import RobotDescription

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
    unknown = first["type"] == "unknown_key"
    place = (*first["loc"], first["ctx"]["key"]) if unknown else first["loc"]
    if unknown:
        path = step_into(path, first["ctx"]["key"])
    line = _line(place)
    return document.error(path, _message(first, value) + (f"; write  {line}" if line else ""))


def _line(location: tuple[int | str, ...]) -> str:
    """The line that states the last key of a location, or the one nearest to it, by the example of the schema."""
    from echelon.formats.schema.robot_schema import RobotDescription

    models: list[Any] = [RobotDescription]
    found: tuple[str, Any] | None = None
    for place, part in enumerate(location):
        fields = {name: field for model in models for name, field in model.model_fields.items()}
        last = place == len(location) - 1
        key = str(part) if part in fields else nearest_word(str(part), fields) if last and models else ""
        if key:
            field = fields[key]
            models = _models(field.annotation)
            found = (key, field.examples[0] if field.examples else _parts(models))
    return "" if found is None else dump_flow({found[0]: found[1]})


def _parts(models: list[Any]) -> dict[str, Any]:
    """The first keys of a mapping with their examples."""
    fields = list(models[0].model_fields.items())[:2] if models else []
    return {name: field.examples[0] if field.examples else _parts(_models(field.annotation)) for name, field in fields}


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
        if known or (isinstance(data, list | tuple) and isinstance(part, int) and part < len(data)):
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
                return "needs one of the keys joint, actuator, wrench and sum, which say what is measured"
            return "the key 'type' is missing: a joint has a type such as revolute"
        case "model_attributes_type":
            return f"needs a mapping such as {{type: revolute, axis: z}}, found {kind_of(value)}"
        case "dict_type":
            return f"needs a mapping 'name: value', found {kind_of(value)}"
        case "string_type":
            return f"needs a text, found {kind_of(value)}"
    return problem["msg"]


_PAIRS = "closed_loop"
_KINDS = {"6D": "weld", "3D": "spherical"}
_UNIVERSAL = re.compile(r"UJOINT_([XYZ])([XYZ])")


def lists_pairs(document: Document) -> bool:
    """Whether a document is a list of frame pairs."""
    return isinstance(document.data, dict) and _PAIRS in document.data and "echelon" not in document.data


def as_description(document: Document) -> Document:
    """The description that says the same."""
    pairs, joints, motors = _items(document, _PAIRS), _items(document, "joint_name"), _items(document, "name_mot")
    kinds = _of_each(document, "type", _PAIRS, pairs, "6d")
    types = _of_each(document, "joint_type", "joint_name", joints, None)
    path = PurePath(document.source)
    data = {
        "echelon": 1,
        "robot": {
            "file": path.with_suffix(".urdf").name,
            "joints": {str(name): _joint(document, k, types[k]) for k, name in enumerate(joints)},
            "driven": motors,
        },
        "loops": [_loop(document, k, pair, kinds[k]) for k, pair in enumerate(pairs)],
    }
    names = {"robot.driven": "name_mot"}
    for k, name in enumerate(joints):
        names[f"robot.joints.{name}"] = f"joint_name[{k}]"
    for k in range(len(pairs)):
        names |= {f"loops[{k}].connects": f"{_PAIRS}[{k}]", f"loops[{k}]": f"{_PAIRS}[{k}]"}
    return Document(data, document.source, document.lines, names)


def _items(document: Document, key: str) -> list[Any]:
    found = document.data.get(key)
    if found is not None and not isinstance(found, list):
        raise document.error(key, f"needs a list, found {kind_of(found)}")
    return found or []


def _of_each(document: Document, key: str, of: str, items: list[Any], usual: str | None) -> list[Any]:
    """One entry for every item; for all of them the usual one, if there are none."""
    found = _items(document, key)
    if not found and usual is not None:
        return [usual] * len(items)
    if len(found) != len(items):
        raise document.error(key, f"has {len(found)} entries, and {of} has {len(items)}: each needs one of the other")
    return found


def _loop(document: Document, index: int, pair: Any, kind: Any) -> dict[str, Any]:
    joint = _KINDS.get(str(kind).upper())
    if joint is None:
        raise document.error(f"type[{index}]", f"{kind_of(kind)} is not a type of contact (valid: 6d, 3d)")
    if not isinstance(pair, list) or len(pair) != 2:
        raise document.error(f"{_PAIRS}[{index}]", f"needs two names of links, found {kind_of(pair)}")
    return {"name": "-".join(str(name) for name in pair), "joint": joint, "connects": pair, "on_second": {}}


def _joint(document: Document, index: int, kind: Any) -> dict[str, str]:
    named = str(kind).upper()
    if named in ("SPHERICAL", "FIXED"):
        return {"type": named.lower()}
    universal = _UNIVERSAL.fullmatch("UJOINT_XY" if named == "CARDAN" else named)
    if universal is None:
        problem = f"{kind_of(kind)} is not a type of joint (valid: SPHERICAL, CARDAN, UJOINT_ZY and such, FIXED)"
        raise document.error(f"joint_type[{index}]", problem)
    return {"type": "universal", "axis": universal[1].lower(), "axis2": universal[2].lower()}
