"""Loops and couplings that stand in a URDF, which the format itself does not have.

Four dialects state loops.  URDF+ has ``<loop>``, a joint with a frame on each of its links, and ``<coupling>``, which
relates the joints on the ways from the nearest common ancestor of two links: ratio · Σ q_predecessor = Σ q_successor.
Simulators read ``<loop_joint>``, with a frame on each link too, and ``<gazebo><joint>``, a joint of SDF whose links
meet where all coordinates are zero.  ``<drake:ball_constraint>`` holds two points together.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import atan2, hypot
from pathlib import PurePath
from typing import Any

from echelon.algebra import Polynomial
from echelon.formats.literal import (
    LiteralClosure,
    LiteralPlacement,
    StatedCoupling,
    Triple,
)
from echelon.formats.mjcf.mjcf_equality import EqualityRelation, resolve
from echelon.formats.mjcf.mjcf_numbers import exact_angle
from echelon.formats.urdf.exact_xml import ExactXml
from echelon.formats.urdf.urdf_vocabulary import LOOP_BESIDE
from echelon.robot import ClosureKind, linear
from echelon.shared import InputError, nearest_of, unused

WORLD = "world"
_ALONG_AXIS = {
    "revolute": ClosureKind.REVOLUTE,
    "continuous": ClosureKind.REVOLUTE,
    "prismatic": ClosureKind.PRISMATIC,
    "cylindrical": ClosureKind.CYLINDRICAL,
    "planar": ClosureKind.PLANAR,
}
WITHOUT_AXIS = {
    "fixed": ClosureKind.WELD,
    "spherical": ClosureKind.SPHERICAL,
    "ball": ClosureKind.SPHERICAL,
}
LOOP_KINDS = {**_ALONG_AXIS, **WITHOUT_AXIS}
"""Joints that close loops, by the types of URDF and its dialects."""

_OF_SDF = ("revolute", "continuous", "prismatic", "ball", "fixed")
_UP: Triple = (0, 0, 1)
_X: Triple = (1, 0, 0)


class UrdfLoops(ExactXml):
    """The closures that a URDF document states."""

    def __init__(
        self, root: Any, source: str, position: Mapping[str, int], tiny: list[str]
    ) -> None:
        super().__init__(source, tiny)
        self.root, self.position = root, position
        self.advice = (
            f"state the loop in {LOOP_BESIDE.format(file=PurePath(source).name)}"
        )
        self._names: set[str] = set()

    def closures(self) -> Iterator[LiteralClosure]:
        """All of them, in the order of the document; joints of Gazebo come last."""
        readers: Mapping[str, Callable[[Any, str], LiteralClosure | None]] = {
            "loop": self._loop,
            "loop_joint": self._loop_joint,
            "drake:ball_constraint": self._ball_constraint,
        }
        stated = [
            (element, readers[element.tag])
            for element in self.root
            if element.tag in readers
        ]
        stated += [
            (element, self._gazebo_joint)
            for element in self.root.findall("gazebo/joint")
        ]
        for element, read in stated:
            name = unused(
                element.get("name") or f"loop{len(self._names) + 1}", self._names
            )
            closure = read(element, name)
            if closure is not None:
                self._names.add(name)
                yield closure

    def _loop(self, element: Any, name: str) -> LiteralClosure:
        where = f"loop '{name}'"
        kind = self._kind(element, where, tuple(LOOP_KINDS))
        aim: tuple[LiteralPlacement, ...] = ()
        if element.get("type") in _ALONG_AXIS:
            axis = element.find("axis")
            aim = (self._aim(None if axis is None else axis.get("xyz"), _X, where),)
        ends = [(tag, element.find(tag)) for tag in ("predecessor", "successor")]
        first, second = (self._link(end, tag, where) for tag, end in ends)
        at, on_second = (self.origin(end, f"{where} {tag}") for tag, end in ends)
        return LiteralClosure(
            where, name, kind, first, second, (at, *aim), (on_second, *aim)
        )

    def _loop_joint(self, element: Any, name: str) -> LiteralClosure:
        where = f"loop_joint '{name}'"
        # with an axis the importers differ: some take x of the frames, some an attribute
        kind = self._kind(element, where, tuple(WITHOUT_AXIS))
        ends = [(tag, element.find(tag)) for tag in ("link1", "link2")]
        first, second = (self._link(end, tag, where) for tag, end in ends)
        at, on_second = (self.placement(end, f"{where} {tag}") for tag, end in ends)
        return LiteralClosure(where, name, kind, first, second, (at,), (on_second,))

    def _ball_constraint(self, element: Any, name: str) -> LiteralClosure:
        where = f"drake:ball_constraint '{name}'"
        stated = {
            child.tag.removeprefix("drake:ball_constraint_"): child for child in element
        }
        first, second = (
            self._link(stated.get(tag), tag, where, "name")
            for tag in ("body_A", "body_B")
        )
        at, on_second = (
            self._point(stated.get(tag), f"{where} {tag}") for tag in ("p_AP", "p_BQ")
        )
        return LiteralClosure(
            where, name, ClosureKind.SPHERICAL, first, second, (at,), (on_second,)
        )

    def _gazebo_joint(self, element: Any, name: str) -> LiteralClosure | None:
        where = f"gazebo joint '{name}'"
        parent, child = (
            (element.findtext(tag) or "").strip() for tag in ("parent", "child")
        )
        root = next(iter(self.position))
        if (parent, child, element.get("type")) == (WORLD, root, "fixed"):
            return None  # the root is fixed anyway
        kind = self._kind(element, where, _OF_SDF)
        first = self._index(child, "child", where)
        second = self._index(parent, "parent", where)
        pose = element.find("pose")
        if pose is not None and pose.get("relative_to", child) != child:
            problem = f"its pose is stated in '{pose.get('relative_to')}': state it in the child link, or {self.advice}"
            raise self.error(problem, where)
        aim: tuple[LiteralPlacement, ...] = ()
        if element.get("type") in _ALONG_AXIS:
            axis = element.find("axis/xyz")
            aim = (self._aim(None if axis is None else axis.text, _UP, where),)
        at = self._pose("" if pose is None else pose.text or "", f"{where} pose")
        return LiteralClosure(where, name, kind, first, second, (at, *aim), None)

    # -- parts -----------------------------------------------------------------------------------------------------

    def _kind(self, element: Any, where: str, valid: Sequence[str]) -> ClosureKind:
        stated = element.get("type")
        if stated not in valid:
            problem = (
                f"its type is '{stated}'"
                if stated
                else "the attribute 'type' is missing"
            )
            raise self.error(
                f"{problem} (read: {', '.join(valid)}): {self.advice}", where
            )
        return LOOP_KINDS[stated]

    def _link(self, end: Any, tag: str, where: str, key: str = "link") -> int:
        return self._index("" if end is None else end.get(key, ""), tag, where)

    def _index(self, name: str, tag: str, where: str) -> int:
        if not name:
            raise self.error(f"<{tag}> with the name of a link is missing", where)
        if name == WORLD and name not in self.position:
            raise self.error(
                f"the world is not a link of a URDF: hold the root link, or {self.advice}",
                where,
            )
        if name not in self.position:
            raise self.error(
                f"{tag} link '{name}' does not exist{nearest_of(name, self.position)}",
                where,
            )
        return self.position[name]

    def _aim(self, text: str | None, usual: Triple, where: str) -> LiteralPlacement:
        """A turn of a frame after which its z axis lies along an axis."""
        axis = self.triple(text, usual, f"{where} axis")
        if not any(axis):
            raise self.error(
                "the axis is zero; it needs a direction such as 0 0 1", where
            )
        x, y, z = map(float, axis)
        return LiteralPlacement(
            f"{where} axis",
            rpy=(0, exact_angle(atan2(hypot(x, y), z)), exact_angle(atan2(y, x))),
        )

    def _point(self, element: Any, where: str) -> LiteralPlacement:
        if element is None or not element.get("value"):
            raise self.error("the point is missing: value='x y z'", where)
        return LiteralPlacement(
            where, self.triple(element.get("value"), (0, 0, 0), where)
        )

    def _pose(self, text: str, where: str) -> LiteralPlacement:
        numbers = [self.number(part, where) for part in text.split()]
        if not numbers:
            return LiteralPlacement(where)
        if len(numbers) != 6:
            raise self.error(f"needs six numbers, found '{text.strip()}'", where)
        x, y, z, roll, pitch, yaw = numbers
        return LiteralPlacement(where, (x, y, z), (roll, pitch, yaw))


class Couplings(ExactXml):
    """The couplings of URDF+ between joints."""

    def __init__(
        self,
        root: Any,
        source: str,
        carried: Mapping[str, str],
        joints: Mapping[str, Any],
        tiny: list[str],
    ) -> None:
        super().__init__(source, tiny)
        self.root, self.carried, self.joints = (
            root,
            carried,
            joints,
        )  # ``carried``: the joint of each link

    def stated(
        self, single: Sequence[str], dependent: Sequence[str]
    ) -> tuple[StatedCoupling, ...]:
        """Couplings between joints with one axis, of which those that are said to be dependent follow others."""
        relations = [
            self._relation(element, single) for element in self.root.findall("coupling")
        ]
        driven = [name for name in self.joints if name not in dependent]
        held, couplings, _ = resolve(
            relations, dict.fromkeys(single, 0), driven, self.source
        )
        for name in held:
            raise self.error(
                "the couplings hold it where it is: make it a fixed joint",
                f"joint '{name}'",
            )
        return couplings

    def _relation(self, element: Any, single: Sequence[str]) -> EqualityRelation:
        where = f"coupling '{element.get('name') or ''}'"
        ratio = element.find("ratio")
        if ratio is None or not ratio.get("value"):
            raise self.error(
                "needs <ratio value='...'/>, of the successor's motion to the predecessor's",
                where,
            )
        factor = Polynomial.constant(self.number(ratio.get("value"), f"{where} ratio"))
        before, after = (
            self._way(element.find(tag), tag, where)
            for tag in ("predecessor", "successor")
        )
        common = {name for name in before if name in after}
        terms = {name: linear(-factor) for name in before if name not in common}
        terms |= {
            name: linear(Polynomial.constant(1)) for name in after if name not in common
        }
        terms = {
            name: term
            for name, term in terms.items()
            if self.joints[name].get("type") != "fixed"
        }
        for name in terms:
            if name not in single:
                raise self.error(
                    f"joint '{name}' between its links has not one axis, as coupled joints need",
                    where,
                )
        if not terms:
            raise self.error("no joint moves its links against each other", where)
        return EqualityRelation(where, "", terms, Polynomial({}))

    def _way(self, end: Any, tag: str, where: str) -> list[str]:
        """The joints from a link to the root."""
        link = "" if end is None else end.get("link", "")
        links = [*dict.fromkeys(e.get("name") for e in self.root.findall("link"))]
        if link not in links:
            raise self.error(
                f"{tag} link '{link}' does not exist{nearest_of(link, links)}", where
            )
        way: list[str] = []
        while link in self.carried:
            way.append(self.carried[link])
            link = self.joints[way[-1]].find("parent").get("link")
        return way


def independence(
    joints: Mapping[str, Any], error: Callable[[str, str], InputError]
) -> dict[str, bool]:
    """Whether joints are independent, as far as their attributes say so."""
    known = {"true": True, "1": True, "false": False, "0": False}
    found: dict[str, bool] = {}
    for name, joint in joints.items():
        text = joint.get("independent")
        if text is None:
            continue
        if text.strip().lower() not in known:
            raise error(
                f"joint '{name}'", f"independent='{text}' is neither true nor false"
            )
        found[name] = known[text.strip().lower()]
    return found
