"""Results of physically consistent fits and of feasibility tests."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

from echelon.arrays import Floats


@dataclass(frozen=True, repr=False)
class Feasibility:
    """Whether any physical robot has given base parameters, with a proof.

    Attributes
    ----------
    feasible : bool or None
        None where neither could be proved.
    proof : str
        What was verified, in a sentence: exact rational arithmetic or interval arithmetic, and of what.
    standard : array of shape (p,), optional
        If feasible: standard parameters of a physical robot that has them (the proof's witness).
    separator : array of shape (r,), optional
        If not: λ with λᵀζ̄ < 0 although λᵀB ζ ≥ 0 for every physical robot (the proof's witness).
    nearest : array of shape (r,), optional
        If not: base parameters of the nearest physical robot.
    distance : float
        Of the nearest ones, in standard deviations of the estimate (Mahalanobis); 0 if feasible.
    exact : tuple of Fraction
        The proof's witness, ζ or λ, in the exact numbers that were verified, so that anybody can verify them again;
        empty where the geometry is irrational or nothing was proved.
    """

    feasible: bool | None
    proof: str
    standard: Floats | None = None
    separator: Floats | None = None
    nearest: Floats | None = None
    distance: float = 0.0
    exact: tuple[Fraction, ...] = ()

    def __repr__(self) -> str:
        return f"Feasibility({self.feasible}: {self.proof})"


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
