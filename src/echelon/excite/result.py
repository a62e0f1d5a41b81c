"""What an excitation design gives: a trajectory, what it shows, and how far it stays from every limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from echelon.base.model import BaseModel
from echelon.excite.margins import Margin
from echelon.excite.trajectory import Trajectory
from echelon.logs.finding import Finding


@dataclass(frozen=True)
class Shown:
    """What a trajectory shows of the base parameters, without smoothing.

    Attributes
    ----------
    condition, scaled_condition : float
        Condition number of the observation matrix whose rows are divided by the outputs' noise, and with columns of
        norm 1.
    log_det : float
        Of the information matrix.
    std : tuple of float
        Standard deviation that each base parameter will have, SI units.
    over_time : tuple of (float, float)
        Scaled condition number of what was seen up to some times, s.
    """

    condition: float
    scaled_condition: float
    log_det: float
    std: tuple[float, ...]
    over_time: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Start:
    """One start of the solver.

    Attributes
    ----------
    number : int
        From 0 on; with the seed it makes the starting point.
    status : str
    value : float
        Of the criterion, smoothed; infinite if no motion kept the limits.
    iterations : int
    history : tuple of float
        The best value so far, each time it became better.
    """

    number: int
    status: str
    value: float
    iterations: int
    history: tuple[float, ...]


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
    shown : Shown
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
    shown: Shown
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
