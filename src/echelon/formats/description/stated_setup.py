"""Drives, effects, rotors, outputs and loops of a description, added to its mechanism or to that of a robot file."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np

from echelon.algebra import PER_PI, PI, Polynomial, pi_generators
from echelon.formats.bodies import BASE
from echelon.formats.builder import Built
from echelon.formats.description.couplings import CouplingReader
from echelon.formats.description.document import (
    Document,
    Expressions,
    coordinate_axis,
    cut_off,
    declared_symbols,
)
from echelon.formats.literal import StatedJoint
from echelon.formats.met_frames import at_zero, second_frame
from echelon.formats.rounding import COARSEST, rounding_of_mechanism
from echelon.formats.schema.robot_schema import RobotDescription
from echelon.formats.schema.schema_outputs import ActuatorOutput
from echelon.formats.schema.schema_setup import (
    LinearTerms,
    OwnEffect,
    ReadyEffect,
    RotorEntry,
)
from echelon.formats.schema.schema_types import Frame, LoopEntry
from echelon.formats.snapping import ReadingOptions
from echelon.formats.usual_effects import (
    AT_OUTPUTS,
    effect_label,
    made_at,
    slides,
)
from echelon.robot import (
    GROUND,
    POSITIVE_CONSTANTS,
    Action,
    Actuator,
    Body,
    Bristles,
    Closure,
    ClosureKind,
    Contact,
    ContactKind,
    Coupling,
    Cut,
    Effect,
    Force,
    Joint,
    Mechanism,
    Motion,
    MotionKind,
    Output,
    Placement,
    Side,
    linear,
    merge,
    ready_made,
)
from echelon.shared import PARAMETERS, nearest_of, step_into, symbol_stem

FindPart = Callable[[str | None, str], tuple[int, Placement]]
"""The body that carries a part and where the part sits on it, by the part's name and the element that names it."""

ADDITIONS = (
    "loops",
    "independent",
    "assembly",
    "actuators",
    "rotors",
    "effects",
    "outputs",
    "contacts",
)
"""Keys of a description that add to its bodies and joints."""

EVERY = "all"
EVERY_OUTPUT = "outputs"
_SPIN = (PARAMETERS.index("XX"), PARAMETERS.index("YY"), PARAMETERS.index("ZZ"))
_ALIASES = {"points": ClosureKind.SPHERICAL, "axes": ClosureKind.CYLINDRICAL}


@dataclass(frozen=True)
class _Spring:
    """The spring of an elastic drive."""

    motor: str
    joint: str
    share: Polynomial  # motion of the joint by that of the motor

    @property
    def name(self) -> str:
        """The drive whose position is the deflection."""
        return f"{self.motor}.spring"

    @property
    def spin(self) -> str:
        """Coordinate of the rotor."""
        return f"{self.motor}.spin"

    @property
    def drives(self) -> tuple[Actuator, Actuator]:
        """The motor, and the spring, whose force is zero: that of the bodies behind it and its own."""
        one = Polynomial.constant(1)
        ends = ((self.joint, one), (self.spin, -self.share))
        return Actuator(self.motor, ((self.spin, one),)), Actuator(self.name, ends)

    def output(self, measured: Sequence[Output]) -> Output:
        """A measured output by the force of the spring in the place of that of the bodies behind it.

        It is a torque in the joint, or else of the motor; or any, as all that is added to it is zero.
        """
        shares = {
            Force(self.joint, Side.JOINT): Polynomial.constant(-1),
            Force(self.motor, Side.ACTUATOR): -self.share,
        }
        found, weight = measured[0], Polynomial.constant(1)
        for place, share in reversed(shares.items()):
            for output in measured:
                if place in dict(output.forces):
                    found, weight = output, dict(output.forces)[place] * share
        own = (Force(self.name, Side.ACTUATOR), weight)
        forces = (*found.forces, own)
        return Output(self.name, found.unit, forces, found.cuts, found.name)


