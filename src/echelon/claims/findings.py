"""The pieces of an audit: verdicts, wrong coefficients, witnesses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum

from echelon.base.expression import Expression
from echelon.claims.reading import Claim


class Verdict(Enum):
    """How a claimed set compares with the exact one; the first that applies, from the bottom of this list."""

    EQUAL = "equal"
    EQUAL_TO_PRINTED_DIGITS = "equal to the printed digits"
    REDUNDANT = "redundant"
    INCOMPLETE = "incomplete"
    WRONG = "wrong"


class Agreement(Enum):
    """How one claimed expression compares with what the outputs see."""

    EXACT = "exact"
    PRINTED_DIGITS = "agrees to the printed digits"
    WRONG = "wrong"


@dataclass(frozen=True)
class TermDifference:
    """A coefficient that is not what it has to be beside the other ones of its row."""

    parameter: str
    claimed: str  # coefficients; "0" where there is no such term
    expected: str  # coefficients; "0" where there is no such term
    difference: float | None  # claimed minus expected at the robot's geometry, if that is known

    def __str__(self) -> str:
        if self.expected == "0":
            return f"the term {self.claimed}·{self.parameter} does not belong here"
        if self.claimed == "0":
            return f"the term {self.expected}·{self.parameter} is missing"
        return f"{self.parameter} has the coefficient {self.claimed} instead of {self.expected}"


@dataclass(frozen=True)
class Witness:
    """A change of the standard parameters that the claimed set and the outputs disagree about."""

    change: Mapping[str, float]  # what is added to the standard parameters, SI units
    # what it changes in the claimed base parameters, by row number from 1; empty if nothing
    claimed: Mapping[int, float]
    # ``q``, ``qd``, ``qdd`` of an example, in the order of the mechanism's coordinates; ``i[name]`` for measured inputs
    state: Mapping[str, tuple[float, ...]]
    outputs: Mapping[str, float]  # change of the outputs in that state
    symbols: Mapping[str, float] = field(default_factory=dict)  # values that were assumed for symbols without one


@dataclass(frozen=True)
class Finding:
    """One claimed base parameter."""

    number: int  # its place in the claimed set, from 1
    claim: Claim
    agreement: Agreement
    redundant: bool  # whether it depends on the rows before it
    differences: tuple[TermDifference, ...] = ()  # what is wrong with it; empty unless the agreement is ``WRONG``
    largest_difference: float = 0.0  # largest difference of a coefficient that is within the printed digits
    witness: Witness | None = None  # for a wrong row: a change that no output sees, but this row does


@dataclass(frozen=True)
class Missing:
    """A base parameter that no claimed row sees."""

    expression: Expression
    witness: Witness  # a change that the outputs see, but no claimed row does
