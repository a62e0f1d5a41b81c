"""Reading trajectories that were made elsewhere, and writing them: a design as JSON with all that is known about it.

Samples give a spline of degree 5 through them, so that accelerations and jerks are continuous.  Its knots are sample
times but for the two next to each end, which would leave it undetermined.  Velocities and accelerations that come with
the samples are not needed; they show that the samples are dense and precise enough for the spline to be what was meant.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.excite.excite import ExcitingTrajectory
from echelon.excite.files.coefficients import text_of, trajectory_from_json, trajectory_to_json
from echelon.excite.files.samples import (
    FEWEST,
    Samples,
    check_repeats,
    csv_text,
    from_yaml,
    parquet_bytes,
    places,
    read_samples,
    sampled,
    yaml_text,
)
from echelon.excite.problem.trajectory import DEGREE, DURATIONS, LARGEST, SHORTEST_STEP, Splines, Trajectory
from echelon.extras import extra
from echelon.files import write_atomically
from echelon.inputs import parse_json, plain_data, read_content
from echelon.logs.files.log_file import existing_file

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


GROSS = 0.2
"""Root mean square of a difference, relative to that of what differs, that cannot come from interpolating."""

_NAMES = ("positions", "velocities", "accelerations")


def interpolated(samples: Samples, units: Sequence[str], source: str, row: str = "row") -> Trajectory:
    """The quintic spline through samples, from time 0 on."""
    with extra("excite"):
        from scipy.interpolate import BSpline, make_interp_spline

    _check_numbers(samples, source, row)
    t = samples.t - samples.t[0]
    _check_times(t, samples.t, source, row)
    spline = make_interp_spline(t, samples.states[0], k=DEGREE)
    # the spline's knots: inside, each once; at the ends, so often that the spline ends there
    breaks = spline.t[DEGREE : len(spline.t) - DEGREE]
    points: Floats = np.ascontiguousarray(spline.c, dtype=float)
    _check_derivatives(samples, BSpline(spline.t, points, DEGREE), t, source)
    return Trajectory(samples.coordinates, tuple(units), Splines(tuple(breaks.tolist())), points)


def _check_numbers(samples: Samples, source: str, row: str) -> None:
    count = len(samples.t)
    if count < FEWEST:
        raise InputError(f"holds {count} samples; a trajectory needs at least {FEWEST}", source=source)
    columns = [("t", samples.t), *((samples.column(order, j), values) for order, j, values in samples.columns())]
    for name, values in columns:
        sound = np.abs(values) <= LARGEST
        if not np.all(sound):
            k = int(np.argmin(sound))
            problem = f"is not a finite number up to {LARGEST:.0e}, in SI units"
            raise InputError(f"{values[k]} {problem}", source=source, element=f"column '{name}', {row} {k}")


def _check_times(t: Floats, stated: Floats, source: str, row: str) -> None:
    """Times rise, also after the first one is taken from them."""
    rising = np.diff(t) >= SHORTEST_STEP
    if not np.all(rising):
        k = int(np.argmin(rising))
        problem = f"{stated[k + 1]!s} s follows {stated[k]!s} s; times must rise"
        raise InputError(problem, source=source, element=f"column 't', {row} {k + 1}")


def _check_derivatives(samples: Samples, spline: BSpline, t: Floats, source: str) -> None:
    """Velocities and accelerations that the file states; differences that rounding explains do not count."""
    speeds, step = spline(t, nu=1), float(np.min(np.diff(t)))
    stamps = samples.resolution + float(np.spacing(np.abs(samples.t).max()))
    for order, j, stated in samples.columns():
        if order == 0:
            continue
        found: Floats = spline(t, nu=order)[:, j]
        rounding = 4 * float(np.spacing(np.abs(samples.states[0][:, j]).max())) + stamps * _rms(speeds[:, j])
        difference, scale = _rms(stated - found), max(_rms(stated), _rms(found))
        # of what the steps can show, the fastest oscillation makes the most of an error
        if difference > GROSS * scale + rounding * (np.pi / step) ** order:
            share = f"{100 * difference / scale:.0f} %"
            problem = (
                f"its {_NAMES[order]} are not those of the positions, from which they differ by {share} (rms): "
                "steps are too long, positions have too few digits, or units differ"
            )
            raise InputError(problem, source=source, element=f"column '{samples.column(order, j)}'")


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


SUFFIXES = (".json", ".csv", ".parquet", ".yaml")
"""Suffixes of trajectories' files; .yml counts as .yaml."""


def kind_of(path: str | os.PathLike[str]) -> str:
    """The suffix that says what a file holds."""
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
        JSON, CSV, Parquet, or a JointTrajectory of ROS 2 as YAML, by suffix.
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
        problem = f"lasts {trajectory.duration:.3g} s and reaches {largest:.3g} in SI units: beyond what a robot can do"
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
    return interpolated(read_samples(path, coordinates, units), units, source)


def _arranged(trajectory: Trajectory, coordinates: Sequence[str], units: Sequence[str], source: str) -> Trajectory:
    """The motion with its coordinates in the order asked for."""
    try:
        order = places(trajectory.coordinates, coordinates, "coordinates")
    except InputError as error:
        raise error.located(source) from None
    for name, unit, place in zip(coordinates, units, order, strict=True):
        if trajectory.units[place] != unit:
            raise InputError(f"'{name}' is in {trajectory.units[place]}; needs {unit}", source=source, element="units")
    return Trajectory(tuple(coordinates), tuple(units), trajectory.basis, trajectory.coefficients[:, order])


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
    return trajectory_to_json(found.trajectory, **plain_data(about))


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
