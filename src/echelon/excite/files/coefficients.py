"""Trajectories as JSON: the functions themselves, not samples of them.

Numbers are written so that they read back exactly.  Bases that combine the functions of another one are written in
terms of that one, whose functions have names that everybody knows.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError, one_line
from echelon.excite.files.trajectory_schema import as_record
from echelon.excite.problem.trajectory import Basis, Fourier, Recombined, Splines, Sum, Trajectory

if TYPE_CHECKING:
    from echelon.excite.files.trajectory_schema import FourierRecord, Motion, SplinesRecord, SumRecord


def trajectory_to_json(trajectory: Trajectory, **extra: Any) -> dict[str, Any]:
    """A trajectory as JSON-able data, a document of :func:`trajectory_schema`; extra keys go with it."""
    from echelon.excite.files.trajectory_schema import EXPLANATION, VERSION

    coefficients = np.asarray(trajectory.coefficients, dtype=float)
    if not np.all(np.isfinite(coefficients)):
        name = trajectory.coordinates[int(np.argmin(np.isfinite(coefficients).all(axis=0)))]
        raise InputError("a coefficient is not finite, so that no file can hold it", element=f"coordinate '{name}'")
    document = {
        "echelon_trajectory": VERSION,
        "explanation": EXPLANATION,
        "coordinates": list(trajectory.coordinates),
        "units": list(trajectory.units),
        "motion": _written(trajectory.basis, coefficients, trajectory.coordinates),
    }
    for key in extra:
        if key in document:
            raise InputError("is a key of the format itself; choose another name", element=f"key '{key}'")
    return document | extra


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


def _written(basis: Basis, coefficients: Floats, names: tuple[str, ...]) -> dict[str, Any]:
    from echelon.excite.files.trajectory_schema import SUM

    if isinstance(basis, Recombined):
        return _written(basis.inner, basis.matrix @ coefficients, names)
    if isinstance(basis, Sum):
        cuts = np.cumsum([part.size for part in basis.parts])[:-1]
        pieces = np.split(coefficients, cuts)
        parts = [_written(part, piece, names) for part, piece in zip(basis.parts, pieces, strict=True)]
        return {"family": "sum", "meaning": SUM, "parts": parts}
    if isinstance(basis, Fourier):
        return _written_fourier(basis, coefficients, names)
    if isinstance(basis, Splines):
        return _written_splines(basis, coefficients, names)
    raise InputError(f"the format knows no motions of the family {type(basis).__name__}; write samples instead")


def _written_fourier(basis: Fourier, coefficients: Floats, names: tuple[str, ...]) -> dict[str, Any]:
    from echelon.excite.files.trajectory_schema import FOURIER

    columns = {
        name: {"constant": float(column[0]), "sin": column[1::2].tolist(), "cos": column[2::2].tolist()}
        for name, column in zip(names, coefficients.T, strict=True)
    }
    return {
        "family": "fourier",
        "meaning": FOURIER,
        "duration": float(basis.duration),
        "harmonics": basis.harmonics,
        "coefficients": columns,
    }


def _written_splines(basis: Splines, coefficients: Floats, names: tuple[str, ...]) -> dict[str, Any]:
    from echelon.excite.files.trajectory_schema import SPLINES

    ends = [0.0] * basis.degree, [float(basis.duration)] * basis.degree
    return {
        "family": "splines",
        "meaning": SPLINES,
        "degree": basis.degree,
        "knots": [*ends[0], *(float(knot) for knot in basis.breaks), *ends[1]],
        "control_points": {name: column.tolist() for name, column in zip(names, coefficients.T, strict=True)},
    }


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
    return Sum(tuple(basis for basis, _ in found)), np.vstack([coefficients for _, coefficients in found])


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
        raise InputError(f"'{one_line(name)}' is none of the document's coordinates {list(names)}", element=path)
