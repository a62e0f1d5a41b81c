"""Logs of still poses: positions of joints, and what was measured beside them.

A column is found by its name, which may begin with the name of the measurement, and its unit stands in brackets behind
it, as in all logs.  A rotation is a matrix, a quaternion, a rotation vector, or roll, pitch and yaw.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from echelon.calibration.fit import Observed
from echelon.calibration.model import ErrorModel
from echelon.calibration.sights import Sight
from echelon.identification import Setup, Table, factor, logged_positions, read_table
from echelon.robot import GROUND
from echelon.shared import Flags, Floats, InputError, extra, locating, nearest_of

_SHIFT = ("x", "y", "z")
_MATRIX = tuple(f"r{i}{j}" for i in "123" for j in "123")
ROTATIONS = {
    9: _MATRIX,
    4: ("qw", "qx", "qy", "qz"),
    3: ("rx", "ry", "rz"),
}
"""Names of the columns of a rotation, by their number."""
_ANGLES = ("roll", "pitch", "yaw")
LARGEST_SKEW = 0.02
"""Error of the entries of a rotation matrix, or of a quaternion's length, that rounding may have made."""
_UNIT = re.compile(r"\s*[\[(]\s*([^\[\]()]*)\s*[\])]\s*$")
_SEPARATORS = "_./ "


def observed(
    model: ErrorModel, setup: Setup, paths: Sequence[str | os.PathLike[str]]
) -> Observed:
    """Positions and measured values of some logs, one after another.

    Raises
    ------
    InputError
        If a column is missing or holds no such quantity; names the log.
    """
    parts = [_of_table(model, setup, read_table(path)) for path in paths]
    if not parts:
        raise InputError("a calibration needs a log of poses")
    joined = parts[0]
    if len(parts) > 1:
        joined = Observed(
            ", ".join(part.source for part in parts),
            np.vstack([part.q for part in parts]),
            tuple(
                np.vstack(some) for some in zip(*(p.values for p in parts), strict=True)
            ),
            np.vstack([part.present for part in parts]),
            np.concatenate([part.rows for part in parts]),
        )
    for k, sight in enumerate(model.sights):
        if not joined.present[:, k].any():
            raise InputError(
                "no row measures it",
                source=joined.source,
                element=f"measure '{sight.name}'",
            )
    measured = np.asarray(joined.present.any(axis=1))
    return joined.part(measured)


def _of_table(model: ErrorModel, setup: Setup, table: Table) -> Observed:
    q, unlogged = logged_positions(table, model.mechanism, setup.columns)
    _check_unlogged(model, unlogged, table.source)
    values: list[Floats] = []
    with locating(table.source):
        for sight, rows in zip(model.sights, model.rows, strict=True):
            found = _measured(table, sight)
            missing = np.zeros((len(q), rows.stop - rows.start))
            chosen = _rows_of(table, sight, len(q))
            values.append(
                np.where(chosen[:, None], missing if found is None else found, np.nan)
            )
    usable = np.isfinite(q).all(axis=1)
    present = [np.isfinite(value).all(axis=1) & usable for value in values]
    clean = tuple(np.nan_to_num(value) for value in values)
    numbers = np.arange(1.0, len(q) + 1)
    return Observed(
        table.source, np.nan_to_num(q), clean, np.column_stack(present), numbers
    )


def _check_unlogged(model: ErrorModel, unlogged: Sequence[str], source: str) -> None:
    """Refuse a log without a joint that moves what is measured."""
    mechanism = model.mechanism
    on_path = {end for sight in model.sights for end in (sight.body, sight.on)}
    for index in reversed(range(len(mechanism.bodies))):
        if index in on_path:
            on_path.add(mechanism.bodies[index].parent)
    for index in sorted(on_path - {GROUND}):
        for motion in mechanism.bodies[index].joint.motions:
            if motion.name in unlogged:
                raise InputError(
                    f"it has no positions of '{motion.name}', which moves what is measured; of a joint that rests, "
                    f"state where:  locked: {{{motion.name}: 0}}",
                    source=source,
                )


def _rows_of(table: Table, sight: Sight, count: int) -> Flags:
    """Rows that measure a sight, as flags."""
    chosen = np.ones(count, dtype=bool)
    for name, value in ({} if sight.entry is None else sight.entry.where).items():
        if name not in table.columns:
            raise InputError(
                f"there is no column '{name}'{nearest_of(name, table.columns)}",
                element=f"measure '{sight.name}'",
            )
        chosen &= table.columns[name] == value
    return chosen


