"""Bodies, and the symbols of their geometry."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.conventions import PER_BODY
from echelon.errors import InputError, one_line
from echelon.exact.expressions import parse
from echelon.exact.numbers import Number
from echelon.exact.polynomial import Polynomial
from echelon.mechanism.joint import Joint

GROUND = -1
"""Parent index of a body that hangs on the fixed world."""

ALL = tuple(range(PER_BODY))
"""All ten standard parameters of a body."""


@dataclass(frozen=True)
class Body:
    """One rigid body."""

    name: str  # name in the file
    # short label that names its parameters: ``"3"`` gives XX3 … M3.  Bodies with one label, such as those of identical
    # legs, share one set of parameters, each about its own frame
    label: str
    parent: int  # index of the parent body, or :data:`GROUND`
    joint: Joint  # connects the parent's frame to this body's frame
    # which of XX … M it carries; none for a massless body, ZZ for a rotor whose other inertia counts to its carrier
    carried: tuple[int, ...] = ALL
    # standard parameters stated by the file, about the body's frame; None where the file is silent
    inertial: tuple[float, ...] | None = None

    @property
    def massless(self) -> bool:
        """Whether it carries no parameters."""
        return not self.carried


@dataclass(frozen=True)
class Symbol:
    """A geometry symbol."""

    name: str
    value: float | None = None  # numeric value in SI units, if known
    exact: str | None = None  # the value as exact text, where it has one (``"0.333"``, ``"sqrt(2)/10"``)
    meaning: str = ""  # where the symbol comes from, for people
    # what it is in terms of angle symbols, where a reader named a sum such as 0.1 + 0.3·cos(roll2)
    stands_for: Polynomial | None = None

    @property
    def number(self) -> Number | None:
        """The exact value, where it is a number of the field of exact numbers."""
        return None if (value := self.expression) is None else value.number

    @property
    def expression(self) -> Polynomial | None:
        """The exact value, perhaps with π as a generator."""
        if self.exact is None:
            return None
        try:
            return parse(self.exact)
        except ValueError as error:
            raise InputError(str(error), element=f"symbol '{one_line(self.name)}'") from None
