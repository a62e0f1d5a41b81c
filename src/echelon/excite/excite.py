"""From a set-up to a trajectory: starts in parallel, the best of them made safe, and what it shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.excite.criteria import condition_number, log_det
from echelon.excite.design import Design, changed, designed, sample_times
from echelon.excite.lazy import Solution
from echelon.excite.pullback import StateRegressor
from echelon.excite.result import ExcitingTrajectory, Shown, Start
from echelon.excite.safety import safe
from echelon.excite.starts import solutions
from echelon.excite.trajectory import Trajectory
from echelon.identification.settings import Setup
from echelon.machine.kernel import processors
from echelon.version import __version__

Floats = npt.NDArray[np.float64]
OnStep = Callable[[str], None]

_MOMENTS = 40  # at which conditioning is reported


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
        complement; see :func:`echelon.excite.known.information_of_logs`.
    jobs : int, optional
        Processes that work on the starts; as many as there are processors if omitted.
    on_step : callable, optional
        Told what happens.
    **changes
        Fields of the section ``excitation`` that replace those of the set-up: ``duration=10, starts=2, …``

    Returns
    -------
    ExcitingTrajectory
        The same for the same seed, unless a time limit ends a start.

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
    >>> found.safe, found.shown.condition < 10
    (True, True)
    """
    step = on_step or (lambda _: None)
    step("deriving the base parameters")
    design = designed(setup, changed(setup.excitation, changes, setup.source), _information(known))
    entry = design.entry
    step(f"optimising from {entry.starts} starts")

    def ended(k: int, solution: Solution) -> None:
        step(f"start {k + 1} of {entry.starts}: {solution.status}, criterion {solution.value:.5g}")

    found = solutions(design.problem, entry.starts, entry.seed, entry.seconds, jobs or processors(), ended)
    step("checking all limits at every time")
    x, margins = safe(design, [s for s in found if s.x is not None])
    trajectory = trajectory_of(design, x)
    starts = tuple(Start(k, s.status, s.value, s.iterations, s.seconds, s.history) for k, s in enumerate(found))
    return ExcitingTrajectory(
        trajectory,
        design.base,
        design.held,
        entry.criterion,
        shown(design, trajectory),
        tuple(margins),
        starts,
        design.findings,
        _record(design),
    )


def trajectory_of(design: Design, x: Floats) -> Trajectory:
    """The trajectory with these coefficients."""
    mechanism = design.mechanism
    units = {limit.name: limit.unit for limit in design.limits.motion if limit.order == 0}
    names = mechanism.velocities
    return Trajectory(
        names, tuple(units.get(n, "rad") for n in names), design.problem.basis, x.reshape(design.problem.shape)
    )


def shown(design: Design, trajectory: Trajectory, known: Floats | None = None) -> Shown:
    """What a trajectory shows, with friction as it is and not smoothed.

    Parameters
    ----------
    design : Design
    trajectory : Trajectory
        Of the design's coordinates.
    known : array of shape (r, r), optional
        Information that there was before; that of the design if omitted.
    """
    base = design.base
    regressor = StateRegressor(base.mechanism, base.matrix.pivots)
    prior = design.problem.information.prior if known is None else known
    times = sample_times(trajectory.duration, design.entry.rate)
    entries = regressor.entries(dict(zip(("q", "qd", "qdd"), trajectory.states(times), strict=True)))
    F, moments = prior.copy(), []
    cuts = np.unique(np.linspace(0, len(times), _MOMENTS + 1).astype(int)[1:])
    for first, end in zip([0, *cuts[:-1].tolist()], cuts.tolist(), strict=True):
        for rows, weight in zip(regressor.rows, design.problem.information.weights, strict=True):
            block = entries[first:end, rows.entries]
            F[np.ix_(rows.columns, rows.columns)] += weight * (block.T @ block)
        moments.append((float(times[end - 1]), _scaled_condition(F)))
    singular = not np.isfinite(_scaled_condition(F))
    std = np.full(base.rank, np.inf) if singular else np.sqrt(np.diag(np.linalg.inv(F)))
    return Shown(condition_number(F), _scaled_condition(F), log_det(F), tuple(std.tolist()), tuple(moments))


def _scaled_condition(F: Floats) -> float:
    sizes = np.sqrt(np.diag(F))
    if np.any(sizes <= 0):
        return float("inf")
    return condition_number(F / np.outer(sizes, sizes))


def _information(known: npt.ArrayLike | None) -> Floats | None:
    if known is None:
        return None
    F = np.asarray(known, dtype=float)
    if F.ndim != 2 or F.shape[0] != F.shape[1] or not np.isfinite(F).all():
        raise InputError(f"known has shape {F.shape}; expected a square matrix of finite numbers")
    return F


def _record(design: Design) -> Mapping[str, Any]:
    return {
        "echelon": __version__,
        "setup": design.setup.source,
        "excitation": design.entry.model_dump(mode="json"),
        "centre": dict(zip(design.mechanism.velocities, design.centre.tolist(), strict=True)),
        "seed": design.entry.seed,
    }
