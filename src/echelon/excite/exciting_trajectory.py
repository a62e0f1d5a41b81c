"""The result of a design: a trajectory, its conditioning, and its margins to every limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from echelon.base.model import BaseModel
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.verify.margins import Margin
from echelon.excite.verify.trajectory_conditioning import Conditioning
from echelon.logs.finding import Finding


@dataclass(frozen=True)
class Start:
    """One start of the solver."""

    number: int  # from 0 on; with the seed it makes the starting point
    status: str
    value: float  # of the criterion, smoothed; infinite if no motion kept the limits
    iterations: int
    history: tuple[float, ...]  # the best value so far, each time it became better


@dataclass(frozen=True)
class ExcitingTrajectory:
    """A trajectory to be run, with all that is known about it.

    Attributes
    ----------
    trajectory : Trajectory
        Of the coordinates that move.
    base : BaseModel
        Base parameters of the robot with the others held.
    held : mapping of str to float
        Coordinates that are held, and where.
    criterion : str
    conditioning : Conditioning
    margins : tuple of Margin
        Of every limit.
    starts : tuple of Start
    findings : tuple of Finding
    settings : mapping
        Everything needed to repeat the design.
    """

    trajectory: Trajectory
    base: BaseModel
    held: Mapping[str, float]
    criterion: str
    conditioning: Conditioning
    margins: tuple[Margin, ...]
    starts: tuple[Start, ...]
    findings: tuple[Finding, ...]
    settings: Mapping[str, Any]

    @property
    def safe(self) -> bool:
        """Whether every limit is kept at every time."""
        return all(margin.kept for margin in self.margins)

    @property
    def active(self) -> tuple[Margin, ...]:
        """Limits that the trajectory comes near to."""
        return tuple(margin for margin in self.margins if margin.active)
