"""Reading trajectories that were made elsewhere."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from echelon.errors import InputError, one_line
from echelon.excite.files.coefficients import trajectory_from_json
from echelon.excite.files.interpolation import interpolated
from echelon.excite.files.messages import from_mcap, from_yaml
from echelon.excite.files.tables import read_samples
from echelon.excite.trajectory import DURATIONS, LARGEST, Trajectory
from echelon.inputs.content import read_content
from echelon.inputs.json_text import parse_json
from echelon.logs.files.access import existing_file

SUFFIXES = (".json", ".csv", ".parquet", ".yaml", ".mcap")
"""Of the names of trajectories' files; .yml counts as .yaml."""


def kind_of(path: str | os.PathLike[str]) -> str:
    """The suffix that says what a file holds.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If it is none of :data:`SUFFIXES`.
    """
    suffix = Path(path).suffix.lower().replace(".yml", ".yaml")
    if suffix not in SUFFIXES:
        problem = f"'{suffix}' names no kind of trajectory; valid are {', '.join(SUFFIXES)}"
        raise InputError(one_line(problem), source=os.fspath(path))
    return suffix


def read_trajectory(path: str | os.PathLike[str], coordinates: Sequence[str], units: Sequence[str]) -> Trajectory:
    """A trajectory from a file.

    Coefficients (JSON) give the motion itself.  Samples, of a table or a message, give the spline of degree 5 through
    them, from time 0 on.

    Parameters
    ----------
    path : path
        JSON, CSV, Parquet, a JointTrajectory of ROS 2 as YAML, or MCAP with one, by suffix.
    coordinates : sequence of str
        Those that move, in the order of the trajectory's columns.
    units : sequence of str
        ``"rad"`` or ``"m"`` of each.

    Returns
    -------
    Trajectory

    Raises
    ------
    InputError
        If the file cannot be read, its coordinates are others, its numbers are not finite or its times do not rise, or
        what it states as velocities and accelerations is far from those of its positions.
    MissingExtraError
        If a package that reads it is not installed.
    """
    source = os.fspath(path)
    trajectory = _read(path, coordinates, units)
    with np.errstate(all="ignore"):
        largest = max(float(np.max(trajectory.bounds(order))) for order in range(4))
    if not (DURATIONS[0] <= trajectory.duration <= DURATIONS[1] and largest <= LARGEST):
        problem = f"lasts {trajectory.duration:.3g} s and reaches {largest:.3g} in SI units: no robot moves so"
        raise InputError(problem, source=source)
    return trajectory


def _read(path: str | os.PathLike[str], coordinates: Sequence[str], units: Sequence[str]) -> Trajectory:
    kind, source = kind_of(path), os.fspath(path)
    found = existing_file(path)
    if kind == ".json":
        trajectory = trajectory_from_json(parse_json(read_content(found), source), source)
        return _arranged(trajectory, coordinates, units, source)
    if kind == ".yaml":
        return interpolated(from_yaml(read_content(found), source, coordinates), units, source, "point")
    if kind == ".mcap":
        return interpolated(from_mcap(path, coordinates), units, source, "point")
    return interpolated(read_samples(path, coordinates, units), units, source)


def _arranged(trajectory: Trajectory, coordinates: Sequence[str], units: Sequence[str], source: str) -> Trajectory:
    """The same motion with its coordinates in the order asked for."""
    there = ", ".join(f"'{one_line(name)}'" for name in trajectory.coordinates)
    for name, unit in zip(coordinates, units, strict=True):
        if name not in trajectory.coordinates:
            problem = f"the coordinate '{name}' is missing; there are {there}"
            raise InputError(problem, source=source, element="coordinates")
        stated = trajectory.units[trajectory.coordinates.index(name)]
        if stated != unit:
            raise InputError(f"'{name}' is in {stated}; needs {unit}", source=source, element="units")
    surplus = ", ".join(f"'{one_line(name)}'" for name in trajectory.coordinates if name not in coordinates)
    if surplus:
        problem = f"there is no coordinate for {surplus}; valid are {', '.join(map(repr, coordinates))}"
        raise InputError(problem, source=source, element="coordinates")
    order = [trajectory.coordinates.index(name) for name in coordinates]
    return Trajectory(tuple(coordinates), tuple(units), trajectory.basis, trajectory.coefficients[:, order])
