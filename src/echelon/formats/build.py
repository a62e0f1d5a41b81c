"""From a literal tree to a mechanism: lumping of fixed links, labels, couplings, floating base."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction

import numpy as np

from echelon.errors import InputError
from echelon.formats.assembly_pose import chosen_pose
from echelon.formats.build_loops import build_closure
from echelon.formats.build_sensors import build_outputs
from echelon.formats.inertia import Inertial, move_inertial, numeric_placement
from echelon.formats.intent import Intent
from echelon.formats.literal import (
    LiteralClosure,
    LiteralLink,
    LiteralPlacement,
    LiteralStep,
    LiteralTree,
    LiteralWrench,
)
from echelon.formats.options import ReadingOptions, gravity_vector
from echelon.formats.parallelograms import with_parallelogram
from echelon.formats.relations import with_relations
from echelon.formats.riders import Ride, Rider, Riders
from echelon.formats.stated_couplings import StatedCoupling, resolved
from echelon.formats.stated_joints import with_joints
from echelon.mechanism.closure import Closure
from echelon.mechanism.joint import Joint, Motion, MotionKind, Step, floating_motions, merge
from echelon.mechanism.mechanism import ALL, GROUND, Body, Mechanism, setup_placements
from echelon.mechanism.output import Output
from echelon.mechanism.placement import Placement, shift, turn
from echelon.mechanism.reading import Snap
from echelon.regressor.loops.closing import close


@dataclass(frozen=True)
class Built:
    """A mechanism with an account of how its numbers were read."""

    mechanism: Mechanism
    snaps: tuple[Snap, ...]
    notes: tuple[str, ...]
    riders: Mapping[str, Rider] = field(default_factory=dict)  # what is fixed to bodies, by name


def build_mechanism(tree: LiteralTree, options: ReadingOptions, literal: Collection[str] = ()) -> Built:
    """Interpret a literal tree."""
    return _Builder(with_joints(tree, options.joints), options, literal).build()


class _Builder:
    def __init__(self, tree: LiteralTree, options: ReadingOptions, literal: Collection[str]) -> None:
        self.tree, self.options = tree, options
        self.intent = Intent(tree, options, literal)
        self.notes = list(tree.notes)
        self.couplings = self._resolved_couplings()
        self.floating_link = self._floating_link() if options.floating else None
        self.bodies: list[Body] = []
        self.sensors = tree.sensors if options.measured == "file" else ()
        wrenches = {s.link for s in self.sensors if isinstance(s, LiteralWrench)}
        self.separate = {tree.links[k].name for k in wrenches}.union(options.separate)
        self.host: dict[int, int] = {}  # link -> body that carries it
        self.offset: dict[int, tuple[LiteralPlacement, ...]] = {}  # link -> placements from its body's frame
        self.sources: dict[str, list[str]] = {}  # label of a body -> elements that its joint's frames come from

    def build(self) -> Built:
        self._check_massless()
        for index, link in enumerate(self.tree.links):
            if self._makes_body(index, link):
                self._add_body(index, link)
            else:
                self._attach(index, link)
        self._attach_inertials()
        gravity = gravity_vector(self.options.gravity, self.intent.gravity())
        if not self.tree.closures:  # loops close at the numbers of the file, not at any others
            self.bodies, gravity = with_relations(self.bodies, gravity, self.intent, self.sources)
        couplings = tuple(c.coupling for c in self.couplings.values())
        closures = tuple(self._closure(closure) for closure in self._moving_closures())
        mechanism = Mechanism(
            self.tree.name,
            tuple(self.bodies),
            gravity,
            couplings,
            closures=closures,
        )
        mechanism = replace(mechanism, measured=self._measured(mechanism))
        used = {s for b in self.bodies for s in b.joint.symbols()}
        used.update(s for placement in setup_placements(mechanism) for s in placement.symbols())
        symbols = {name: symbol for name, symbol in self.intent.symbols.items() if name in used}
        # a placement on the way to a closure is read once more
        snaps = tuple(dict.fromkeys(self.intent.snaps))
        riders = Riders(self.intent, self._rides())
        mechanism = replace(mechanism, symbols=symbols)
        if closures:
            assembly, note = chosen_pose(mechanism, self.tree.poses)
            mechanism = replace(mechanism, assembly=assembly)
            self.notes += [note] if note else []
            driven = [name for name in self.tree.driven if name in mechanism.velocities]
            mechanism = close(mechanism, None, prefer=driven)
        return Built(mechanism, snaps, tuple(self.notes), riders)

    def _rides(self) -> dict[str, Ride]:
        """What is fixed to bodies, by name: links, frames, and joints, which mark the link that they fix."""
        links, bodies = self.tree.links, {body.name for body in self.bodies}
        rides = {link.name: self._ride(k) for k, link in enumerate(links) if link.name not in bodies}
        for frame in self.tree.frames:
            if frame.name not in bodies:
                body, placements = self._ride(frame.link)
                rides.setdefault(frame.name, (body, (*placements, *frame.placements)))
        for link in links:
            if link.joint and link.joint not in bodies and link.name in rides:
                rides.setdefault(link.joint, rides[link.name])
        return rides

    def _measured(self, mechanism: Mechanism) -> tuple[Output, ...] | None:
        """What the sensors of the file measure, if that is asked for."""
        if self.options.measured == "drives":
            if self.tree.sensors:
                unused = f"{len(self.tree.sensors)} sensors of forces in the file are not used"
                self.notes.append(f"{unused}; --measured file takes them as outputs")
            return None
        motions = {m.name: m for m in mechanism.motions if m.name not in mechanism.dependent}
        outputs = tuple(build_outputs(self.sensors, motions, self._ride, self.intent, self.notes))
        if not outputs:
            raise InputError("it has no sensors of forces that could be outputs", source=self.tree.source)
        return outputs

    def _closure(self, stated: LiteralClosure) -> Closure:
        closure = build_closure(stated, self.tree, self.intent, self._ride)
        return with_parallelogram(closure, stated.element, self.bodies, self.intent)

    def _moving_closures(self) -> Iterator[LiteralClosure]:
        for closure in self.tree.closures:
            if self._ride(closure.first)[0] != self._ride(closure.second)[0]:
                yield closure
            else:
                self.notes.append(f"{closure.element} is ignored: it connects what does not move against each other")

    def _ride(self, link: int) -> Ride:
        """The body that carries a link, and the placements from its frame to the link's."""
        return self.host.get(link, GROUND), self.offset.get(link, ())

    # -- bodies ----------------------------------------------------------------------------------------------------

    def _makes_body(self, index: int, link: LiteralLink) -> bool:
        moves = any(not isinstance(step, LiteralPlacement) for step in link.steps)
        is_world = index == 0 and self.tree.root_is_world
        kept = self.options.every_link or link.name in self.separate
        return moves or index == self.floating_link or (kept and not is_world)

    def _floating_link(self) -> int:
        """The link that floats: the root, or what hangs on the world where the world is the root."""
        if not self.tree.root_is_world:
            return 0
        hanging = [k for k, link in enumerate(self.tree.links) if link.parent == 0]
        if len(hanging) == 1 and all(isinstance(s, LiteralPlacement) for s in self.tree.links[hanging[0]].steps):
            return hanging[0]
        names = ", ".join(f"'{self.tree.links[k].name}'" for k in hanging) or "none"
        raise InputError(
            f"floating needs exactly one body that is fixed to the world; the world carries {names}",
            source=self.tree.source,
        )

    def _add_body(self, index: int, link: LiteralLink) -> None:
        label = str(len(self.bodies) if self.options.floating or self.options.every_link else len(self.bodies) + 1)
        parent = self.host.get(link.parent, GROUND)
        steps: tuple[LiteralStep, ...] = (*self.offset.get(link.parent, ()), *link.steps)
        self.sources[label] = [step.element for step in steps]
        read = self._read(steps, label)
        kind, name = link.kind, link.joint
        if index == self.floating_link:
            kind, name, read = "floating", "base", (*floating_motions("base"), *read)
        read = merge(read)
        if not self.tree.closures:  # loops close at the lengths of the file, not at any others
            read = merge(self.intent.name_lengths(read, label, f"joint '{link.joint or link.name}'"))
        massless = link.name in self.options.massless
        self.bodies.append(Body(link.name, label, parent, Joint(name, kind, read), () if massless else ALL))
        self.host[index] = len(self.bodies) - 1
        self.offset[index] = ()

    def _attach(self, index: int, link: LiteralLink) -> None:
        """A fixed link rides on its parent's body."""
        placements = tuple(step for step in link.steps if isinstance(step, LiteralPlacement))
        self.host[index] = self.host.get(link.parent, GROUND)
        self.offset[index] = (*self.offset.get(link.parent, ()), *placements)

    def _read(self, steps: tuple[LiteralStep, ...], label: str) -> tuple[Step, ...]:
        read: list[Step] = []
        for step in steps:
            if isinstance(step, LiteralPlacement):
                read.append(self.intent.placement(step, label))
                continue
            motions = self.intent.motion(step, label)
            read.extend(motions)
            coupling = self.couplings.get(step.name)
            if coupling is not None and coupling.offset:
                moved = next(m for m in motions if isinstance(m, Motion))
                read.insert(read.index(moved), self._offset(coupling, moved, label))
        return merge(tuple(read))

    def _offset(self, coupling: StatedCoupling, motion: Motion, label: str) -> Placement:
        """The constant part of a coupling, as a placement before the motion."""
        offset = coupling.offset * motion.sign
        if motion.kind is MotionKind.TRANSLATION:
            x, y, z = (offset if k == motion.axis else 0 for k in range(3))
            return shift(x, y, z)
        value = offset.number
        assert isinstance(value, int | Fraction)
        return turn(motion.axis, self.intent.angle(value, f"{coupling.element} offset", f"offset{label}"))

    def _check_massless(self) -> None:
        names = {link.name: index for index, link in enumerate(self.tree.links)}
        for name in self.options.massless:
            if name not in names:
                raise InputError(f"no link '{name}' to declare massless", source=self.tree.source)
            if not self._makes_body(names[name], self.tree.links[names[name]]):
                raise InputError(
                    "it is fixed to its parent and counts as part of it; keep every link, or declare the moving link",
                    source=self.tree.source,
                    element=f"massless link '{name}'",
                )

    # -- inertials -------------------------------------------------------------------------------------------------

    def _attach_inertials(self) -> None:
        totals: dict[int, Inertial] = {}
        for index, link in enumerate(self.tree.links):
            body = self.host[index]
            if body == GROUND or link.inertial is None:
                continue
            rotation, translation = np.eye(3), np.zeros(3)
            for placement in self.offset[index]:
                step_rotation, step_translation = numeric_placement(placement)
                translation = translation + rotation @ step_translation
                rotation = rotation @ step_rotation
            moved = move_inertial(np.array(link.inertial), rotation, translation)
            totals[body] = totals[body] + moved if body in totals else moved
        for body, total in totals.items():
            values = tuple(float(v) for v in total)
            self.bodies[body] = replace(self.bodies[body], inertial=values)

    # -- couplings -------------------------------------------------------------------------------------------------

    def _resolved_couplings(self) -> dict[str, StatedCoupling]:
        """Couplings by dependent coordinate, unless they are to be ignored."""
        if self.options.independent_mimics:
            return {}
        found = resolved(self.tree.couplings, self._error)
        if found:
            self.notes.append(f"coupled to another joint: {', '.join(found)}")
        return found

    def _error(self, element: str, problem: str) -> InputError:
        return InputError(problem, source=self.tree.source, element=element)