class Additions:
    """Set-up that a description adds to a mechanism: loops, drives, rotors, effects and outputs."""

    def __init__(
        self,
        mechanism: Mechanism,
        robot: RobotDescription,
        expressions: Expressions,
        find: FindPart,
    ) -> None:
        self.mechanism = mechanism
        self.robot = robot
        self.expressions = expressions
        self.find = find
        self.springs: list[_Spring] = []

    def added(self) -> Mechanism:
        """The mechanism with all of them."""
        self.mechanism = self._closed()
        self.mechanism = replace(
            self.mechanism,
            actuators=tuple(self._actuators()),
            contacts=tuple(self._contacts()),
        )
        for index, rotor in enumerate(self.robot.rotors):
            self._add_rotor(rotor, f"rotors[{index}]")
        stated = self.robot.outputs
        if stated is None and self.springs:
            stated = (ActuatorOutput(actuator=EVERY),)
        if stated is not None:
            measured = [
                output
                for k, entry in enumerate(stated)
                for output in entry.outputs(self, f"outputs[{k}]")
            ]
            measured += [spring.output(measured) for spring in self.springs if measured]
            self.mechanism = replace(self.mechanism, measured=tuple(measured))
        self.mechanism = replace(self.mechanism, effects=tuple(self._effects()))
        return replace(
            self.mechanism, symbols={**self.mechanism.symbols, **self.expressions.named}
        )

    # -- drives ----------------------------------------------------------------------------------------------------

    @property
    def _drives(self) -> tuple[str, ...]:
        return tuple(
            actuator.name for actuator in self.mechanism.transmission.actuators
        )

    def _actuators(self) -> Iterator[Actuator]:
        for name, entry in self.robot.actuators.items():
            path = f"actuators.{name}"
            terms = self._linear(entry, path)
            for coordinate, _ in terms:
                if coordinate not in self.mechanism.independent_velocities:
                    problem = f"'{coordinate}' depends on others through loops; list it in 'independent' to drive it"
                    raise self.expressions.error(path, problem)
            yield Actuator(name, terms)

    def _linear(
        self, entry: str | LinearTerms, path: str
    ) -> tuple[tuple[str, Polynomial], ...]:
        """A combination of uncoupled coordinates; an actuator's name stands for its own combination."""
        moving = {m.name: m for m in self.mechanism.free_motions}
        single = {
            name: m for name, m in moving.items() if m.kind is not MotionKind.BALL
        }
        reader = CouplingReader(self.expressions, single)
        if not isinstance(entry, str):
            terms = reader.ratios(entry.terms, path)
        else:
            drives = {a.name: dict(a.terms) for a in self.mechanism.actuators}
            if entry in drives:
                return tuple(drives[entry].items())
            terms, offset = reader.linear(entry, path)
            if offset:
                raise self.expressions.error(
                    path, f"'{entry}' has a constant part; a transmission has none"
                )
        return tuple(terms.items())

    def _add_rotor(self, rotor: RotorEntry, path: str) -> None:
        spin = f"{rotor.name}.spin"
        kind = "xyz".index(rotor.axis[-1])
        motion = Motion(
            MotionKind.ROTATION, spin, kind, -1 if rotor.axis.startswith("-") else 1
        )
        label = rotor.label or symbol_stem(rotor.name)
        placed = self.expressions.frame(rotor.frame, f"{path}.frame", label)
        parent, rides = self.find(rotor.on, f"{path}.on")
        joint = Joint(rotor.name, "rotor", merge((rides @ placed, motion)))
        # of a rotor that is symmetric about its axis all but the spin inertia counts to its carrier
        body = Body(rotor.name, label, parent, joint, (_SPIN[kind],))
        drives = self._linear(rotor.drives, f"{path}.drives")
        if rotor.elastic:
            self._add_spring(body, drives, path)
            return
        coupling = Coupling(
            spin, tuple((name, linear(ratio)) for name, ratio in drives)
        )
        self.mechanism = replace(
            self.mechanism,
            bodies=(*self.mechanism.bodies, body),
            couplings=(*self.mechanism.couplings, coupling),
        )

    def _add_spring(
        self, rotor: Body, drives: tuple[tuple[str, Polynomial], ...], path: str
    ) -> None:
        """A rotor that turns by itself, and the spring to its joint as a drive whose position is the deflection."""
        mechanism = self.mechanism
        (joint, ratio), *others = drives
        number = ratio.number
        if others or not isinstance(number, int | Fraction) or not number:
            problem = "an elastic drive moves one joint, by a ratio that is a number: drives: 100*j1"
            raise self.expressions.error(f"{path}.drives", problem)
        share = Polynomial.constant(Fraction(1, number))
        spring = _Spring(rotor.name, joint, share)
        self.springs.append(spring)
        self.mechanism = replace(
            mechanism,
            bodies=(*mechanism.bodies, rotor),
            actuators=(*mechanism.actuators, *spring.drives),
            independent=mechanism.independent and (*mechanism.independent, spring.spin),
        )

    # -- effects ---------------------------------------------------------------------------------------------------

    def _effects(self) -> Iterator[Effect]:
        for index, entry in enumerate(self.robot.effects or ()):
            path = f"effects[{index}]"
            if isinstance(entry, OwnEffect):
                yield self._own(entry, path)
            elif not isinstance(
                entry, str
            ):  # the usual ones join when it is known what is measured
                yield from self._ready(entry, path)
        for spring in self.springs:
            label = effect_label(self.mechanism, spring.motor)
            sliding = slides(self.mechanism, spring.name)
            yield from ready_made(
                "elastic", spring.name, Side.ACTUATOR, label, sliding=sliding
            )

    def _own(self, entry: OwnEffect, path: str) -> Effect:
        actions = tuple(
            Action(
                action.at,
                self._side(action.at, action.side, f"{path}.acts[{k}].at"),
                action.term,
            )
            for k, action in enumerate(entry.acts)
        )
        value = (
            None
            if entry.value is None
            else self.expressions.real(entry.value, f"{path}.value")
        )
        state = entry.bristles
        bristles = None if state is None else Bristles(**state.model_dump())
        return Effect(entry.parameter, entry.unit, actions, value, bristles)

    def _ready(self, entry: ReadyEffect, path: str) -> list[Effect]:
        names = (entry.at,) if isinstance(entry.at, str) else entry.at
        places = [
            place for name in names for place in self._places(name, entry, f"{path}.at")
        ]
        for constant, text in entry.constants.items():
            self._check_positive(constant, text)
        found: list[tuple[Effect, ...]] = []
        for name, side in places:
            if side is Side.OUTPUT and entry.type not in AT_OUTPUTS:
                problem = (
                    f"a sensor has no {entry.type} friction or force of its own: name a joint or an actuator; at "
                    f"outputs there is {' or '.join(AT_OUTPUTS)}"
                )
                raise self.expressions.error(f"{path}.type", problem)
            found.append(
                made_at(
                    self.mechanism,
                    entry.type,
                    name,
                    side,
                    entry.label,
                    entry.constants,
                )
            )
        if entry.label is None or len(found) < 2:
            return [effect for effects in found for effect in effects]
        return [
            self._shared(effects, f"{path}.label")
            for effects in zip(*found, strict=True)
        ]

    def _check_positive(self, constant: str, text: str) -> None:
        """Refuse a symbol with a value, or a range to be fitted in, that a constant of a law cannot have."""
        symbol = self.expressions.snapping.symbols.get(text)
        if symbol is None or constant not in POSITIVE_CONSTANTS:
            return
        least = symbol.value if symbol.fit is None else symbol.fit[0]
        if least is not None and least <= 0:
            problem = (
                f"it is the {constant} of a law, which is above zero, and not {least:g}"
            )
            raise self.expressions.error(f"symbols.{text}", problem)

    def _shared(self, effects: Sequence[Effect], path: str) -> Effect:
        """Effects of one label at several places as one, whose parameter all places share."""
        if len({effect.unit for effect in effects}) > 1:
            raise self.expressions.error(
                path, "places that share a label must have the same unit, N or N·m"
            )
        return replace(
            effects[0],
            actions=tuple(action for effect in effects for action in effect.actions),
        )

    def _stiff(self, names: Sequence[str]) -> tuple[str, ...]:
        """Places without those of elastic drives at which nothing is measured, and no friction usual."""
        hidden = {name for s in self.springs for name in (s.name, s.spin)}
        return tuple(name for name in names if name not in hidden)

    def _places(self, at: str, entry: ReadyEffect, path: str) -> list[tuple[str, Side]]:
        """Places that a name stands for: all of them, or of a sensor its outputs."""
        if at == EVERY:
            free = self.mechanism.floating_velocities
            side = Side(entry.side or Side.ACTUATOR)
            every = {
                Side.JOINT: self.mechanism.velocities,
                Side.ACTUATOR: self._drives,
                Side.OUTPUT: self._outputs,
            }[side]
            return [(name, side) for name in self._stiff(every) if name not in free]
        sensors = {EVERY_OUTPUT: list(self._outputs)}
        for output in self.mechanism.stated_outputs:
            sensors.setdefault(output.sensor, []).append(output.name)
        names, components = self._valid(entry.side), sensors.get(at, [])
        is_sensor = bool(components) and components != [at]
        if is_sensor and entry.side in (None, Side.OUTPUT):
            if at not in names:
                return [(name, Side.OUTPUT) for name in components]
            if entry.type in AT_OUTPUTS:
                problem = f"'{at}' may be the sensor or the {names[at]} of this name: write side: output or side: {names[at]}"
                raise self.expressions.error(path, problem)
        return [(at, self._side(at, entry.side, path))]

    def _side(self, at: str, stated: str | None, path: str) -> Side:
        valid = self._valid(stated)
        kind = "coordinate or output" if self._outputs else "coordinate"
        self.expressions.check(at, tuple(valid), path, stated or kind)
        return valid[at]

    def _valid(self, stated: str | None) -> dict[str, Side]:
        """Names of places of one side, or of all: drives before joints, and these before outputs."""
        joints = [n for motion in self.mechanism.motions for n in motion.velocities]
        names: dict[Side, Sequence[str]] = {
            Side.ACTUATOR: self._drives,
            Side.JOINT: joints,
            Side.OUTPUT: self._outputs,
        }
        found: dict[str, Side] = {}
        for side in [Side(stated)] if stated else names:
            for name in names[side]:
                found.setdefault(name, side)
        return found

    @property
    def _outputs(self) -> tuple[str, ...]:
        return tuple(output.name for output in self.mechanism.stated_outputs)

    # -- what the entries of sensors ask for -----------------------------------------------------------------------

    def forces(self, side: Side, at: str, path: str) -> dict[str, tuple[Force, str]]:
        """The force at a place, or at all of them, and its unit, by place."""
        valid = (
            self.mechanism.independent_velocities
            if side is Side.JOINT
            else self._drives
        )
        valid = self._stiff(valid)
        kind = "actuator" if side is Side.ACTUATOR else "joint coordinate"
        if side is Side.JOINT and self.mechanism.closures:
            kind = f"independent {kind}"
        found: dict[str, tuple[Force, str]] = {}
        for name in valid if at == EVERY else (at,):
            self.expressions.check(name, valid, path, kind)
            found[name] = (
                Force(name, side),
                "N" if slides(self.mechanism, name) else "N·m",
            )
        return found

    def cut(
        self,
        component: str,
        body: str,
        frame: Frame,
        fixed_to: str,
        stem: str,
        path: str,
        key: str = "wrench",
    ) -> Cut:
        """One component of the wrench of a body, in a frame whose angles are named after ``stem``."""
        index, rides = self.find(body, f"{path}.{key}")
        placed = rides @ self.expressions.frame(
            frame, f"{path}.frame", symbol_stem(stem)
        )
        axis, angular = "xyz".index(component[1]), component[0] == "t"
        return Cut(index, placed, fixed_to == "parent", axis, angular)

    def weight(self, text: str, path: str) -> Polynomial:
        """A number or an expression in symbols."""
        return self.expressions.polynomial(text, path)

    def _contacts(self) -> Iterator[Contact]:
        for index, entry in enumerate(self.robot.contacts):
            path = f"contacts[{index}]"
            body, rides = self.find(entry.body, f"{path}.body")
            if body == GROUND:
                raise self.expressions.error(
                    f"{path}.body", f"'{entry.body}' is fixed to the ground"
                )
            kind, name = ContactKind(entry.type), entry.name or entry.body
            rolls = kind is ContactKind.ROLLING
            stated = "radius" in entry.model_fields_set
            if rolls != stated:
                raise self.expressions.error(
                    f"{path}.radius",
                    "what rolls needs a radius" if rolls else "only what rolls has one",
                )
            frame = rides @ self.expressions.frame(
                entry.at, f"{path}.at", symbol_stem(name)
            )
            radius = self.expressions.length(entry.radius, f"{path}.radius")
            yield Contact(name, kind, body, frame, radius, entry.measured)

    # -- loops -----------------------------------------------------------------------------------------------------

    def _closed(self) -> Mechanism:
        """The mechanism with the loops that are stated, beside those that it has."""
        closures = (*self.mechanism.closures, *self._closures())
        if not closures:
            problem = (
                "there are no loops, so no coordinate depends on others through them"
            )
            for key in ("independent", "assembly", "rounding"):
                if key in self.robot.model_fields_set:
                    raise self.expressions.error(key, problem)
            return self.mechanism
        # what a robot file chose already stays where it can
        prefer = (*self._driven(), *self.mechanism.independent)
        assembly = {**self.mechanism.assembly, **self._assembly()}
        symbols = {**self.mechanism.symbols, **self.expressions.named}
        opened = replace(
            self.mechanism,
            closures=closures,
            independent=(),
            assembly=assembly,
            symbols=symbols,
        )
        if self.robot.rounding is not None:
            opened = replace(opened, rounding=self._rounding(self.robot.rounding))
        elif (
            self.expressions.snapping.options.snap_tolerance
            and self.robot.robot is None
            and not self.robot.symbols
        ):  # what has a name is as it is stated
            opened = replace(opened, rounding=rounding_of_mechanism(opened))
        from echelon.loops import close  # robots without loops load without it

        return close(opened, self._independent(), prefer=prefer)

    def _closures(self) -> Iterator[Closure]:
        """The joints that close loops."""
        taken = {closure.name for closure in self.mechanism.closures}
        for index, entry in enumerate(self.robot.loops):
            path = f"loops[{index}]"
            if isinstance(entry, tuple):
                shown = "-".join(
                    part or BASE for part in entry
                )  # two frames that are held together as they are
                own = Frame.model_construct()
                entry = LoopEntry.model_construct(
                    name=shown, joint="weld", connects=entry, on_second=own
                )
            name = entry.name or f"loop{len(self.mechanism.closures) + index + 1}"
            if name in taken:
                raise self.expressions.error(
                    f"{path}.name", f"another loop has the name '{name}'"
                )
            taken.add(name)
            yield self._closure(entry, name, path)

    def _closure(self, entry: LoopEntry, name: str, path: str) -> Closure:
        (first, offset), (second, other) = (
            self.find(part, f"{path}.connects[{k}]")
            for k, part in enumerate(entry.connects)
        )
        if first == second:
            shown = " and ".join(
                f"'{part}'" if part else "the world" for part in entry.connects
            )
            raise self.expressions.error(
                f"{path}.connects", f"{shown} do not move against each other"
            )
        stem = symbol_stem(name)
        aim = self._aim(entry, path, stem)
        kind = _ALIASES.get(entry.joint) or ClosureKind(entry.joint)
        frame = offset @ self.expressions.frame(entry.at, f"{path}.at", stem) @ aim
        # what is only fixed to something that moves can have no other use than to mark a place
        moving = {
            BASE,
            None,
            *(body.name for body in self.mechanism.bodies if not body.joint.is_fixed),
        }
        meets = "at" not in entry.model_fields_set and moving.isdisjoint(entry.connects)
        if entry.on_second is None and not meets:
            met = self._met(kind, first, second, frame, path)
        else:
            stated = entry.at if entry.on_second is None else entry.on_second
            met = (
                other @ self.expressions.frame(stated, f"{path}.on_second", stem) @ aim
            )
        return Closure(name, kind, first, second, frame, met)

    def _aim(self, entry: LoopEntry, path: str, stem: str) -> Placement:
        """A frame whose z axis lies along the joint's axis."""
        if entry.axis is None:
            return Placement()
        direction = self.expressions.direction(entry.axis, f"{path}.axis")
        return self.expressions.snapping.aim_at(direction, f"{path}.axis", stem)

    def _met(
        self, kind: ClosureKind, first: int, second: int, frame: Placement, path: str
    ) -> Placement:
        """The frame of the second body that coincides with that of the first one while all coordinates are zero."""
        bodies = self.mechanism.bodies
        symbols = {**self.mechanism.symbols, **self.expressions.named}
        try:
            return second_frame(
                kind,
                first,
                second,
                frame,
                lambda k: bodies[k].parent,
                lambda k: at_zero(bodies[k]),
                symbols,
            )
        except ValueError as error:
            raise self.expressions.error(path, str(error)) from None

    def _independent(self) -> tuple[str, ...] | None:
        """The coordinates that shall be independent, if they are stated."""
        for index, name in enumerate(self.robot.independent or ()):
            self.expressions.check(
                name, self.mechanism.velocities, f"independent[{index}]"
            )
        return self.robot.independent

    def _rounding(self, stated: float) -> float:
        if not 0 <= stated <= COARSEST:
            raise self.expressions.error(
                "rounding", f"{stated:g} is not between 0 and {COARSEST}"
            )
        return stated

    def _assembly(self) -> dict[str, float]:
        """Positions near which the loops close."""
        found = {}
        for name, text in self.robot.assembly.items():
            path = f"assembly.{name}"
            self.expressions.check(name, self.mechanism.positions, path)
            value = self.expressions.polynomial(text, path)
            if not set(value.generators()) <= {PI, PER_PI}:
                raise self.expressions.error(
                    path, f"'{text}' must be a number here, without symbols"
                )
            found[name] = value.evaluate(pi_generators(math.pi), float)
        return found

    def _driven(self) -> list[str]:
        """Coordinates that actuators drive."""
        stated: list[str] = []
        if self.robot.robot is not None:
            for index, name in enumerate(self.robot.robot.driven):
                several = [
                    known
                    for known in self.mechanism.velocities
                    if known.startswith(f"{name}.")
                ]
                if not several:
                    self.expressions.check(
                        name, self.mechanism.velocities, f"robot.driven[{index}]"
                    )
                stated += several or [name]
        for actuator, entry in self.robot.actuators.items():
            if isinstance(entry, str):
                stated += self.expressions.parsed(
                    entry, f"actuators.{actuator}"
                ).symbols()
            else:
                stated += entry.terms
        return [
            name for name in dict.fromkeys(stated) if name in self.mechanism.velocities
        ]


