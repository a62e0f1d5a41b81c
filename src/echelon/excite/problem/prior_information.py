"""Prior information: what logs at hand say already about the base parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from echelon.arrays import Floats
from echelon.base.derive import base_parameters
from echelon.errors import InputError
from echelon.formats.schema.schema_excite import EVERY
from echelon.identification.rows.plan import Plan
from echelon.identification.settings import Setup
from echelon.identification.survey import survey
from echelon.logs.files.open_log import log_paths
from echelon.observe.observation import Observation

Path = str | os.PathLike[str]


def information_of_logs(setup: Setup, logs: Sequence[Path]) -> Floats:
    """The information matrix Σ Wᵀ diag(1/σ²) W of logs, prepared as for an identification.

    Parameters
    ----------
    setup : Setup
        With the outputs' noise σ in its section ``excitation``.
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
    entry = setup.excitation
    if entry.move is not None or entry.hold:
        problem = "logs determine other parameters than a trajectory that holds coordinates; let all of them move"
        raise InputError(problem, source=setup.source, element="excitation")
    if any(body.joint.kind == "floating" for body in setup.mechanism.bodies):
        raise InputError("a floating base is held by trajectories, and not in logs", source=setup.source)
    base = base_parameters(setup.mechanism, seed=setup.settings.seed)
    paths = [path for log in logs for path in log_paths(log)]
    found = survey(setup, base, paths)
    # a row for every sample: filters average what decimation leaves out, so that counting rows would count too few
    whole = replace(found.preparation, output_cutoff=inf, decimation=())
    rows = Plan(base, setup.columns, whole).rows(paths)
    return information_of(rows.observation(), entry.noise)


def information_of(observation: Observation, noise: Mapping[str, float]) -> Floats:
    """The information matrix of R-factors, shape (r, r)."""
    layout = observation.layout
    F = np.zeros((len(layout.parameters), len(layout.parameters)))
    for output, columns, R in zip(layout.outputs, layout.columns, observation.factors, strict=True):
        part = R[:, :-1]
        where = np.asarray(columns, dtype=np.intp)
        F[np.ix_(where, where)] += part.T @ part / noise.get(output, noise.get(EVERY, 1.0)) ** 2
    return F
