"""URDF: the robot description format of ROS.

Numbers are taken from the text, so 0.333 is 333/1000.  XML is parsed defensively: entities and external references are
refused.  The reader checks the tree completely, because the rest of Echelon relies on it.  Loops are those of the
format's dialects (see :mod:`echelon.formats.urdf.urdf_dialects`).
"""

from __future__ import annotations

from collections.abc import Iterator
from math import nan
from pathlib import PurePath
from typing import Any

from echelon.algebra import as_polynomial, decimal_text
from echelon.formats.literal import (
    MOTIONS,
    LiteralLink,
    LiteralMotion,
    LiteralStep,
    LiteralTree,
    StatedCoupling,
    Triple,
    central_inertial,
    numeric_placement,
)
from echelon.formats.snapping import tiny_notes
from echelon.formats.urdf.exact_xml import ExactXml
from echelon.formats.urdf.urdf_dialects import (
    LOOP_KINDS,
    WITHOUT_AXIS,
    Couplings,
    UrdfLoops,
    independence,
)
from echelon.formats.urdf.urdf_vocabulary import URDF
from echelon.formats.vocabulary import unread
from echelon.robot import ClosureKind, linear
from echelon.shared import InputError, in_quotes

JOINT_TYPES = (*MOTIONS, "fixed")
SINGLE_AXIS = ("revolute", "continuous", "prismatic")
_DEFAULT_AXIS: Triple = (1, 0, 0)
_DYNAMICS = {"damping": "viscous", "friction": "coulomb", "armature": "rotor_inertia"}
"""Attributes of <dynamics>, and the effects that they are; the last one is of models in memory."""


def stated_number(text: str | None) -> float:
    """A number that nothing else checks; what is none is as good as zero here."""
    try:
        return float(text or 0)
    except ValueError:
        return 0.0


