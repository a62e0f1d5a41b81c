"""Parameters that do not stay what they are: a payload that is attached on the way, friction that warms up."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.conventions import PER_BODY
from echelon.identification.judge.effects import places
from echelon.identification.judge.evidence import BLOCKS, States
from echelon.identification.judge.hypothesis import Kind, Term, Usual

_WARM = (0.1, 0.3, 1.0)  # times in which friction decays to a part of 1/e, by that of the logs


def payloads(base: BaseModel, states: States) -> Iterator[Term]:
    """Another load from some time on, at each body that carries none."""
    mechanism, time = base.mechanism, states.time
    carriers = {body.parent for body in mechanism.bodies}
    X = base.regressor(states.q, states.qd, states.qdd, states.symbols, dict(states.inputs), threads=1)
    B = base.B_float()
    for index, body in enumerate(mechanism.bodies):
        mine = [k for k, column in enumerate(mechanism.columns) if column.body == index]
        if index in carriers or len(mine) < PER_BODY:
            continue
        left, sizes, _ = np.linalg.svd(B[:, mine], full_matrices=False)
        told = sizes > 1e-9 * sizes.max(initial=1e-300)
        forces = states.scale[:, None] * (X @ (left[:, told] * sizes[told]))
        for block in range(1, BLOCKS):
            begin = time[len(time) * block // BLOCKS]
            later = (time >= begin)[:, None, None] * forces
            words = f"'{body.name}' carries another load from {begin:.3g} s on"
            write = f"cut the log at {begin:.3g} s, and identify both parts"
            yield Term(
                Kind.CHANGE, words, body.name, write, Usual.OFTEN, {k: later[:, k] for k in range(later.shape[1])}
            )


def warming(base: BaseModel, states: States) -> Iterator[Term]:
    """Friction of all drives that decays as they warm up."""
    time = states.time
    for share in _WARM:
        constant = share * float(time[-1])
        decay: Floats = np.exp(-time / constant)
        words = f"friction falls as drives warm up, within about {constant:.2g} s"
        write = "begin when the drives are warm, or map a temperature under 'input' and add temperature_friction"
        for place in places(base.mechanism, states.q.shape[1], states.qd.shape[1]):
            _, qd, _ = place.state(states)
            forces = np.stack([decay * qd, decay * np.sign(qd)], axis=1)
            yield Term(Kind.CHANGE, words, place.name, write, Usual.OFTEN, {place.output: forces})
