"""Drives, effects, rotors and outputs of a description, added to a mechanism."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from echelon.conventions import PARAMETERS
from echelon.exact.polynomial import Polynomial
from echelon.formats.bodies import BASE
from echelon.formats.description.stated_expressions import Expressions
from echelon.formats.description.stated_joints import CouplingReader, Joints
from echelon.formats.description.stated_loops import FindPart
from echelon.formats.usual_effects import effect_label, slides
from echelon.mechanism.body import Body
from echelon.mechanism.coupling import Coupling, linear
from echelon.mechanism.effect import Action, Effect, Side, ready_made
from echelon.mechanism.joint import Joint, Motion, MotionKind, merge
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.output import ActuatorForce, Channel, Cut, JointForce, Output, plain
from echelon.mechanism.transmission import Actuator

if TYPE_CHECKING:
    from echelon.formats.schema.robot_schema import RobotDescription
    from echelon.formats.schema.schema_setup import (
        LinearTerms,
        OutputEntry,
        OwnEffect,
        ReadyEffect,
        RotorEntry,
        WrenchOutput,
    )


EVERY = "all"
_SPIN = (PARAMETERS.index("XX"), PARAMETERS.index("YY"), PARAMETERS.index("ZZ"))


def cut_off(robot: RobotDescription) -> tuple[str, ...]:
    """Names of what force/torque sensors carry: sensors see fixed parts apart from what they are fixed to."""
    return tuple(w for w in (getattr(output, "wrench", BASE) for output in robot.outputs or ()) if w != BASE)


def add_setup(mechanism: Mechanism, robot: RobotDescription, expressions: Expressions, find: FindPart) -> Mechanism:
    """A mechanism with the drives, rotors, effects and outputs that a description states."""
    return _Setup(mechanism, robot, expressions, find).added()


class _Setup:
    def __init__(self, mechanism: Mechanism, robot: RobotDescription, expressions: Expressions, find: FindPart) -> None:
        self.mechanism, self.robot, self.expressions, self.find = mechanism, robot, expressions, find
        self.joints = Joints(expressions)

    def added(self) -> Mechanism:
        self.mechanism = replace(self.mechanism, actuators=tuple(self._actuators()))
        for index, rotor in enumerate(self.robot.rotors):
            self._add_rotor(rotor, f"rotors[{index}]")
        effects = tuple(effect for found in self._effects() for effect in found)
        self.mechanism = replace(self.mechanism, effects=effects)
        if self.robot.outputs is not None:
            self.mechanism = replace(self.mechanism, measured=tuple(o for found in self._outputs() for o in found))
        return replace(self.mechanism, symbols={**self.mechanism.symbols, **self.expressions.named})

    # -- drives ----------------------------------------------------------------------------------------------------

    @property
    def _drives(self) -> tuple[str, ...]:
        return tuple(actuator.name for actuator in self.mechanism.transmission.actuators)

    def _actuators(self) -> Iterator[Actuator]:
        for name, entry in self.robot.actuators.items():
            path = f"actuators.{name}"
            terms = self._linear(entry, path)
            for coordinate, _ in terms:
                if coordinate not in self.mechanism.independent_velocities:
                    problem = f"'{coordinate}' depends on others through loops; list it in 'independent' to drive it"
                    raise self.expressions.error(path, problem)
            yield Actuator(name, terms)

    def _linear(self, entry: str | LinearTerms, path: str) -> tuple[tuple[str, Polynomial], ...]:
        """A combination of coordinates that no coupling makes dependent; actuators may stand for what they are."""
        moving = {m.name: m for m in self.mechanism.motions if m.name not in self.mechanism.dependent}
        single = {name: m for name, m in moving.items() if m.kind is not MotionKind.BALL}
        reader = CouplingReader(self.expressions, single)
        if not isinstance(entry, str):
            terms = reader.ratios(entry.terms, path)
        else:
            drives = {a.name: dict(a.terms) for a in self.mechanism.actuators}
            if entry in drives:
                return tuple(drives[entry].items())
            terms, offset = reader.linear(entry, path)
            if offset:
                raise self.expressions.error(path, f"'{entry}' has a constant part; a transmission has none")
        return tuple(terms.items())

    def _add_rotor(self, rotor: RotorEntry, path: str) -> None:
        spin = f"{rotor.name}.spin"
        kind = "xyz".index(rotor.axis[-1])
        motion = Motion(MotionKind.ROTATION, spin, kind, -1 if rotor.axis.startswith("-") else 1)
        label = rotor.label or f"_{rotor.name}"
        placed = self.joints.frame(rotor.frame, f"{path}.frame", label)
        parent, rides = self.find(rotor.on, f"{path}.on")
        joint = Joint(rotor.name, "rotor", merge((rides @ placed, motion)))
        # of a rotor that is symmetric about its axis all but the spin inertia counts to its carrier
        body = Body(rotor.name, label, parent, joint, (_SPIN[kind],))
        drives = self._linear(rotor.drives, f"{path}.drives")
        coupling = Coupling(spin, tuple((name, linear(ratio)) for name, ratio in drives))
        self.mechanism = replace(
            self.mechanism,
            bodies=(*self.mechanism.bodies, body),
            couplings=(*self.mechanism.couplings, coupling),
        )

    # -- effects ---------------------------------------------------------------------------------------------------

    def _effects(self) -> Iterator[Sequence[Effect]]:
        from echelon.formats.schema.schema_setup import OwnEffect

        for index, entry in enumerate(self.robot.effects or ()):
            path = f"effects[{index}]"
            if isinstance(entry, OwnEffect):
                yield [self._own(entry, path)]
            elif not isinstance(entry, str):  # the usual ones join when it is known what is measured
                yield self._ready(entry, path)

    def _own(self, entry: OwnEffect, path: str) -> Effect:
        actions = tuple(
            Action(action.at, self._side(action.at, action.side, f"{path}.acts[{k}].at"), action.term)
            for k, action in enumerate(entry.acts)
        )
        value = None if entry.value is None else self.expressions.real(entry.value, f"{path}.value")
        return Effect(entry.parameter, entry.unit, actions, value)

    def _ready(self, entry: ReadyEffect, path: str) -> list[Effect]:
        names = (entry.at,) if isinstance(entry.at, str) else entry.at
        if names == (EVERY,):
            names = self.mechanism.velocities if entry.side == "joint" else self._drives
        found: list[tuple[Effect, ...]] = []
        for name in names:
            side = self._side(name, entry.side, f"{path}.at")
            label = entry.label or effect_label(self.mechanism, name)
            sliding = slides(self.mechanism, name)
            found.append(ready_made(entry.type, name, side, label, sliding=sliding, constants=entry.constants))
        if entry.label is None or len(found) < 2:
            return [effect for effects in found for effect in effects]
        return [self._shared(effects, f"{path}.label") for effects in zip(*found, strict=True)]

    def _shared(self, effects: Sequence[Effect], path: str) -> Effect:
        """Effects of one label at several places as one, whose parameter all places share."""
        if len({effect.unit for effect in effects}) > 1:
            raise self.expressions.error(path, "one label is for places that all turn or all slide")
        return replace(effects[0], actions=tuple(action for effect in effects for action in effect.actions))

    def _side(self, at: str, stated: str | None, path: str) -> Side:
        drives = self._drives
        joints = tuple(name for motion in self.mechanism.motions for name in motion.velocities)
        valid = {"joint": joints, "actuator": drives}.get(stated or "", (*drives, *joints))
        self.expressions.check(at, valid, path, stated or "coordinate")
        return Side(stated) if stated else Side.ACTUATOR if at in drives else Side.JOINT

    # -- outputs ---------------------------------------------------------------------------------------------------

    def _outputs(self) -> Iterator[Sequence[Output]]:
        for index, entry in enumerate(self.robot.outputs or ()):
            yield self._read_output(entry, f"outputs[{index}]")

    def _read_output(self, entry: OutputEntry, path: str) -> Sequence[Output]:
        from echelon.formats.schema.schema_setup import ActuatorOutput, JointOutput, WrenchOutput

        if isinstance(entry, WrenchOutput):
            return self._wrench(entry, path)
        if isinstance(entry, JointOutput):
            every = self.mechanism.independent_velocities if entry.joint == EVERY else (entry.joint,)
            return [self._plain(self._joint(n, f"{path}.joint"), n, entry.name, len(every)) for n in every]
        if isinstance(entry, ActuatorOutput):
            every = self._drives if entry.actuator == EVERY else (entry.actuator,)
            return [self._plain(self._drive(n, f"{path}.actuator"), n, entry.name, len(every)) for n in every]
        terms: list[tuple[Channel, Polynomial]] = []
        for k, term in enumerate(entry.sum):
            where = f"{path}.sum[{k}]"
            channel = (
                self._joint(term.joint, where) if term.joint is not None else self._drive(term.actuator or "", where)
            )
            terms.append((channel, self.expressions.polynomial(term.weight, f"{where}.weight")))
        return [Output(entry.name, entry.unit, tuple(terms))]

    def _plain(self, channel: Channel, at: str, name: str | None, count: int) -> Output:
        chosen = at if name is None else name if count == 1 else f"{name}.{at}"
        return plain(chosen, "N" if slides(self.mechanism, at) else "N·m", channel)

    def _joint(self, name: str, path: str) -> JointForce:
        kind = "independent joint coordinate" if self.mechanism.closures else "joint coordinate"
        self.expressions.check(name, self.mechanism.independent_velocities, path, kind)
        return JointForce(name)

    def _drive(self, name: str, path: str) -> ActuatorForce:
        self.expressions.check(name, self._drives, path, "actuator")
        return ActuatorForce(name)

    def _wrench(self, entry: WrenchOutput, path: str) -> list[Output]:
        body, rides = self.find(entry.wrench, f"{path}.wrench")
        frame = rides @ self.joints.frame(entry.frame, f"{path}.frame", f"_{entry.name or entry.wrench}")
        name = entry.name or entry.wrench
        return [
            plain(
                f"{name}.{component}",
                "N" if component[0] == "f" else "N·m",
                Cut(body, frame, entry.fixed_to == "parent", "xyz".index(component[1]), component[0] == "t"),
            )
            for component in entry.components
        ]
