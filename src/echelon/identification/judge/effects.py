"""Effects that a model may lack, at every drive or joint whose force is measured, and zeros of other sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from echelon.base import BaseModel
from echelon.identification.judge.evidence import States
from echelon.identification.judge.hypothesis import Kind, Term, Usual
from echelon.identification.judge.places import Place, places
from echelon.robot import Mechanism
from echelon.shared import Floats

_HARMONICS = range(1, 13)
_SLOW = ((0.05, "very slow"), (0.15, "slow"), (0.4, "rather slow"))
"""Velocities of Stribeck friction that are tried, by the usual speed."""
_SMOOTH = (0.55, 1.8)
"""Sizes of smooth friction by that of the Coulomb friction in whose place it is.  They are the same for the true width;
steps of tried widths, of 2.5 at most, leave as much open."""
_ENDS = (0.7, 0.75, 0.8, 0.85, 0.9, 0.95)  # where stops may begin, by half of the range


def effects(mechanism: Mechanism, states: States, load: Floats) -> Iterator[Term]:
    """All effects at all places; ``load`` is what the model predicts, shape (samples, outputs)."""
    found = tuple(places(mechanism, states.q.shape[1], states.qd.shape[1]))
    yield from _zeros(mechanism, states)
    for place in found:
        yield from _at(place, states, load[:, place.output])
        yield from _elsewhere(
            place, [other for other in found if other is not place], states
        )


def friction_at_reversals(
    base: BaseModel, states: States, values: Floats
) -> Iterator[Term]:
    """Friction in place of Coulomb friction, per unit of what this was found to be: smooth, or seen early or late."""
    mechanism = base.mechanism
    found = {mechanism.parameters[p]: k for k, p in enumerate(base.matrix.pivots)}
    late: dict[tuple[int, float], list[Floats]] = {}
    for some, column in states.reversals.items():
        output = mechanism.outputs[some.output]
        force, _ = output.forces[0]
        own = [
            e.parameter
            for e in mechanism.effects
            if [(a.at, a.side, a.kind) for a in e.actions]
            == [(force.at, force.side, "coulomb")]
        ]
        size = sum(values[found[name]] for name in own if name in found)
        if size <= 0:
            continue
        if some.late:
            late.setdefault((some.output, abs(some.late)), []).append(size * column)
            continue
        unit = "rad/s" if output.unit == "N·m" else "m/s"
        yield Term(
            Kind.EFFECT,
            f"slow motion, as in dry friction that is smooth within {some.width:g} {unit}",
            force.at,
            f"{{type: smooth_coulomb, at: {{at}}, width: {some.width:g}}}",
            Usual.OFTEN,
            {some.output: size * column},
            sizes=_SMOOTH,
            instead="coulomb",
        )
    for (number, delay), columns in late.items():
        force, _ = mechanism.outputs[number].forces[0]
        words = f"a direction that is seen {delay:g} s early or late"
        signals = {number: np.hstack(columns)}
        yield Term(Kind.EFFECT, words, force.at, "", Usual.EVERYWHERE, signals)


_CONSTANT = ("nothing but a constant", "{type: offset, at: {at}}", Usual.EVERYWHERE)


def _zeros(mechanism: Mechanism, states: States) -> Iterator[Term]:
    """Constants in what force/torque sensors say."""
    words, entry, usual = _CONSTANT
    for k, output in enumerate(mechanism.outputs):
        if output.cuts and not output.reads:
            signals = {k: np.ones((len(states.q), 1))}
            yield Term(Kind.EFFECT, words, output.name, entry, usual, signals)


def _at(place: Place, states: States, load: Floats) -> Iterator[Term]:
    q, qd, qdd = place.state(states.motion)
    sign, one = np.sign(qd), np.ones(len(q))

    def term(
        words: str,
        entry: str,
        usual: Usual,
        *forces: Floats,
        kind: Kind = Kind.EFFECT,
        of_position: bool = False,
    ) -> Term:
        signals = {place.output: np.stack(forces, axis=1)}
        return Term(
            kind, words, place.name, entry, usual, signals, of_position=of_position
        )

    every, often, rarely = Usual.EVERYWHERE, Usual.OFTEN, Usual.RARELY
    yield term(*_CONSTANT, one)
    yield term("the velocity qd", "{type: viscous, at: {at}}", every, qd)
    yield term("the direction sign(qd)", "{type: coulomb, at: {at}}", every, sign)
    yield term(
        "the acceleration qdd",
        "{type: rotor_inertia, at: {at}}",
        every,
        qdd,
        kind=Kind.ROTOR,
    )
    yield term(
        "the speed |qd|", "{type: asymmetric_viscous, at: {at}}", often, np.abs(qd)
    )
    yield term(
        "the load |tau|·sign(qd)",
        "{type: load_friction, at: {at}}",
        often,
        sign * np.abs(load),
    )
    speed = float(np.percentile(np.abs(qd), 90))
    for share, words in _SLOW:
        velocity = f"{max(share * speed, 1e-9):.1g}"
        entry = f"{{type: stribeck, at: {{at}}, velocity: {velocity}}}"
        force: Floats = sign * np.exp(-((qd / float(velocity)) ** 2))
        some = term(f"{words} motion, as in Stribeck friction", entry, often, force)
        yield replace(some, sizes=(0.0, inf))
    yield term(
        "the position q", "{type: spring, at: {at}}", often, q, one, of_position=True
    )
    yield term(
        "q, q² and q³",
        "{type: cable, at: {at}}",
        rarely,
        q,
        q**2,
        q**3,
        of_position=True,
    )
    yield from _stops(place, q)
    for k in _HARMONICS:
        angle = "q" if k == 1 else f"{k}q"
        entry = f"{{type: ripple, at: {{at}}, harmonic: {k}}}"
        yield term(
            f"sin({angle}) and cos({angle})",
            entry,
            rarely,
            np.sin(k * q),
            np.cos(k * q),
            of_position=True,
        )
    if place.name in states.inputs:
        warmth = states.inputs[place.name]
        entry = "{type: temperature_friction, at: {at}}"
        yield term(
            "the measured input times velocity and direction",
            entry,
            often,
            warmth * qd,
            warmth * sign,
        )


def _stops(place: Place, q: Floats) -> Iterator[Term]:
    low, high = float(q.min()), float(q.max())
    for share in _ENDS:
        lower = (low + high) / 2 - share * (high - low) / 2
        upper = (low + high) / 2 + share * (high - low) / 2
        entry = f"{{type: stop, at: {{at}}, lower: {lower:.3g}, upper: {upper:.3g}}}"
        force = np.maximum(q - upper, 0) + np.minimum(q - lower, 0)
        if force.any():
            words = f"the last {1 - share:.0%} of the range"
            signals = {place.output: force[:, None]}
            yield Term(
                Kind.EFFECT,
                words,
                place.name,
                entry,
                Usual.RARELY,
                signals,
                of_position=True,
            )


def _elsewhere(place: Place, others: Sequence[Place], states: States) -> Iterator[Term]:
    for other in others:
        _, qd, qdd = other.state(states.motion)
        for term, force in (
            ("qd[{}]", qd),
            ("sign(qd[{}])", np.sign(qd)),
            ("qdd[{}]", qdd),
        ):
            written = term.format(other.name)
            acts = f'[{{at: {place.name}, term: "{written}"}}]'
            entry = f'{{parameter: "{place.name} by {other.name}", acts: {acts}}}'
            signals = {place.output: force[:, None]}
            yield Term(
                Kind.EFFECT,
                f"another joint, {written}",
                place.name,
                entry,
                Usual.RARELY,
                signals,
            )