# -- beside a robot file ----------------------------------------------------------------------------------------------


def add_to_file(
    document: Document,
    robot: RobotDescription,
    options: ReadingOptions,
    base: Callable[[ReadingOptions], Built],
) -> Built:
    """A robot file with what a description adds to it."""
    assert robot.robot is not None
    if "couplings" in robot.model_fields_set:
        problem = "the robot file states how coordinates depend on others, such as mimic joints: leave couplings out"
        raise document.error("couplings", problem)
    options = replace(options, floating=options.floating or robot.floating_base)
    if (
        "gravity" in robot.model_fields_set and options.gravity == "file"
    ):  # how the robot is mounted
        options = replace(options, gravity=robot.gravity)
    joints = []
    for name, entry in robot.robot.joints.items():
        axes = tuple(
            coordinate_axis(axis)
            for axis in (entry.axis, entry.axis2)
            if axis is not None
        )
        joints.append(
            StatedJoint(
                name, entry.type, axes, partial(document.error, f"robot.joints.{name}")
            )
        )
    options = replace(
        options, separate=cut_off(robot), joints=tuple(joints), looped=bool(robot.loops)
    )
    # the loops of a geometry in numbers close at these numbers only
    stated = base(replace(options, symbolic=False) if robot.loops else options)
    mechanism = stated.mechanism
    symbols, bare = declared_symbols(robot, document)
    known = {n: s for n, s in symbols.items() if n not in bare}
    expressions = Expressions(document, options, (), {**mechanism.symbols, **symbols})
    mechanism, notes = _labelled(
        replace(mechanism, symbols={**mechanism.symbols, **known}), robot, document
    )
    mechanism = Additions(
        mechanism, robot, expressions, _FileParts(stated, mechanism, expressions)
    ).added()
    stated.snapping.snaps += expressions.snapping.snaps
    driven = (*stated.driven, *robot.robot.driven)
    return replace(
        stated, mechanism=mechanism, notes=(*stated.notes, *notes), driven=driven
    )


