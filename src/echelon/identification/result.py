"""Identification: all that one run found out, from the logs to the verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from echelon.arrays import Floats
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.excitation.excitation import Excitation
from echelon.identification.physics.result import Feasibility, PhysicalFit
from echelon.identification.validation.validation import Validation
from echelon.logs.finding import Finding
from echelon.logs.preparation.settings import Preparation

if TYPE_CHECKING:
    from echelon.base.model import BaseModel


@dataclass(frozen=True, repr=False)
class Identification:
    """A fitted model with its evidence.

    Attributes
    ----------
    base : BaseModel
        The base parameters in closed form; ``base.mechanism`` is the robot.
    logs : tuple of str
        Sources of the data it was fitted to.
    preparation : Preparation
        As used: every choice is filled in and gives its reason.
    estimate : Estimate
        Base parameters; the one that predictions use unless ``physical`` does.
    essential : Estimate, optional
        The smaller model after backward elimination; values of eliminated parameters are 0.
    excitation : Excitation
    feasibility : Feasibility, optional
        Of ``estimate``.
    physical : PhysicalFit, optional
    validations : tuple of Validation
        Identification data first, then data that the fit did not see.
    findings : tuple of Finding
        What is wrong with the logs or the fit; warnings first.
    chosen : str
        Which values predictions use: ``"estimate"``, ``"essential"`` or ``"physical"``.
    settings : mapping
        Everything needed to repeat the run: seed, versions, options.
    verdict : str
        The whole in words.
    """

    base: BaseModel
    logs: tuple[str, ...]
    preparation: Preparation
    estimate: Estimate
    essential: Estimate | None
    excitation: Excitation
    feasibility: Feasibility | None
    physical: PhysicalFit | None
    validations: tuple[Validation, ...]
    findings: tuple[Finding, ...]
    chosen: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    verdict: str = ""

    @property
    def values(self) -> Floats:
        """Base parameters that predictions use, shape (r,)."""
        if self.chosen == "physical" and self.physical is not None:
            return self.physical.base
        if self.chosen == "essential" and self.essential is not None:
            return self.essential.values
        return self.estimate.values

    def __repr__(self) -> str:
        return f"Identification({self.base.mechanism.name}: {self.base.rank} base parameters, {len(self.logs)} logs)"
