"""Exact numbers of XML documents, and errors that name the element."""

from __future__ import annotations

from typing import Any

from echelon.algebra import Rational, parse_decimal
from echelon.formats.literal import LiteralPlacement, Triple
from echelon.formats.snapping import checked_size, is_tiny
from echelon.shared import InputError


class ExactXml:
    """Exact numbers of an XML document, and errors that name the element."""

    def __init__(self, source: str, tiny: list[str] | None = None) -> None:
        """``tiny`` takes the places of numbers that are read as zero."""
        self.source, self.tiny = source, [] if tiny is None else tiny

    def error(self, problem: str, element: str | None = None) -> InputError:
        """An error about an element."""
        return InputError(problem, source=self.source, element=element)

    def number(self, text: str, where: str) -> Rational:
        """An exact number; a tiny one is zero, and its place kept."""
        try:
            value = parse_decimal(text.strip())
            if is_tiny(value):
                self.tiny.append(f"{where} = {text.strip()}")
                return 0
            return checked_size(value, text)
        except ValueError as error:
            raise self.error(str(error), where) from None

    def triple(self, text: str | None, usual: Triple, where: str) -> Triple:
        """Three numbers."""
        if text is None:
            return usual
        parts = text.split()
        if len(parts) != len(usual):
            raise self.error(f"needs three numbers, found '{text}'", where)
        x, y, z = (self.number(part, where) for part in parts)
        return (x, y, z)

    def origin(self, element: Any, where: str) -> LiteralPlacement:
        """The frame that <origin> in an element states; the element's own without one."""
        origin = None if element is None else element.find("origin")
        if origin is None:
            return LiteralPlacement(f"{where} origin")
        return self.placement(origin, f"{where} origin")

    def placement(self, element: Any, where: str) -> LiteralPlacement:
        """The frame that an element states by the attributes xyz and rpy."""
        xyz, rpy = (
            self.triple(element.get(key), (0, 0, 0), f"{where} {key}")
            for key in ("xyz", "rpy")
        )
        return LiteralPlacement(where, xyz, rpy)
