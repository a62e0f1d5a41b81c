"""Drive gains from files: logs without and with a payload, prepared alike."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace

from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.gains.gains import GainEstimate, Method, drive_gains
from echelon.identification.gains.payload import Payload, loaded_rows, with_zeros
from echelon.identification.rows.model_rows import ModelRows
from echelon.identification.rows.plan import Plan
from echelon.identification.settings import Setup
from echelon.logs.files.open_log import log_paths
from echelon.logs.preparation.choices import chosen
from echelon.logs.read_log import read_log
from echelon.logs.recording import Samples, Segment

Paths = Sequence[str | os.PathLike[str]]


def gains_from_logs(
    setup: Setup,
    unloaded: Paths,
    loaded: Paths = (),
    payload: Payload | None = None,
    *,
    known: Mapping[str, float] | None = None,
    method: Method = "currents",
) -> GainEstimate:
    """Drive gains and base parameters from logs of currents.

    Parameters
    ----------
    setup : Setup
        A robot with ``drive_gain`` effects, whose logs have currents as inputs and need no outputs.
    unloaded : sequence of path
        Runs without the payload; a directory stands for all logs in it.
    loaded : sequence of path, optional
        Runs with it.
    payload : Payload, optional
        What is known of the load.
    known : mapping of str to float, optional
        Base parameters or gains that are known, by name, SI units.
    method : "currents", "ls" or "tls"
        See :func:`drive_gains`.

    Returns
    -------
    GainEstimate

    Raises
    ------
    InputError
        If logs cannot be read, or nothing fixes the scale: see :func:`drive_gains`.
    """
    if bool(loaded) != (payload is not None):
        raise InputError("runs with a payload and the payload itself go together: give both or neither")
    base = base_parameters(setup.mechanism, seed=setup.settings.seed)
    plan = _plan(setup, base, unloaded)
    rows = ModelRows.of(base, _samples(plan, unloaded))
    if payload is None:
        return drive_gains(base, rows, known=known, method=method)
    return drive_gains(
        base, rows, loaded_rows(base, payload, _samples(plan, loaded)), payload, known=known, method=method
    )


def _plan(setup: Setup, base: BaseModel, logs: Paths) -> Plan:
    """Settings chosen from the runs without a load; they hold for all."""
    segments: list[Segment] = []
    for path in (path for log in logs for path in log_paths(log)):
        for piece in read_log(path, setup.mechanism, setup.columns, rate=setup.preparation.rate, outputs=False):
            segments += piece.segments
    preparation = chosen(setup.preparation, segments, setup.mechanism)
    return Plan(base, setup.columns, replace(preparation, delays=setup.preparation.delays or {}))


def _samples(plan: Plan, logs: Paths) -> list[Samples]:
    paths = [path for log in logs for path in log_paths(log)]
    return [with_zeros(plan.base, some) for path in paths for some in plan.samples(path, outputs=False)]
