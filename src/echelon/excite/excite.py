"""The job ``excite``: from a set-up to a trajectory that keeps all limits, with all that is known about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel
from echelon.compute import processors
from echelon.excite.problem.closed_loops import state_regressor
from echelon.excite.problem.information import condition_number, log_det, sample_times
from echelon.excite.problem.task import Task, changed, task_of
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.solve.design import designed, safe
from echelon.excite.solve.solver import solutions
from echelon.excite.verify import Margin, margins_of
from echelon.identification import Finding, Setup, setup_of, warning
from echelon.robot import Readable
from echelon.shared import Floats, InputError, __version__, public

_MOMENTS = 40  # at which conditioning is reported


@dataclass(frozen=True)
class Conditioning:
    """Conditioning of the base parameters, with friction that is not smoothed."""

    condition: float  # condition number of the observation matrix whose rows are divided by the outputs' noise
    scaled_condition: float  # the same with columns of norm 1
    log_det: float  # of the information matrix
    std: tuple[float, ...]  # standard deviation of each base parameter, SI units
    over_time: tuple[
        tuple[float, float], ...
    ]  # time, s, and the scaled condition number of all samples up to it


def conditioning_of(
    task: Task, trajectory: Trajectory, prior: Floats | None = None
) -> Conditioning:
    """Conditioning along a trajectory, with friction that is not smoothed; ``prior`` is information of shape (r, r)."""
    base = task.base
    regressor = state_regressor(base.mechanism, base.matrix.pivots)
    times = sample_times(trajectory.duration, task.entry.rate)
    entries = regressor.entries(
        dict(zip(("q", "qd", "qdd"), trajectory.states(times), strict=True))
    )
    F = np.zeros((base.rank, base.rank)) if prior is None else prior.copy()
    moments = []
    cuts = np.unique(np.linspace(0, len(times), _MOMENTS + 1).astype(int)[1:])
    for first, end in zip([0, *cuts[:-1].tolist()], cuts.tolist(), strict=True):
        for rows, weight in zip(regressor.rows, task.weights, strict=True):
            block = entries[first:end, rows.entries]
            F[np.ix_(rows.columns, rows.columns)] += weight * (block.T @ block)
        moments.append((float(times[end - 1]), _scaled_condition(F)))
    std = _deviations(F)
    return Conditioning(
        condition_number(F),
        _scaled_condition(F),
        log_det(F),
        tuple(std.tolist()),
        tuple(moments),
    )


def _deviations(F: Floats) -> Floats:
    """Standard deviations of the parameters; infinite if some are not determined."""
    if not np.isfinite(_scaled_condition(F)):
        return np.full(len(F), np.inf)
    sizes = np.sqrt(np.diag(F))
    found: Floats = np.sqrt(np.diag(np.linalg.inv(F / np.outer(sizes, sizes)))) / sizes
    return found


def _scaled_condition(F: Floats) -> float:
    sizes = np.sqrt(np.diag(F))
    if np.any(sizes <= 0):
        return float("inf")
    return condition_number(F / np.outer(sizes, sizes))


@dataclass(frozen=True)
class Start:
    """One start of the solver."""

    number: int  # from 0 on; with the seed it makes the starting point
    status: str
    value: float  # of the criterion, smoothed; infinite if no motion kept the limits
    iterations: int
    history: tuple[float, ...]  # the best value so far, each time it became better


@public
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
        """Whether every limit is kept: at every time, or where a margin is ``sampled`` at samples."""
        return all(margin.kept for margin in self.margins)

    @property
    def active(self) -> tuple[Margin, ...]:
        """Limits that the trajectory comes near to."""
        return tuple(margin for margin in self.margins if margin.active)


@public
def exciting_trajectory(
    setup: Setup | Readable,
    *,
    prior_information: npt.ArrayLike | None = None,
    jobs: int | None = None,
    on_step: Callable[[str], None] | None = None,
    **changes: Any,
) -> ExcitingTrajectory:
    """Design a trajectory that makes base parameters visible and keeps all limits.

    Parameters
    ----------
    setup : Setup or path-like
        A robot with its sensors, or its file, and, in the section ``excitation``, its limits; see
        :func:`echelon.load_setup`.
    prior_information : array of shape (r, r), optional
        Information matrix Σ Wᵀ diag(1/σ²) W of logs at hand, with the outputs' noise σ; the trajectory adds to it.
        See :func:`echelon.information_of_logs`.
    jobs : int, optional
        Processes that work on the starts; as many as there are processors if omitted.
    on_step : callable, optional
        Called with a line of text at every step.
    **changes
        Fields of the section ``excitation`` that replace those of the set-up: ``duration=10, starts=2, …``

    Returns
    -------
    ExcitingTrajectory
        The same for the same seed, whatever else the machine does.

    Raises
    ------
    InputError
        If the set-up is not complete, or if no pose keeps all limits; names them.
    MissingExtraError
        If CasADi is not installed.

    Examples
    --------
    >>> import echelon as ec
    >>> setup = ec.load_setup("examples/double_pendulum.yaml")
    >>> found = ec.exciting_trajectory(setup, duration=6, starts=1, limits={"velocity": 3, "position": [-2, 2]})
    >>> found.safe, found.conditioning.condition < 10
    (True, True)
    """
    setup = setup_of(setup)
    step = on_step or (lambda _: None)
    prior = _checked(prior_information)
    step("deriving the base parameters")
    task = task_of(setup, changed(setup.excitation, changes, setup.source))
    design = designed(task, prior)
    step(f"optimising from {task.entry.starts} starts")
    found = solutions(design.problem, task.entry, jobs or processors(), step)
    step("checking all limits")
    x, margins = safe(design, found)
    starts = [
        Start(k, s.status, s.value, s.iterations, s.history)
        for k, s in enumerate(found)
    ]
    centre = dict(
        zip(task.mechanism.independent_velocities, design.centre.tolist(), strict=True)
    )
    return _result(task, design.trajectory(x), margins, prior, starts, centre=centre)


@public
def judged_trajectory(
    setup: Setup | Readable, trajectory: Trajectory, **changes: Any
) -> ExcitingTrajectory:
    """Judge a trajectory made elsewhere by the limits and the criterion of a set-up.

    Parameters
    ----------
    setup : Setup or path-like
        A robot with its limits, or its file.
    trajectory : Trajectory
        Of the coordinates that the set-up lets move, in its order; see :func:`read_trajectory`.
    **changes
        Fields of the section ``excitation`` that replace those of the set-up.

    Returns
    -------
    ExcitingTrajectory
        Without starts; whether it is safe, it says itself.

    Raises
    ------
    InputError
        If it moves other coordinates.
    """
    setup = setup_of(setup)
    task = task_of(setup, changed(setup.excitation, changes, setup.source))
    if trajectory.coordinates != task.mechanism.independent_velocities:
        moves, should = (
            ", ".join(trajectory.coordinates),
            ", ".join(task.mechanism.independent_velocities),
        )
        raise InputError(
            f"the trajectory moves {moves}; the set-up lets {should} move",
            source=setup.source,
        )
    return _result(task, trajectory, margins_of(trajectory, task))


def _checked(information: npt.ArrayLike | None) -> Floats | None:
    if information is None:
        return None
    F = np.asarray(information, dtype=float)
    if F.ndim != 2 or F.shape[0] != F.shape[1] or not np.isfinite(F).all():
        raise InputError(
            f"prior_information has shape {F.shape}; expected a square matrix of finite numbers"
        )
    return F


def _result(
    task: Task,
    trajectory: Trajectory,
    margins: Sequence[Margin],
    prior: Floats | None = None,
    starts: Sequence[Start] = (),
    **settings: Any,
) -> ExcitingTrajectory:
    """The trajectory with all that is known about it, and what is needed to design it again."""
    conditioning = conditioning_of(task, trajectory, prior)
    return ExcitingTrajectory(
        trajectory=trajectory,
        base=task.base,
        held=task.held,
        criterion=task.entry.criterion,
        conditioning=conditioning,
        margins=tuple(margins),
        starts=tuple(starts),
        findings=(*_warnings(task, conditioning, starts), *task.findings),
        settings={
            "echelon": __version__,
            "setup": task.setup.source,
            "excitation": task.entry.model_dump(mode="json"),
            "seed": task.entry.seed,
            **settings,
        },
    )


def _warnings(
    task: Task, conditioning: Conditioning, starts: Sequence[Start]
) -> list[Finding]:
    """Reasons why a trajectory is of little use."""
    texts = []
    if not isfinite(conditioning.scaled_condition):
        texts.append(
            "this motion does not determine all base parameters: give it more time, or wider limits"
        )
    if starts and all(start.status != "converged" for start in starts):
        ended = ", ".join(sorted({start.status for start in starts}))
        texts.append(
            f"no start of the solver converged ({ended}): better motions may exist"
        )
    return [warning("design", task.setup.source, text) for text in texts]
