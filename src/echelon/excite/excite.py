"""From a set-up to a trajectory: starts in parallel, the best of them made safe, and what it shows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.exciting_trajectory import ExcitingTrajectory, Start
from echelon.excite.problem.task import Task, changed, task_of
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.solve.design import designed
from echelon.excite.solve.safety import safe
from echelon.excite.solve.solver import Solution
from echelon.excite.solve.starts import solutions
from echelon.excite.verify import margins_of
from echelon.excite.verify.conditioning import Conditioning, conditioning_of
from echelon.identification.settings import Setup
from echelon.logs.finding import Finding, Severity
from echelon.machine.kernel import processors
from echelon.version import __version__

OnStep = Callable[[str], None]


def exciting_trajectory(
    setup: Setup,
    *,
    known: npt.ArrayLike | None = None,
    jobs: int | None = None,
    on_step: OnStep | None = None,
    **changes: Any,
) -> ExcitingTrajectory:
    """Design a trajectory that makes base parameters visible and keeps all limits.

    Parameters
    ----------
    setup : Setup
        A robot with its sensors and, in the section ``excitation``, its limits; see :func:`echelon.load_setup`.
    known : array of shape (r, r), optional
        Information matrix of data at hand, Σ Wᵀ diag(1/σ²) W with the outputs' noise, which the trajectory is to
        complement; see :func:`echelon.excite.problem.prior_information.information_of_logs`.
    jobs : int, optional
        Processes that work on the starts; as many as there are processors if omitted.
    on_step : callable, optional
        Told what happens.
    **changes
        Fields of the section ``excitation`` that replace those of the set-up: ``duration=10, starts=2, …``

    Returns
    -------
    ExcitingTrajectory
        The same for the same seed, whatever else the machine does.

    Raises
    ------
    InputError
        If the set-up is not complete, or limits are in each other's way; names them.
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
    step("deriving the base parameters")
    task = task_of(setup, changed(setup.excitation, changes, setup.source))
    entry, prior = task.entry, _information(known)
    try:
        design = designed(task, prior)
    except InputError as error:
        raise error.located(setup.source) from None
    step(f"optimising from {entry.starts} starts")

    def ended(k: int, solution: Solution) -> None:
        step(f"start {k + 1} of {entry.starts}: {solution.status}, criterion {solution.value:.5g}")

    found = solutions(design.problem, entry.starts, entry.seed, entry.iterations, jobs or processors(), ended)
    step("checking all limits at every time")
    x, margins = safe(design, [s for s in found if s.x is not None])
    trajectory = design.trajectory(x)
    starts = tuple(Start(k, s.status, s.value, s.iterations, s.history) for k, s in enumerate(found))
    seen = conditioning_of(task, trajectory, prior)
    centre = dict(zip(task.mechanism.independent_velocities, design.centre.tolist(), strict=True))
    return ExcitingTrajectory(
        trajectory,
        task.base,
        task.held,
        entry.criterion,
        seen,
        tuple(margins),
        starts,
        (*_warnings(task, seen, starts), *task.findings),
        {**record(task), "centre": centre},
    )


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
    margins = tuple(margins_of(trajectory, task))
    seen = conditioning_of(task, trajectory)
    return ExcitingTrajectory(
        trajectory,
        task.base,
        task.held,
        task.entry.criterion,
        seen,
        margins,
        (),
        (*_warnings(task, seen, ()), *task.findings),
        record(task),
    )


def _information(known: npt.ArrayLike | None) -> Floats | None:
    if known is None:
        return None
    F = np.asarray(known, dtype=float)
    if F.ndim != 2 or F.shape[0] != F.shape[1] or not np.isfinite(F).all():
        raise InputError(f"known has shape {F.shape}; expected a square matrix of finite numbers")
    return F


def _warnings(task: Task, seen: Conditioning, starts: Sequence[Start]) -> list[Finding]:
    """What makes a trajectory of little use."""
    texts = []
    if not isfinite(seen.scaled_condition):
        texts.append("this motion does not show all base parameters: give it more time, or wider limits")
    if starts and all(start.status != "converged" for start in starts):
        ended = ", ".join(sorted({start.status for start in starts}))
        texts.append(f"no start of the solver converged ({ended}): better motions may exist")
    return [Finding(Severity.WARNING, "design", task.setup.source, text) for text in texts]


def record(task: Task) -> dict[str, Any]:
    """What is needed to do the same again."""
    return {
        "echelon": __version__,
        "setup": task.setup.source,
        "excitation": task.entry.model_dump(mode="json"),
        "seed": task.entry.seed,
    }
