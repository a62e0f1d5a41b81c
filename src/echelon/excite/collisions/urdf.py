"""Collision shapes of URDF files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.excite.collisions.carriers import STAND_IN, Geometry, carriers
from echelon.excite.collisions.meshes import READABLE, find_mesh, mesh_shape, mesh_vertices
from echelon.excite.collisions.shapes import Kind, Shape, placed
from echelon.formats.inertia import rotation_matrix
from echelon.formats.urdf import read_urdf
from echelon.inputs.xml_text import parse_xml
from echelon.mechanism.mechanism import Mechanism


def urdf_geometry(mechanism: Mechanism, text: str | bytes, file: Path, tolerant: bool = False) -> Geometry:
    """Shapes of all ``<collision>`` elements; see :func:`echelon.excite.collisions.geometry.read_geometry`.

    Parameters
    ----------
    mechanism : Mechanism
    text : str or bytes
        Content of the file.
    file : Path
        For messages, and to find meshes from.
    tolerant : bool
    """
    tree = read_urdf(text, str(file), mimics=False)
    placement = {link.name: where for link, where in zip(tree.links, carriers(tree, mechanism), strict=True)}
    shapes: list[Shape] = []
    notes: list[str] = []
    for link in parse_xml(text, str(file)).findall("link"):
        name = link.get("name")
        body, place = placement[name]
        for element, own in _named(link):
            reader = _Reader(element, own, name, file)
            try:
                shapes.append(reader.shape(body, place))
            except InputError as error:
                if not tolerant:
                    raise
                notes.append(f"left out: {error}")
    return Geometry(tuple(shapes), notes=tuple(notes))


def _named(link: Any) -> Iterator[tuple[Any, str]]:
    """Collision elements with names: those of the links, numbered if there are several."""
    elements = link.findall("collision")
    for number, element in enumerate(elements, start=1):
        yield element, link.get("name") if len(elements) == 1 else f"{link.get('name')}/{number}"


class _Reader:
    """One collision element."""

    def __init__(self, element: Any, name: str, link: str, file: Path) -> None:
        self.element, self.name, self.link, self.file = element, name, link, file

    def shape(self, body: int, place: Floats) -> Shape:
        """The shape, placed in the frame of a body in which the link has a place."""
        geometry = self.element.find("geometry")
        form = None if geometry is None or len(geometry) == 0 else geometry[0]
        placement = place @ self._origin()
        if form is not None and form.tag == "mesh":
            return mesh_shape(self.name, body, placement, self._vertices(form), self.link)
        if form is not None and form.tag == "box":
            x, y, z = self._numbers(form, "size", 3)
            return Shape(self.name, body, Kind.BOX, (x / 2, y / 2, z / 2), placement, link=self.link)
        if form is not None and form.tag == "sphere":
            return Shape(self.name, body, Kind.SPHERE, self._numbers(form, "radius", 1), placement, link=self.link)
        if form is not None and form.tag in ("cylinder", "capsule"):
            size = (*self._numbers(form, "radius", 1), self._numbers(form, "length", 1)[0] / 2)
            return Shape(self.name, body, Kind(form.tag), size, placement, link=self.link)
        found = "nothing" if form is None else f"<{form.tag}>"
        raise self._error(f"its geometry is {found}; expected <box>, <cylinder>, <capsule>, <sphere> or <mesh>")

    def _origin(self) -> Floats:
        origin = self.element.find("origin")
        if origin is None:
            return np.eye(4)
        rotation = rotation_matrix(*self._numbers(origin, "rpy", 3, "0 0 0"))
        return placed(rotation, self._numbers(origin, "xyz", 3, "0 0 0"))

    def _vertices(self, form: Any) -> Floats:
        name = form.get("filename")
        if not name:
            raise self._error("a <mesh> needs filename='…'")
        x, y, z = self._numbers(form, "scale", 3, "1 1 1")
        suffix = Path(name).suffix.lower()
        if suffix not in READABLE:
            raise self._error(f"mesh '{name}' cannot be read (valid: {', '.join(READABLE)}); {STAND_IN}")
        found = find_mesh(name, self.file.parent)
        if found is None:
            raise self._error(f"mesh '{name}' is not found; {STAND_IN}")
        try:
            return mesh_vertices(found, (x, y, z))
        except InputError as error:
            raise self._error(f"mesh '{name}': {error.problem}; {STAND_IN}") from None

    def _numbers(self, element: Any, name: str, count: int, default: str = "") -> tuple[float, ...]:
        text = element.get(name, default)
        try:
            values = tuple(float(word) for word in text.split())
        except ValueError:
            values = ()
        if len(values) != count or not np.all(np.isfinite(values)):
            numbers = "a number" if count == 1 else f"{count} numbers"
            raise self._error(f"<{element.tag}> needs {name} = {numbers}, found '{text}'")
        return values

    def _error(self, problem: str) -> InputError:
        return InputError(problem, source=str(self.file), element=f"collision of link '{self.link}'")
