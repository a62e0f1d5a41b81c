"""Result of a comparison, as an object, as text and as JSON-able data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any

from echelon.base import GeometryDifference
from echelon.comparison.outputs import PARTS
from echelon.shared import one_line, public, published_schema, schema_of, shortened

SCHEMA_NAME = "echelon.comparison/1"
_LISTED, _LONGEST = 8, 100
"""Differences of one kind that the text lists, and characters of an expression; an object and JSON have all."""
_BELOW = "below the files' last decimals"


@public
class Equality(StrEnum):
    """Whether two robots are equal up to what their sensors see."""

    EQUAL = "equal"
    DIFFERENT = "different"
    UNDECIDED = "undecided"


@dataclass(frozen=True)
class ParameterDifference:
    """A standard parameter that differs, about the first robot's frames."""

    name: str
    body: str  # of the first robot; empty for a parameter of an effect
    unit: str
    first: float
    second: float
    visible: bool  # whether a base parameter that differs depends on it
    # whether outputs show it by no more than the last decimals of the files explain
    rounded: bool


@dataclass(frozen=True)
class BaseDifference:
    """A base parameter that differs by more than the rounding of the files."""

    name: str  # representative
    body: str  # of the first robot; empty for a parameter of an effect
    expression: str
    unit: str
    first: float
    second: float
    output: str  # where this difference alone shows most, of some states
    effect: float  # by how much there, N·m or N


@dataclass(frozen=True)
class Largest:
    """The largest difference of an output, or of a part of it."""

    attained: float  # N·m or N, in the state
    bound: float | None  # that no state within limits exceeds; None with loops
    state: Mapping[str, tuple[float, ...]]  # q, qd, qdd in the order of ``coordinates``


@dataclass(frozen=True)
class OutputComparison:
    """One output of both robots."""

    name: str
    unit: str
    tolerance: float  # up to which it counts as equal
    total: Largest
    parts: Mapping[str, Largest]  # gravity, acceleration, velocity, effects


