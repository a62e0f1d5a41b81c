"""How finely a file states its inertial values: the last decimals of masses, their centres and moments."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from echelon.formats.robot_file import RobotFile
from echelon.formats.rounding import last_decimal
from echelon.shared import PARAMETERS

_MASS, _CENTRE, _MOMENT = range(3)
_INERTIAL_KEYS = {
    **dict.fromkeys(("mass", "value"), _MASS),
    **dict.fromkeys(("com", "xyz", "pos", "pose"), _CENTRE),
    **dict.fromkeys(("diaginertia", "fullinertia"), _MOMENT),
    **dict.fromkeys(("xx", "xy", "xz", "yy", "yz", "zz"), _MOMENT),
    **dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), _MOMENT),
}
"""Which inertial value the attributes and elements of all formats state."""
_COORDINATES = 3  # of a centre of mass; those of a pose are followed by angles


def inertial_rounding(file: RobotFile) -> tuple[float, float, float]:
    """Units of the last decimals of masses (kg), their centres (m) and moments (kg·m²); 0 if all are short."""
    numbers: tuple[list[Fraction], ...] = ([], [], [])
    for key, text in _inertial_texts(file):
        kind = _INERTIAL_KEYS.get(key)
        if kind is None:
            continue
        words = text.split()[: _COORDINATES if kind == _CENTRE else None]
        for word in words:
            try:
                numbers[kind].append(Fraction(word))
            except ValueError:  # a formula of a description is exact
                continue
    mass, centre, moment = (last_decimal(found) for found in numbers)
    return mass, centre, moment


def _inertial_texts(file: RobotFile) -> Iterator[tuple[str, str]]:
    """Keys and values inside of inertial elements, as they stand in a file."""
    if file.is_description:
        yield from _described_texts(file.document.data, "")
    if (robot := file.robot) is None:
        return
    for inertial in robot.root.iter("inertial"):
        for element in inertial.iter():
            yield from element.attrib.items()
            yield str(element.tag), element.text or ""


def _described_texts(data: Any, inside: str) -> Iterator[tuple[str, str]]:
    if isinstance(data, dict):
        for key, value in data.items():
            yield from _described_texts(
                value, str(key) if inside or key == "inertial" else ""
            )
    elif isinstance(data, list) and inside == "standard":
        keys = (*(name.lower() for name in PARAMETERS[:6]), "com", "com", "com", "mass")
        yield from zip(keys, map(str, data), strict=False)
    elif isinstance(data, list):
        for value in data:
            yield from _described_texts(value, inside)
    elif inside:
        yield inside, str(data)
