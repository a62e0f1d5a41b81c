"""Drives, effects and outputs of a mechanism in the description format."""

from __future__ import annotations

from typing import Any

from echelon.exact.polynomial import Polynomial
from echelon.formats.bodies import BASE
from echelon.formats.schema.schema_setup import COMPONENTS
from echelon.formats.writers.loops_writer import expression_text, frame_data
from echelon.mechanism.effect import Effect
from echelon.mechanism.mechanism import GROUND, Mechanism
from echelon.mechanism.output import ActuatorForce, Cut, JointForce, Output


def write_setup(mechanism: Mechanism) -> dict[str, Any]:
    """The keys ``actuators``, ``effects`` and ``outputs``, where there are any."""
    written: dict[str, Any] = {}
    if mechanism.actuators:
        written["actuators"] = {a.name: _terms(a.terms) for a in mechanism.actuators}
    if mechanism.effects:
        written["effects"] = [_effect(effect) for effect in mechanism.effects]
    if mechanism.measured is not None:
        written["outputs"] = [_output(output, mechanism) for output in mechanism.measured]
    return written


def _terms(terms: tuple[tuple[str, Polynomial], ...]) -> dict[str, Any]:
    return {"terms": {name: expression_text(ratio) for name, ratio in terms}}


def _effect(effect: Effect) -> dict[str, Any]:
    acts = [{"at": a.at, "side": a.side.value, "term": a.term} for a in effect.actions]
    written: dict[str, Any] = {"parameter": effect.parameter, "unit": effect.unit, "acts": acts}
    if effect.value is not None:
        written["value"] = repr(float(effect.value))
    return written


def _output(output: Output, mechanism: Mechanism) -> dict[str, Any]:
    channel, weight = output.terms[0]
    if isinstance(channel, Cut):
        component = COMPONENTS[channel.axis + (3 if channel.angular else 0)]
        return {
            "wrench": BASE if channel.body == GROUND else mechanism.bodies[channel.body].name,
            "name": output.name.removesuffix(f".{component}"),
            "frame": frame_data(channel.frame),
            "fixed_to": "parent" if channel.on_parent else "body",
            "components": [component],
        }
    if len(output.terms) == 1 and weight == 1 and isinstance(channel, JointForce):
        return {"joint": channel.coordinate, "name": output.name}
    if len(output.terms) == 1 and weight == 1 and isinstance(channel, ActuatorForce):
        return {"actuator": channel.actuator, "name": output.name}
    summed = [
        {"joint" if isinstance(c, JointForce) else "actuator": _place(c), "weight": expression_text(w)}
        for c, w in output.terms
        if not isinstance(c, Cut)
    ]
    return {"name": output.name, "unit": output.unit, "sum": summed}


def _place(channel: JointForce | ActuatorForce) -> str:
    return channel.coordinate if isinstance(channel, JointForce) else channel.actuator
