"""Trajectories as messages ``trajectory_msgs/JointTrajectory`` of ROS 2, without ROS.

The message starts at once (its stamp is 0) and a point holds positions, velocities and accelerations.  As YAML it is
what ``ros2 topic pub`` takes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.excite.files.trajectory_samples import Samples, places
from echelon.inputs.yaml_text import parse_yaml
from echelon.logs.files.message_columns import fields, nanoseconds

_NANO = 10**9  # steps of the message's times in a second
_STATES = ("positions", "velocities", "accelerations")


def yaml_text(samples: Samples) -> str:
    """The message as YAML."""
    import yaml

    names = yaml.safe_dump(list(samples.coordinates), default_flow_style=True, width=float("inf"), allow_unicode=True)
    lines = [
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        "  frame_id: ''",
        f"joint_names: {names.strip()}",
        "points:",
    ]
    states = [values for values in samples.states if values is not None]
    for time, *state in zip(samples.t.tolist(), *states, strict=True):
        sec, nanosec = divmod(round(time * _NANO), _NANO)
        lines += [
            f"{mark} {field}: [{', '.join(map(_number, values.tolist()))}]"
            for mark, field, values in zip("-  ", _STATES, state, strict=True)
        ]
        lines += ["  effort: []", f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}"]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """All digits; YAML 1.1 takes 1e-05 for a text, unlike 1.0e-05."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


_LATEST = 2**31 * 10**9
_DOT = re.compile(r"\.(?=[a-zA-Z])")  # of .nan and .inf
_INTEGER = re.compile(r"[+-]?[0-9]{1,1000}")
_SHAPE = "a JointTrajectory has joint_names and points"


def from_yaml(content: bytes, source: str, coordinates: Sequence[str]) -> Samples:
    """Samples from a message as YAML."""
    documents = [found.data for found in parse_yaml(content, source) if found.data is not None]
    if len(documents) != 1:
        raise InputError(f"holds {len(documents)} messages; needs one: {_SHAPE}", source=source)
    return _samples(documents[0], source, coordinates)


def _samples(message: Any, source: str, coordinates: Sequence[str]) -> Samples:
    found = dict(fields(message))
    names, points = found.get("joint_names"), found.get("points")
    if not isinstance(names, list) or not isinstance(points, list):
        raise InputError(f"is not a trajectory: {_SHAPE}", source=source)
    try:
        order = places(_names(names), coordinates, "joint_names")
        rows = [dict(fields(point)) for point in points]
        t = np.array([_time(row, k) for k, row in enumerate(rows)]) / 10**9
        values = [_values(rows, name, len(names)) for name in _STATES]
    except InputError as error:
        raise error.located(source) from None
    q, qd, qdd = (None if block is None else block[:, order] for block in values)
    if q is None:
        raise InputError("holds no points with positions", source=source, element="points")
    return Samples(tuple(coordinates), t, (q, qd, qdd), 1 / _NANO)


def _names(names: list[Any]) -> list[str]:
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"holds {type(name).__name__} where a name is needed", element="joint_names")
    return list(names)


def _time(point: dict[str, Any], k: int) -> int:
    element = f"points[{k}].time_from_start"
    parts = {name: _whole(value) for name, value in fields(point.get("time_from_start"))}
    try:
        found = nanoseconds(parts)
    except InputError as error:
        raise InputError(error.problem, element=element) from None
    if found is None or abs(found) > _LATEST:
        raise InputError("needs two integers, sec and nanosec", element=element)
    return found


def _whole(value: Any) -> Any:
    """An integer, which is text in YAML."""
    return int(value) if isinstance(value, str) and _INTEGER.fullmatch(value) else value


def _values(points: list[dict[str, Any]], field: str, width: int) -> Floats | None:
    """A field of all points, shape (N, width); None if none has it."""
    given = [point.get(field) for point in points]
    lengths = [0 if value is None else len(value) if isinstance(value, list) else -1 for value in given]
    if not any(lengths):
        return None
    for k, length in enumerate(lengths):
        if length != width:
            count = f"{length} numbers" if length >= 0 else "no list"
            raise InputError(f"holds {count}; needs {width}, one for each joint", element=f"points[{k}].{field}")
    return np.array([_numbers(value, f"points[{k}].{field}") for k, value in enumerate(given)])


def _numbers(values: Any, element: str) -> Floats:
    found = []
    for value in values:
        # text in YAML
        if isinstance(value, bool) or not isinstance(value, int | float | str) or not str(value).isascii():
            raise InputError(f"holds {type(value).__name__} where a number is needed", element=element)
        try:
            found.append(float(_DOT.sub("", value) if isinstance(value, str) else value))
        except (ValueError, OverflowError):
            raise InputError(f"{one_line(str(value))[:40]!r} is not a number", element=element) from None
    return np.array(found)
