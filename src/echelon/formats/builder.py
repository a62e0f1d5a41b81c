"""From a literal tree to a mechanism: bodies, couplings, closures and measured outputs.

Links that are fixed to others become part of the bodies that carry them, and are remembered as riders.  Loops are
assembled at the reference pose of the file, or at a keyframe that closes them better.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import partial

import numpy as np

from echelon.algebra import Angle, Polynomial, as_polynomial
from echelon.formats.bodies import Bodies, Part, placed_before, with_relations
from echelon.formats.literal import (
    LiteralClosure,
    LiteralLink,
    LiteralPlacement,
    LiteralSensor,
    LiteralStep,
    LiteralTree,
    LiteralWrench,
    StatedCoupling,
    move_inertial,
    numeric_placements,
    resolved,
    with_joints,
)
from echelon.formats.met_frames import second_frame
from echelon.formats.rounding import rounding_of_tree
from echelon.formats.snapping import PRECISION, ReadingOptions, Snapping, gravity_vector
from echelon.robot import (
    ALL,
    GROUND,
    Closure,
    Cut,
    Force,
    Mechanism,
    Motion,
    MotionKind,
    Output,
    Placement,
    Side,
    Snap,
    Step,
    merge,
    setup_placements,
    stated_impossibilities,
)
from echelon.shared import Floats, InputError, symbol_stem

Ride = tuple[int, tuple[LiteralPlacement, ...]]
"""The body that carries something, or GROUND, and the placements from its frame to what it carries."""


@dataclass(frozen=True)
class Built:
    """A mechanism with an account of how its numbers were read."""

    mechanism: Mechanism
    snapping: Snapping  # read the numbers, and goes on to do so
    notes: tuple[str, ...]
    # links, frames and joints that are fixed to bodies, by name
    rides: Mapping[str, Ride] = field(default_factory=dict)
    driven: tuple[
        str, ...
    ] = ()  # coordinates, or joints, that have drives, as far as that is said

    @property
    def snaps(self) -> tuple[Snap, ...]:
        """Numbers that were read as nearby exact ones; what is read once more counts once."""
        return tuple(dict.fromkeys(self.snapping.snaps))

    def place(self, name: str) -> tuple[int, Placement]:
        """The body that carries one of the rides, and where it sits on that body."""
        body, placements = self.rides[name]
        placed = self.snapping.placements(placements, symbol_stem(name))
        return body, self.snapping.without_noise(placed, f"frame '{name}'")


def build_mechanism(
    tree: LiteralTree, options: ReadingOptions, literal: Collection[str] = ()
) -> Built:
    """Interpret a literal tree."""
    return _Builder(with_joints(tree, options.joints), options, literal).build()


class _Builder:
    def __init__(
        self, tree: LiteralTree, options: ReadingOptions, literal: Collection[str]
    ) -> None:
        self.tree, self.options = tree, options
        lengths = (
            abs(float(x))
            for k in tree.links
            for s in k.steps
            if isinstance(s, LiteralPlacement)
            for x in s.xyz
        )
        looped = replace(options, looped=options.looped or bool(tree.closures))
        self.snapping = Snapping(
            tree.source, looped, literal, scale=max(lengths, default=0.0)
        )
        self.notes = list(tree.notes)
        self.couplings = self._resolved_couplings()
        self.floating_link = self._floating_link() if options.floating else None
        self.lumped = Bodies(0 if options.floating or options.keep_fixed_links else 1)
        self.bodies = self.lumped.made
        self.sensors = tree.sensors if options.measured == "file" else ()
        wrenches = {s.link for s in self.sensors if isinstance(s, LiteralWrench)}
        self.separate = {tree.links[k].name for k in wrenches}.union(options.separate)

    def build(self) -> Built:
        self._check_massless()
        for index, link in enumerate(self.tree.links):
            self._add(index, link)
        self._attach_inertials()
        x, y, z = map(as_polynomial, self.tree.gravity)
        gravity = gravity_vector(self.options.gravity, (x, y, z))
        closures = tuple(self._closure(closure) for closure in self._moving_closures())
        ends = [(closure.first, closure.second) for closure in closures]
        self.bodies, gravity = with_relations(
            self.bodies, gravity, self.snapping, self.lumped.sources, ends=ends
        )
        couplings = tuple(c.coupling for c in self.couplings.values())
        rounding = rounding_of_tree(self.tree) if self.options.snap_tolerance else 0.0
        mechanism = Mechanism(
            self.tree.name,
            tuple(self.bodies),
            gravity,
            couplings,
            closures=closures,
            rounding=rounding,
        )
        mechanism = replace(mechanism, measured=self._measured(mechanism))
        if closures:
            mechanism = replace(mechanism, symbols=self.snapping.symbols)
            assembly, note = chosen_pose(mechanism, self.tree.poses)
            if note:
                self.notes.append(note)
            mechanism = replace(mechanism, assembly=assembly)
        used = {s for b in mechanism.bodies for s in b.joint.symbols()}
        used.update(
            s for placement in setup_placements(mechanism) for s in placement.symbols()
        )
        symbols = {
            name: symbol
            for name, symbol in self.snapping.symbols.items()
            if name in used
        }
        mechanism = replace(mechanism, symbols=symbols)
        if closures:
            from echelon.loops import close  # robots without loops load without it

            mechanism = close(mechanism, prefer=self._preferred(mechanism))
        self._check_independent(mechanism)
        return Built(
            mechanism, self.snapping, tuple(self.notes), self._rides(), self.tree.driven
        )

    def _preferred(self, mechanism: Mechanism) -> list[str]:
        """Coordinates that shall be independent where loops leave a choice: first those of drives."""
        first = [name for name in self.tree.driven if name in mechanism.velocities]
        if not self.tree.independent:
            return first
        others = [
            name
            for name in mechanism.velocities
            if self.tree.independent.get(name, True)
        ]
        return list(dict.fromkeys([*first, *others]))

    def _check_independent(self, mechanism: Mechanism) -> None:
        """Refuse joints of which the file says that they depend on others, or do not, if that is not so."""
        if self.options.looped or (
            self.options.independent_mimics and self.tree.has_mimics
        ):
            return  # loops stand in a file beside this one, or couplings are ignored on request
        for name, stated in self.tree.independent.items():
            if not stated and name in mechanism.independent_velocities:
                problem = (
                    "the file states that it depends on others (independent='false'), but has no loop or coupling "
                    "for it: add one, or ignore the attribute (--ignore @independent)"
                )
                raise self._error(f"joint '{name}'", problem)
            if (
                stated
                and name in mechanism.velocities
                and name not in mechanism.independent_velocities
            ):
                chosen = ", ".join(mechanism.independent_velocities)
                problem = f"the file states that it is independent, but loops determine it from others: {chosen}"
                raise self._error(f"joint '{name}'", problem)

    def _rides(self) -> dict[str, Ride]:
        """Parts fixed to bodies, by name: links, frames, and joints, which mark the link that they fix."""
        links, bodies = self.tree.links, {body.name for body in self.bodies}
        rides = {
            link.name: self._ride(k)
            for k, link in enumerate(links)
            if link.name not in bodies
        }
        for frame in self.tree.frames:
            if frame.name not in bodies:
                body, placements = self._ride(frame.link)
                rides.setdefault(frame.name, (body, (*placements, *frame.placements)))
        for link in links:
            if link.joint and link.joint not in bodies and link.name in rides:
                rides.setdefault(link.joint, rides[link.name])
        return rides

    def _measured(self, mechanism: Mechanism) -> tuple[Output, ...] | None:
        """Outputs from the file's force sensors; None if the drives are measured."""
        if self.options.measured == "drives":
            if self.tree.sensors:
                unused = (
                    f"{len(self.tree.sensors)} force sensors of the file are not used"
                )
                self.notes.append(f"{unused}; --measured file takes them as outputs")
            return None
        motions = {m.name: m for m in mechanism.free_motions}
        outputs = tuple(
            output
            for sensor in self.sensors
            for output in self._outputs(sensor, motions)
        )
        if not outputs:
            raise InputError(
                "the file has no force sensors that could be outputs",
                source=self.tree.source,
            )
        return outputs

    def _outputs(
        self, sensor: LiteralSensor, motions: Mapping[str, Motion]
    ) -> Iterator[Output]:
        if isinstance(sensor, LiteralWrench):
            body, offset = self._ride(sensor.link)
            frame = self.snapping.placements(
                (*offset, *sensor.placements), symbol_stem(sensor.name)
            )
            for axis in range(3):
                cut = Cut(body, frame, False, axis, sensor.angular)
                yield cut.of_sensor(sensor.name)
        elif sensor.joint in motions:
            unit = (
                "N" if motions[sensor.joint].kind is MotionKind.TRANSLATION else "N·m"
            )
            force = Force(sensor.joint, Side.JOINT), Polynomial.constant(sensor.weight)
            yield Output(sensor.name, unit, forces=(force,))
        else:
            self.notes.append(
                f"{sensor.element} is left out: joint '{sensor.joint}' does not move freely"
            )

    def _closure(self, stated: LiteralClosure) -> Closure:
        first, offset = self._ride(stated.first)
        second, other = self._ride(stated.second)
        read, stem = self.snapping.placements, symbol_stem(stated.name)
        aim = (
            Placement() if stated.axis is None else self.snapping.aim(stated.axis, stem)
        )
        frame = read(stated.first_frame, stem) @ aim
        met = (
            self._met(stated, frame)
            if stated.second_frame is None
            else read(stated.second_frame, stem) @ aim
        )
        frame, met = read(offset, stem) @ frame, read(other, stem) @ met
        return Closure(stated.name, stated.kind, first, second, frame, met)

    def _met(self, stated: LiteralClosure, frame: Placement) -> Placement:
        """The frame of the second link that coincides with that of the first one at the reference pose."""
        links, read = self.tree.links, self.snapping.placements
        try:
            return second_frame(
                stated.kind,
                stated.first,
                stated.second,
                frame,
                lambda k: links[k].parent,
                lambda k: read(links[k].rest, symbol_stem(links[k].name)),
                self.snapping.symbols,
            )
        except ValueError as error:
            raise InputError(
                str(error), source=self.tree.source, element=stated.element
            ) from None

    def _moving_closures(self) -> Iterator[LiteralClosure]:
        for closure in self.tree.closures:
            if self._ride(closure.first)[0] != self._ride(closure.second)[0]:
                yield closure
            else:
                self.notes.append(
                    f"{closure.element} is ignored: its two ends do not move against each other"
                )

    def _ride(self, link: int) -> Ride:
        """The body that carries a link, and the placements from its frame to the link's."""
        links, found = self.tree.links, tuple[LiteralPlacement, ...]()
        body = self.lumped.host[links[link].name] if link != GROUND else GROUND
        while link != GROUND and not self._makes_body(link, links[link]):
            found = (
                *(
                    step
                    for step in links[link].steps
                    if isinstance(step, LiteralPlacement)
                ),
                *found,
            )
            link = links[link].parent
        return body, found

    # -- bodies ----------------------------------------------------------------------------------------------------

    def _makes_body(self, index: int, link: LiteralLink) -> bool:
        moves = any(not isinstance(step, LiteralPlacement) for step in link.steps)
        is_world = index == 0 and self.tree.root_is_world
        kept = self.options.keep_fixed_links or link.name in self.separate
        return moves or index == self.floating_link or (kept and not is_world)

    def _floating_link(self) -> int:
        """The link that floats: the root, or what hangs on the world where the world is the root."""
        self._check_fixed_base()
        if not self.tree.root_is_world:
            return 0
        hanging = [k for k, link in enumerate(self.tree.links) if link.parent == 0]
        if len(hanging) == 1 and all(
            isinstance(s, LiteralPlacement) for s in self.tree.links[hanging[0]].steps
        ):
            return hanging[0]
        names = ", ".join(f"'{self.tree.links[k].name}'" for k in hanging) or "none"
        raise InputError(
            f"floating needs exactly one body that is fixed to the world; the world carries {names}",
            source=self.tree.source,
        )

    def _check_fixed_base(self) -> None:
        """Refuse a base that floats already by a joint of the file."""
        root, *others = self.tree.links
        carried = [link for link in others if link.parent == 0]
        while (
            len(carried) == 1 and _is_fixed(carried[0]) and root.inertial is None
        ):  # such as a frame of the world
            place = self.tree.links.index(carried[0])
            root = carried[0]
            carried = [link for link in others if link.parent == place]
        floats = [link for link in carried if any(_floats(step) for step in link.steps)]
        if len(floats) == len(carried) == 1 and root.inertial is None:
            problem = (
                f"its joint '{floats[0].joint}' lets it float already, so the base need not float as well: leave out "
                "--floating (floating=True, floating_base: true)"
            )
            raise self._error(f"body '{floats[0].name}'", problem)

    def _add(self, index: int, link: LiteralLink) -> None:
        parent = None if link.parent == GROUND else self.tree.links[link.parent].name
        part = Part(
            tuple(step.element for step in link.steps),
            link.name,
            parent,
            link.joint,
            link.kind,
            moves=any(not isinstance(step, LiteralPlacement) for step in link.steps),
            steps=partial(self._read, link.steps),
            carried=() if link.name in self.options.massless else ALL,
        )
        if not self._makes_body(index, link):
            self.lumped.attach(part, part.steps)
            return
        label = self.lumped.add(part, floats=index == self.floating_link)
        if (
            not self.tree.closures
        ):  # loops close at the lengths of the file, not at any others
            body, element = self.bodies[-1], f"joint '{link.joint or link.name}'"
            steps = merge(self.snapping.name_lengths(body.joint.steps, label, element))
            self.bodies[-1] = replace(body, joint=replace(body.joint, steps=steps))

    def _read(self, steps: tuple[LiteralStep, ...], label: str) -> tuple[Step, ...]:
        read: list[Step] = []
        for step in steps:
            if isinstance(step, LiteralPlacement):
                read.append(self.snapping.placement(step, label))
                continue
            motions = self.snapping.motion(step, label)
            read.extend(motions)
            coupling = self.couplings.get(step.name)
            if coupling is not None and coupling.offset:
                moved = next(m for m in motions if isinstance(m, Motion))
                read.insert(read.index(moved), self._offset(coupling, moved, label))
        return merge(tuple(read))

    def _offset(
        self, coupling: StatedCoupling, motion: Motion, label: str
    ) -> Placement:
        """The constant part of a coupling, as a placement before the motion."""

        def angle(value: Polynomial) -> Angle:
            assert isinstance(value.number, int | Fraction)
            return self.snapping.angle(
                value.number, f"{coupling.element} offset", f"offset{label}"
            )

        return placed_before(motion, coupling.offset, angle)

    def _check_massless(self) -> None:
        names = {link.name: index for index, link in enumerate(self.tree.links)}
        for name in self.options.massless:
            if name not in names:
                raise InputError(
                    f"no link '{name}' to declare massless", source=self.tree.source
                )
            if not self._makes_body(names[name], self.tree.links[names[name]]):
                raise InputError(
                    "it is fixed to its parent and counts as part of it; keep every link, or declare the moving link",
                    source=self.tree.source,
                    element=f"massless link '{name}'",
                )

    # -- inertials -------------------------------------------------------------------------------------------------

    def _attach_inertials(self) -> None:
        totals: dict[int, Floats] = {}
        for index, link in enumerate(self.tree.links):
            body, placements = self._ride(index)
            if body == GROUND or link.inertial is None:
                continue
            moved = move_inertial(
                np.array(link.inertial), numeric_placements(placements)
            )
            totals[body] = totals[body] + moved if body in totals else moved
            faults = stated_impossibilities(link.name, link.inertial)
            self.bodies[body] = replace(
                self.bodies[body], impossible=(*self.bodies[body].impossible, *faults)
            )
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


