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
    readers: list[tuple[Sight, list[str], Flags]] = []
    with locating(table.source):
        for sight, rows in zip(model.sights, model.rows, strict=True):
            read: list[str] = []
            found = _measured(table, sight, read)
            missing = np.zeros((len(q), rows.stop - rows.start))
            chosen = _rows_of(table, sight, len(q))
            for other, columns, rows_there in readers:
                both = [name for name in read if name in columns]
                if both and (chosen & rows_there).any():
                    raise InputError(
                        f"it reads the column '{both[0]}', as '{other.name}' does: let the columns of each begin with "
                        f"its name, such as '{sight.name}_x', or state  columns  or  where",
                        element=f"measure '{sight.name}'",
                    )
            readers.append((sight, read, chosen))
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
                    f"it has no positions of '{motion.name}', which moves the tool; for a joint at rest, state its "
                    f"position:  locked: {{{motion.name}: 0}}",
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


def _measured(table: Table, sight: Sight, read: list[str]) -> Floats | None:
    """Measured values of a sight, SI units, NaN where a row has none; None where rows vanish.

    The columns are added to those that were read.
    """
    stated = None if sight.entry is None else sight.entry.columns
    if not sight.measured:
        if stated:
            raise InputError(
                "its value never changes, so it needs no columns: leave out  columns, or  length",
                element=f"measure '{sight.name}'",
            )
        return None
    names = _Named(_named(table), read)
    try:
        if isinstance(stated, tuple):
            return _stated(table, names, sight, stated)
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
            f"the rotation is missing: name its columns {shown}, or state  columns; "
            "of a point without a rotation state  measure: [{position: BODY}]"
        )
    except InputError as error:
        raise InputError(error.problem, element=f"measure '{sight.name}'") from None


def _stated(table: Table, names: _Named, sight: Sight, stated: Sequence[str]) -> Floats:
    """Measured values of the columns that an entry lists."""
    wanted = {"distance": (1,), "position": (3,)}.get(sight.kind, (6, 7, 12))
    if len(stated) not in wanted:
        counts = " or ".join(map(str, wanted))
        raise InputError(
            f"{len(stated)} columns do not make a {sight.kind}, which has {counts}: x y z of a position, then nine "
            "of a "
            "matrix, four of a quaternion w x y z, or three of a rotation vector"
        )
    _check_order(sight, stated)
    turns = "rad" if len(stated) == 6 else "1"
    units = ["m"] * 3 + [turns] * (len(stated) - 3)
    found = [
        _column(table, names, name, unit)
        for name, unit in zip(stated, units, strict=False)
    ]
    if sight.kind == "distance":
        return found[0][:, None]
    return _values(sight, found[:3], found[3:])


def _check_order(sight: Sight, stated: Sequence[str]) -> None:
    """Refuse columns whose own names say another order than that in which they are read."""
    ends = [_UNIT.sub("", name).lower() for name in stated]
    if sight.kind == "distance":
        return
    for part, usual in (
        (ends[:3], _SHIFT),
        (ends[3:], ROTATIONS.get(len(ends) - 3, ())),
    ):
        known = [
            next((u for u in usual if end == u or _ends_with(end, u)), None)
            for end in part
        ]
        angles = [any(end.endswith(angle) for angle in _ANGLES) for end in part]
        if any(angles):
            raise InputError(
                "roll, pitch and yaw are not a rotation vector: leave out  columns, or state the beginning of "
                "their names"
            )
        if None not in known and known != list(usual):
            shown = " ".join(usual)
            raise InputError(
                f"Echelon reads columns in the order {shown}, but their names mean {' '.join(map(str, known))}: "
                "list them in that order"
            )


def _plain(column: str) -> str:
    """The name of a column without its unit."""
    return _UNIT.sub("", column)


def _ends_with(name: str, part: str) -> bool:
    """Whether a name ends with a part of a pose behind a separator."""
    return any(name.endswith(f"{mark}{part}") for mark in _SEPARATORS)


class _Named(dict[str, tuple[str, str]]):
    """Columns and their units by their names, which notes what is read."""

    def __init__(self, names: Mapping[str, tuple[str, str]], read: list[str]) -> None:
        super().__init__(names)
        self.read = read


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
    yield from (f"{stated or ''}{marker or sight.name}{mark}" for mark in _SEPARATORS)
    if not marker:
        yield stated or ""


def _column(table: Table, names: _Named, name: str, quantity: str) -> Floats:
    if name not in names:
        raise InputError(f"there is no column '{name}'{nearest_of(name, names)}")
    column, unit = names[name]
    twice = [other for other in table.columns if _plain(other) == name]
    if len(twice) > 1:
        shown = ", ".join(f"'{other}'" for other in twice)
        raise InputError(f"the columns {shown} have one name: take out all but one")
    names.read.append(column)
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
            f"{len(shift) + len(turn)} columns do not make a {sight.kind}: three of a position, then nine of a "
            "matrix, four "
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
        raise InputError("its matrices are not rotations")
    return nearest
