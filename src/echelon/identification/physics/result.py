"""Results of physically consistent fits and of feasibility tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from echelon.arrays import Floats


@dataclass(frozen=True, repr=False)
class Feasibility:
    """Whether any physical robot has given base parameters.

    Attributes
    ----------
    feasible : bool or None
        None on the boundary of what robots can have.
    evidence : str
        What was found, in a sentence.
    standard : array of shape (p,), optional
        If feasible: standard parameters of a physical robot that has them.
    nearest : array of shape (r,), optional
        If not: base parameters of the nearest physical robot.
    distance : float
        Of the nearest ones, in standard deviations of the estimate (Mahalanobis); 0 if feasible.
    """

    feasible: bool | None
    evidence: str
    standard: Floats | None = None
    nearest: Floats | None = None
    distance: float = 0.0

    def __repr__(self) -> str:
        return f"Feasibility({self.feasible}: {self.evidence})"


@dataclass(frozen=True, repr=False)
class PhysicalFit:
    """Standard parameters of a robot that can exist, fitted to data.

    Attributes
    ----------
    parameters, units : tuple of str
        The p standard parameters.
    standard : array of shape (p,)
        They satisfy every constraint.
    base : array of shape (r,)
        Their base parameters B ζ.
    misfit : float
        Σ ((W ζ̄ − y)/σ)² of the fit, and
    least_misfit : float
        that of plain (weighted) least squares, which no fit undercuts.
    margins : mapping of str to float
        Body → smallest eigenvalue of its pseudo-inertia relative to that of its prior or its scale.
    prior : str
        What it was drawn to: name of the prior, or empty.
    prior_weight : float
    status : str
        Of the solver.
    diagnostics : mapping
        JSON-able: solver, iterations, active bounds, …
    """

    parameters: tuple[str, ...]
    units: tuple[str, ...]
    standard: Floats
    base: Floats
    misfit: float
    least_misfit: float
    margins: Mapping[str, float]
    prior: str
    prior_weight: float
    status: str
    diagnostics: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        above = self.misfit - self.least_misfit
        drawn = f", drawn to {self.prior} with weight {self.prior_weight:g}" if self.prior else ""
        return f"PhysicalFit({len(self.margins)} bodies, misfit {above:.4g} above {self.least_misfit:.4g}{drawn})"
