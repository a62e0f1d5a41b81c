"""URDF files as numeric bodies for :mod:`truth`, by a reader of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import flint
from flint import arb

from support.ball_rank import BITS, Body, Move, Place, Vec, number, vector
from support.special_numbers import moves

STEP = 15
"""Degrees of which angles may be multiples."""


def bodies_of(file: Path, floating: bool, tolerance: float) -> list[Body]:
    """Moving bodies; mimic joints are independent, fixed links belong to what carries them.

    Angles (rad) and components of axes within the tolerance of a multiple of 15° or of −1, 0, 1 are taken as that.
    Offsets below a hundredth of it, relative to the largest one, are taken as zero.
    """
    root = ElementTree.parse(file).getroot()
    joints = root.findall("joint")
    children = {_name(joint, "child") for joint in joints}
    (base,) = [
        link.get("name", "")
        for link in root.findall("link")
        if link.get("name") not in children
    ]
    largest = max(
        (abs(float(x)) for j in joints for x in _origin(j, "xyz").split()), default=0.0
    )
    bodies: list[Body] = []
    with flint.ctx.workprec(BITS):
        first: list[Place | Move] = []
        if floating:
            bodies.append(Body(-1, moves("floating", vector(0, 0, 1), arb(0))))
        waiting: list[tuple[str, int, list[Place | Move]]] = [
            (base, len(bodies) - 1, first)
        ]
        while waiting:
            link, body, steps = waiting.pop()
            for joint in (j for j in joints if _name(j, "parent") == link):
                place = Place(
                    _offset(joint, tolerance * largest / 100), _angles(joint, tolerance)
                )
                kind, child = joint.get("type", ""), _name(joint, "child")
                if kind == "fixed":
                    waiting.append((child, body, [*steps, place]))
                else:
                    bodies.append(
                        Body(
                            body,
                            [
                                *steps,
                                place,
                                *moves(kind, _axis(joint, tolerance), arb(0)),
                            ],
                        )
                    )
                    waiting.append((child, len(bodies) - 1, []))
    return bodies


def _name(joint: Any, end: str) -> str:
    return str(joint.find(end).get("link"))


def _origin(joint: Any, key: str) -> str:
    origin = joint.find("origin")
    return "0 0 0" if origin is None else str(origin.get(key, "0 0 0"))


def _offset(joint: Any, smallest: float) -> Vec:
    return vector(
        *(
            number(x) if abs(float(x)) > smallest else 0
            for x in _origin(joint, "xyz").split()
        )
    )


def _angles(joint: Any, tolerance: float) -> Vec:
    def angle(text: str) -> arb:
        exact = (
            arb.pi() * STEP / 180 * round(float(number(text) / arb.pi()) * 180 / STEP)
        )
        return exact if abs(float(number(text) - exact)) < tolerance else number(text)

    return vector(*map(angle, _origin(joint, "rpy").split()))


def _axis(joint: Any, tolerance: float) -> Vec:
    element = joint.find("axis")
    axis = [
        number(x)
        for x in (
            "1 0 0" if element is None else str(element.get("xyz", "1 0 0"))
        ).split()
    ]
    size = float(sum((x * x for x in axis), arb(0)).sqrt())
    nearest = [round(float(x) / size) for x in axis]
    close = all(
        abs(float(x) / size - y) < tolerance for x, y in zip(axis, nearest, strict=True)
    )
    return vector(*(nearest if close else axis))
