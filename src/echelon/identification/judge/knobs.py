"""Continuous changes of what is read: gravity's direction, gains, delays, a rate, zeros, joints that give way."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from math import inf

import numpy as np

from echelon.base import BaseModel
from echelon.formats import slides
from echelon.identification.judge.evidence import States, of_bodies
from echelon.identification.judge.hypothesis import Kind, Knob, Term, Usual
from echelon.identification.judge.places import Place, places
from echelon.identification.judge.readings import Readings
from echelon.shared import Floats

_SHORT = 0.01
"""Delay up to which none is told here, s: those were looked for on the clock of the log, which knows when friction
turns while the slower one of the rows does not."""
_FARTHEST = 14.0
"""Logarithm of factors that are tried, those of a million: prefixes of units lie no farther apart."""
_RATIO = "its true size relative to the other outputs (data show ratios only)"


def turned(readings: Readings, states: States, values: Floats) -> Iterator[Term]:
    """Terms of all knobs: derivatives of the prediction with some base parameters."""
    base, names = readings.base, readings.outputs

    def term(
        kind: Kind, words: str, place: str, knob: Knob, usual: Usual = Usual.OFTEN
    ) -> Term:
        load = load_of(base, states, values, knob)
        signals = slopes(base, states, values, knob, np.zeros(knob.count), load)
        # no joint has a negative compliance
        sizes = (0.0, inf) if kind is Kind.JOINT else (-inf, inf)
        return Term(kind, words, place, "", usual, signals, knob, sizes=sizes)

    if states.gravity is not None:
        yield term(
            Kind.GRAVITY, "gravity in another direction", "", _tilt(states.gravity)
        )
    for k, name in enumerate(names):
        some = term(
            Kind.GAIN, f"the gain of the output of '{name}'", name, gain([k], [name])
        )
        yield replace(some, signals={k: some.signals[k]})
    yield from delays(readings, states, values)
    yield term(Kind.RATE, "the rate", "", _rate(readings.velocities))
    for k, label in enumerate(readings.position_labels):
        yield term(Kind.ZERO, f"the zero of {label}", label, _zero(readings, k))
    for place in places(base.mechanism, states.q.shape[1], states.qd.shape[1]):
        for words, knob in gears(base, place):
            yield term(Kind.JOINT, words, place.name, knob, Usual.RARELY)


def delays(readings: Readings, states: States, values: Floats) -> Iterator[Term]:
    """The delay of all outputs together, then those of each."""
    names = readings.outputs
    changes = -states.derivative(states.predicted(readings.base, values))
    groups = [list(range(len(names))), *([k] for k in range(len(names)))]
    for outputs in groups if len(names) > 1 else groups[:1]:
        together = len(outputs) == len(names)
        name = "" if together else names[outputs[0]]
        subject = "the outputs are" if together else f"the output of '{name}' is"
        words = (
            "the delay of the outputs"
            if together
            else f"the delay of the output of '{name}'"
        )
        signals = {k: changes[:, [k]] for k in outputs}
        yield Term(
            Kind.DELAY, words, name, "", Usual.OFTEN, signals, _delay(outputs, subject)
        )


def slopes(
    base: BaseModel,
    start: States,
    values: Floats,
    knob: Knob,
    sizes: Floats,
    load: Floats,
) -> dict[int, Floats]:
    """Derivatives of the prediction, less the measured outputs, by the sizes of a knob; by output, shape (samples, k).

    They are central differences.
    """
    columns = []
    for step in knob.step * np.eye(knob.count):
        ahead, back = (knob.moved(start, sizes + sign * step, load) for sign in (1, -1))
        change = (
            ahead.predicted(base, values)
            - back.predicted(base, values)
            - (ahead.y - back.y)
        )
        columns.append(change / (2 * knob.step))
    whole = np.stack(columns, axis=2)
    return {k: whole[:, k] for k in range(whole.shape[1])}


def load_of(base: BaseModel, states: States, values: Floats, knob: Knob) -> Floats:
    """Loads of gears, without the effects of drives such as friction, shape (samples, outputs).

    Those that the model predicts, which are smooth enough to be differentiated twice; or the measured ones where a knob
    turns by their signs, which are right whatever the model lacks.
    """
    if not knob.by_measured_load:
        return states.predicted(base, np.where(of_bodies(base), values, 0.0))
    return states.y - states.predicted(base, np.where(of_bodies(base), 0.0, values))


def gears(base: BaseModel, place: Place) -> Iterator[tuple[str, Knob]]:
    """Knobs for what may be between an encoder and its joint, with words for them."""
    if len(place.ratios) == 1:
        sliding = slides(base.mechanism, place.name)
        yield f"a joint '{place.name}' that gives way", _elastic(place, sliding)
        yield f"a gear of '{place.name}' that has play", _play(place, sliding)


def _factors(logarithms: Floats) -> Floats:
    """Factors by their logarithms: steps may lead anywhere where an output does not follow the model."""
    return np.asarray(np.exp(np.clip(logarithms, -_FARTHEST, _FARTHEST)))


def _tilt(gravity: Floats) -> Knob:
    size = float(np.linalg.norm(gravity))
    across = np.linalg.svd(gravity[None])[2][1:]

    def moved(states: States, sizes: Floats, _: Floats) -> States:
        assert states.gravity is not None
        found = states.gravity + size * (sizes @ across)
        return replace(states, gravity=size * found / np.linalg.norm(found))

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        found = gravity + size * (sizes @ across)
        found = size * found / np.linalg.norm(found)
        angle = np.degrees(np.arccos(np.clip(found @ gravity / size**2, -1, 1)))
        line = ", ".join(f"{g:.4g}" for g in found)
        error = np.degrees(float(np.linalg.norm(errors)))
        return (
            f"the base is tilted by {angle:.2g}° ± {error:.1g}°: gravity is along [{line}]",
            f"gravity: [{line}]",
        )

    return Knob(1e-3, 2, moved, says)


def gain(
    outputs: Sequence[int], names: Sequence[str], signs: Sequence[float] = ()
) -> Knob:
    """Outputs that are some times what they should be, with signs, 1 if omitted; sizes are logarithms."""
    sign = np.array(signs or [1.0] * len(outputs))

    def moved(states: States, sizes: Floats, _: Floats) -> States:
        scale = states.scale.copy()
        scale[list(outputs)] *= sign * _factors(sizes)
        return replace(states, scale=scale)

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        factors = sign * _factors(sizes)
        several = zip(names, factors, np.abs(factors) * errors, strict=True)
        each = [
            f"that of '{name}' is {factor:.3g} ± {error:.1g} times"
            for name, factor, error in several
        ]
        line = ", ".join(
            f"{name}: {1 / factor:.4g}"
            for name, factor in zip(names, factors, strict=True)
        )
        if len(each) > 1:
            return (
                f"outputs are in units of their own: {', '.join(each)} {_RATIO}",
                f"scales of {line}",
            )
        return (
            f"the output{each[0].removeprefix('that')} {_RATIO}",
            f"scale: {1 / factors[0]:.4g}",
        )

    return Knob(1e-2, len(outputs), moved, says, float(sign[0]))


def _rate(velocities: bool) -> Knob:
    def moved(states: States, sizes: Floats, _: Floats) -> States:
        faster = float(_factors(sizes)[0])
        first = 1.0 if velocities else faster
        drives = states.drives
        if drives is not None:
            drives = drives[0], first * drives[1], first * faster * drives[2]
        return replace(
            states, qd=first * states.qd, qdd=first * faster * states.qdd, drives=drives
        )

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        return (
            f"the clock is wrong: the rate is about {np.exp(sizes[0]):.4g} ± {errors[0]:.1g} times that",
            "",
        )

    return Knob(1e-3, 1, moved, says)


def _delay(outputs: Sequence[int], subject: str) -> Knob:
    """Outputs that are measured some seconds after the positions."""

    def moved(states: States, sizes: Floats, _: Floats) -> States:
        return states.earlier(outputs, float(sizes[0]))

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        order = "late" if sizes[0] > 0 else "early"
        return f"{subject} {abs(sizes[0]):.3g} ± {errors[0]:.1g} s {order}", ""

    return Knob(1e-3, 1, moved, says, least=_SHORT)


def _zero(readings: Readings, k: int) -> Knob:
    """A column of positions whose zero is not that of the robot."""
    label = readings.position_labels[k]
    unit = readings.position_units[k]
    offset = readings.offsets[k]

    def moved(states: States, sizes: Floats, _: Floats) -> States:
        return readings.with_zero(states, k, float(sizes[0]))

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        words = f"the zero of {label} is {sizes[0]:.3g} ± {errors[0]:.1g} {unit} off"
        return words, f"offset: {offset + sizes[0]:.4g}"

    return Knob(1e-4, 1, moved, says)


def _elastic(place: Place, sliding: bool) -> Knob:
    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        about, error = 1 / sizes[0], errors[0] / sizes[0] ** 2
        unit = "N/m" if sliding else "N·m/rad"
        return (
            f"'{place.name}' gives way: its stiffness is about {about:.3g} ± {error:.1g} {unit}",
            "",
        )

    return Knob(1e-6, 1, _ahead(place, lambda _, load: load), says)


def _play(place: Place, sliding: bool) -> Knob:
    """An encoder that is ahead of its joint by half the play of the gear, on the side that the load presses to."""

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        unit = "m" if sliding else "rad"
        return (
            f"the gear of '{place.name}' has a play of {2 * sizes[0]:.2g} ± {2 * errors[0]:.1g} {unit}",
            "",
        )

    return Knob(1e-4, 1, _ahead(place, _side), says, by_measured_load=True)


def _ahead(
    place: Place, signal: Callable[[States, Floats], Floats]
) -> Callable[[States, Floats, Floats], States]:
    """Encoders that are ahead of their joint by the size of a knob times a signal of the load on the gear."""
    ((q, v, ratio),) = place.ratios

    def moved(states: States, sizes: Floats, load: Floats) -> States:
        ahead = (
            states.smoothed(signal(states, load[:, place.output])) * sizes[0] / ratio
        )
        rate = states.derivative(ahead)
        positions = states.q.copy()
        velocities = states.qd.copy()
        accelerations = states.qdd.copy()
        positions[:, q] -= ahead
        velocities[:, v] -= rate
        accelerations[:, v] -= states.derivative(rate)
        drives = states.drives or states.motion
        return replace(
            states, q=positions, qd=velocities, qdd=accelerations, drives=drives
        )

    return moved


def _side(states: States, load: Floats) -> Floats:
    """Signs of a load, with steps that are a straight line from one sample to the next; shape (samples,)."""
    change = np.abs(states.derivative(load)) / states.rate
    return np.asarray(
        load / np.maximum(np.maximum(change, np.abs(load)), np.finfo(float).tiny)
    )
