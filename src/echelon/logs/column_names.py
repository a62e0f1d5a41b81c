"""What the name of a column says: ``q_rad_1``, ``/joint_states/position/elbow``, ``torques[0]``, ``time [ms]``.

A name is understood word by word, and only if every word is: ``tau_fric1`` is some torque, but not the measured one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

_WORDS = {
    "position": "q pos position positions angle angles",
    "velocity": "v qd dq qdot vel velocity velocities speed speeds",
    "acceleration": "a qdd ddq qddot acc accel acceleration accelerations",
    "output": "tau torque torques trq effort efforts force forces",
    "time": "t ts time times timestamp timestamps stamp",
}
_KINDS = {word: kind for kind, words in _WORDS.items() for word in words.split()}
_OTHERS = {
    "reference": "ref reference target targets des desired cmd command commanded setpoint sp",
    "motor": "motor motors actuator actuators",
    "neutral": "meas measured act actual read joint joints j state states",
}
_ROLES = {word: role for role, words in _OTHERS.items() for word in words.split()}
_UNITS = {
    "rad": "rad",
    "deg": "deg",
    "rads": "rad/s",
    "degs": "deg/s",
    "rads2": "rad/s²",
    "rpm": "rpm",
    "m": "m",
    "mm": "mm",
    "nm": "N·m",
    "mnm": "mN·m",
    "n": "N",
    "s": "s",
    "sec": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
}
_BRACKETS = re.compile(r"\s*[\[(]\s*([^\[\]()]*[A-Za-z°][^\[\]()]*?)\s*[\])]")
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z][a-z])")


@dataclass(frozen=True)
class Meaning:
    """What a column's name says.

    Attributes
    ----------
    kind : str
        ``position``, ``velocity``, ``acceleration``, ``output``, ``reference`` or ``time``.
    name : str
        Coordinate, output or actuator that it names; empty if it has none.
    index : int, optional
        Its number.
    motor : bool
        Whether it says that it was measured at a motor.
    unit : str
    """

    kind: str
    name: str = ""
    index: int | None = None
    motor: bool = False
    unit: str = ""


def meaning(column: str, names: Iterable[str]) -> Meaning | None:
    """What a column's name says; None if there is a word that is not understood.

    Parameters
    ----------
    column : str
    names : iterable of str
        Names that there are, of coordinates, outputs and actuators.

    Examples
    --------
    >>> meaning("q_rad_1", [])
    Meaning(kind='position', name='', index=1, motor=False, unit='rad')
    >>> meaning("/joint_states/effort/elbow", ["elbow"])
    Meaning(kind='output', name='elbow', index=None, motor=False, unit='')
    >>> meaning("tau_fric1", []) is None
    True
    """
    rest, unit, name = column, "", ""
    bracket = _BRACKETS.search(rest)
    if bracket:
        unit, rest = bracket.group(1), rest[: bracket.start()] + "_" + rest[bracket.end() :]
    for known in sorted(set(names), key=lambda n: (-len(n), n)):
        # a name that could also be a quantity's, such as q1, is left to its number
        parted = re.split(rf"(?<![A-Za-z0-9]){re.escape(known)}(?![A-Za-z0-9])", rest)
        if len(parted) == 2 and re.search("[A-Za-z]", "".join(parted)):
            rest, name = "_".join(parted), known
            break
    return _by_words(_HUMP.sub("_", rest), name, unit)


def _by_words(text: str, name: str, unit: str) -> Meaning | None:
    kind, index = "", None
    roles: set[str] = set()
    for word in re.findall(r"[a-z0-9°]+", text.lower()):
        letters, digits = (word, "") if word in _UNITS else re.fullmatch(r"(.*?)(\d*)", word).groups()  # type: ignore[union-attr]
        if digits:
            if index is not None:
                return None
            index = int(digits)
        if letters in _KINDS and not kind:
            kind = _KINDS[letters]
        elif not letters or letters in _ROLES:
            roles.add(_ROLES.get(letters, ""))
        elif letters in _UNITS and not unit:
            unit = _UNITS[letters]
        else:
            return None
    reference = "reference" in roles
    if not kind or (reference and kind != "position") or (name and index is not None):
        return None
    return Meaning("reference" if reference else kind, name, index, "motor" in roles, unit)
