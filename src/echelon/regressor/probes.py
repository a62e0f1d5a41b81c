"""Sensors as freedoms that never move, effects as forces, and the virtual motion that an output stands for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from echelon.mechanism.effect import Action, Effect, Side
from echelon.mechanism.joint import Placement
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.output import ActuatorForce, Cut, JointForce
from echelon.program.tape import Scalar
from echelon.program.text import record_expression
from echelon.regressor.steps import Freedom, Recorder, Step


class Probes:
    """The cuts of a mechanism's outputs."""

    def __init__(self, mechanism: Mechanism, recorder: Recorder) -> None:
        self.recorder = recorder
        self.names: dict[Cut, str] = {}
        for output in mechanism.outputs:
            for cut, _ in output.terms:
                if isinstance(cut, Cut):
                    # no coordinate can have this name
                    self.names.setdefault(cut, f"output '{output.name}' #{len(self.names)}")

    def steps(self, body: int, on_parent: bool) -> list[Step]:
        """Steps of the cuts at a body: into the sensor's frame, the freedom, and back."""
        recorded: list[Step] = []
        for cut, name in self.names.items():
            if cut.body == body and cut.on_parent == on_parent:
                recorded += [self._place(cut.frame), self._freedom(cut, name), self._place(cut.frame.inverse())]
        return recorded

    def _place(self, placement: Placement) -> Step:
        return self.recorder.placement(placement)

    def _freedom(self, cut: Cut, name: str) -> Step:
        program, zeros = self.recorder.program, self.recorder.zeros
        x, y, z = (program.one if k == cut.axis else program.zero for k in range(3))
        direction = (x, y, z)
        angular, linear = (direction, zeros) if cut.angular else (zeros, direction)
        return Step(None, None, (Freedom(name, angular, linear, program.zero, program.zero),))


@dataclass(frozen=True)
class VirtualMotion:
    """Virtual velocities that belong to one output, or to all of them together."""

    freedoms: Mapping[str, Scalar]  # of joint coordinates (dependent ones included) and cuts; absent where zero
    drives: Mapping[str, Scalar]  # of actuators, whose effects the output sees
    # those of freedoms that the outputs determine; in a mechanism with loops the others follow
    chosen: Mapping[str, Scalar]


Speeds = Callable[[Mapping[str, Scalar]], Mapping[str, Scalar]]
"""Virtual velocities of the coordinates that depend on given ones through loops."""


def virtual_motion(
    mechanism: Mechanism, probes: Probes, speeds: Mapping[str, Scalar], solved: Speeds | None = None
) -> VirtualMotion:
    """The virtual motion whose power is Σ speed · output."""
    program = probes.recorder.program
    freedoms: dict[str, Scalar] = {}
    drives: dict[str, Scalar] = {}
    if mechanism.closures:
        freedoms.update(dict.fromkeys(mechanism.independent_velocities, program.zero))

    def increase(target: dict[str, Scalar], name: str, speed: Scalar) -> None:
        target[name] = target[name] + speed if name in target else speed

    for output in mechanism.outputs:
        if output.name not in speeds:
            continue
        for channel, weight in output.terms:
            speed = speeds[output.name] * program.polynomial(weight)
            if isinstance(channel, Cut):
                increase(freedoms, probes.names[channel], speed)
            elif isinstance(channel, JointForce):
                increase(freedoms, channel.coordinate, speed)
            elif isinstance(channel, ActuatorForce):
                increase(drives, channel.actuator, speed)
                for joint, inverse in mechanism.transmission.inverse[channel.actuator].items():
                    factor = program.polynomial(inverse.numerator) / program.polynomial(inverse.denominator)
                    increase(freedoms, joint, speed * factor)
    chosen = dict(freedoms)
    if mechanism.closures:
        open_ = [n for n in mechanism.velocities if n not in chosen]
        freedoms.update({n: program.input(f"v[{n}]") for n in open_} if solved is None else solved(chosen))
    return VirtualMotion(_coupled(probes.recorder, freedoms), drives, chosen)


