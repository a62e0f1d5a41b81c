"""Trajectories as JSON of a versioned schema: the functions themselves, not samples of them.

A document says how its numbers are to be evaluated, in words that travel with them: whoever runs the motion on a robot
needs the file and nothing else.

Numbers are written so that they read back exactly.  Bases that combine the functions of another one are written in
terms of that one, whose functions have names that everybody knows.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel as Schema
from pydantic import ConfigDict, Discriminator, Field

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.excite.problem.trajectory import DURATIONS, Basis, Combined, Fourier, Splines, Trajectory
from echelon.inputs import published_schema
from echelon.results.schema import checked

VERSION = 1
"""Version of the format."""

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

Length = Annotated[float, Field(ge=DURATIONS[0], le=DURATIONS[1])]


class _Strict(Schema):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class FourierCoefficients(_Strict):
    """One coordinate's coefficients, in its unit."""

    constant: float
    sin: list[float] = Field(description="Of sin(2πkt/duration), k = 1, 2, …, harmonics.")
    cos: list[float] = Field(description="Of cos(2πkt/duration), k = 1, 2, …, harmonics.")


class FourierRecord(_Strict):
    """A finite Fourier series."""

    family: Literal["fourier"]
    meaning: str = FOURIER
    duration: Length = Field(description="The period, s.")
    harmonics: int = Field(ge=1)
    coefficients: dict[str, FourierCoefficients] = Field(description="By coordinate.")


class SplinesRecord(_Strict):
    """B-splines on knots that all coordinates share."""

    family: Literal["splines"]
    meaning: str = SPLINES
    degree: int = Field(ge=5)
    knots: list[float] = Field(
        description="s; the first, 0, and the last, the duration, occur degree + 1 times, the others once."
    )
    control_points: dict[str, list[float]] = Field(
        description="By coordinate, in its unit; as many as there are knots less degree + 1."
    )


class SumRecord(_Strict):
    """Motions of one duration on top of one another."""

    family: Literal["sum"]
    meaning: str = SUM
    parts: list[Motion] = Field(min_length=1)


Motion = Annotated[FourierRecord | SplinesRecord | SumRecord, Discriminator("family")]


class TrajectoryRecord(_Strict):
    """A trajectory; keys that are not named here say where it comes from and do not change it."""

    model_config = ConfigDict(extra="allow", title="Echelon trajectory")

    echelon_trajectory: Literal[1] = Field(description="Version of this format.")
    explanation: str = EXPLANATION
    coordinates: list[str] = Field(min_length=1, description="Names, each once.")
    units: list[Literal["rad", "m"]] = Field(description="Of each coordinate.")
    motion: Motion


def trajectory_schema() -> dict[str, Any]:
    """The JSON schema of the file."""
    return published_schema("trajectory", TrajectoryRecord.model_json_schema())


_KEY = "echelon_trajectory"


def as_record(data: Any, source: str) -> TrajectoryRecord:
    """A document, checked against its schema."""
    if not isinstance(data, dict) or _KEY not in data:
        problem = f'is not a trajectory: the document of one is an object that begins with "{_KEY}": {VERSION}'
        raise InputError(problem, source=source)
    return checked(TrajectoryRecord, data, source, "a trajectory of this format")


def trajectory_to_json(trajectory: Trajectory, **extra: Any) -> dict[str, Any]:
    """A trajectory as JSON-able data, a document of :func:`trajectory_schema`; extra keys go with it."""
    names, coefficients = trajectory.coordinates, np.asarray(trajectory.coefficients, dtype=float)
    if not np.all(np.isfinite(coefficients)):
        name = names[int(np.argmin(np.isfinite(coefficients).all(axis=0)))]
        raise InputError("a coefficient is not finite, so that no file can hold it", element=f"coordinate '{name}'")
    for key in extra:
        if key in TrajectoryRecord.model_fields:
            raise InputError("is a key of the format itself; choose another name", element=f"key '{key}'")
    record = TrajectoryRecord.model_construct(
        echelon_trajectory=VERSION,
        coordinates=list(names),
        units=list(trajectory.units),
        motion=_written(trajectory.basis, coefficients, names),
    )
    return record.model_dump() | extra


def trajectory_from_json(data: Any, source: str) -> Trajectory:
    """The trajectory that a document describes."""
    record = as_record(data, source)
    names = tuple(record.coordinates)
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"'{one_line(twice)}' occurs twice", source=source, element="coordinates")
    if len(record.units) != len(names):
        problem = f"has {len(record.units)} entries for {len(names)} coordinates; needs one for each"
        raise InputError(problem, source=source, element="units")
    try:
        basis, coefficients = _read(record.motion, names, "motion")
    except InputError as error:
        raise error.located(source) from None
    return Trajectory(names, tuple(record.units), basis, coefficients)


