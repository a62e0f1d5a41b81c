"""Contacts with the surroundings, through which forces act that nobody measures: feet, hands and wheels.

A contact keeps some components of the velocity of a frame on a body at zero, and a force or moment of unknown size acts
along each of them.  Virtual motions that keep them at zero, too, do not feel these forces.  Where in the world the
contact is does not matter: the base floats, and feet may stand anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from echelon.algebra import Polynomial
from echelon.robot.joint import Placement


class ContactKind(Enum):
    """Kinds of contacts, by the axes about which the body cannot turn; its frame's origin never slips."""

    POINT = "point"
    LINE = "line"
    SURFACE = "surface"
    ROLLING = "rolling"

    @property
    def held_axes(self) -> tuple[int, ...]:
        """Axes of the frame about which the body cannot turn; a line is along x."""
        return {"line": (1, 2), "surface": (0, 1, 2)}.get(self.value, ())

    @property
    def components(self) -> tuple[str, ...]:
        """Components of the wrench that acts on the body, in the frame's axes."""
        return ("fx", "fy", "fz", *(f"t{'xyz'[axis]}" for axis in self.held_axes))


@dataclass(frozen=True)
class Contact:
    """A place where a body touches the ground, an object or a tool."""

    name: str
    kind: ContactKind
    body: int  # index of the body
    frame: Placement  # in the body's frame; of a rolling body at its centre
    # of a ball, or of a wheel that stays upright: it touches the ground that far below its centre
    radius: Polynomial = Polynomial({})
    measured: tuple[str, ...] = ()  # components that a force plate measures