def any_motion(mechanism: Mechanism, recorder: Recorder, kind: str = "v") -> VirtualMotion:
    """A virtual motion whose velocities, of all coordinates that no coupling makes dependent, are inputs ``v[...]``."""
    program = recorder.program
    freedoms = {name: program.input(f"{kind}[{name}]") for name in mechanism.velocities}
    return motion_of_joints(mechanism, recorder, freedoms)


def motion_of_joints(mechanism: Mechanism, recorder: Recorder, freedoms: dict[str, Scalar]) -> VirtualMotion:
    """The virtual motion in which some independent coordinates have given velocities, and the drives follow."""
    program = recorder.program
    zero = program.zero
    drives = {
        actuator.name: sum((freedoms[n] * program.polynomial(r) for n, r in actuator.terms if n in freedoms), zero)
        for actuator in mechanism.transmission.actuators
        if any(n in freedoms for n, _ in actuator.terms)
    }
    return VirtualMotion(_coupled(recorder, freedoms), drives, {})


def _coupled(recorder: Recorder, freedoms: dict[str, Scalar]) -> dict[str, Scalar]:
    """Virtual velocities completed by those of dependent coordinates."""
    complete = dict(freedoms)
    for coordinate, slopes in recorder.slopes.items():
        moved = [freedoms[name] * slope for name, slope in slopes.items() if name in freedoms]
        if moved:
            complete[coordinate] = sum(moved, complete.get(coordinate, recorder.program.zero))
    return complete


class EffectRecorder:
    """Writes the terms of effects onto a program."""

    def __init__(self, mechanism: Mechanism, recorder: Recorder) -> None:
        self.mechanism, self.recorder = mechanism, recorder
        self._states = self._all_states() if mechanism.effects else {}

    def forces(self, effect: Effect) -> list[tuple[Side, str, Scalar]]:
        """Side, coordinate or actuator, and force per unit of the parameter."""
        return [(a.side, a.at, self._record(effect, a)) for a in effect.actions]

    def _record(self, effect: Effect, action: Action) -> Scalar:
        program = self.recorder.program
        names: dict[str, Scalar] = dict(self._states)
        for kind in ("q", "qd", "qdd"):
            if f"{kind}[{action.at}]" in names:
                names[kind] = names[f"{kind}[{action.at}]"]
        names["i"] = program.input(f"i[{action.at}]")
        for name in self.mechanism.symbols:
            names.setdefault(name, program.input(name, "symbol"))
        return record_expression(action.term, names, f"effect '{effect.parameter}'", program, rounded_phases=True)

    def _all_states(self) -> dict[str, Scalar]:
        """Positions, velocities and accelerations of all coordinates and actuators, by the names used in terms."""
        names: dict[str, Scalar] = {}
        recorder = self.recorder
        for name, coordinates in recorder.coordinates.items():
            if len(coordinates.position) != 1:
                continue  # a free rotation has no coordinate that a term could use
            names |= _named(name, coordinates.position[0], coordinates.rate[0], coordinates.acceleration[0])
        for actuator in self.mechanism.transmission.actuators:
            terms = [(recorder.coordinates.get(n), recorder.program.polynomial(r)) for n, r in actuator.terms]
            if any(c is None or len(c.position) != 1 for c, _ in terms):
                continue
            zero = recorder.program.zero
            known = [(c, r) for c, r in terms if c is not None]
            names |= _named(
                actuator.name,
                sum((c.position[0] * r for c, r in known), zero),
                sum((c.rate[0] * r for c, r in known), zero),
                sum((c.acceleration[0] * r for c, r in known), zero),
            )
        return names


def _named(name: str, position: Scalar, rate: Scalar, acceleration: Scalar) -> Mapping[str, Scalar]:
    return {f"q[{name}]": position, f"qd[{name}]": rate, f"qdd[{name}]": acceleration}
