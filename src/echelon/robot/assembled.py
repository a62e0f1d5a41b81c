"""Moves of coordinates from a stated assembly pose, or zero, to one that closes the loops."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from echelon.shared import AssemblyWarning, InputError

_LARGE, _TOO_LARGE = 0.1, 2.0
"""Moves of coordinates to a closed pose that are told, and that are refused, rad or characteristic lengths."""


@dataclass(frozen=True)
class Moved:
    """Move of one coordinate that closed the loops."""

    coordinate: str  # name of a motion; a ball counts as one
    distance: float  # in its unit; of a ball, the angle
    unit: str  # ``"rad"`` or ``"m"``
    relative: float  # the same in rad or characteristic lengths of the mechanism
    stated: bool  # whether the assembly pose says where the coordinate is


@dataclass(frozen=True)
class Assembled:
    """Moves that closed the loops, where the stated assembly pose, or zero, does not."""

    moved: tuple[Moved, ...]  # what moved by more than rounding, the largest move first
    closure: str  # the closure that was open most
    opening: float  # by how much, in its unit
    unit: str
    pose: Mapping[str, float]  # the closed pose that is taken

    @property
    def large(self) -> bool:
        """Whether something moved by more than 0.1 rad or a tenth of the characteristic length."""
        return bool(self.moved) and self.moved[0].relative > _LARGE

    def check(self) -> None:
        """Warn of a large move; refuse one of more than 2 rad or lengths where the position is stated."""
        far = next(
            (m for m in self.moved if m.stated and m.relative > _TOO_LARGE), None
        )
        if far is not None:
            problem = f"{self._open()}, and the nearest closed pose that was found is far from it: {_by([far])}"
            raise InputError(f"{problem}.  {self._to_write()}", element="assembly")
        if self.large:
            warnings.warn(f"{self}.  {self._to_write()}", AssemblyWarning, stacklevel=2)

    def __str__(self) -> str:
        return f"{self._open()}; the loops were closed by moving {_by(self.moved[:1])}"

    def _open(self) -> str:
        where = (
            "the stated assembly pose" if any(m.stated for m in self.moved) else "zero"
        )
        return f"at {where} closure '{self.closure}' is open by {self.opening:.3g} {self.unit}"

    def _to_write(self) -> str:
        return f"If this pose is right, write  {to_write(self.pose)};  else state one at which the loops close"


def to_write(pose: Mapping[str, float]) -> str:
    """The line of a description that states a pose."""
    return f"assembly: {{{', '.join(f'{name}: {value:.6g}' for name, value in pose.items())}}}"


def _by(moved: Sequence[Moved]) -> str:
    return ", ".join(f"'{m.coordinate}' by {m.distance:.3g} {m.unit}" for m in moved)
