"""The job ``excite``: from a set-up to a trajectory that keeps all limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.exciting_trajectory import Conditioning, ExcitingTrajectory, Start, conditioning_of
from echelon.excite.problem.task import Task, changed, task_of
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.solve.design import designed, safe
from echelon.excite.solve.starts import solutions
from echelon.excite.verify import margins_of
from echelon.excite.verify.margins import Margin
from echelon.logs.finding import Finding, Severity
from echelon.machine.kernel import processors
from echelon.setup.setup import Setup
from echelon.version import __version__


def exciting_trajectory(
    setup: Setup,
    *,
    prior_information: npt.ArrayLike | None = None,
    jobs: int | None = None,
    on_step: Callable[[str], None] | None = None,
    **changes: Any,
) -> ExcitingTrajectory:
    """Design a trajectory that makes base parameters visible and keeps all limits.

    Parameters
    ----------
    setup : Setup
        A robot with its sensors and, in the section ``excitation``, its limits; see :func:`echelon.load_setup`.
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
    step = on_step or (lambda _: None)
    prior = _checked(prior_information)
    step("deriving the base parameters")
    task = task_of(setup, changed(setup.excitation, changes, setup.source))
    design = designed(task, prior)
    step(f"optimising from {task.entry.starts} starts")
    found = solutions(design.problem, task.entry, jobs or processors(), step)
    step("checking all limits")
    x, margins = safe(design, found)
    starts = [Start(k, s.status, s.value, s.iterations, s.history) for k, s in enumerate(found)]
    return _result(task, design.trajectory(x), margins, prior, starts, centre=design.named_centre)


def judged_trajectory(setup: Setup, trajectory: Trajectory, **changes: Any) -> ExcitingTrajectory:
    """Judge a trajectory made elsewhere by the limits and the criterion of a set-up.

    Parameters
    ----------
    setup : Setup
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
    task = task_of(setup, changed(setup.excitation, changes, setup.source))
    if trajectory.coordinates != task.mechanism.independent_velocities:
        moves, should = ", ".join(trajectory.coordinates), ", ".join(task.mechanism.independent_velocities)
        raise InputError(f"the trajectory moves {moves}; the set-up lets {should} move", source=setup.source)
    return _result(task, trajectory, margins_of(trajectory, task))


def _checked(information: npt.ArrayLike | None) -> Floats | None:
    if information is None:
        return None
    F = np.asarray(information, dtype=float)
    if F.ndim != 2 or F.shape[0] != F.shape[1] or not np.isfinite(F).all():
        raise InputError(f"prior_information has shape {F.shape}; expected a square matrix of finite numbers")
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


def _warnings(task: Task, conditioning: Conditioning, starts: Sequence[Start]) -> list[Finding]:
    """Reasons why a trajectory is of little use."""
    texts = []
    if not isfinite(conditioning.scaled_condition):
        texts.append("this motion does not determine all base parameters: give it more time, or wider limits")
    if starts and all(start.status != "converged" for start in starts):
        ended = ", ".join(sorted({start.status for start in starts}))
        texts.append(f"no start of the solver converged ({ended}): better motions may exist")
    return [Finding(Severity.WARNING, "design", task.setup.source, text) for text in texts]
