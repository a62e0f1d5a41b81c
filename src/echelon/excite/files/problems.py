"""What is wrong with a document of a trajectory, in words that help."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from echelon.errors import InputError, one_line
from echelon.hints import nearest_of

if TYPE_CHECKING:
    from pydantic_core import ErrorDetails

    from echelon.excite.files.schema import TrajectoryRecord

_KEY = "echelon_trajectory"
_FAMILIES = ("fourier", "splines", "sum")


def as_record(data: Any, source: str) -> TrajectoryRecord:
    """A document, checked against its schema.

    Parameters
    ----------
    data : object
    source : str
        File name for messages.

    Raises
    ------
    InputError
        If it does not have the shape of the schema; names the element.
    """
    from pydantic import ValidationError

    from echelon.excite.files.schema import VERSION, TrajectoryRecord

    if not isinstance(data, dict) or _KEY not in data:
        problem = f'is no trajectory: the document of one is an object that begins with "{_KEY}": {VERSION}'
        raise InputError(problem, source=source)
    version = data[_KEY]
    if version != VERSION or isinstance(version, bool):
        problem = f"version {one_line(repr(version))[:40]} of the format is not known; valid is {VERSION}"
        raise InputError(problem, source=source, element=_KEY)
    try:
        return TrajectoryRecord.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        element = one_line(_path(data, first["loc"]))
        raise InputError(_message(first), source=source, element=element or None) from None


def _path(data: Any, location: tuple[int | str, ...]) -> str:
    """The element's path; a location also names the branches of unions, which the document does not have."""
    path = ""
    for part in location:
        if isinstance(data, dict) and part in data:
            path, data = f"{path}.{part}" if path else str(part), data[part]
        elif isinstance(data, list) and isinstance(part, int) and part < len(data):
            path, data = f"{path}[{part}]", data[part]
    return path


def _message(problem: ErrorDetails) -> str:
    kind = problem["type"]
    if kind == "missing":
        return f"the key '{problem['loc'][-1]}' is missing"
    if kind == "union_tag_not_found":
        return f"the key 'family' is missing (valid: {', '.join(_FAMILIES)})"
    if kind == "union_tag_invalid":
        tag = one_line(str(problem.get("ctx", {}).get("tag")))
        return f"the family '{tag}' is not known{nearest_of(tag, _FAMILIES)}"
    if kind == "extra_forbidden":
        return "is no key of the format"
    return problem["msg"].replace("Input should", "should", 1)
