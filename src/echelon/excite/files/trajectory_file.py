"""Files of trajectories: coefficients as JSON of a versioned schema, and samples.

A document says how its numbers are to be evaluated, in words that travel with them: whoever runs the motion on a robot
needs the file and nothing else.  Numbers are written so that they read back exactly.  Bases that combine the functions
of another one are written in terms of that one, whose functions have names that everybody knows.  A design is such a
document with all that is known about it.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np

from echelon.excite.excite import ExcitingTrajectory
from echelon.excite.files.samples import (
    check_repeats,
    csv_text,
    from_yaml,
    interpolated,
    parquet_bytes,
    places,
    read_samples,
    sampled,
    yaml_text,
)
from echelon.excite.problem.trajectory import (
    DURATIONS,
    LARGEST,
    Basis,
    Combined,
    Fourier,
    Splines,
    Trajectory,
)
from echelon.identification import existing_file
from echelon.shared import (
    ByValue,
    Floats,
    InputError,
    Record,
    Within,
    locating,
    one_line,
    parse_json,
    plain_data,
    public,
    published_schema,
    read_content,
    record_from,
    required,
    schema_of,
    write_atomically,
)

VERSION = 1  # version of the format

FOURIER = (
    "q(t) = constant + sum over k = 1 ... harmonics of sin[k-1] * sin(2 pi k t / duration) "
    "+ cos[k-1] * cos(2 pi k t / duration); periodic with the duration"
)
SPLINES = (
    "B-spline: q(t) = sum over i of control_points[i] * N[i](t), N[i] the B-spline of the degree on "
    "knots[i] ... knots[i + degree + 1]; from t = 0 to the last knot"
)
SUM = "the sum of the parts at each t"
EXPLANATION = (
    "Position of each coordinate in its unit over time t in s, as the motion's 'meaning' says; velocities, "
    "accelerations and jerks are the derivatives of the same formula."
)

Length = Annotated[float, Within(ge=DURATIONS[0], le=DURATIONS[1])]


class FourierCoefficients(Record):
    """One coordinate's coefficients, in its unit."""

    constant: float
    sin: list[float] = required(
        "Coefficients of sin(2πkt/duration), k = 1, 2, …, harmonics."
    )
    cos: list[float] = required(
        "Coefficients of cos(2πkt/duration), k = 1, 2, …, harmonics."
    )


class FourierRecord(Record):
    """A finite Fourier series."""

    family: Literal["fourier"]
    meaning: str = FOURIER
    duration: Length = required("The period, s.")
    harmonics: Annotated[int, Within(ge=1)]
    coefficients: dict[str, FourierCoefficients] = required("By coordinate.")


class SplinesRecord(Record):
    """B-splines on knots that all coordinates share."""

    family: Literal["splines"]
    meaning: str = SPLINES
    degree: Annotated[int, Within(ge=5)]
    knots: list[float] = required(
        "s; the first, 0, and the last, the duration, occur degree + 1 times, the others once."
    )
    control_points: dict[str, list[float]] = required(
        "By coordinate, in its unit; as many as there are knots less degree + 1."
    )


class SumRecord(Record):
    """Motions of one duration on top of one another."""

    family: Literal["sum"]
    meaning: str = SUM
    parts: Annotated[list[Motion], Within(min_length=1)]


Motion = Annotated[
    FourierRecord | SplinesRecord | SumRecord,
    ByValue("family", "{family: fourier, …}"),
]


class TrajectoryRecord(Record):
    """A trajectory; keys that are not named here say where it comes from and do not change it."""

    title = "Echelon trajectory"
    other_keys = True

    echelon_trajectory: Literal[1] = required("Version of this format.")
    explanation: str = EXPLANATION
    coordinates: Annotated[list[str], Within(min_length=1)] = required(
        "Names, each once."
    )
    units: list[Literal["rad", "m"]] = required("Unit of each coordinate.")
    motion: Motion


def trajectory_schema() -> dict[str, Any]:
    """The JSON schema of the file."""
    return published_schema("trajectory", schema_of(TrajectoryRecord))


_KEY = "echelon_trajectory"


