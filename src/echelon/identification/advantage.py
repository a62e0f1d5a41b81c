"""Comparison of two predictions of held-out blocks of time, with a standard error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from echelon.shared import Floats

LEAST_ADVANTAGE = 0.005
"""Half of a percent of the residuals: less is no advantage however sure it is."""


@dataclass(frozen=True)
class Advantage:
    """A comparison of two predictions: logarithms of ratios of residuals, averaged over all outputs."""

    mean: float
    error: float  # standard error, from blocks

    @staticmethod
    def of(before: Floats, after: Floats, floor: Floats) -> Advantage:
        """From squares by block and output, shape (blocks, outputs), and squares that count as none, (outputs,)."""
        told = (before > 0).any(axis=0)
        if not told.any():
            return Advantage(0.0, np.inf)
        least = np.maximum(floor / len(before), np.finfo(float).tiny)
        ratios = 0.5 * np.log(np.maximum(before, least) / np.maximum(after, least))[
            :, told
        ].mean(axis=1)
        return Advantage.of_blocks(ratios)

    @staticmethod
    def of_blocks(ratios: Floats) -> Advantage:
        """From logarithms of ratios by block, shape (blocks,)."""
        error = ratios.std(ddof=1) / np.sqrt(len(ratios))
        return Advantage(float(ratios.mean()), float(error))

    @property
    def is_none(self) -> bool:
        """Whether it is within its standard error, or too little to matter."""
        return self.mean < max(self.error, LEAST_ADVANTAGE)

    @property
    def ratio(self) -> float:
        """The mean in standard errors."""
        return self.mean / max(self.error, np.finfo(float).tiny)
