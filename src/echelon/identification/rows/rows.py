"""Rows: the regressor and the measured outputs of prepared samples, both filtered alike, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

from echelon.arrays import Floats
from echelon.observe.layout import Layout
from echelon.observe.observation import Observation


@dataclass(frozen=True)
class RowBlock:
    """Rows of [W y], output by output; outputs may have different numbers of rows.

    Attributes
    ----------
    source : str
        Log they come from.
    segment : int
        Counts uninterrupted stretches, so that neighbouring rows can be told from those across a gap.
    times : tuple of array of shape (k_i,)
        For each output, the times of its rows, s.
    matrices : tuple of array of shape (k_i, n_i)
        For each output, the columns ``layout.columns[i]`` of the regressor.
    y : tuple of array of shape (k_i,)
        For each output, the measured values.
    """

    source: str
    segment: int
    times: tuple[Floats, ...]
    matrices: tuple[Floats, ...]
    y: tuple[Floats, ...]


class Rows(Protocol):
    """Rows that can be gone through as often as a method needs; every pass gives the same blocks."""

    @property
    def layout(self) -> Layout:
        """Outputs, parameters, and which of them each output can depend on."""
        ...

    @property
    def units(self) -> tuple[str, ...]:
        """SI units of the parameters."""
        ...

    @property
    def output_units(self) -> tuple[str, ...]:
        """SI units of the outputs."""
        ...

    def blocks(self) -> Iterator[RowBlock]:
        """All rows, in the order of time, log after log."""
        ...

    def observation(self) -> Observation:
        """The R-factors of all rows."""
        ...