def trajectory_to_json(trajectory: Trajectory, **extra: Any) -> dict[str, Any]:
    """A trajectory as JSON-able data, a document of :func:`trajectory_schema`; extra keys go with it."""
    names, coefficients = (
        trajectory.coordinates,
        np.asarray(trajectory.coefficients, dtype=float),
    )
    if not np.all(np.isfinite(coefficients)):
        name = names[int(np.argmin(np.isfinite(coefficients).all(axis=0)))]
        raise InputError(
            "a coefficient is not finite, and files cannot contain it",
            element=f"coordinate '{name}'",
        )
    for key in extra:
        if key in TrajectoryRecord.model_fields:
            raise InputError(
                "is a key of the format itself; choose another name",
                element=f"key '{key}'",
            )
    record = TrajectoryRecord.model_construct(
        echelon_trajectory=VERSION,
        coordinates=list(names),
        units=list(trajectory.units),
        motion=_written(trajectory.basis, coefficients, names),
    )
    return record.model_dump() | extra


def trajectory_from_json(data: Any, source: str) -> Trajectory:
    """The trajectory that a document describes."""
    if not isinstance(data, dict) or _KEY not in data:
        problem = f'is not a trajectory: the document of one is an object that begins with "{_KEY}": {VERSION}'
        raise InputError(problem, source=source)
    record = record_from(TrajectoryRecord, data, source, "a trajectory of this format")
    names = tuple(record.coordinates)
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(
            f"'{one_line(twice)}' occurs twice", source=source, element="coordinates"
        )
    if len(record.units) != len(names):
        problem = f"has {len(record.units)} entries for {len(names)} coordinates; needs one for each"
        raise InputError(problem, source=source, element="units")
    with locating(source):
        return Trajectory(
            names, tuple(record.units), *_read_motion(record.motion, names, "motion")
        )


def text_of(document: Mapping[str, Any]) -> str:
    """A document as JSON text; equal documents give equal text."""
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


# -- writing -----------------------------------------------------------------------------------------------------------


def _written(basis: Basis, coefficients: Floats, names: tuple[str, ...]) -> Motion:
    columns = dict(zip(names, coefficients.T, strict=True))
    if isinstance(basis, Combined):
        parts = [_written(part, own, names) for part, own in basis.split(coefficients)]
        return (
            parts[0]
            if len(parts) == 1
            else SumRecord.model_construct(family="sum", parts=parts)
        )
    if isinstance(basis, Fourier):
        found = {
            name: FourierCoefficients(
                constant=float(c[0]), sin=c[1::2].tolist(), cos=c[2::2].tolist()
            )
            for name, c in columns.items()
        }
        return FourierRecord.model_construct(
            family="fourier",
            duration=float(basis.duration),
            harmonics=basis.harmonics,
            coefficients=found,
        )
    if isinstance(basis, Splines):
        knots = (
            [0.0] * basis.degree,
            map(float, basis.breaks),
            [float(basis.duration)] * basis.degree,
        )
        points = {name: column.tolist() for name, column in columns.items()}
        return SplinesRecord.model_construct(
            family="splines",
            degree=basis.degree,
            knots=[k for part in knots for k in part],
            control_points=points,
        )
    raise InputError(
        f"the format knows no motions of the family {type(basis).__name__}; write samples instead"
    )


# -- reading -----------------------------------------------------------------------------------------------------------


def _read_motion(
    record: Motion, names: tuple[str, ...], path: str
) -> tuple[Basis, Floats]:
    if record.family == "fourier":
        return _read_fourier(record, names, path)
    if record.family == "splines":
        return _read_splines(record, names, path)
    found = [
        _read_motion(part, names, f"{path}.parts[{k}]")
        for k, part in enumerate(record.parts)
    ]
    durations = [basis.duration for basis, _ in found]
    for k, duration in enumerate(durations):
        if duration != durations[0]:
            problem = f"lasts {duration!r} s, the first part {durations[0]!r} s; parts of a sum need equal durations"
            raise InputError(problem, element=f"{path}.parts[{k}]")
    return Combined(tuple(basis for basis, _ in found)), np.vstack(
        [coefficients for _, coefficients in found]
    )


def _read_fourier(
    record: FourierRecord, names: tuple[str, ...], path: str
) -> tuple[Basis, Floats]:
    places(list(record.coefficients), names, f"{path}.coefficients")
    for name in names:
        found = record.coefficients[name]
        for key, values in {"sin": found.sin, "cos": found.cos}.items():
            if len(values) != record.harmonics:
                problem = f"has {len(values)} entries; needs {record.harmonics}, one for each harmonic"
                raise InputError(
                    problem, element=f"{path}.coefficients.{one_line(name)}.{key}"
                )
    columns = np.zeros(
        (1 + 2 * record.harmonics, len(names))
    )  # as long as the lists that were just counted
    for j, name in enumerate(names):
        found = record.coefficients[name]
        columns[0, j], columns[1::2, j], columns[2::2, j] = (
            found.constant,
            found.sin,
            found.cos,
        )
    return Fourier(record.duration, record.harmonics), columns


