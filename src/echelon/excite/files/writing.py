"""Writing trajectories, for robots and other programs."""

from __future__ import annotations

import os

from echelon.excite.files.coefficients import text_of, trajectory_to_json
from echelon.excite.files.joint_trajectory import mcap_bytes, yaml_text
from echelon.excite.files.reading import kind_of
from echelon.excite.files.samples import check_repeats, sampled
from echelon.excite.files.tables import csv_text, parquet_bytes
from echelon.excite.trajectory import Trajectory
from echelon.files import write_atomically


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
    """What a trajectory's file holds.

    Parameters
    ----------
    trajectory : Trajectory
    kind : str
        One of :data:`echelon.excite.files.reading.SUFFIXES`.
    rate, repeats : float, int
        See :func:`write_trajectory`.

    Raises
    ------
    InputError
        If the rate is not valid, or a motion that is not periodic is to be repeated.
    MissingExtraError
        If a package that makes it is not installed.
    """
    check_repeats(trajectory, repeats)
    if kind == ".json":
        return text_of(trajectory_to_json(trajectory))
    samples = sampled(trajectory, rate, repeats)
    if kind == ".csv":
        return csv_text(samples)
    if kind == ".parquet":
        return parquet_bytes(samples, trajectory.units)
    return yaml_text(samples) if kind == ".yaml" else mcap_bytes(samples)
