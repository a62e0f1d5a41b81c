"""Shapes that a set-up states: for robots without a file of shapes, and for what is around a robot.

An entry names a body and one shape::

    {"body": "link3", "sphere": 0.06, "at": [0, 0, 0.1]}
    {"body": "link3", "capsule": 0.05, "from": [0, 0, 0], "to": [0, 0, 0.4]}
    {"body": "link2", "box": [0.05, 0.05, 0.2], "at": [0, 0, 0.2], "rpy": [0, 0, 0.3]}
    {"body": "world", "plane": [0, 0, 1], "through": [0, 0, -0.1]}

Lengths are in m, angles in rad, in the frame of the body; boxes have half lengths, ellipsoids semi-axes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.problem.robot_shapes import find_mesh, mesh_shape, mesh_vertices
from echelon.excite.problem.shapes import Kind, Shape, placed, z_along
from echelon.formats.literal import rotation_matrix
from echelon.mechanism.body import GROUND
from echelon.mechanism.mechanism import Mechanism

WORLD = ("world", "base", "ground")
"""Names of the fixed world, unless a body has one of them."""

_POSED = ("at", "rpy")
_ALLOWED = {
    Kind.SPHERE: ("at",),
    Kind.CAPSULE: ("from", "to"),
    Kind.CYLINDER: ("from", "to"),
    Kind.BOX: _POSED,
    Kind.ELLIPSOID: _POSED,
    Kind.PLANE: ("through",),
    Kind.MESH: (*_POSED, "scale"),
}


def entry_shapes(
    mechanism: Mechanism, entries: Sequence[Mapping[str, Any]], directory: Path | None = None
) -> tuple[Shape, ...]:
    """Shapes of a set-up."""
    return tuple(
        _Entry(entry, number, mechanism, directory or Path()).shape() for number, entry in enumerate(entries, start=1)
    )


class _Entry:
    def __init__(self, entry: Mapping[str, Any], number: int, mechanism: Mechanism, directory: Path) -> None:
        self.entry, self.mechanism, self.directory = entry, mechanism, directory
        self.where = f"shapes, entry {number}"
        if not isinstance(entry, Mapping):
            raise self._error(f"expected a mapping such as {{body: link3, sphere: 0.06}}, got {entry!r}")
        kinds = [kind for kind in Kind if kind.value in entry]
        if len(kinds) != 1:
            found = " and ".join(kinds) if kinds else "none"
            raise self._error(f"it needs exactly one of {', '.join(Kind)}; found {found}")
        self.kind = kinds[0]
        valid = ("body", "name", self.kind.value, *_ALLOWED[self.kind])
        strange = next((key for key in entry if key not in valid), None)
        if strange is not None:
            raise self._error(f"'{strange}' has no meaning for a {self.kind} (valid: {', '.join(valid)})")
        self.body = self._body()
        unnamed = f"{self.kind} {number}" if self.body == GROUND else f"{entry['body']}:{self.kind}{number}"
        self.name = str(entry.get("name", unnamed))

    def shape(self) -> Shape:
        """The entry as a shape."""
        try:
            return self._shape()
        except InputError as error:
            raise InputError(error.problem, source=error.source, element=self.where) from None

    def _shape(self) -> Shape:
        if self.kind is Kind.MESH:
            return mesh_shape(self.name, self.body, self._pose(), self._vertices())
        if self.kind is Kind.PLANE:
            normal = self._direction(self._numbers(self.kind.value, 3), "the normal")
            return Shape(self.name, self.body, self.kind, (), placed(z_along(normal), self._triple("through")))
        if self.kind in (Kind.CAPSULE, Kind.CYLINDER):
            return self._between(self._numbers(self.kind.value, 1)[0])
        count = 1 if self.kind is Kind.SPHERE else 3
        return Shape(self.name, self.body, self.kind, tuple(self._numbers(self.kind.value, count)), self._pose())

    def _between(self, radius: float) -> Shape:
        for key in ("from", "to"):
            if key not in self.entry:
                raise self._error(f"a {self.kind} needs '{key}', an end of its axis")
        first, last = self._triple("from"), self._triple("to")
        along = self._direction(last - first, "the way from 'from' to 'to'")
        size = (radius, float(np.linalg.norm(along)) / 2)
        return Shape(self.name, self.body, self.kind, size, placed(z_along(along), (first + last) / 2))

    def _body(self) -> int:
        name = self.entry.get("body")
        names = [body.name for body in self.mechanism.bodies]
        if name in names:
            return names.index(name)
        if name in WORLD:
            return GROUND
        problem = f"there is no body '{name}'" if name is not None else "it does not name its body"
        raise self._error(f"{problem} (valid: {', '.join((*names, WORLD[0]))})")

    # -- numbers ---------------------------------------------------------------------------------------------------

    def _pose(self) -> Floats:
        return placed(rotation_matrix(*self._triple("rpy")), self._triple("at"))

    def _triple(self, key: str) -> Floats:
        return np.array(self._numbers(key, 3)) if key in self.entry else np.zeros(3)

    def _numbers(self, key: str, count: int) -> list[float]:
        given = self.entry[key]
        values = [given] if isinstance(given, (int, float)) else given
        good = isinstance(values, (list, tuple, np.ndarray)) and len(values) == count
        if not good or not all(_finite(value) for value in values):
            raise self._error(f"'{key}' needs {'a number' if count == 1 else f'{count} numbers'}, got {given!r}")
        return [float(value) for value in values]

    def _direction(self, vector: npt.ArrayLike, what: str) -> Floats:
        found = np.asarray(vector, dtype=float)
        if not np.any(found):
            raise self._error(f"{what} must not be zero")
        return found

    def _vertices(self) -> Floats:
        given = self.entry["mesh"]
        if not isinstance(given, str):
            raise self._error(f"'mesh' needs the name of a file, got {given!r}")
        scale = self._numbers("scale", 3) if "scale" in self.entry else [1.0, 1.0, 1.0]
        file = find_mesh(given, self.directory)
        if file is None:
            raise self._error(f"mesh '{given}' is not found")
        return mesh_vertices(file, (scale[0], scale[1], scale[2]))

    def _error(self, problem: str) -> InputError:
        return InputError(problem, element=self.where)


def _finite(value: object) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and bool(np.isfinite(value))
