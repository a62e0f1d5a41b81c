"""Reading ``trajectory_msgs/JointTrajectory``: from YAML, or the only such message of an MCAP file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

import numpy as np

from echelon.errors import InputError, one_line
from echelon.excite.files.joint_trajectory import KIND, RESOLUTION
from echelon.excite.files.samples import Floats, Samples
from echelon.logs.files.mcap import Mcap
from echelon.logs.files.messages import fields, nanoseconds

_STATES = ("positions", "velocities", "accelerations")
_DEEPEST = 20
_LATEST = 2**31 * 10**9
_SHAPE = "a JointTrajectory has joint_names and points"


def from_yaml(content: bytes, source: str, coordinates: Sequence[str]) -> Samples:
    """Samples from a message as YAML.

    Parameters
    ----------
    content : bytes
        UTF-8; also as ``ros2 topic echo`` prints it.
    source : str
        File name for messages.
    coordinates : sequence of str
        Order of the columns.

    Raises
    ------
    InputError
        If it is no such message, or its joints are others.
    """
    import yaml

    try:
        documents = _documents(content.decode("utf-8-sig"), source)
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 text: {error.reason} at byte {error.start}", source=source) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f" (line {mark.line + 1})" if mark else ""
        raise InputError(f"not well-formed YAML: {error.problem or error.context}{where}", source=source) from None
    except (yaml.YAMLError, ValueError) as error:
        raise InputError(f"not readable as YAML: {one_line(str(error))}", source=source) from None
    if len(documents) != 1:
        raise InputError(f"holds {len(documents)} messages; needs one: {_SHAPE}", source=source)
    return _samples(documents[0], source, coordinates)


def from_mcap(path: str | os.PathLike[str], coordinates: Sequence[str]) -> Samples:
    """Samples from an MCAP file; messages of other types do not matter.

    Parameters
    ----------
    path : path
    coordinates : sequence of str
        Order of the columns.

    Raises
    ------
    InputError
        If the file cannot be read, holds no such message or several, or its joints are others.
    MissingExtraError
        If mcap or rosbags is not installed.
    """
    file = Mcap(path)
    readable = [topic for topic, reason in file.topics.items() if not reason]
    topics = [topic for topic, _, message in file.messages(readable, head=1) if _is_trajectory(message)]
    found = [message for _, _, message in file.messages(topics) if _is_trajectory(message)] if topics else []
    if len(found) != 1:
        where = f" in {', '.join(map(repr, sorted(set(topics))))}" if topics else ""
        problem = f"holds {len(found)} messages of the type {KIND}{where}; needs one"
        raise InputError(one_line(problem), source=file.source)
    return _samples(found[0], file.source, coordinates)


def _documents(text: str, source: str) -> list[Any]:
    """What YAML documents hold; empty ones do not count."""
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    for event in yaml.parse(text, loader):
        # the fast loader calls itself for each level, and deep ones would overflow the stack of the process
        depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if depth > _DEEPEST:
            raise InputError("nested too deeply to be a message", source=source)
    return [found for found in yaml.load_all(text, loader) if found is not None]


def _is_trajectory(message: Any) -> bool:
    """By its type, or, where messages have none (JSON), by its fields."""
    kind = getattr(message, "__msgtype__", None)
    return kind == KIND if kind else {"joint_names", "points"} <= {name for name, _ in fields(message)}


def _samples(message: Any, source: str, coordinates: Sequence[str]) -> Samples:
    found = dict(fields(message))
    names, points = found.get("joint_names"), found.get("points")
    if not isinstance(names, list) or not isinstance(points, list):
        raise InputError(f"is no trajectory: {_SHAPE}", source=source)
    try:
        order = _order(_names(names), coordinates)
        rows = [dict(fields(point)) for point in points]
        t = np.array([_time(row, k) for k, row in enumerate(rows)]) / 10**9
        values = [_values(rows, name, len(names)) for name in _STATES]
    except InputError as error:
        raise error.located(source) from None
    q, qd, qdd = (None if block is None else block[:, order] for block in values)
    if q is None:
        raise InputError("holds no points with positions", source=source, element="points")
    return Samples(tuple(coordinates), t, (q, qd, qdd), RESOLUTION)


def _names(names: list[Any]) -> list[str]:
    """Texts; names of digits alone are numbers in YAML."""
    for name in names:
        if isinstance(name, bool) or not isinstance(name, int | str):
            raise InputError(f"holds {type(name).__name__} where a name is needed", element="joint_names")
    return [str(name) for name in names]


def _order(names: list[str], coordinates: Sequence[str]) -> list[int]:
    """Place of each coordinate among the joints."""
    there = ", ".join(f"'{one_line(name)}'" for name in names)
    if len(set(names)) < len(names):
        raise InputError(f"a joint occurs twice: {there}", element="joint_names")
    for name in coordinates:
        if name not in names:
            raise InputError(f"the coordinate '{name}' is missing; there are {there or 'none'}", element="joint_names")
    surplus = ", ".join(f"'{one_line(name)}'" for name in names if name not in coordinates)
    if surplus:
        problem = f"there is no coordinate for {surplus}; valid are {', '.join(map(repr, coordinates))}"
        raise InputError(problem, element="joint_names")
    return [names.index(name) for name in coordinates]


def _time(point: dict[str, Any], k: int) -> int:
    element = f"points[{k}].time_from_start"
    try:
        found = nanoseconds(point.get("time_from_start"))
    except InputError as error:
        raise InputError(error.problem, element=element) from None
    if found is None or abs(found) > _LATEST:
        raise InputError("needs two integers, sec and nanosec", element=element)
    return found


def _values(points: list[dict[str, Any]], field: str, width: int) -> Floats | None:
    """A field of all points, shape (N, width); None if none has it."""
    given = [point.get(field) for point in points]
    lengths = [0 if value is None else len(value) if isinstance(value, list | np.ndarray) else -1 for value in given]
    if not any(lengths):
        return None
    for k, length in enumerate(lengths):
        if length != width:
            count = f"{length} numbers" if length >= 0 else "no list"
            raise InputError(f"holds {count}; needs {width}, one for each joint", element=f"points[{k}].{field}")
    return np.array([_numbers(value, f"points[{k}].{field}") for k, value in enumerate(given)])


def _numbers(values: Any, element: str) -> Floats:
    if isinstance(values, np.ndarray):
        return values.astype(float)
    found = []
    for value in values:
        # texts as well, because YAML 1.1 takes 1e-05, which other programs write, for one
        if isinstance(value, bool) or not isinstance(value, int | float | str) or not str(value).isascii():
            raise InputError(f"holds {type(value).__name__} where a number is needed", element=element)
        try:
            found.append(float(value))
        except (ValueError, OverflowError):
            raise InputError(f"{one_line(str(value))[:40]!r} is no number", element=element) from None
    return np.array(found)
