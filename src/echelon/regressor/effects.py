"""Effects on a program: the generalised force that a unit of each effect's parameter causes."""

from __future__ import annotations

from collections.abc import Mapping

from echelon.mechanism.effect import Action, Effect, Side
from echelon.mechanism.mechanism import Mechanism
from echelon.program.tape import Scalar
from echelon.program.text import record_expression
from echelon.regressor.steps import Recorder


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
