"""Frames of SDF models: links, joints and named frames, each placed in another one by a pose.

A pose is kept as the numbers of the file.  What lies between two frames is the way from one up to where both hang and
down to the other, so inverses are exact, and what is common to both never counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, radians
from typing import Any

from echelon.errors import InputError
from echelon.exact.expressions import STEPS_PER_HALF_TURN
from echelon.exact.numbers import Rational, parse_decimal
from echelon.formats.literal import LiteralPlacement, Triple, numeric_placements
from echelon.formats.mjcf.mjcf_numbers import exact_angle, exact_number, placements, placements_of
from echelon.formats.reading_options import ANGLE_TOLERANCE, checked_size
from echelon.hints import nearest_of

WORLD, MODEL = "world", "__model__"
_SIX, _SEVEN = 6, 7
_DIGITS = 15  # decimals of a metre


_MOST_GENERAL = 2
"""Rotations by general angles that are multiplied exactly; products of more have too many terms."""


@dataclass(frozen=True)
class SdfFrame:
    """A frame of a model."""

    name: str
    kind: str  # tag of the element that states it
    carrier: str  # the frame with which it moves; empty for a link, which moves by itself
    base: str  # the frame in which its pose is stated
    pose: tuple[LiteralPlacement, ...]


class SdfFrames:
    """All frames of a model, by name."""

    def __init__(self, source: str) -> None:
        self.source = source
        self.known = {WORLD: SdfFrame(WORLD, "world", "", "", ())}

    def add(self, frame: SdfFrame) -> None:
        """One more frame, whose name nothing else has."""
        if frame.name in self.known:
            raise self.error("this name occurs twice; names must be unique", f"{frame.kind} '{frame.name}'")
        self.known[frame.name] = frame

    def link(self, name: str, element: str) -> str:
        """The link, or the world, that carries a frame."""
        seen: list[str] = []
        while self._frame(name, element).carrier:
            if name in seen:
                raise self.error(f"the frames {' -> '.join([*seen, name])} are attached in a circle", element)
            seen.append(name)
            name = self.known[name].carrier
        return name

    def between(self, start: str, end: str, element: str) -> tuple[LiteralPlacement, ...]:
        """Where one frame is in another one."""
        down, up = self._way(end, element), self._way(start, element)
        common = 0
        while common < min(len(down), len(up)) and down[common] == up[common]:
            common += 1
        inward = [replace(p, inverse=True) for name in reversed(up[common:]) for p in reversed(self.known[name].pose)]
        way = (*inward, *(p for name in down[common:] for p in self.known[name].pose))
        return way if sum(_is_general(p) for p in way) <= _MOST_GENERAL else _as_one(way, element)

    def _way(self, name: str, element: str) -> list[str]:
        """From the world to a frame."""
        way: list[str] = []
        while name:
            if name in way:
                raise self.error(f"the poses of {' -> '.join([*way, name])} refer to each other in a circle", element)
            way.append(name)
            name = self._frame(name, element).base
        return way[::-1]

    def _frame(self, name: str, element: str) -> SdfFrame:
        if name not in self.known:
            raise self.error(f"there is no link, joint or frame '{name}'{nearest_of(name, self.known)}", element)
        return self.known[name]

    # -- numbers ---------------------------------------------------------------------------------------------------

    def pose(self, element: Any, where: str) -> tuple[LiteralPlacement, ...]:
        """The pose that an element states."""
        stated = element.find("pose")
        text = "" if stated is None else (stated.text or "")
        if not text.strip():
            return ()
        turned = stated.get("rotation_format", "euler_rpy") == "quat_xyzw"
        numbers = [self.number(part, f"{where} pose") for part in text.split()]
        if len(numbers) != (_SEVEN if turned else _SIX):
            raise self.error(f"needs {_SEVEN if turned else _SIX} numbers, found '{text.strip()}'", f"{where} pose")
        x, y, z, *rest = numbers
        if turned:
            if not any(rest):
                raise self.error("the quaternion is zero", f"{where} pose")
            return placements(f"{where} pose", (x, y, z), [float(rest[k]) for k in (3, 0, 1, 2)])
        if stated.get("degrees", "false") in ("true", "1"):
            rest = [exact_angle(radians(angle)) for angle in rest]
        roll, pitch, yaw = rest
        return (LiteralPlacement(f"{where} pose", (x, y, z), (roll, pitch, yaw)),)

    def triple(self, text: str | None, usual: Triple, where: str) -> Triple:
        """Three numbers."""
        if text is None or not text.strip():
            return usual
        parts = [self.number(part, where) for part in text.split()]
        if len(parts) != len(usual):
            raise self.error(f"needs three numbers, found '{text.strip()}'", where)
        x, y, z = parts
        return (x, y, z)

    def number(self, text: str, where: str) -> Rational:
        """An exact number."""
        try:
            return checked_size(parse_decimal(text.strip()), text)
        except ValueError as error:
            raise self.error(str(error), where) from None

    def error(self, problem: str, element: str | None = None) -> InputError:
        """An error about an element."""
        return InputError(problem, source=self.source, element=element)


def _is_general(placement: LiteralPlacement) -> bool:
    """Whether a placement turns by angles that are no multiples of 15°."""
    step = pi / STEPS_PER_HALF_TURN
    return any(abs(a - step * round(a / step)) > ANGLE_TOLERANCE for a in map(float, placement.rpy))


def _as_one(way: tuple[LiteralPlacement, ...], element: str) -> tuple[LiteralPlacement, ...]:
    """Several placements as one, rounded as doubles are."""
    rotation, translation = numeric_placements(way)
    x, y, z = (exact_number(round(float(v), _DIGITS)) for v in translation)
    return placements_of(element, (x, y, z), rotation)
