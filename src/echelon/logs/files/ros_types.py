"""Types of ROS 2 messages, through rosbags: no ROS has to be installed.

Bags carry the definitions of their messages since ROS 2 Iron.  Older ones do not, so that what is missing is taken from
Humble, the last release before it; standard messages have not changed since.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from echelon.errors import MissingExtraError

_RULE = "=" * 80 + "\n"


@dataclass(frozen=True)
class Definition:
    """How a bag defines a type.

    Attributes
    ----------
    name : str
        Such as ``sensor_msgs/msg/JointState``.
    language : str
        ``"msg"`` or ``"idl"``; empty if the bag does not define it.
    text : str
    """

    name: str
    language: str
    text: str


class RosTypes:
    """Decodes messages of the types that a bag defines.

    Parameters
    ----------
    definitions : iterable of Definition

    Raises
    ------
    MissingExtraError
        If rosbags is not installed.

    Attributes
    ----------
    left_out : mapping of str to str
        Types whose messages cannot be decoded, and why.
    """

    def __init__(self, definitions: Iterable[Definition]) -> None:
        try:
            from rosbags.typesys import Stores, TypesysError, get_typestore
        except ImportError:
            raise MissingExtraError("rosbags", "ros") from None

        self.left_out: dict[str, str] = {}
        needed = {definition.name: definition for definition in definitions}
        types: dict[str, Any] = {}
        for name, definition in needed.items():
            try:
                types |= _parsed(definition)
            except TypesysError as error:
                self.left_out[name] = f"its type {name} is not defined properly in the bag: {error}"
        if any(name not in types and name not in self.left_out for name in needed):
            types = {**get_typestore(Stores.ROS2_HUMBLE).fielddefs, **types}
        for name in needed:
            if name not in types and name not in self.left_out:
                self.left_out[name] = f"its type {name} is defined neither in the bag nor by ROS 2"
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(types)

    def decode(self, name: str, message: bytes) -> Any:
        """A message as an object with its fields.

        Parameters
        ----------
        name : str
            Its type.
        message : bytes
            In ROS's binary encoding, CDR.
        """
        return self._store.deserialize_cdr(message, name)


def ros_name(name: str) -> str:
    """A type's name with its middle part, which some recorders leave out.

    Parameters
    ----------
    name : str

    Examples
    --------
    >>> ros_name("sensor_msgs/JointState")
    'sensor_msgs/msg/JointState'
    """
    package, _, rest = name.partition("/")
    return f"{package}/msg/{rest}" if rest and "/" not in rest else name


def _parsed(definition: Definition) -> dict[str, Any]:
    """Parsed types of a definition, with those that it uses."""
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if definition.language == "msg":
        return dict(get_types_from_msg(definition.text, definition.name))
    if definition.language == "idl":
        parts = definition.text.split(_RULE) if definition.text.startswith(_RULE) else [definition.text]
        found: dict[str, Any] = {}
        for part in filter(None, parts):
            found |= get_types_from_idl(part.split("\n", 1)[1] if part.startswith("IDL: ") else part)
        return found
    return {}