class UrdfReader(ExactXml):
    """Reads a URDF document."""

    def __init__(self, root: Any, source: str) -> None:
        super().__init__(source)
        self.root = root
        self.notes = list(unread(root, URDF, source))
        self.links = self._named("link")
        self.joints = self._named("joint")

    def read(self, mimics: bool) -> LiteralTree:
        """The tree of its links."""
        if not self.links:
            raise self.error("the robot has no links")
        parents = self._parents()
        order, pending = list[str](), [self._root_link(parents)]
        while pending:  # depth first
            order.append(pending.pop())
            pending.extend(reversed(self.children[order[-1]]))
        if len(order) < len(self.links):
            lost = sorted(set(self.links) - set(order))
            problem = f"links {in_quotes(lost)} form a cycle and are not connected to the root"
            raise self.error(f"{problem}: {self._cut(parents, lost[0])}")
        position = {name: i for i, name in enumerate(order)}
        links = tuple(self._link(name, parents.get(name), position) for name in order)
        closures = tuple(
            UrdfLoops(self.root, self.source, position, self.tiny).closures()
        )
        independent = independence(
            self.joints, lambda element, problem: self.error(problem, element)
        )
        couplings = (
            (*self._couplings(), *self._relations(parents, independent))
            if mimics
            else ()
        )
        has_mimics = any(
            joint.find("mimic") is not None for joint in self.joints.values()
        )
        return LiteralTree(
            self.root.get("name") or "robot",
            self.source,
            links,
            couplings,
            self._gravity(),
            (*self.notes, *tiny_notes(self.tiny)),
            closures=closures,
            poses={"zero": {}} if closures else {},
            driven=tuple(name for name, stated in independent.items() if stated),
            independent=independent,
            drives=dict(self._drives()),
            has_mimics=has_mimics or self.root.find("coupling") is not None,
        )

    def _gravity(self) -> Triple:
        """That of a model in memory; URDF itself says nothing about it."""
        element = self.root.find("gravity")
        return self.triple(
            None if element is None else element.get("xyz"),
            LiteralTree("", "", ()).gravity,
            "gravity",
        )

    def _drives(self) -> Iterator[tuple[str, dict[str, float]]]:
        """Friction that joints state, and which of them a transmission drives."""
        geared = {
            e.get("name")
            for part in self.root.findall("transmission")
            for e in part.findall("joint")
        }
        for name, joint in self.joints.items():
            dynamics = joint.find("dynamics")
            stated = (
                {}
                if dynamics is None
                else {_DYNAMICS[k]: v for k, v in dynamics.items() if k in _DYNAMICS}
            )
            numbers = {
                kind: value
                for kind, text in stated.items()
                if (value := stated_number(text))
            }
            if numbers or name in geared:
                yield name, ({"rotor_inertia": nan} if name in geared else {}) | numbers

    # -- tree ------------------------------------------------------------------------------------------------------

    def _named(self, tag: str) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for element in self.root.findall(tag):
            name = element.get("name")
            if not name:
                raise self.error(f"a <{tag}> has no name")
            if name in found:
                raise self.error(
                    "this name occurs twice; names must be unique", f"{tag} '{name}'"
                )
            found[name] = element
        return found

    def _parents(self) -> dict[str, str]:
        """Joint that carries each link, by link."""
        carried: dict[str, str] = {}
        self.children: dict[str, list[str]] = {name: [] for name in self.links}
        for name, joint in self.joints.items():
            parent = self._end(joint, "parent", name)
            child = self._end(joint, "child", name)
            if parent == child:
                raise self.error(f"link '{child}' is its own parent", f"joint '{name}'")
            if child in carried:
                raise self._closes_loop(name, child, carried[child])
            carried[child] = name
            self.children[parent].append(child)
        return carried

    def _closes_loop(self, name: str, child: str, carrier: str) -> InputError:
        """A second joint of a link closes a loop, which URDF cannot state, but a description can."""
        problem = f"link '{child}' already has joint '{carrier}', and the links of a URDF form a tree"
        return self.error(f"{problem}: {self._beside(name)}", f"joint '{name}'")

    def _cut(self, parents: dict[str, str], link: str) -> str:
        """Advice about a cycle above a link: the joint that a description can state as a loop."""
        seen: list[str] = []
        while link not in seen:
            seen.append(link)
            link = self._end(self.joints[parents[link]], "parent", parents[link])
        cycle = {parents[name] for name in seen[seen.index(link) :]}
        last = next(name for name in reversed(self.joints) if name in cycle)
        return f"joint '{last}' closes it: {self._beside(last)}"

    def _beside(self, name: str) -> str:
        """How a joint that closes a loop is stated in a description beside the file."""
        joint = self.joints[name]
        where = f"joint '{name}'"
        file = PurePath(self.source).name
        kind = joint.get("type")
        if kind == "floating":
            return "take this joint out, as it constrains nothing"
        parent, child = (self._end(joint, tag, name) for tag in ("parent", "child"))
        origin = self.origin(joint, where)
        frame = f"{{xyz: [{_written(origin.xyz)}], rpy: [{_written(origin.rpy)}]}}"
        word = LOOP_KINDS.get(str(kind), ClosureKind.REVOLUTE).value
        axis = (
            ""
            if kind in WITHOUT_AXIS
            else f", axis: [{_written(self._axis(joint, name))}]"
        )
        loop = f"{{name: {name}, joint: {word}, connects: [{parent}, {child}], at: {frame}{axis}, on_second: {{}}}}"
        stated = f"'robot: {{file: {file}}}' and 'loops: [{loop}]'"
        return f"take this joint out, and state it as a loop: {stated} in a YAML file beside it"

    def _end(self, joint: Any, tag: str, name: str) -> str:
        element = joint.find(tag)
        link = None if element is None else element.get("link")
        if not link:
            raise self.error(f"needs <{tag} link='...'/>", f"joint '{name}'")
        if link not in self.links:
            raise self.error(f"{tag} link '{link}' does not exist", f"joint '{name}'")
        return str(link)

    def _root_link(self, parents: dict[str, str]) -> str:
        roots = [name for name in self.links if name not in parents]
        if not roots:
            problem = (
                "every link has a parent: the links form a cycle and there is no root"
            )
            raise self.error(f"{problem}: {self._cut(parents, next(iter(self.links)))}")
        if len(roots) > 1:
            raise self.error(
                f"there are {len(roots)} root links, {in_quotes(roots)}; a tree has one"
            )
        return roots[0]

    # -- elements --------------------------------------------------------------------------------------------------

    def _link(
        self, name: str, joint: str | None, position: dict[str, int]
    ) -> LiteralLink:
        inertial = self._inertial(name)
        if joint is None:
            return LiteralLink(name, -1, "", "root", (), inertial)
        element, kind = self.joints[joint], self._kind(joint)
        origin = self.origin(element, f"joint '{joint}'")
        steps: list[LiteralStep] = [origin]
        if kind != "fixed":
            axis = (0, 0, 1) if kind == "floating" else self._axis(element, joint)
            steps.append(LiteralMotion(f"joint '{joint}'", joint, MOTIONS[kind], axis))
        parent = position[self._end(element, "parent", joint)]
        return LiteralLink(
            name, parent, joint, kind, tuple(steps), inertial, rest=(origin,)
        )

    def _kind(self, joint: str) -> str:
        kind = self.joints[joint].get("type")
        if kind not in JOINT_TYPES:
            valid = ", ".join(JOINT_TYPES)
            problem = (
                f"unknown joint type '{kind}'"
                if kind
                else "the attribute 'type' is missing"
            )
            raise self.error(f"{problem} (valid: {valid})", f"joint '{joint}'")
        return str(kind)

    def _axis(self, element: Any, joint: str) -> Triple:
        axis = element.find("axis")
        values = self.triple(
            None if axis is None else axis.get("xyz"),
            _DEFAULT_AXIS,
            f"joint '{joint}' axis",
        )
        if not any(values):
            raise self.error(
                "the axis is zero; it needs a direction such as 0 0 1",
                f"joint '{joint}'",
            )
        return values

    def _inertial(self, link: str) -> tuple[float, ...] | None:
        where = f"link '{link}' inertial"
        element = self.links[link].find("inertial")
        if element is None:
            return None
        mass = self._attribute(element.find("mass"), "value", f"{where} mass")
        inertia = element.find("inertia")
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        moments = [self._attribute(inertia, name, f"{where} inertia") for name in keys]
        frame = numeric_placement(self.origin(element, where))
        return central_inertial(mass, frame[:3, 3], moments, frame[:3, :3])

    def _attribute(self, element: Any, name: str, where: str) -> float:
        text = None if element is None else element.get(name)
        if text is None:
            raise self.error(f"the attribute '{name}' is missing", where)
        return float(self.number(text, where))

    def _relations(
        self, parents: dict[str, str], independent: dict[str, bool]
    ) -> tuple[StatedCoupling, ...]:
        """Couplings of the dialect URDF+."""
        single = [
            name
            for name, joint in self.joints.items()
            if joint.get("type") in SINGLE_AXIS
        ]
        dependent = [name for name, stated in independent.items() if not stated]
        return Couplings(
            self.root, self.source, parents, self.joints, self.tiny
        ).stated(single, dependent)

    def _couplings(self) -> Iterator[StatedCoupling]:
        for name, joint in self.joints.items():
            mimic = joint.find("mimic")
            if mimic is None:
                continue
            where = f"joint '{name}' mimic"
            leader = mimic.get("joint")
            if not leader:
                raise self.error("needs joint='...', the joint that it follows", where)
            if leader not in self.joints:
                raise self.error(
                    f"it follows joint '{leader}', which does not exist (--mimic independent ignores that)",
                    where,
                )
            if leader == name:
                raise self.error("the joint mimics itself", where)
            if joint.get("type") == "fixed":
                self.notes.append(f"{where} is ignored: the joint is fixed")
                continue
            for role in (name, leader):
                kind = self.joints[role].get("type")
                if kind not in SINGLE_AXIS:
                    raise self.error(
                        f"joint '{role}' is {kind}; only single-axis joints can be coupled",
                        where,
                    )
            ratio, offset = (
                as_polynomial(self.number(mimic.get(key, usual), where))
                for key, usual in (("multiplier", "1"), ("offset", "0"))
            )
            yield StatedCoupling(where, name, {leader: linear(ratio)}, offset)


def _written(numbers: Triple) -> str:
    return ", ".join(decimal_text(number) for number in numbers)
