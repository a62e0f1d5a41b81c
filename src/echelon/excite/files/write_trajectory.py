"""Writing trajectories: a design as JSON with all that is known about it, and samples as tables or messages."""

from __future__ import annotations

import os
from dataclasses import asdict
from math import isfinite
from typing import Any

from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.excite.files.coefficients import text_of, trajectory_to_json
from echelon.excite.files.joint_trajectory import mcap_bytes, yaml_text
from echelon.excite.files.read_trajectory import kind_of
from echelon.excite.files.trajectory_samples import check_repeats, csv_text, parquet_bytes, sampled
from echelon.excite.problem.trajectory import Trajectory
from echelon.excite.verify.margins import Margin
from echelon.files import write_atomically


def design_to_json(found: ExcitingTrajectory) -> dict[str, Any]:
    """Everything about a designed or judged trajectory, JSON-able; it reads back as its trajectory."""
    shown = found.conditioning
    names = [expression.name for expression in found.base.expressions]
    std = {name: _number(value) for name, value in zip(names, shown.std, strict=True)}
    conditions = {"plain": _number(shown.condition), "scaled": _number(shown.scaled_condition)}
    return trajectory_to_json(
        found.trajectory,
        safe=found.safe,
        criterion=found.criterion,
        condition_numbers=conditions,
        log_det=_number(shown.log_det),
        standard_deviations=std,
        scaled_condition_over_time=[[t, _number(c)] for t, c in shown.over_time],
        held=dict(found.held),
        margins=[_margin(margin) for margin in found.margins],
        starts=[
            {**asdict(start), "value": _number(start.value), "history": list(start.history)} for start in found.starts
        ],
        findings=[str(finding) for finding in found.findings],
        settings=dict(found.settings),
    )


def _margin(margin: Margin) -> dict[str, Any]:
    numbers = {key: _number(value) for key, value in asdict(margin).items() if isinstance(value, float)}
    size = {"margin": _number(margin.margin), "kept": margin.kept, "active": margin.active}
    return {"label": margin.label, "unit": margin.unit, **numbers, **size}


def _number(value: float) -> float | None:
    """A number, or nothing where it is not finite, which JSON cannot say."""
    return float(value) if isfinite(value) else None


def write_trajectory(trajectory: Trajectory, path: str | os.PathLike[str], rate: float, repeats: int = 1) -> None:
    """Write a trajectory to a file, whole or not at all.

    Parameters
    ----------
    trajectory : Trajectory
    path : path
        By suffix: ``.json`` for its coefficients; ``.csv`` or ``.parquet`` for samples of positions, velocities and
        accelerations; ``.yaml`` or ``.mcap`` for the same as a JointTrajectory of ROS 2.
    rate : float
        Samples per second, Hz; of no influence on coefficients.
    repeats : int
        How often a periodic motion is run in the samples.

    Raises
    ------
    InputError
        If the suffix or the rate is not valid, a motion that is not periodic is to be repeated, or the file cannot be
        written.
    MissingExtraError
        If a package that writes it is not installed.
    """
    write_atomically(path, trajectory_content(trajectory, kind_of(path), rate, repeats))


def trajectory_content(trajectory: Trajectory, kind: str, rate: float, repeats: int = 1) -> str | bytes:
    """What a trajectory's file holds."""
    check_repeats(trajectory, repeats)
    if kind == ".json":
        return text_of(trajectory_to_json(trajectory))
    samples = sampled(trajectory, rate, repeats)
    if kind == ".csv":
        return csv_text(samples)
    if kind == ".parquet":
        return parquet_bytes(samples, trajectory.units)
    return yaml_text(samples) if kind == ".yaml" else mcap_bytes(samples)
