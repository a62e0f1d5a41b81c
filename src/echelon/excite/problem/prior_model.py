"""Knowledge before a trajectory is run: information of logs at hand, and the model that predicts efforts."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from echelon.base import base_parameters
from echelon.compute import Observation
from echelon.excite.problem.state_limits import EffortLimit, EffortModel, effort_output
from echelon.formats import EVERY, ExcitationEntry
from echelon.identification import (
    Finding,
    ModelRows,
    Setup,
    listed,
    load_identified,
    note,
    prior_from,
    setup_of,
    surveyed_plan,
    warning,
    with_file_effects,
    with_logs,
)
from echelon.robot import Mechanism, Readable
from echelon.shared import Floats, InputError, public


@public
def information_of_logs(
    setup: Setup | Readable, logs: Sequence[str | os.PathLike[str]]
) -> Floats:
    """The information matrix Σ Wᵀ diag(1/σ²) W of logs, prepared as for an identification.

    Parameters
    ----------
    setup : Setup or path-like
        A robot, or its file, with the outputs' noise σ in its section ``excitation``.
    logs : sequence of path
        Logs, or directories of logs.

    Returns
    -------
    array of shape (r, r)
        In the order of the base parameters.

    Raises
    ------
    InputError
        If a log cannot be read, or coordinates are held, so that other parameters are seen.
    """
    setup = with_file_effects(setup_of(setup))
    entry = setup.excitation
    if entry.move is not None or entry.hold:
        problem = "logs determine other parameters than a trajectory with held coordinates; let all of them move"
        raise InputError(problem, source=setup.source, element="excitation")
    if setup.mechanism.floating_joints:
        raise InputError(
            "logs move a floating base, and trajectories hold it", source=setup.source
        )
    moved = setup.mechanism.velocities
    setup, paths, _ = with_logs(setup, logs, usual=False)
    if setup.mechanism.velocities != moved:
        absent = listed(
            [name for name in moved if name not in setup.mechanism.velocities]
        )
        problem = f"the logs lack {absent}, so they determine other parameters; lock joints that do not move"
        raise InputError(problem, source=setup.source, element="locked")
    plan, _ = surveyed_plan(setup, paths)
    # a row for every sample: the filter averages what decimation leaves out, so that counting rows would count too few
    every = [
        replace(some, reduction=None) for path in paths for some in plan.samples(path)
    ]
    rows = ModelRows.of(plan.base, every)
    return information_of(rows.observation(), entry.noise)


def information_of(observation: Observation, noise: Mapping[str, float]) -> Floats:
    """The information matrix of R-factors, shape (r, r)."""
    layout = observation.layout
    F = np.zeros((len(layout.parameters), len(layout.parameters)))
    for output, columns, R in zip(
        layout.outputs, layout.columns, observation.factors, strict=True
    ):
        part = R[:, :-1]
        where = np.asarray(columns, dtype=np.intp)
        F[np.ix_(where, where)] += (
            part.T @ part / noise.get(output, noise.get(EVERY, 1.0)) ** 2
        )
    return F


# -- the model that predicts efforts ---------------------------------------------------------------------------------


def identified_efforts(
    setup: Setup,
    file: str,
    deviations: float,
    mechanism: Mechanism,
    limits: Sequence[EffortLimit],
) -> EffortModel:
    """Identified base parameters in the place of the pivots, with their covariance."""
    found = load_identified(Path(setup.source).parent / file)
    whole = base_parameters(setup.mechanism, seed=setup.seed)
    ours, theirs = (tuple(map(str, base.expressions)) for base in (whole, found.base))
    if ours != theirs:
        problem = f"the model {file} has other base parameters than this robot with its sensors"
        raise InputError(problem, element="excitation.model")
    check_determined(setup.mechanism, limits, whole.rank, setup.seed)
    parameters = list(mechanism.parameters)
    columns = [
        parameters.index(setup.mechanism.parameters[pivot])
        for pivot in whole.matrix.pivots
    ]
    covariance = np.array(found.document["estimate"]["covariance"], dtype=float)
    return EffortModel(found.values, columns, covariance, deviations)


def check_determined(
    mechanism: Mechanism, limits: Sequence[EffortLimit], rank: int, seed: int
) -> None:
    """Refuse efforts that depend on more than the outputs see: their rows would add to the rank."""
    efforts = (effort_output(mechanism, limit) for limit in limits)
    named = tuple(
        replace(output, name=f"effort of {output.name}") for output in efforts
    )
    both = replace(mechanism, measured=(*mechanism.outputs, *named))
    if base_parameters(both, seed=seed).rank > rank:
        problem = "the identified model does not determine all torques and forces that are limited"
        raise InputError(problem, element="excitation.model")


def prior_efforts(
    setup: Setup, entry: ExcitationEntry, mechanism: Mechanism, findings: list[Finding]
) -> EffortModel | None:
    """Standard parameters of the prior, None where it has no inertias; friction without a value counts as none."""
    names = setup.mechanism.parameters
    if setup.prior is not None:
        whole = base_parameters(setup.mechanism, seed=setup.seed)
        given = dict(
            zip(names, prior_from(whole, setup.prior).values.tolist(), strict=True)
        )
    else:
        stated = zip(names, setup.mechanism.standard_values(), strict=True)
        given = {name: np.nan if value is None else value for name, value in stated}
    values = np.array([given[name] for name in mechanism.parameters])
    inertial = np.array([column.body is not None for column in mechanism.columns])
    if np.isnan(values[inertial]).any():
        if entry.limits.effort:
            problem = "limits of torques need inertial values: state them, an identified model under excitation: model,"
            raise InputError(
                f"{problem} or a file under identification: prior",
                element="effort limits",
            )
        text = "torques have no limits, because the robot file has no inertial values to predict them"
        findings.append(warning("effort", setup.source, text))
        return None
    if np.isnan(values).any():
        text = "the prior model has no friction: the margin of the torque limits must cover it"
        findings.append(note("effort", setup.source, text))
    return EffortModel(np.nan_to_num(values))