def _read_splines(
    record: SplinesRecord, names: tuple[str, ...], path: str
) -> tuple[Basis, Floats]:
    degree, knots = record.degree, np.array(record.knots, dtype=float)
    breaks = knots[degree : len(knots) - degree]
    ends = [*knots[:degree], *knots[len(knots) - degree :]]
    clamped = len(breaks) >= 2 and ends == [0.0] * degree + [breaks[-1]] * degree
    if not clamped or breaks[0] != 0 or np.any(np.diff(breaks) <= 0):
        ends_with = f"end with {degree + 1} times the duration"
        problem = (
            f"of degree {degree} begin with {degree + 1} times 0, rise, and {ends_with}"
        )
        raise InputError(problem, element=f"{path}.knots")
    places(list(record.control_points), names, f"{path}.control_points")
    basis = Splines(tuple(breaks.tolist()), degree)
    for name in names:
        count = len(record.control_points[name])
        if count != basis.size:
            problem = f"has {count} entries; {len(knots)} knots of degree {degree} need {basis.size}"
            raise InputError(problem, element=f"{path}.control_points.{one_line(name)}")
    return basis, np.array(
        [record.control_points[name] for name in names], dtype=float
    ).T


# -- files of every kind -----------------------------------------------------------------------------------------------

SUFFIXES = (
    ".json",
    ".csv",
    ".parquet",
    ".yaml",
)  # suffixes of trajectories' files; .yml counts as .yaml


def kind_of(path: str | os.PathLike[str]) -> str:
    """The suffix that says what a file holds."""
    suffix = Path(path).suffix.lower().replace(".yml", ".yaml")
    if suffix not in SUFFIXES:
        problem = (
            f"'{suffix}' names no kind of trajectory; valid are {', '.join(SUFFIXES)}"
        )
        raise InputError(one_line(problem), source=os.fspath(path))
    return suffix


@public
def read_trajectory(
    path: str | os.PathLike[str], coordinates: Sequence[str], units: Sequence[str]
) -> Trajectory:
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
        problem = f"lasts {trajectory.duration:.3g} s and reaches {largest:.3g} in SI units: no robot reaches that"
        raise InputError(problem, source=source)
    return trajectory


def _read(
    path: str | os.PathLike[str], coordinates: Sequence[str], units: Sequence[str]
) -> Trajectory:
    kind, source = kind_of(path), os.fspath(path)
    found = existing_file(path)
    if kind == ".json":
        trajectory = trajectory_from_json(
            parse_json(read_content(found), source), source
        )
        return _arranged(trajectory, coordinates, units, source)
    if kind == ".yaml":
        return interpolated(
            from_yaml(read_content(found), source, coordinates), units, source, "point"
        )
    return interpolated(read_samples(path, coordinates, units), units, source)


def _arranged(
    trajectory: Trajectory,
    coordinates: Sequence[str],
    units: Sequence[str],
    source: str,
) -> Trajectory:
    """The motion with its coordinates in the order asked for."""
    with locating(source):
        order = places(trajectory.coordinates, coordinates, "coordinates")
    for name, unit, place in zip(coordinates, units, order, strict=True):
        if trajectory.units[place] != unit:
            raise InputError(
                f"'{name}' is in {trajectory.units[place]}; needs {unit}",
                source=source,
                element="units",
            )
    return Trajectory(
        tuple(coordinates),
        tuple(units),
        trajectory.basis,
        trajectory.coefficients[:, order],
    )


def design_to_json(found: ExcitingTrajectory) -> dict[str, Any]:
    """Everything about a designed or judged trajectory, JSON-able; it reads back as its trajectory."""
    conditioning, names = (
        found.conditioning,
        [expression.name for expression in found.base.expressions],
    )
    margins = [
        {
            **asdict(margin),
            "margin": margin.margin,
            "kept": margin.kept,
            "active": margin.active,
        }
        for margin in found.margins
    ]
    about = {
        "safe": found.safe,
        "unchecked": found.unchecked,
        "criterion": found.criterion,
        "condition_numbers": {
            "plain": conditioning.condition,
            "scaled": conditioning.scaled_condition,
        },
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


@public
def write_trajectory(
    trajectory: Trajectory, path: str | os.PathLike[str], rate: float, repeats: int = 1
) -> None:
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


def trajectory_content(
    trajectory: Trajectory, kind: str, rate: float, repeats: int = 1
) -> str | bytes:
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