def _labelled(
    mechanism: Mechanism, robot: RobotDescription, document: Document
) -> tuple[Mechanism, list[str]]:
    """A robot file's mechanism with the labels that a description gives to its bodies, and remarks."""
    names = [body.name for body in mechanism.bodies]
    for name in robot.labels:
        if name not in names:
            raise document.error(
                step_into("labels", name),
                f"there is no body '{name}'{nearest_of(name, names)}",
            )
    bodies = [
        replace(body, label=robot.labels.get(body.name, body.label))
        for body in mechanism.bodies
    ]
    notes = []
    for label in dict.fromkeys(robot.labels.values()):
        sharing = [k for k, body in enumerate(bodies) if body.label == label]
        stated = [values for k in sharing if (values := bodies[k].inertial) is not None]
        if (
            len(set(stated)) > 1
        ):  # files round; the mean of bodies is one that can exist
            mean = tuple(float(value) for value in np.mean(stated, axis=0))
            for k in sharing:
                bodies[k] = replace(bodies[k], inertial=mean)
            notes.append(
                f"bodies of label '{label}' get the mean of their stated inertial values"
            )
    return replace(mechanism, bodies=tuple(bodies)), notes


class _FileParts:
    """Finds bodies of a robot file, and what is fixed to them."""

    def __init__(
        self, built: Built, mechanism: Mechanism, expressions: Expressions
    ) -> None:
        self.built, self.expressions = built, expressions
        self.names = {body.name: k for k, body in enumerate(mechanism.bodies)}
        self._joints = {body.joint.name: k for k, body in enumerate(mechanism.bodies)}

    def __call__(self, name: str | None, path: str) -> tuple[int, Placement]:
        if name in self.names:
            return self.names[name], Placement()
        if name is not None and name in self.built.rides:
            body, placement = self.built.place(name)
            known, own = self.expressions.snapping.symbols, self.built.snapping.symbols
            for symbol in placement.symbols():
                if known.setdefault(symbol, own[symbol]) != own[symbol]:
                    raise self.expressions.error(
                        path,
                        f"the robot file has an angle '{symbol}': rename the symbol",
                    )
            return body, placement
        if (
            name != BASE and name in self._joints
        ):  # a joint marks the frame that it moves
            return self._joints[name], Placement()
        if name is not None:
            self.expressions.check(
                name, [BASE, *self.names, *self.built.rides], path, "body or frame"
            )
        return GROUND, Placement()
