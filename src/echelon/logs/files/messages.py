"""Numbers in messages: what a message of a bag holds, whatever its type.

Messages are walked as they come, decoded from ROS's CDR or from JSON alike, with no table of known types: a robot's own
messages are as welcome as the standard ones.  One convention is known: where a message lists names (joints of a
``JointState``), its arrays go by these names and not by position, because publishers may change the order.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from echelon.errors import InputError, one_line

Labels = tuple[str, ...] | int | None
"""Names of an array's entries, or how many there are, or None for a single number."""

_NAME_FIELDS = ("name", "names", "joint_names", "interface_names")
_NANOSECONDS = ("nanosec", "nsec", "nsecs", "nanosecs")
END_OF_TIME = 2**63
"""Nanoseconds that do not fit into 64 bits any more."""
_SECONDS = ("sec", "secs")
_LONGEST = 256


@dataclass
class Numbers:
    """The numbers of one message.

    Attributes
    ----------
    topic : str
    parts : list of (path, labels, values)
        A field's path, beginning with the topic; how its entries are told apart; and they themselves.
    left_out : mapping of str to str
        Paths of what is no column, and why.
    """

    topic: str
    parts: list[tuple[str, Labels, Sequence[float]]] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)

    def visit(self, value: Any, path: str, names: tuple[str, ...] = ()) -> None:
        """Take in a field and what is inside it.

        Parameters
        ----------
        value : object
            A number, array, list, mapping or decoded ROS message; other things hold no numbers.
        path : str
            Where it is, beginning with the topic.
        names : tuple of str
            Names that the message around it lists.
        """
        if isinstance(value, bool | int | float):
            self.parts.append((path, None, (value,)))
        elif isinstance(value, np.ndarray):
            if value.size > _LONGEST:  # such as the pixels of an image
                self._leave_out(path, value.size)
            else:
                self._numbers(value.ravel().tolist(), path, names)
        elif isinstance(value, list):
            self._list(value, path, names)
        else:
            self._fields(fields(value), path, names)

    def _fields(self, found: Sequence[tuple[str, Any]], path: str, names: tuple[str, ...]) -> None:
        own = self._names(found, path) or names
        for name, value in found:
            if name in ("stamp", "timestamp") and self._is_clock(f"{path}/{name}", value):
                continue
            self.visit(value, f"{path}/{name}", own)

    def _list(self, values: list[Any], path: str, names: tuple[str, ...]) -> None:
        if all(entry is None or isinstance(entry, bool | int | float) for entry in values):
            self._numbers([float("nan") if entry is None else entry for entry in values], path, names)
        elif len(values) > _LONGEST:
            self._leave_out(path, len(values))
        elif not isinstance(values[0], str):
            labels = [f"/{name}" for name in names] if len(names) == len(values) else None
            for index, entry in enumerate(values):
                self.visit(entry, path + (labels[index] if labels else f"[{index}]"))

    def _numbers(self, values: list[float], path: str, names: tuple[str, ...]) -> None:
        if len(values) > _LONGEST:
            self._leave_out(path, len(values))
        elif values:
            self.parts.append((path, names if len(names) == len(values) else len(values), values))

    def _leave_out(self, path: str, length: int) -> None:
        self.left_out[path] = f"has {length} entries; arrays of at most {_LONGEST} become columns"

    def _names(self, found: Iterable[tuple[str, Any]], path: str) -> tuple[str, ...]:
        """Names that a message lists for the entries of its arrays."""
        for name, value in found:
            if name in _NAME_FIELDS and isinstance(value, list) and value and all(isinstance(n, str) for n in value):
                if len(set(value)) != len(value):
                    twice = next(entry for entry in value if value.count(entry) > 1)
                    raise InputError(f"a message names '{one_line(twice)}' twice", element=f"'{path}/{name}'")
                return tuple(value)
        return ()

    def _is_clock(self, path: str, value: Any) -> bool:
        return path in (f"{self.topic}/header/stamp", f"{self.topic}/timestamp") and nanoseconds(value) is not None


def fields(message: Any) -> list[tuple[str, Any]]:
    """The fields of a decoded message, none for anything else.

    Parameters
    ----------
    message : mapping or dataclass
    """
    if isinstance(message, dict):
        return [(str(name), value) for name, value in message.items()]
    names = getattr(type(message), "__dataclass_fields__", ())
    return [(name, getattr(message, name)) for name in names if not name.startswith("__")]


def stamp(message: Any) -> int | None:
    """The time that a message carries, ``header.stamp`` or ``timestamp``, ns; None without one.

    Parameters
    ----------
    message : mapping or dataclass

    Examples
    --------
    >>> stamp({"header": {"stamp": {"sec": 2, "nanosec": 7}}, "data": 0.5})
    2000000007
    """
    found = dict(fields(message))
    inside = dict(fields(found.get("header")))
    return nanoseconds(inside["stamp"]) if "stamp" in inside else nanoseconds(found.get("timestamp"))


def nanoseconds(value: Any) -> int | None:
    """A time of two integers, seconds and nanoseconds, as one; None for anything else.

    Parameters
    ----------
    value : mapping or dataclass

    Raises
    ------
    InputError
        If so many nanoseconds do not fit into 64 bits.
    """
    found = dict(fields(value))
    seconds = next((found[name] for name in _SECONDS if name in found), None)
    rest = next((found[name] for name in _NANOSECONDS if name in found), None)
    if len(found) != 2 or not isinstance(seconds, int) or not isinstance(rest, int):
        return None
    time = seconds * 10**9 + rest
    if abs(time) >= END_OF_TIME:
        raise InputError("a message's time is further away than 292 years, which no clock says", element="stamp")
    return time
