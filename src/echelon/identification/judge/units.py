"""A unit that outputs share: it scales all parameters, so that only a model that one had before can tell it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import exp, log

import numpy as np

from echelon.base import BaseModel
from echelon.compute import Observation
from echelon.identification.advantage import Advantage
from echelon.identification.judge.hypothesis import Kind, Usual
from echelon.identification.judge.judge import Judged
from echelon.identification.logs.finding import Finding, warning
from echelon.identification.physics.fit import FAR
from echelon.shared import Floats

_FOREIGN = 50.0
"""Ratio of an output to what the prior predicts that no robot explains: below that of units, above errors of priors."""
_ALIKE = 0.5  # cosine from which on outputs and what the prior predicts have something to do with one another
_NEAR_UNIT, _NEAR_PRIOR = (
    4.0,
    20.0,
)  # factors within which a ratio is that of a unit, and the prior's own
_ONE_FACTOR = 2.0
"""Ratio of the largest to the least of some ratios up to which they are one factor: friction adds less to outputs."""


def common_unit(
    base: BaseModel, observation: Observation, prior: Floats
) -> Judged | None:
    """A wrong unit of all outputs, or of the one that is its place, by the base parameters of a prior."""
    ratios, layout = _ratios(observation, prior), observation.layout
    units = {output.name: output.unit for output in base.mechanism.outputs}
    outputs = len(layout.outputs)
    for factor, prefix in ((1e3, "m"), (1e-3, "k")):
        off = [
            name
            for name, ratio in ratios.items()
            if abs(log(ratio / factor)) < log(_NEAR_UNIT)
        ]
        usual = [
            name for name, ratio in ratios.items() if abs(log(ratio)) < log(_NEAR_PRIOR)
        ]
        every = _tells_of_all(len(off), len(ratios), outputs)
        if every or len(off) == 1 == outputs - len(usual):
            ratio = float(np.median([ratios[name] for name in off]))
            which = "all outputs are" if every else f"the output of '{off[0]}' is"
            said = " or ".join(
                f"{prefix}{unit}" for unit in dict.fromkeys(units[name] for name in off)
            )
            text = f"{which} in {said} (unit: {said.split(' or ')[0]}), {ratio:.3g} times what the prior model predicts"
            return _judged(text, ratio, ratio / factor, () if every else off)
    foreign = [ratio for ratio in ratios.values() if abs(log(ratio)) > log(_FOREIGN)]
    if _tells_of_all(len(foreign), len(ratios), outputs):
        ratio = float(np.median(foreign))
        text = f"the outputs are in another unit: they are {ratio:.3g} times what the prior model predicts"
        return _judged(text, ratio, 1.0)
    return None


def common_scale(observation: Observation, prior: Floats) -> Iterator[Finding]:
    """A warning where all of several outputs are far from what the prior predicts by one factor that is of no unit.

    Bodies of a prior are wrong by factors of their own; friction, which it lacks, enters outputs alike only by chance.
    """
    ratios = list(_ratios(observation, prior).values())
    if len(ratios) < 2 or len(ratios) < len(observation.layout.outputs):
        return
    middle = float(np.median(ratios))
    if abs(log(middle)) > log(FAR) and max(ratios) < _ONE_FACTOR * min(ratios):
        text = (
            f"all outputs are about {middle:.2g} times what the prior model predicts, and all parameters with them: is "
            "the scale of their columns right (a gear, a torque constant, a unit)?"
        )
        yield warning("scale", "", text)


def _ratios(observation: Observation, prior: Floats) -> dict[str, float]:
    """Sizes of outputs by those that the prior predicts, where they have something to do with one another."""
    ratios, layout = {}, observation.layout
    for name, R, columns in zip(
        layout.outputs, observation.factors, layout.columns, strict=True
    ):
        measured, guess = R[:, -1], R[:, :-1] @ prior[list(columns)]
        sizes = float(np.linalg.norm(measured)), float(np.linalg.norm(guess))
        if min(sizes) > 0 and measured @ guess > _ALIKE * sizes[0] * sizes[1]:
            ratios[name] = sizes[0] / sizes[1]
    return ratios


def _tells_of_all(count: int, told: int, outputs: int) -> bool:
    """Whether as many outputs tell the unit of all: most of those that are told, and more than one of several."""
    return 2 * count > told and (count > 1 or outputs == 1)


def _judged(text: str, ratio: float, left: float, places: Sequence[str] = ()) -> Judged:
    before, after = abs(log(ratio)), abs(log(left))
    return Judged(
        Kind.UNIT,
        text,
        "",
        Usual.EVERYWHERE,
        Advantage(before - after, 0.0),
        tuple(places),
        before=(exp(before),),
        after=(exp(after),),
    )
