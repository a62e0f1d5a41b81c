"""The text of an MJCF model, checked before MuJoCo sees it.

MuJoCo would resolve includes against the working directory, write a log file and go on when a number is not finite, and
take hours over a large ``<replicate>``.  So all documents are read here, and are handed over only if they are harmless.
"""

from __future__ import annotations

from collections.abc import Collection
from math import isfinite, prod
from pathlib import Path, PurePath
from typing import Any
from xml.etree.ElementTree import tostring

from echelon.errors import InputError
from echelon.exact.syntax import is_whole
from echelon.inputs.content import read_content
from echelon.inputs.limits import INCLUDES
from echelon.inputs.xml_text import parse_xml

_NUMERIC = {
    *("pos", "quat", "axisangle", "xyaxes", "zaxis", "euler", "axis", "ref", "polycoef", "gravity"),
    *("mass", "density", "diaginertia", "fullinertia", "fromto", "size", "offset", "scale", "massscale"),
}
_MULTIPLYING = ("replicate", "composite", "flexcomp")
_MOST_COPIES = 10_000


def check_document(
    text: str | bytes, source: str, directory: Path | None
) -> tuple[str, dict[str, bytes], tuple[str, ...]]:
    """The text of a model, and the contents of the files that it includes or attaches, by the names it uses.

    Includes of missing files are left out, unless they would define parts of bodies.
    """
    root = parse_xml(text, source)
    if root.tag == "mujocoinclude":
        raise InputError("this is a fragment, not a model: read the file that includes it", source=source)
    if root.tag != "mujoco":
        raise InputError(f"expected a <mujoco> element, found <{root.tag}>", source=source)
    try:
        decoded = text.decode("utf-8-sig") if isinstance(text, bytes) else text
    except UnicodeDecodeError:
        raise InputError("not UTF-8, which MuJoCo expects", source=source) from None
    included: dict[str, bytes] = {}
    _check(root, source)
    _gather(root, source, directory, PurePath(), included)
    missing = tuple(name for name, content in included.items() if not content)
    if missing:
        decoded = _without(root, missing).decode()
        present = {name: parse_xml(content, name) for name, content in included.items() if name not in missing}
        included = {name: _without(child, missing) for name, child in present.items()}
    return decoded, included, missing


def _without(root: Any, missing: Collection[str]) -> bytes:
    """A document without includes of missing files; for MuJoCo an empty file will not do."""
    for element in list(root.iter()):
        for child in [c for c in element if c.tag == "include" and c.get("file") in missing]:
            element.remove(child)
    return bytes(tostring(root, encoding="utf-8"))


def _gather(
    root: Any, source: str, directory: Path | None, folder: PurePath, included: dict[str, bytes], inside: bool = False
) -> None:
    """Read and check the files that a document includes or attaches, and those that these include."""
    in_bodies = {id(e) for tree in root.iter("worldbody") for e in tree.iter("include")}
    for element in root.iter():
        name = element.get("file") if element.tag in ("include", "model") else None
        if name is None or name in included:
            continue
        where = f"{element.tag} '{name}'"
        needed = inside or element.tag == "model" or id(element) in in_bodies
        if directory is None and needed:
            raise InputError("the model has no directory to find this file in", source=source, element=where)
        # MuJoCo looks beside the main file first, then beside the including one
        places = (PurePath(name), folder / name)
        found = None if directory is None else next((p for p in places if (directory / p).is_file()), None)
        if directory is None or found is None:
            if needed:
                raise InputError("no such file, and it is part of the bodies", source=source, element=where)
            included[name] = b""
            continue
        included[name] = read_content(directory / found)
        INCLUDES.check(len(included), source, where)
        child = parse_xml(included[name], str(found))
        _check(child, str(found))
        _gather(child, str(found), directory, found.parent, included, needed)


def _check(root: Any, source: str) -> None:
    _check_finite(root, source)
    _check_copies(root, source)


def _check_finite(root: Any, source: str) -> None:
    """MuJoCo itself lets nan and inf pass with no more than a warning."""
    for element in root.iter():
        for name, value in element.items():
            for word in value.split() if name in _NUMERIC else ():
                try:
                    finite = isfinite(float(word))
                except ValueError:
                    continue  # MuJoCo reports it, with the line
                if not finite:
                    where = f"{element.tag} '{element.get('name', '')}' {name}"
                    raise InputError(f"'{word}' is not a finite number", source=source, element=where)


def _check_copies(root: Any, source: str) -> None:
    pending = [(root, 1)]
    while pending:
        element, copies = pending.pop()
        if element.tag in _MULTIPLYING:
            copies *= prod(int(word) for word in element.get("count", "1").split() if is_whole(word))
            if copies > _MOST_COPIES:
                problem = f"{copies} copies are too many; {_MOST_COPIES} are allowed"
                raise InputError(problem, source=source, element=element.tag)
        pending.extend((child, copies) for child in element)
