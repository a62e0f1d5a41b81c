"""Exact mechanisms: bodies, joints and closures, with all axes and points in the world at a closed pose."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from flint import arb, arb_mat

from support.loop_linkage import ONE, Body, Linkage, Loop, matrix, sliding, turning
from support.loop_readers import FREE
from support.rounded_exports.geometry import Mat, Vec, Y, cross, unit

GROUND = "base"
FREEDOMS = {"hinge": 1, "slide": 1, "universal": 2, "ball": 3}


@dataclass(frozen=True)
class Part:
    """A body and the joint, at `point`, that carries it: one axis, two of a universal joint, or none."""

    name: str
    parent: str
    kind: str
    point: Vec
    axes: tuple[Vec, ...] = ()


@dataclass(frozen=True)
class Closure:
    """Two bodies that share a point (`point`), an axis through it (`pin`), or their whole frame (`weld`)."""

    kind: str
    first: str
    second: str
    point: Vec
    axis: Vec = field(default_factory=lambda: Y)


@dataclass(frozen=True)
class Exact:
    """A mechanism at a closed pose, at which all coordinates are zero; its base is fixed, or floats."""

    name: str
    parts: tuple[Part, ...]
    closures: tuple[Closure, ...]
    planar: bool = False
    floating: bool = False

    @property
    def has_universals(self) -> bool:
        return any(part.kind == "universal" for part in self.parts)

    def turned(self, turn: Mat) -> Exact:
        parts = (
            replace(p, point=turn @ p.point, axes=tuple(turn @ a for a in p.axes))
            for p in self.parts
        )
        closures = (
            replace(c, point=turn @ c.point, axis=turn @ c.axis) for c in self.closures
        )
        return replace(self, parts=tuple(parts), closures=tuple(closures))

    def sawn(self) -> Exact:
        """The mechanism with a piece of the last closure's first body that is a body of its own, and welded to it."""
        *others, last = self.closures
        axes = (last.axis,) if last.kind == "pin" else ()
        piece = Part(
            "piece", last.second, "hinge" if axes else "ball", last.point, axes
        )
        return replace(
            self,
            parts=(*self.parts, piece),
            closures=(*others, Closure("weld", "piece", last.first, last.point)),
        )

    def linkage(self) -> Linkage:
        """The mechanism for the oracle: body frames along the world, origins at the joints."""
        places = {GROUND: Y * 0} | {part.name: part.point for part in self.parts}
        index = {name: k for k, name in enumerate(places)}
        bodies = [Body(GROUND, -1, ONE, FREE if self.floating else ())]
        for part in self.parts:
            pose = shifted(part.point - places[part.parent])
            bodies.append(Body(part.name, index[part.parent], pose, motions(part)))
        loops = [
            Loop(
                {"pin": "revolute"}.get(c.kind, c.kind),
                index[c.first],
                index[c.second],
                framed(c.axis, c.point - places[c.first]),
                framed(c.axis, c.point - places[c.second]),
            )
            for c in self.closures
        ]
        return Linkage(
            tuple(bodies),
            tuple(loops),
            (0.0,) * sum(len(body.motions) for body in bodies),
        )

    def moved(self, q: list[arb]) -> Exact:
        """The mechanism at other closed coordinates, which are zero there."""
        linkage, names = self.linkage(), [GROUND, *(part.name for part in self.parts)]
        still = linkage.state([arb(0)] * len(q), [arb(0)] * len(q)).poses
        there = linkage.state(q, [arb(0)] * len(q)).poses
        change = {name: there[k] * still[k].inv() for k, name in enumerate(names)}
        parts = []
        for part in self.parts:
            carriers = (part.parent, part.name)
            axes = tuple(
                direction(change[c], axis)
                for c, axis in zip(carriers, part.axes, strict=False)
            )
            parts.append(
                replace(part, point=place(change[part.name], part.point), axes=axes)
            )
        closures = (
            replace(
                c,
                point=place(change[c.first], c.point),
                axis=direction(change[c.first], c.axis),
            )
            for c in self.closures
        )
        return replace(self, parts=tuple(parts), closures=tuple(closures))


@dataclass
class Draft:
    """A mechanism that is being written down, body after body."""

    parts: list[Part] = field(default_factory=list)
    closures: list[Closure] = field(default_factory=list)

    def hinge(self, name: str, parent: str, point: Vec, axis: Vec = Y) -> str:
        return self._add(name, parent, "hinge", point, axis)

    def slide(self, name: str, parent: str, point: Vec, axis: Vec) -> str:
        return self._add(name, parent, "slide", point, axis)

    def universal(
        self, name: str, parent: str, point: Vec, axis: Vec, axis2: Vec
    ) -> str:
        """Two axes through a point; what the second one lacks to be perpendicular is taken off."""
        first = unit(axis)
        return self._add(
            name, parent, "universal", point, first, axis2 - first * (first @ axis2)
        )

    def ball(self, name: str, parent: str, point: Vec) -> str:
        return self._add(name, parent, "ball", point)

    def rod(self, name: str, parent: str, start: Vec, end: Vec, side: Vec = Y) -> str:
        """A rod on a universal joint: it cannot spin about itself."""
        across = cross(end - start, side)
        return self.universal(name, parent, start, across, cross(across, end - start))

    def _add(self, name: str, parent: str, kind: str, point: Vec, *axes: Vec) -> str:
        self.parts.append(
            Part(name, parent, kind, point, tuple(unit(axis) for axis in axes))
        )
        return name

    def pin(self, first: str, second: str, point: Vec, axis: Vec = Y) -> None:
        self.closures.append(Closure("pin", first, second, point, unit(axis)))

    def meet(self, first: str, second: str, point: Vec) -> None:
        self.closures.append(Closure("point", first, second, point))

    def weld(self, first: str, second: str, point: Vec) -> None:
        self.closures.append(Closure("weld", first, second, point))


def motions(part: Part) -> tuple[arb_mat, ...]:
    if part.kind == "ball":
        return FREE[3:]
    return tuple(
        (sliding if part.kind == "slide" else turning)(axis) for axis in part.axes
    )


def beside(axis: Vec) -> Vec:
    """A direction across an axis: the coordinate direction that is least along it, without what is along it."""
    least = min(range(3), key=lambda k: (round(abs(float(axis[k])), 6), k))
    start = np.array([arb(int(k == least)) for k in range(3)], dtype=object)
    return unit(start - axis * (axis @ start))


def frame_along(z: Vec) -> Mat:
    """A rotation whose third column is an axis."""
    x = beside(z)
    return np.column_stack([x, cross(z, x), z])


def shifted(by: Vec) -> arb_mat:
    return matrix(
        [[1, 0, 0, by[0]], [0, 1, 0, by[1]], [0, 0, 1, by[2]], [0, 0, 0, 1]]
    ).mid()


def framed(axis: Vec, point: Vec) -> arb_mat:
    rows = [[*row, x] for row, x in zip(frame_along(axis), point, strict=True)]
    return matrix([*rows, [0, 0, 0, 1]]).mid()


def direction(pose: arb_mat, v: Vec) -> Vec:
    return np.array(
        [sum((pose[i, j] * v[j] for j in range(3)), arb(0)).mid() for i in range(3)],
        dtype=object,
    )


def place(pose: arb_mat, v: Vec) -> Vec:
    return direction(pose, v) + np.array([pose[i, 3] for i in range(3)], dtype=object)