def text_of(document: Mapping[str, Any]) -> str:
    """A document as JSON text; equal documents give equal text."""
    return json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


# -- writing -----------------------------------------------------------------------------------------------------------


def _written(basis: Basis, coefficients: Floats, names: tuple[str, ...]) -> Motion:
    columns = dict(zip(names, coefficients.T, strict=True))
    if isinstance(basis, Combined):
        parts = [_written(part, own, names) for part, own in basis.split(coefficients)]
        return parts[0] if len(parts) == 1 else SumRecord(family="sum", parts=parts)
    if isinstance(basis, Fourier):
        found = {
            name: FourierCoefficients(constant=float(c[0]), sin=c[1::2].tolist(), cos=c[2::2].tolist())
            for name, c in columns.items()
        }
        return FourierRecord.model_construct(
            family="fourier", duration=float(basis.duration), harmonics=basis.harmonics, coefficients=found
        )
    if isinstance(basis, Splines):
        knots = [0.0] * basis.degree, map(float, basis.breaks), [float(basis.duration)] * basis.degree
        points = {name: column.tolist() for name, column in columns.items()}
        return SplinesRecord(
            family="splines", degree=basis.degree, knots=[k for part in knots for k in part], control_points=points
        )
    raise InputError(f"the format knows no motions of the family {type(basis).__name__}; write samples instead")


# -- reading -----------------------------------------------------------------------------------------------------------


def _read(record: Motion, names: tuple[str, ...], path: str) -> tuple[Basis, Floats]:
    if record.family == "fourier":
        return _read_fourier(record, names, path)
    if record.family == "splines":
        return _read_splines(record, names, path)
    return _read_sum(record, names, path)


def _read_sum(record: SumRecord, names: tuple[str, ...], path: str) -> tuple[Basis, Floats]:
    found = [_read(part, names, f"{path}.parts[{k}]") for k, part in enumerate(record.parts)]
    durations = [basis.duration for basis, _ in found]
    for k, duration in enumerate(durations):
        if duration != durations[0]:
            problem = f"lasts {duration!r} s, the first part {durations[0]!r} s; parts of a sum last equally long"
            raise InputError(problem, element=f"{path}.parts[{k}]")
    return Combined(tuple(basis for basis, _ in found)), np.vstack([coefficients for _, coefficients in found])


def _read_fourier(record: FourierRecord, names: tuple[str, ...], path: str) -> tuple[Basis, Floats]:
    _check_names(record.coefficients, names, f"{path}.coefficients")
    for name in names:
        found = record.coefficients[name]
        for key, values in {"sin": found.sin, "cos": found.cos}.items():
            if len(values) != record.harmonics:
                problem = f"has {len(values)} entries; needs {record.harmonics}, one for each harmonic"
                raise InputError(problem, element=f"{path}.coefficients.{one_line(name)}.{key}")
    columns = np.zeros((1 + 2 * record.harmonics, len(names)))  # as long as the lists that were just counted
    for j, name in enumerate(names):
        found = record.coefficients[name]
        columns[0, j], columns[1::2, j], columns[2::2, j] = found.constant, found.sin, found.cos
    return Fourier(record.duration, record.harmonics), columns


def _read_splines(record: SplinesRecord, names: tuple[str, ...], path: str) -> tuple[Basis, Floats]:
    degree, knots = record.degree, np.array(record.knots, dtype=float)
    breaks = knots[degree : len(knots) - degree]
    ends = [*knots[:degree], *knots[len(knots) - degree :]]
    clamped = len(breaks) >= 2 and ends == [0.0] * degree + [breaks[-1]] * degree
    if not clamped or breaks[0] != 0 or np.any(np.diff(breaks) <= 0):
        problem = (
            f"of degree {degree} begin with {degree + 1} times 0, rise, and end with {degree + 1} times the duration"
        )
        raise InputError(problem, element=f"{path}.knots")
    _check_names(record.control_points, names, f"{path}.control_points")
    basis = Splines(tuple(breaks.tolist()), degree)
    for name in names:
        count = len(record.control_points[name])
        if count != basis.size:
            problem = f"has {count} entries; {len(knots)} knots of degree {degree} need {basis.size}"
            raise InputError(problem, element=f"{path}.control_points.{one_line(name)}")
    return basis, np.array([record.control_points[name] for name in names], dtype=float).T


def _check_names(found: Iterable[str], names: tuple[str, ...], path: str) -> None:
    """Every coordinate and no other."""
    there = set(found)
    for name in names:
        if name not in there:
            raise InputError(f"the coordinate '{one_line(name)}' is missing", element=path)
    for name in sorted(there - set(names)):
        raise InputError(f"'{one_line(name)}' is not among the document's coordinates {list(names)}", element=path)
