"""Effects that a model may lack, at every drive or joint whose force is measured, and zeros of other sensors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.identification.judge.evidence import States
from echelon.identification.judge.hypothesis import Kind, Term, Usual
from echelon.identification.logs.columns.column_map import signal_names
from echelon.robot import Mechanism, Side, known_values
from echelon.shared import Floats

_HARMONICS = range(1, 13)
_SLOW = ((0.05, "very slow"), (0.15, "slow"), (0.4, "rather slow"))
"""Velocities of Stribeck friction that are tried, by the usual speed."""
_ENDS = (0.7, 0.75, 0.8, 0.85, 0.9, 0.95)  # where stops may begin, by half of the range


@dataclass(frozen=True)
class Place:
    """An output that is the force of one drive or joint, and the coordinate of that."""

    output: int
    name: str
    ratios: tuple[
        tuple[int, int, float], ...
    ]  # columns of positions and of velocities, and ratio, of coordinates

    def state(self, states: States) -> tuple[Floats, Floats, Floats]:
        """Position, velocity and acceleration of the coordinate, shape (samples,)."""
        q = np.sum([r * states.q[:, p] for p, _, r in self.ratios], axis=0)
        qd, qdd = (
            np.sum([r * x[:, v] for _, v, r in self.ratios], axis=0)
            for x in (states.qd, states.qdd)
        )
        return q, qd, qdd


def places(mechanism: Mechanism, q: int, qd: int) -> Iterator[Place]:
    """Outputs that are forces of one drive or joint, for states with numbers of positions and velocities."""
    positions = signal_names(mechanism, "q", q)
    velocities = signal_names(mechanism, "qd", qd)
    known = known_values(mechanism)
    drives = {a.name: a.terms for a in mechanism.transmission.actuators}
    for k, output in enumerate(mechanism.outputs):
        if len(output.forces) != 1 or output.cuts:
            continue
        force, _ = output.forces[0]
        ratios = {force.at: 1.0}
        if force.side is Side.ACTUATOR:
            ratios = {
                n: r.at(known)
                for n, r in drives[force.at]
                if known.keys() >= set(r.symbols())
            }
        if ratios and all(n in positions and n in velocities for n in ratios):
            yield Place(
                k,
                force.at,
                tuple(
                    (positions.index(n), velocities.index(n), r)
                    for n, r in ratios.items()
                ),
            )


def effects(mechanism: Mechanism, states: States, load: Floats) -> Iterator[Term]:
    """All effects at all places; ``load`` is what the model predicts, shape (samples, outputs)."""
    found = tuple(places(mechanism, states.q.shape[1], states.qd.shape[1]))
    yield from _zeros(mechanism, states)
    for place in found:
        yield from _at(place, states, load[:, place.output])
        yield from _elsewhere(
            place, [other for other in found if other is not place], states
        )


_CONSTANT = ("nothing but a constant", "{type: offset, at: {at}}", Usual.EVERYWHERE)


def _zeros(mechanism: Mechanism, states: States) -> Iterator[Term]:
    """Constants in what force/torque sensors say."""
    words, entry, usual = _CONSTANT
    for k, output in enumerate(mechanism.outputs):
        if output.cuts and not output.reads:
            signals = {k: np.ones((len(states.q), 1))}
            yield Term(Kind.EFFECT, words, output.name, entry, usual, signals)


def _at(place: Place, states: States, load: Floats) -> Iterator[Term]:
    q, qd, qdd = place.state(states)
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
        yield term(f"{words} motion, as in Stribeck friction", entry, often, force)
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
        _, qd, qdd = other.state(states)
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
