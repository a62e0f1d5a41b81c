"""Trajectories as messages ``trajectory_msgs/JointTrajectory`` of ROS 2, without ROS.

The message starts at once (its stamp is 0) and a point holds positions, velocities and accelerations.  As YAML it is
what ``ros2 topic pub`` takes.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError, MissingExtraError, one_line
from echelon.excite.files.trajectory_samples import Samples
from echelon.inputs.yaml_text import parse_yaml
from echelon.logs.files.mcap_file import Mcap
from echelon.logs.files.message_columns import fields, nanoseconds
from echelon.version import __version__

KIND = "trajectory_msgs/msg/JointTrajectory"
"""Type of the message."""

TOPIC = "/joint_trajectory_controller/joint_trajectory"
"""Where ROS 2's own controller listens."""

RESOLUTION = 1e-9
"""Steps of the message's times, s."""

_NANO = 10**9


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
    for time, (q, qd, qdd) in zip(_times(samples), _rows(samples), strict=True):
        sec, nanosec = divmod(time, _NANO)
        lines += [
            f"- positions: {_list(q)}",
            f"  velocities: {_list(qd)}",
            f"  accelerations: {_list(qdd)}",
            "  effort: []",
            f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}",
        ]
    return "\n".join(lines) + "\n"


def mcap_bytes(samples: Samples) -> bytes:
    """An MCAP file of this one message, with the definition of its type."""
    try:
        from mcap.writer import Writer
    except ImportError:
        raise MissingExtraError("mcap", "ros") from None
    definition, content = _encoded(samples)
    stream = io.BytesIO()
    writer: Any = Writer(stream)
    writer.start(profile="ros2", library=f"echelon {__version__}")
    schema = writer.register_schema(name=KIND, encoding="ros2msg", data=definition.encode())
    channel = writer.register_channel(
        topic=TOPIC, message_encoding="cdr", schema_id=schema, metadata={"offered_qos_profiles": ""}
    )
    writer.add_message(channel, log_time=0, publish_time=0, data=content)
    writer.finish()
    return stream.getvalue()


def _encoded(samples: Samples) -> tuple[str, bytes]:
    """The definition of the message's type, and the message in ROS's binary encoding."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise MissingExtraError("rosbags", "ros") from None
    store = get_typestore(Stores.ROS2_HUMBLE)
    types: Any = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=0, nanosec=0)
    points = []
    for time, (q, qd, qdd) in zip(_times(samples), _rows(samples), strict=True):
        sec, nanosec = divmod(time, _NANO)
        since = types["builtin_interfaces/msg/Duration"](sec=sec, nanosec=nanosec)
        points.append(types[f"{KIND}Point"](q, qd, qdd, np.zeros(0), since))
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    message = types[KIND](header=header, joint_names=list(samples.coordinates), points=points)
    definition, _ = store.generate_msgdef(KIND, ros_version=2)
    return definition, bytes(store.serialize_cdr(message, KIND))


def _times(samples: Samples) -> list[int]:
    """From the start, ns."""
    return [round(time * _NANO) for time in samples.t.tolist()]


def _rows(samples: Samples) -> list[tuple[Floats, Floats, Floats]]:
    """Positions, velocities and accelerations of each point."""
    q, qd, qdd = (np.ascontiguousarray(values, dtype=float) for values in samples.states if values is not None)
    return list(zip(q, qd, qdd, strict=True))


def _list(values: Floats) -> str:
    return f"[{', '.join(map(_number, values.tolist()))}]"


def _number(value: float) -> str:
    """All digits; YAML 1.1 takes 1e-05 for a text, unlike 1.0e-05."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


_STATES = ("positions", "velocities", "accelerations")
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


def from_mcap(path: str | os.PathLike[str], coordinates: Sequence[str]) -> Samples:
    """Samples from an MCAP file; messages of other types do not matter."""
    file = Mcap(path)
    readable = [topic for topic, reason in file.topics.items() if not reason]
    topics = [topic for topic, _, message in file.messages(readable, head=1) if _is_trajectory(message)]
    found = [message for _, _, message in file.messages(topics) if _is_trajectory(message)] if topics else []
    if len(found) != 1:
        where = f" in {', '.join(map(repr, sorted(set(topics))))}" if topics else ""
        problem = f"holds {len(found)} messages of the type {KIND}{where}; needs one"
        raise InputError(one_line(problem), source=file.source)
    return _samples(found[0], file.source, coordinates)


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
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"holds {type(name).__name__} where a name is needed", element="joint_names")
    return list(names)


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
        # text in YAML
        if isinstance(value, bool) or not isinstance(value, int | float | str) or not str(value).isascii():
            raise InputError(f"holds {type(value).__name__} where a number is needed", element=element)
        try:
            found.append(float(_DOT.sub("", value) if isinstance(value, str) else value))
        except (ValueError, OverflowError):
            raise InputError(f"{one_line(str(value))[:40]!r} is no number", element=element) from None
    return np.array(found)