@public
@dataclass(frozen=True, repr=False)
class Comparison:
    """Two robots, compared by what their sensors see.

    Made by :func:`echelon.compare`.

    Attributes
    ----------
    first, second : str
        Names of the robots.
    verdict : Equality
        Undecided where no state was met that tells them apart, and the bounds do not exclude one.
    matched : tuple of (str, str)
        Joint coordinates of the first and of the second robot that correspond.
    geometry : tuple of GeometryDifference
        Differences of axes, zeros, directions and gravity, from the base on.
    moved : tuple of float
        Translation (m) and turn (rad) between the base frames in which the axes agree.
    rank : int
        Base parameters of the first robot.
    rounded : int
        Base parameters that differ, but by no more than the last decimals of the files explain.
    base : tuple of BaseDifference
        Visible differences, in base parameters of the first robot.
    parameters : tuple of ParameterDifference
        Standard parameters that differ, visible or not.
    cancelled : tuple of tuple of str
        Bodies whose differences no output shows, alone or together: those between which mass was moved.
    outputs : tuple of OutputComparison
    coordinates : mapping of str to tuple of str
        Names of the first robot's ``q``, ``qd`` and ``qdd`` in example states.
    limits : mapping of str to (float, float)
        Ranges of all that varies, ``q[...]``, ``qd[...]`` and ``qdd[...]``.
    notes : tuple of str
        What was assumed.
    """

    first: str
    second: str
    verdict: Equality
    matched: tuple[tuple[str, str], ...]
    geometry: tuple[GeometryDifference, ...]
    moved: tuple[float, float]
    rank: int
    rounded: int
    base: tuple[BaseDifference, ...]
    parameters: tuple[ParameterDifference, ...]
    cancelled: tuple[tuple[str, ...], ...]
    outputs: tuple[OutputComparison, ...]
    coordinates: Mapping[str, tuple[str, ...]]
    limits: Mapping[str, tuple[float, float]]
    notes: tuple[str, ...]

    @property
    def invisible(self) -> tuple[ParameterDifference, ...]:
        """Differences of standard parameters that no output shows."""
        hidden = (p for p in self.parameters if not (p.visible or p.rounded))
        return tuple(hidden)

    def __bool__(self) -> bool:
        return self.verdict is Equality.EQUAL

    @property
    def _worst(self) -> OutputComparison:
        """The output that differs most."""
        return max(self.outputs, key=lambda output: output.total.attained)

    def __repr__(self) -> str:
        told = ""
        if self.outputs and not self:
            worst = self._worst
            told = f"; up to {worst.total.attained:.3g} {worst.unit} in {worst.name}"
        return f"Comparison({self.first} and {self.second}: {self.verdict}{told})"

    def __str__(self) -> str:
        return self.to_text()

    def to_text(self) -> str:
        """Verdict, what was matched, differences and outputs, a line each."""
        lines = [*self.heading(), ""]
        table = self.table()
        widths = [max(map(len, column)) for column in zip(*table, strict=True)]
        for row in table:
            cells = [
                cell.rjust(width)
                for cell, width in zip(row[1:], widths[1:], strict=True)
            ]
            lines.append("  ".join([row[0].ljust(widths[0]), *cells]))
        return (
            "\n".join(one_line(line).rstrip() for line in [*lines, "", *self.closing()])
            + "\n"
        )

    def heading(self) -> list[str]:
        """Verdict, pairs, geometry, base parameters, and differences that nobody sees, a line each."""
        seen = {
            Equality.EQUAL: "equal in all outputs",
            Equality.DIFFERENT: "different",
            Equality.UNDECIDED: "no difference found, but the bounds do not exclude one",
        }[self.verdict]
        if self.rounded and self.verdict is Equality.EQUAL:
            seen += f", with differences {_BELOW}"
        renamed = [f"{one} = {other}" for one, other in self.matched if one != other]
        lines = [f"{self.first} and {self.second}: {seen}"]
        lines.append(
            f"matched by name: {len(self.matched) - len(renamed)} joint coordinates"
        )
        lines += _shown("matched by axes", renamed)
        if any(self.moved):
            lines.append(
                f"base frames: {self.moved[0]:.6g} m and {self.moved[1]:.6g} rad apart, which moves no joint"
            )
        lines += _shown("geometry", self.geometry) or ["geometry: the same"]
        more = f", {self.rounded} more {_BELOW}" if self.rounded else ""
        lines.append(f"base parameters: {len(self.base)} of {self.rank} differ{more}")
        # many differences of one kind would hide all of the other
        lines += _in_one_line([found for found in self.base if not found.body])
        inertial = (found for found in self.base if found.body)
        lines += _shown("  visible", map(_described, inertial))
        for bodies in self.cancelled:
            lines.append(f"  invisible: all differences of {' and '.join(bodies)}")
        cancelled = {body for bodies in self.cancelled for body in bodies}
        alone = (p for p in self.invisible if p.body not in cancelled)
        lines += _shown("  invisible", map(_stated, alone))
        below = (p for p in self.parameters if p.rounded)
        lines += _shown(f"  {_BELOW}", map(_stated, below))
        return lines

    def table(self) -> list[tuple[str, ...]]:
        """Outputs with the largest differences, attained and at most, and the parts; the first row is the head."""
        head = ("output", "largest", "at most", "tolerance", *PARTS)
        found: list[tuple[str, ...]] = [head]
        for output in self.outputs:
            total = output.total
            most = "" if total.bound is None else f"{total.bound:.3g}"
            parts = (f"{part.attained:.3g}" for part in output.parts.values())
            found.append(
                (
                    f"{output.name} ({output.unit})",
                    f"{total.attained:.3g}",
                    most,
                    f"{output.tolerance:.2g}",
                    *parts,
                )
            )
        return found

    def closing(self) -> list[str]:
        """An example state of the output that differs most, and notes."""
        lines = []
        if self.outputs and not self:
            worst = self._worst
            state = ", ".join(
                f"{name} = ({', '.join(f'{x:.4g}' for x in values)})"
                for name, values in worst.total.state.items()
            )
            lines.append(
                f"example: {worst.name} differs by {worst.total.attained:.6g} {worst.unit} at {state}"
            )
        return lines + [f"note: {note}" for note in self.notes]

    def to_dict(self) -> dict[str, Any]:
        """JSON-able data, a document of the published schema."""
        return {"schema": SCHEMA_NAME, **asdict(self)}


def _described(found: BaseDifference) -> str:
    values = f"{found.first:.6g} and {found.second:.6g} {found.unit}"
    expression = shortened(found.expression, _LONGEST)
    return f"{expression}: {values}, up to {found.effect:.3g} in {found.output}"


def _in_one_line(effects: Sequence[BaseDifference]) -> list[str]:
    """The difference of friction, springs or rotors that shows most, and how many more there are; at most a line."""
    if not effects:
        return []
    more = len(effects) - 1
    others = f"; and {more} more of friction, springs or rotors" if more else ""
    return [f"  visible: {_described(effects[0])}{others}"]


def _stated(found: ParameterDifference) -> str:
    values = f"{found.first:.6g} and {found.second:.6g} {found.unit}"
    body = f" ({found.body})" if found.body else ""
    return f"{found.name}{body}: {values}"


def _shown(title: str, entries: Iterable[object]) -> list[str]:
    """Entries under a title, one a line, and how many more there are."""
    found = [str(entry) for entry in entries]
    more = [f"{len(found) - _LISTED} more"] if len(found) > _LISTED else []
    return [f"{title}: {entry}" for entry in [*found[:_LISTED], *more]]


def comparison_schema() -> dict[str, Any]:
    """The JSON schema of :meth:`Comparison.to_dict`."""
    schema = schema_of(Comparison)
    schema["properties"] = {"schema": {"const": SCHEMA_NAME}, **schema["properties"]}
    schema["required"] = ["schema", *schema["required"]]
    return published_schema("comparison", schema)
