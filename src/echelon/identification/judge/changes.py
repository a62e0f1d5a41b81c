"""Parameters that do not stay what they are: a payload that is attached on the way, friction that warms up."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import floor, log10

import numpy as np

from echelon.base import BaseModel
from echelon.identification.judge.evidence import BLOCKS, States
from echelon.identification.judge.hypothesis import Kind, Term, Usual
from echelon.identification.judge.places import places
from echelon.shared import PER_BODY, Floats

_WARM = (
    0.1,
    0.3,
    1.0,
)  # times in which friction decays to a part of 1/e, by that of the logs
_ROUNDING = 1e-9  # relative size of directions of a body's parameters that are in the base parameters by rounding alone


def payloads(base: BaseModel, states: States) -> Iterator[Term]:
    """Another load from some time on, or in one of several logs, at each body that carries none."""
    for name, forces in _loads(base, states):
        for change in _changes(states):
            words = f"'{name}' carries another load {change.words}"
            later = _Later(forces, change.first, change.stop)
            yield Term(Kind.CHANGE, words, name, change.write, Usual.OFTEN, later)


def whole_loads(base: BaseModel, states: States) -> Iterator[Term]:
    """Another load all the time, at each body that carries none."""
    for name, forces in _loads(base, states):
        yield Term(
            Kind.CHANGE,
            f"'{name}' carries another load",
            name,
            "",
            Usual.OFTEN,
            _Later(forces, 0, None),
        )


def _loads(base: BaseModel, states: States) -> Iterator[tuple[str, Floats]]:
    """Bodies that carry none, with forces of what they may carry, shape (samples, outputs, k)."""
    mechanism = base.mechanism
    carriers = {body.parent for body in mechanism.bodies}
    B = base.B_float(states.symbols)
    for index, body in enumerate(mechanism.bodies):
        mine = [k for k, column in enumerate(mechanism.columns) if column.body == index]
        is_seen = np.any(B[:, mine])  # not where it belongs to another experiment
        if index in carriers or len(mine) < PER_BODY or not is_seen:
            continue
        left, sizes, _ = np.linalg.svd(B[:, mine], full_matrices=False)
        told = sizes > _ROUNDING * sizes.max(initial=1e-300)
        directions = (left[:, told] * sizes[told]).T
        yield (
            body.name,
            np.stack(
                [states.predicted(base, direction) for direction in directions], axis=2
            ),
        )


@dataclass(frozen=True, eq=False)
class _Later(Mapping[int, Floats]):
    """Forces (samples, k) by output from one sample to another; they are made when they are asked for."""

    forces: Floats  # shape (samples, outputs, k)
    first: int
    stop: int | None  # sample before which they end; the last one if None

    def __getitem__(self, output: int) -> Floats:
        some = slice(self.first, self.stop)
        found = np.zeros_like(self.forces[:, output])
        found[some] = self.forces[some, output]
        return found

    def __iter__(self) -> Iterator[int]:
        return iter(range(self.forces.shape[1]))

    def __len__(self) -> int:
        return int(self.forces.shape[1])


@dataclass(frozen=True)
class _Stretch:
    """Samples from some border on, to the end or to another border."""

    first: int  # sample after it
    words: str  # from when on, by the stamps of the logs
    write: str  # what to do about it
    stop: int | None = None  # sample before which it ends again


def _changes(states: States) -> Iterator[_Stretch]:
    """Borders of logs and of blocks, and logs between others; a block's border that is near one of logs is left out."""
    count, least = len(states.q), len(states.q) / (2 * BLOCKS)
    borders: list[int] = []
    for first in _log_borders(states):
        if first >= max([0, *borders[-1:]]) + least and first <= count - least:
            borders.append(first)
    inner = [count * block // BLOCKS for block in range(1, BLOCKS)]
    inner = [
        first
        for first in inner
        if all(abs(first - border) >= least for border in borders)
    ]
    for first in sorted([*borders, *inner]):
        yield _at_log(states, first) if first in borders else _within_log(states, first)
    for first, stop in pairwise(borders):
        source = states.place(first)[0].source
        if states.place(stop - 1)[0].source == source:
            write = f"identify '{source}' and the other logs separately"
            yield _Stretch(first, f"in '{source}' alone", write, stop)


def _log_borders(states: States) -> list[int]:
    """Samples with which another log begins."""
    ends = np.cumsum([len(piece) for piece in states.pieces]).tolist()
    pairs = zip(pairwise(states.pieces), ends, strict=False)
    return [end for (before, after), end in pairs if before.source != after.source]


def _at_log(states: States, first: int) -> _Stretch:
    sources = list(dict.fromkeys(piece.source for piece in states.pieces))
    piece, _ = states.place(first)
    words = (
        f"in '{piece.source}'"
        if piece.source == sources[-1]
        else f"from '{piece.source}' on"
    )
    before, _ = states.place(first - 1)
    write = f"identify the logs up to '{before.source}' and those from '{piece.source}' on separately"
    return _Stretch(first, words, write)


def _within_log(states: States, first: int) -> _Stretch:
    piece, time = states.place(first)
    said = f"{time:.{_decimals(float(states.time[-1]))}f} s"
    several = any(other.source != piece.source for other in states.pieces)
    where = f" of '{piece.source}'" if several else ""
    log = f"'{piece.source}'" if several else "the log"
    return _Stretch(
        first,
        f"from about {said}{where} on",
        f"cut {log} at {said}, and identify both parts",
    )


def _decimals(length: float) -> int:
    """Decimals of times, s, that tell a thousandth to a hundredth of the length of the logs."""
    return max(0, 2 - floor(log10(max(length, 1e-9))))


def warming(base: BaseModel, states: States) -> Iterator[Term]:
    """Friction of all drives that decays as they warm up."""
    time = states.time
    for share in _WARM:
        constant = share * float(time[-1])
        decay: Floats = np.exp(-time / constant)
        words = f"friction falls as drives warm up, within about {constant:.2g} s"
        write = "begin when the drives are warm, or map a temperature under 'input' and add temperature_friction"
        for place in places(base.mechanism, states.q.shape[1], states.qd.shape[1]):
            _, qd, _ = place.state(states.motion)
            forces = np.stack([decay * qd, decay * np.sign(qd)], axis=1)
            yield Term(
                Kind.CHANGE,
                words,
                place.name,
                write,
                Usual.OFTEN,
                {place.output: forces},
            )
