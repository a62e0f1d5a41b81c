"""Continuous changes of what is read: gravity's direction, gains of outputs, a rate, joints that give way."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.formats.usual_effects import slides
from echelon.identification.judge.effects import Place, places
from echelon.identification.judge.evidence import States, of_bodies
from echelon.identification.judge.hypothesis import Kind, Knob, Term, Usual

_RATIO = "what it should be beside the others, for data tell ratios of outputs only"


def turned(
    base: BaseModel, states: States, values: Floats, velocities: bool
) -> Iterator[Term]:
    """Terms of all knobs: derivatives of the prediction with some base parameters.

    ``velocities`` says whether they were measured, so that they do not depend on the clock.
    """
    for kind, words, place, usual, outputs, knob in _knobs(base, states, velocities):
        load = load_of(base, states, values, knob)
        signals = slopes(base, states, values, knob, np.zeros(knob.count), load)
        columns, positive = {k: signals[k] for k in outputs}, kind is Kind.JOINT
        yield Term(kind, words, place, "", usual, columns, knob, positive=positive)


def slopes(
    base: BaseModel,
    start: States,
    values: Floats,
    knob: Knob,
    sizes: Floats,
    load: Floats,
) -> dict[int, Floats]:
    """Derivatives of the prediction by the sizes of a knob, from central differences; by output, shape (samples, k)."""
    columns = []
    for step in knob.step * np.eye(knob.count):
        ahead, back = (
            knob.moved(start, sizes + sign * step, load).predicted(base, values)
            for sign in (1, -1)
        )
        columns.append((ahead - back) / (2 * knob.step))
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


def _knobs(
    base: BaseModel, states: States, velocities: bool
) -> Iterator[tuple[Kind, str, str, Usual, list[int], Knob]]:
    mechanism = base.mechanism
    names = [output.name for output in mechanism.outputs]
    every = list(range(len(names)))
    if states.gravity is not None:
        yield (
            Kind.GRAVITY,
            "gravity in another direction",
            "",
            Usual.OFTEN,
            every,
            _tilt(states.gravity),
        )
    for k, name in enumerate(names):
        words = f"the gain of the output of '{name}'"
        yield Kind.GAIN, words, name, Usual.OFTEN, [k], gain([k], [name])
    yield Kind.RATE, "the rate", "", Usual.OFTEN, every, _rate(velocities)
    for place in places(mechanism, states.q.shape[1], states.qd.shape[1]):
        for words, knob in gears(base, place):
            yield Kind.JOINT, words, place.name, Usual.RARELY, every, knob


def gears(base: BaseModel, place: Place) -> Iterator[tuple[str, Knob]]:
    """Knobs for what may be between an encoder and its joint, with words for them."""
    if len(place.ratios) == 1:
        sliding = slides(base.mechanism, place.name)
        yield f"a joint '{place.name}' that gives way", _elastic(place, sliding)
        yield f"a gear of '{place.name}' that has play", _play(place, sliding)


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
        scale[list(outputs)] *= sign * np.exp(sizes)
        return replace(states, scale=scale)

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        factors = sign * np.exp(sizes)
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
        faster = float(np.exp(sizes[0]))
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


def _elastic(place: Place, sliding: bool) -> Knob:
    ((q, v, ratio),) = place.ratios

    def moved(states: States, sizes: Floats, load: Floats) -> States:
        bent = states.smoothed(load[:, place.output]) * sizes[0] / ratio
        rate = states.derivative(bent)
        return _shifted(states, q, v, bent, rate, states.derivative(rate))

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        about, error = 1 / sizes[0], errors[0] / sizes[0] ** 2
        unit = "N/m" if sliding else "N·m/rad"
        return (
            f"'{place.name}' gives way: its stiffness is about {about:.3g} ± {error:.1g} {unit}",
            "",
        )

    return Knob(1e-6, 1, moved, says)


def _play(place: Place, sliding: bool) -> Knob:
    """An encoder that is ahead of its joint by half the play of the gear, on the side that the load presses to."""
    ((q, v, ratio),) = place.ratios

    def moved(states: States, sizes: Floats, load: Floats) -> States:
        ahead = states.smoothed(_side(states, load[:, place.output])) * sizes[0] / ratio
        rate = states.derivative(ahead)
        return _shifted(states, q, v, ahead, rate, states.derivative(rate))

    def says(sizes: Floats, errors: Floats) -> tuple[str, str]:
        unit = "m" if sliding else "rad"
        return (
            f"the gear of '{place.name}' has a play of {2 * sizes[0]:.2g} ± {2 * errors[0]:.1g} {unit}",
            "",
        )

    return Knob(1e-4, 1, moved, says, by_measured_load=True)


def _side(states: States, load: Floats) -> Floats:
    """Signs of a load, with steps that are a straight line from one sample to the next; shape (samples,)."""
    change = np.abs(states.derivative(load)) / states.rate
    return np.clip(load / np.maximum(change, np.finfo(float).tiny), -1.0, 1.0)


def _shifted(
    states: States,
    q: int,
    v: int,
    position: Floats,
    rate: Floats | float,
    acceleration: Floats | float,
) -> States:
    """States whose encoder is ahead of the joint by some position, with its rate and acceleration."""
    positions, velocities, accelerations = (
        states.q.copy(),
        states.qd.copy(),
        states.qdd.copy(),
    )
    positions[:, q] -= position
    velocities[:, v] -= rate
    accelerations[:, v] -= acceleration
    drives = states.drives or (states.q, states.qd, states.qdd)
    return replace(states, q=positions, qd=velocities, qdd=accelerations, drives=drives)
