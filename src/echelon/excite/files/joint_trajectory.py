"""Trajectories as messages ``trajectory_msgs/JointTrajectory`` of ROS 2, without ROS.

The message starts at once (its stamp is 0) and a point holds positions, velocities and accelerations.  As YAML it is
what ``ros2 topic pub`` takes; as MCAP it is a recording that ``ros2 bag play`` sends.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import MissingExtraError
from echelon.excite.files.samples import Samples
from echelon.version import __version__

KIND = "trajectory_msgs/msg/JointTrajectory"
"""Type of the message."""

TOPIC = "/joint_trajectory_controller/joint_trajectory"
"""Where ROS 2's own controller listens."""

RESOLUTION = 1e-9
"""Steps of the message's times, s."""

_NANO = 10**9


def yaml_text(samples: Samples) -> str:
    """The message as YAML.

    Parameters
    ----------
    samples : Samples
    """
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
    """An MCAP file of this one message, with the definition of its type.

    Parameters
    ----------
    samples : Samples

    Raises
    ------
    MissingExtraError
        If mcap or rosbags is not installed.
    """
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
