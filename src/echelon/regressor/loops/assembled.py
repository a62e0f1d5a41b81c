"""How far the closed pose that a mechanism with loops is taken in lies from the one that is stated."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from echelon.errors import AssemblyWarning, InputError

ROUNDING = 1e-6
"""Moves up to this size, rad or characteristic lengths, are not worth a word."""
_LARGE, _TOO_LARGE = 0.1, 2.0  # rad or characteristic lengths


@dataclass(frozen=True)
class Moved:
    """How far one coordinate was moved to close the loops.

    Attributes
    ----------
    coordinate : str
        Name of a motion; a ball counts as one.
    distance : float
        In its unit; of a ball, the angle.
    unit : str
        ``"rad"`` or ``"m"``.
    relative : float
        The same in rad or characteristic lengths of the mechanism.
    stated : bool
        Whether the assembly pose says where the coordinate is.
    """

    coordinate: str
    distance: float
    unit: str
    relative: float
    stated: bool


@dataclass(frozen=True)
class Assembled:
    """What had to be moved because the stated assembly pose, or zero, does not close the loops.

    Attributes
    ----------
    moved : tuple of Moved
        What moved by more than rounding, the largest move first.
    closure : str
        The closure that was open most.
    opening : float
        By how much, in its unit.
    unit : str
    pose : mapping of str to float
        The closed pose that is taken.
    """

    moved: tuple[Moved, ...]
    closure: str
    opening: float
    unit: str
    pose: Mapping[str, float]

    @property
    def large(self) -> bool:
        """Whether something moved by more than 0.1 rad or a tenth of the characteristic length."""
        return bool(self.moved) and self.moved[0].relative > _LARGE

    def check(self) -> None:
        """Warn of a large move.

        Raises
        ------
        InputError
            If a coordinate whose position is stated would move by more than 2 rad or characteristic lengths.
        """
        far = next((m for m in self.moved if m.stated and m.relative > _TOO_LARGE), None)
        if far is not None:
            problem = f"{self._open()}, and the nearest closed pose that was found is far from it: {_by([far])}"
            raise InputError(f"{problem}.  {self._to_write()}", element="assembly")
        if self.large:
            warnings.warn(f"{self}.  {self._to_write()}", AssemblyWarning, stacklevel=2)

    def __str__(self) -> str:
        return f"{self._open()}; the loops were closed by moving {_by(self.moved[:1])}"

    def _open(self) -> str:
        where = "the stated assembly pose" if any(m.stated for m in self.moved) else "zero"
        return f"at {where} closure '{self.closure}' is open by {self.opening:.3g} {self.unit}"

    def _to_write(self) -> str:
        pose = ", ".join(f"{name}: {value:.6g}" for name, value in self.pose.items())
        return f"If this pose is meant, write  assembly: {{{pose}}};  else state one at which the loops close"


def _by(moved: Sequence[Moved]) -> str:
    return ", ".join(f"'{m.coordinate}' by {m.distance:.3g} {m.unit}" for m in moved)
