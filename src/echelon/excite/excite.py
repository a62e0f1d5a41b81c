"""The job ``excite``: from a set-up to a trajectory that keeps all limits, with all that is known about it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel
from echelon.excite.closeness import (
    Closeness,
    beginning,
    clearances,
    closeness_of,
    room_needed,
)
from echelon.excite.problem.closed_loops import state_regressor
from echelon.excite.problem.information import condition_number, log_det, sample_times
from echelon.excite.problem.shapes import Shape
from echelon.excite.problem.task import Task, changed, task_of
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.solve.design import Chance, designed, safe, searched
from echelon.excite.solve.solver import Watch
from echelon.excite.verify import Margin, margins_of, used_limits
from echelon.formats import NO_LIMIT
from echelon.identification import (
    Finding,
    Setup,
    note,
    setup_of,
    warning,
    with_file_effects,
)
from echelon.robot import Readable
from echelon.shared import Floats, InputError, __version__, plain_data, public

MOMENTS = 40
"""Times at which conditioning is reported: a curve over time still looks smooth."""


@dataclass(frozen=True)
class MotionConditioning:
    """Conditioning of the base parameters, with friction that is not smoothed."""

    condition: float  # condition number of the observation matrix whose rows are divided by the outputs' noise
    scaled_condition: float  # the same with columns of norm 1
    log_det: float  # of the information matrix
    std: tuple[float, ...]  # standard deviation of each base parameter, SI units
    over_time: tuple[
        tuple[float, float], ...
    ]  # time, s, and the scaled condition number of all samples up to it

    @property
    def worst(self) -> int:
        """The parameter with the largest standard deviation."""
        return int(np.argmax(self.std))


def conditioning_of(
    task: Task, trajectory: Trajectory, prior: Floats | None = None
) -> MotionConditioning:
    """Conditioning along a trajectory, with friction that is not smoothed; ``prior`` is information of shape (r, r)."""
    blocks = _information_over_time(task, [trajectory], prior, MOMENTS)
    times, matrices = next(blocks)
    moments = [
        (time, _scaled_condition(F)) for time, F in zip(times, matrices, strict=True)
    ]
    F = matrices[-1]
    std = _deviations(F)
    conditions = condition_number(F), _scaled_condition(F)
    return MotionConditioning(
        *conditions, log_det(F), tuple(std.tolist()), tuple(moments)
    )


def chance_of(
    task: Task, motions: Sequence[Trajectory], prior: Floats | None = None
) -> Chance:
    """The best that some motions reach, each figure by itself."""
    matrices = [
        found[-1] for _, found in _information_over_time(task, motions, prior, 1)
    ]
    conditions, worst = (
        [_scaled_condition(F) for F in matrices],
        [float(_deviations(F).max()) for F in matrices],
    )
    return Chance(len(motions), min(conditions), min(worst))


def _information_over_time(
    task: Task, motions: Sequence[Trajectory], prior: Floats | None, moments: int
) -> Iterator[tuple[list[float], list[Floats]]]:
    """For every motion, some times and the information of all samples up to each, shape (r, r)."""
    base = task.base
    regressor = state_regressor(base.mechanism, base.matrix.pivots)
    for motion in motions:
        times = sample_times(motion.duration, task.entry.rate)
        entries = regressor.entries(
            dict(zip(("q", "qd", "qdd"), motion.states(times), strict=True))
        )
        cuts = np.unique(
            np.linspace(0, len(times), moments + 1).astype(int)[1:]
        ).tolist()
        F = np.zeros((base.rank, base.rank)) if prior is None else prior.copy()
        matrices = []
        for first, end in zip([0, *cuts[:-1]], cuts, strict=True):
            for rows, weight in zip(regressor.rows, task.weights, strict=True):
                block = entries[first:end, rows.entries]
                F[np.ix_(rows.columns, rows.columns)] += weight * (block.T @ block)
            matrices.append(F.copy())
        yield [float(times[end - 1]) for end in cuts], matrices


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
    chance : Chance, optional
        The best that random motions within the limits reach; None if nothing was searched.
    closeness : Closeness, optional
        Distances over time; None if none are checked.
    shapes : tuple of Shape
        Shapes that are checked: those of the robot, and obstacles.
    unchecked : tuple of str
        What no margin says anything about, in sentences: collisions, links without shapes, pairs that overlap.
    """

    trajectory: Trajectory
    base: BaseModel
    held: Mapping[str, float]
    criterion: str
    conditioning: MotionConditioning
    margins: tuple[Margin, ...]
    starts: tuple[Start, ...]
    findings: tuple[Finding, ...]
    settings: Mapping[str, Any]
    chance: Chance | None = None
    closeness: Closeness | None = None
    shapes: tuple[Shape, ...] = ()
    unchecked: tuple[str, ...] = ()

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
    on_step: Callable[[str], object] = str,
    stopped: Callable[[], bool] = bool,
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
    on_step : callable, optional
        Called with a line of text at every step.
    stopped : callable, optional
        Asked at every step of the solver; once it is true, the search ends with the best motion so far.
    **changes
        Fields of the section ``excitation`` that replace those of the set-up: ``duration=10, starts=2, …``

    Returns
    -------
    ExcitingTrajectory
        The trajectory; equal seeds give equal trajectories on one machine, however busy it is.

    Raises
    ------
    InputError
        If the set-up is not complete, or if no pose keeps all limits; names them.
    MissingExtraError
        If SciPy or MuJoCo is not installed.

    Examples
    --------
    >>> import echelon as ec
    >>> setup = ec.load_setup("examples/double_pendulum.yaml")
    >>> found = ec.exciting_trajectory(setup, duration=6, starts=1, limits={"velocity": 3, "position": [-2, 2]})
    >>> found.safe, found.conditioning.condition < 10
    (True, True)
    """
    setup = with_file_effects(setup_of(setup))
    prior = _checked(prior_information)
    on_step("deriving the base parameters")
    task = task_of(setup, changed(setup.excitation, changes, setup.source))
    watch = Watch(task.entry.budget, stopped, on_step)
    on_step("searching for a pose within all limits")
    design = designed(task, prior)
    found = searched(design, watch)
    x, margins = safe(design, found.best_first, watch)
    starts = [
        Start(k, s.status, s.value, s.iterations, s.history)
        for k, s in enumerate(found.starts)
    ]
    on_step("conditioning")
    chance = chance_of(
        task, [design.trajectory(motion) for motion in found.motions], prior
    )
    centre = dict(
        zip(task.mechanism.independent_velocities, design.centre.tolist(), strict=True)
    )
    return _result(
        task, design.trajectory(x), margins, prior, starts, chance, centre=centre
    )


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
        Without starts; its attribute ``safe`` tells whether it keeps all limits.

    Raises
    ------
    InputError
        If it moves other coordinates.
    """
    setup = with_file_effects(setup_of(setup))
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
    chance: Chance | None = None,
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
        chance=chance,
        closeness=closeness_of(task, trajectory),
        shapes=tuple(shape for part, _ in clearances(task) for shape in part.shapes),
        unchecked=task.unchecked,
        findings=(
            *_warnings(task, conditioning, starts),
            *_notes(task, trajectory, margins),
            *task.findings,
        ),
        settings={
            "echelon": __version__,
            "setup": task.setup.source,
            "excitation": plain_data(task.entry.model_dump(), NO_LIMIT),
            "seed": task.entry.seed,
            **settings,
        },
    )


