"""The filter that goes over both sides of the equation: low-pass, then decimation.

A model that is linear in its parameters stays true when every column of the regressor and the outputs pass the same
linear filter (Gautier's parallel filter); noise above the band of the motion goes, and so does the work.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


class Reduction(Protocol):
    """A linear filter along time that keeps every k-th sample.

    Attributes
    ----------
    factor : int
        Samples before, per sample after.
    reach : int
        Samples on either side that a result depends on (for recursive filters: to within 1e-9 of the signal).
    """

    factor: int
    reach: int

    def kept(self, count: int) -> npt.NDArray[np.intp]:
        """Which of so many samples remain."""
        ...

    def apply(self, values: Floats) -> Floats:
        """The filtered values at the samples that remain; shape (N, …) to (kept, …)."""
        ...
