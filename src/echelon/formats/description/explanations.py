"""Messages about descriptions that do not fit their schema, with the line to write instead."""

from __future__ import annotations

from typing import Any, get_args

from echelon.formats.schema.robot_schema import RobotDescription
from echelon.shared import UnfitError, dump_flow, nearest_word, step_into


def explained(data: Any, error: UnfitError) -> tuple[str, str]:
    """Path and description of what does not fit, with the line to write instead."""
    unknown = () if error.unknown is None else (error.unknown,)
    missing = () if error.missing is None else (error.missing,)
    line = _line((*error.where, *unknown, *missing))
    return path_of(data, error), error.problem + (f"; write  {line}" if line else "")


def path_of(data: Any, error: UnfitError) -> str:
    """Path of what does not fit, as far as the document has it: a shorter way of writing may stand for the rest."""
    path = ""
    unknown = () if error.unknown is None else (error.unknown,)
    for part in (*error.where, *unknown):
        if isinstance(data, dict):
            known = part in data
        else:
            known = isinstance(part, int) and isinstance(data, list | tuple)
        if known:
            data, path = data[part], step_into(path, part)
    return path


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
