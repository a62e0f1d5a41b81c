"""Lists of frame pairs beside a URDF, as collections of parallel robots publish them, as descriptions.

``closed_loop`` lists pairs of links that are held together, ``type`` whether in 6 or in 3 directions, ``name_mot`` the
joints with motors.  ``joint_name`` and ``joint_type`` say which joints of the URDF stand for others: a ball, or turns
about x and then y of the joint's frame (CARDAN), or about other axes of it (UJOINT_ZY).  The URDF has the name of the
list.
"""

from __future__ import annotations

import re
from pathlib import PurePath
from typing import Any

from echelon.formats.description.document import Document
from echelon.shared import kind_of

_PAIRS = "closed_loop"
_JOINT_OF_TYPE = {"6D": "weld", "3D": "spherical"}
_UNIVERSAL = re.compile(r"UJOINT_([XYZ])([XYZ])")


def as_description(document: Document) -> Document:
    """The equivalent description."""
    pairs = _items(document, _PAIRS)
    joints = _items(document, "joint_name")
    motors = _items(document, "name_mot")
    kinds = _of_each(document, "type", _PAIRS, pairs, "6d")
    types = _of_each(document, "joint_type", "joint_name", joints, None)
    path = PurePath(document.source)
    data = {
        "echelon": 1,
        "robot": {
            "file": path.with_suffix(".urdf").name,
            "joints": {
                str(name): _joint(document, k, types[k])
                for k, name in enumerate(joints)
            },
            "driven": motors,
        },
        "loops": [_loop(document, k, pair, kinds[k]) for k, pair in enumerate(pairs)],
    }
    names = {"robot.driven": "name_mot"}
    for k, name in enumerate(joints):
        names[f"robot.joints.{name}"] = f"joint_name[{k}]"
    for k in range(len(pairs)):
        names |= {
            f"loops[{k}].connects": f"{_PAIRS}[{k}]",
            f"loops[{k}]": f"{_PAIRS}[{k}]",
        }
    return Document(data, document.source, document.lines, names)


def _items(document: Document, key: str) -> list[Any]:
    found = document.data.get(key)
    if found is not None and not isinstance(found, list):
        raise document.error(key, f"needs a list, found {kind_of(found)}")
    return found or []


def _of_each(
    document: Document, key: str, of: str, items: list[Any], usual: str | None
) -> list[Any]:
    """One entry for every item; for all of them the usual one, if there are none."""
    found = _items(document, key)
    if not found and usual is not None:
        return [usual] * len(items)
    if len(found) != len(items):
        raise document.error(
            key,
            f"has {len(found)} entries, and {of} has {len(items)}: both need as many",
        )
    return found


def _loop(document: Document, index: int, pair: Any, kind: Any) -> dict[str, Any]:
    joint = _JOINT_OF_TYPE.get(str(kind).upper())
    if joint is None:
        raise document.error(
            f"type[{index}]",
            f"{kind_of(kind)} is not a type of contact (valid: 6d, 3d)",
        )
    if not isinstance(pair, list) or len(pair) != 2:
        raise document.error(
            f"{_PAIRS}[{index}]", f"needs two names of links, found {kind_of(pair)}"
        )
    return {
        "name": "-".join(str(name) for name in pair),
        "joint": joint,
        "connects": pair,
        "on_second": {},
    }


def _joint(document: Document, index: int, kind: Any) -> dict[str, str]:
    named = str(kind).upper()
    if named in ("SPHERICAL", "FIXED"):
        return {"type": named.lower()}
    universal = _UNIVERSAL.fullmatch("UJOINT_XY" if named == "CARDAN" else named)
    if universal is None:
        problem = f"{kind_of(kind)} is not a type of joint (valid: SPHERICAL, CARDAN, UJOINT_ZY and such, FIXED)"
        raise document.error(f"joint_type[{index}]", problem)
    return {
        "type": "universal",
        "axis": universal[1].lower(),
        "axis2": universal[2].lower(),
    }