def _warnings(
    task: Task, conditioning: MotionConditioning, starts: Sequence[Start]
) -> list[Finding]:
    """Reasons why a trajectory is of little use."""
    texts = []
    if not isfinite(conditioning.scaled_condition):
        texts.append(
            "this motion does not determine all base parameters: allow more time, or wider limits"
        )
    ended = {start.status for start in starts}
    if ended & {"stopped", "budget"}:
        why = (
            "somebody stopped it"
            if "stopped" in ended
            else f"its budget of {task.entry.budget:g} was used up"
        )
        texts.append(f"the search ended early, because {why}: better motions may exist")
    elif starts and "converged" not in ended:
        texts.append(
            f"no start of the solver converged ({', '.join(sorted(ended))}): better motions may exist"
        )
    return [warning("design", task.setup.source, text) for text in texts]


def _notes(
    task: Task, trajectory: Trajectory, margins: Sequence[Margin]
) -> list[Finding]:
    """Notes for whoever runs the motion."""
    found = []
    if begins := beginning(task, trajectory):
        found.append(note("beginning", task.setup.source, begins))
    if room := room_needed(task, trajectory):
        found.append(note("room", task.setup.source, room))
    if used := used_limits(margins):
        text = (
            f"the motion uses up to these shares of its limits: {used}; for more room state smaller limits, or a scale for "
            "those of the robot file"
        )
        found.append(note("limits", task.setup.source, text))
    return found
