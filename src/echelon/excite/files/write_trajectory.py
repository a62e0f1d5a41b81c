"""Writing trajectories: a design as JSON with all that is known about it, and samples as tables or messages."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import asdict
from math import isfinite
from typing import Any

from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.excite.files.coefficients import text_of, trajectory_to_json
from echelon.excite.files.joint_trajectory import yaml_text
from echelon.excite.files.read_trajectory import kind_of
from echelon.excite.files.trajectory_samples import check_repeats, csv_text, parquet_bytes, sampled
from echelon.excite.problem.trajectory import Trajectory
from echelon.files import write_atomically


def design_to_json(found: ExcitingTrajectory) -> dict[str, Any]:
    """Everything about a designed or judged trajectory, JSON-able; it reads back as its trajectory."""
    conditioning, names = found.conditioning, [expression.name for expression in found.base.expressions]
    margins = [
        {**asdict(margin), "margin": margin.margin, "kept": margin.kept, "active": margin.active}
        for margin in found.margins
    ]
    about = {
        "safe": found.safe,
        "criterion": found.criterion,
        "condition_numbers": {"plain": conditioning.condition, "scaled": conditioning.scaled_condition},
        "log_det": conditioning.log_det,
        "standard_deviations": dict(zip(names, conditioning.std, strict=True)),
        "scaled_condition_over_time": conditioning.over_time,
        "held": found.held,
        "margins": margins,
        "starts": [asdict(start) for start in found.starts],
        "findings": [str(finding) for finding in found.findings],
        "settings": found.settings,
    }
    return trajectory_to_json(found.trajectory, **{key: _plain(value) for key, value in about.items()})


def _plain(value: Any) -> Any:
    """Lists, mappings, texts and numbers; null for a number that is not finite, which JSON cannot say."""
    if isinstance(value, Mapping):
        return {key: _plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not isfinite(value) else value


def write_trajectory(trajectory: Trajectory, path: str | os.PathLike[str], rate: float, repeats: int = 1) -> None:
    """Write a trajectory to a file, whole or not at all.

    Parameters
    ----------
    trajectory : Trajectory
    path : path
        By suffix: ``.json`` for its coefficients; ``.csv`` or ``.parquet`` for samples of positions, velocities and
        accelerations; ``.yaml`` for the same as a JointTrajectory of ROS 2.
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
    """Content of a trajectory's file; the kind is its suffix."""
    check_repeats(trajectory, repeats)
    if kind == ".json":
        return text_of(trajectory_to_json(trajectory))
    samples = sampled(trajectory, rate, repeats)
    if kind == ".csv":
        return csv_text(samples)
    if kind == ".parquet":
        return parquet_bytes(samples, trajectory.units)
    return yaml_text(samples)