def _is_fixed(link: LiteralLink) -> bool:
    return all(isinstance(step, LiteralPlacement) for step in link.steps)


def _floats(step: LiteralStep) -> bool:
    return not isinstance(step, LiteralPlacement) and step.kind == "floating"


NEARLY_CLOSED = 0.02
"""Closure error, rad or share of the characteristic length, up to which the first stated pose is the intended one."""


def chosen_pose(
    mechanism: Mechanism, poses: Mapping[str, Mapping[str, float]]
) -> tuple[dict[str, float], str]:
    """The pose near which loops are assembled, and what the user should know about it, if anything."""
    from echelon.loops import ClosedMotion, largest, normalised

    known = [
        {n: v for n, v in pose.items() if n in mechanism.positions}
        for pose in poses.values()
    ]
    motion = ClosedMotion(mechanism)
    q = normalised(mechanism, np.array([_positions(mechanism, pose) for pose in known]))
    open_by = largest(motion.closures.at(q)[0])
    best = 0 if open_by[0] < NEARLY_CLOSED else int(open_by.argmin())
    names = list(poses)
    if best:
        at_first = f"at {names[0]} {motion.opening(q[0])}"
        return known[
            best
        ], f"the loops are assembled near {names[best]}, because {at_first}"
    if open_by[0] > PRECISION:
        return known[
            0
        ], f"at {names[0]} {motion.opening(q[0])}: the loops are assembled near it"
    return known[0], ""


def _positions(mechanism: Mechanism, pose: Mapping[str, float]) -> Floats:
    upright = {
        m.positions[0]: 1.0 for m in mechanism.motions if m.kind is MotionKind.BALL
    }
    return np.array(
        [pose.get(name, upright.get(name, 0.0)) for name in mechanism.positions]
    )