def _measured(table: Table, sight: Sight) -> Floats | None:
    """Measured values of a sight, SI units, NaN where a row has none; None where rows vanish."""
    if not sight.measured:
        return None
    names = _named(table)
    stated = None if sight.entry is None else sight.entry.columns
    try:
        if isinstance(stated, tuple):
            found = [_column(table, names, name, "m") for name in stated]
            return (
                _values(sight, found[:3], found[3:])
                if sight.kind != "distance"
                else found[0][:, None]
            )
        if sight.kind == "distance":
            return _column(table, names, stated or sight.name, "m")[:, None]
        before = _beginning(names, sight, stated)
        shift = [_column(table, names, before + part, "m") for part in _SHIFT]
        if sight.kind == "position":
            return np.column_stack(shift)
        for parts in (*ROTATIONS.values(), _ANGLES):
            if all(before + part in names for part in parts):
                unit = "rad" if len(parts) == 3 else "1"
                turn = [_column(table, names, before + part, unit) for part in parts]
                return _values(sight, shift, turn, angles=parts is _ANGLES)
        shown = f"{before}r11 … {before}r33, {before}qw … {before}qz or {before}rx … {before}rz"
        raise InputError(
            f"there is no rotation: name its columns {shown}, or state  columns"
        )
    except InputError as error:
        raise InputError(error.problem, element=f"measure '{sight.name}'") from None


def _named(table: Table) -> dict[str, tuple[str, str]]:
    """Columns and their units by their names without units."""
    found = dict[str, tuple[str, str]]()
    for column in table.columns:
        unit = _UNIT.search(column)
        name = column if unit is None else column[: unit.start()]
        found[name] = (column, "" if unit is None else unit.group(1))
    return found | {column: found[name] for name, (column, _) in found.items()}


def _beginning(
    names: Mapping[str, tuple[str, str]], sight: Sight, stated: str | None
) -> str:
    """First letters of the columns' names."""
    marker = sight.name.partition(".")[2]
    tried = list(_beginnings(sight, stated, marker))
    for before in tried:
        if all(before + part in names for part in _SHIFT):
            return before
    shown = ", ".join(f"'{before}x'" for before in tried)
    raise InputError(
        f"there are no columns of its position, such as {shown}{nearest_of(tried[0] + 'x', names)}"
    )


def _beginnings(sight: Sight, stated: str | None, marker: str) -> Iterator[str]:
    stems = [marker] if marker else [sight.name, sight.name.partition(".")[0]]
    for mark in _SEPARATORS:
        yield from (f"{stated or ''}{stem}{mark}" for stem in stems)
    if not marker:
        yield stated or ""


def _column(
    table: Table, names: Mapping[str, tuple[str, str]], name: str, quantity: str
) -> Floats:
    if name not in names:
        raise InputError(f"there is no column '{name}'{nearest_of(name, names)}")
    column, unit = names[name]
    return table.columns[column] * factor(unit, quantity)


def _values(
    sight: Sight,
    shift: Sequence[Floats],
    turn: Sequence[Floats],
    *,
    angles: bool = False,
) -> Floats:
    """Positions and rotation matrices by rows, shape (N, 12), or positions alone."""
    count = 3 if sight.kind == "position" else None
    if len(shift) != 3 or (count is None and len(turn) not in ROTATIONS):
        raise InputError(
            f"{len(shift) + len(turn)} columns are no {sight.kind}: three of a position, then nine of a matrix, four "
            "of a quaternion w x y z, or three of a rotation vector"
        )
    if count is not None:
        return np.column_stack(shift)
    parts = np.column_stack(turn)
    usable = np.isfinite(parts).all(axis=1)
    rotations = np.full((len(parts), 9), np.nan)
    rotations[usable] = _rotation(parts[usable], angles=angles).reshape(-1, 9)
    return np.column_stack([*shift, rotations])


def _rotation(parts: Floats, *, angles: bool) -> Floats:
    """Rotation matrices, shape (N, 3, 3)."""
    with extra("identify"):
        from scipy.spatial.transform import Rotation

    if angles:
        return Rotation.from_euler("xyz", parts).as_matrix()
    if parts.shape[1] == 3:
        return Rotation.from_rotvec(parts).as_matrix()
    if parts.shape[1] == 4:
        if (
            len(parts)
            and np.abs(np.linalg.norm(parts, axis=1) - 1).max() > LARGEST_SKEW
        ):
            raise InputError("its quaternions have not the length 1")
        return Rotation.from_quat(parts[:, [1, 2, 3, 0]]).as_matrix()
    matrices = parts.reshape(-1, 3, 3)
    left, _, right = np.linalg.svd(matrices)
    nearest: Floats = left @ right
    if len(parts) and (
        np.abs(nearest - matrices).max() > LARGEST_SKEW
        or np.linalg.det(nearest).min() < 0
    ):
        raise InputError("its matrices are no rotations")
    return nearest
