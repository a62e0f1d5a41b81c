"""Survey: a first look at the logs, from which everything is chosen that the set-up leaves open.

The delay of measured outputs behind positions is found by the model itself.  Torques and positions come from different
devices.  A constant delay d between them leaves a residual that no parameters explain, so d is where the residuals of
the outputs' own least-squares fits are smallest: W stays, y is shifted, and one R-factor of W gives the residuals of
all fits.  Outputs that come over one bus are late together, and a single one with many parameters could explain almost
anything by a delay of its own; so one delay is sought for all, by the mean of the logarithms of their residuals, and
taken only where it removes more than noise would.  An output has one of its own only where that differs by more than
half a period and removes twice as much of what is left.

``first_look`` says what logs can show of a robot, and what is missing, before anything is fitted; ``explained_rate`` at
which rate a log without a clock was taken.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from echelon.arrays import Floats
from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.extras import extra
from echelon.identification.band import Noisy, slower, with_band
from echelon.identification.conditioning import (
    Conditioning,
    conditioning,
    without_rounding,
)
from echelon.identification.estimators.least_squares import noise_estimate
from echelon.identification.judge.evidence import States
from echelon.identification.judge.judge import Judge
from echelon.identification.judge.readings import Readings
from echelon.identification.rows.plan import SAMPLED, Plan
from echelon.identification.rows.rows import ModelRows, rows_taken
from echelon.logs.columns.by_values import fitting_units
from echelon.logs.columns.column_map import ColumnMap, signal_names
from echelon.logs.finding import Finding, counted, note, warning
from echelon.logs.preparation.choices import Signals, chosen
from echelon.logs.preparation.prepare import Preparation, PreparationPlan, prepare
from echelon.logs.read_log import LogPiece, read_log
from echelon.logs.recording import Samples, Segment
from echelon.observe.triangle import safe_norms, upper_triangle
from echelon.setup.setup import Setup
from echelon.signals.clock import shift_reach, shifted

_LONGEST = 0.02  # longest delay that is looked for, s: beyond it the log is at fault
_PERIODS = 2.5
"""The same in periods, where that is longer: slow recorders pair positions with outputs of the sample before."""
_STEPS, _BETWEEN = 10, 80
"""Delays to either side that are tried, and values between two: squares are smooth, their logarithms are not."""
_LEFT = 1e-3  # least squares between two delays, relative to those at all of them
_GAIN = 0.1  # least share of the residual's squares that a delay must remove
_SHORTEST = 10 * _LONGEST  # segments are at least so long, s
_SAMPLES, _WHOLE = 10_000, 40_000
"""Samples that are looked at, on a clock that is no faster than the band needs: a delay shows in any motion.  Shorter
logs are looked at as a whole, on their own clock if it gives no more: between samples of a slow one friction turns."""


def with_delays(
    preparation: Preparation, segments: Sequence[Segment], base: BaseModel
) -> Preparation:
    """The preparation with delays estimated, where it leaves them open."""
    if preparation.delays is not None:
        return preparation
    rate = max(segments, key=len).rate
    longest = max(_LONGEST, _PERIODS / rate)
    tried = np.linspace(-longest, longest, 2 * _STEPS + 1)
    squares = _residuals(
        preparation.model_copy(update={"delays": {}}), segments, base, tried
    )
    tried, squares = _between(tried, squares)
    delay, gain = _best(tried, squares)
    delay = delay if gain >= _GAIN else 0.0
    found = {output.name: delay for output in base.mechanism.outputs if delay}
    text = f"outputs are {1e3 * delay:.2g} ms behind positions: undoing it removes {gain:.0%} of the residuals' squares"
    if not delay:
        text = (
            f"none: no common delay would remove {_GAIN:.0%} of the residuals' squares"
        )
    for k, output in enumerate(base.mechanism.outputs):
        own, share = _best(
            tried, squares[:, [k]], np.interp(delay, tried, squares[:, k])
        )
        if share >= 2 * _GAIN and abs(own - delay) > 0.5 / rate:
            found[output.name] = own
            text += f"; {output.name} {1e3 * own:.2g} ms, which removes {share:.0%} of what is left of it"
    return preparation.model_copy(
        update={"delays": found, "reasons": {**preparation.reasons, "delays": text}}
    )


def _residuals(
    preparation: Preparation,
    segments: Sequence[Segment],
    base: BaseModel,
    delays: Floats,
) -> Floats:
    """Squares of each output's residual for each delay, shape (delays, outputs)."""
    count = len(base.mechanism.outputs)
    matrices: list[list[Floats]] = [[] for _ in range(count)]
    values: list[list[Floats]] = [[] for _ in range(count)]
    least, fast = (
        SAMPLED * (preparation.band or np.inf),
        _WHOLE / sum(len(segment) for segment in segments),
    )
    left = _WHOLE if fast * segments[0].rate > least else _SAMPLES
    for segment in segments:
        if len(segment) / segment.rate < _SHORTEST or left <= 0:
            continue
        begun = slower(segment, max(least, fast * segment.rate), left)
        left -= len(begun)
        if len(begun) <= PreparationPlan(
            preparation, base.mechanism, begun.rate
        ).needed + 2 * _margin(begun, delays):
            continue
        samples = _inner(
            prepare(begun, preparation, base.mechanism), _margin(begun, delays)
        )
        blocks = list(ModelRows.of(base, [samples]).blocks())
        assert samples.y is not None
        for output in range(count):
            matrices[output] += [block.matrices[output] for block in blocks]
            values[output].append(_late(samples, samples.y[:, output], output, delays))
    if not values[0]:
        return np.zeros((len(delays), count))
    return np.stack(
        [
            _rest(np.vstack(a), np.vstack(b))
            for a, b in zip(matrices, values, strict=True)
        ],
        axis=1,
    )


def _late(samples: Samples, y: Floats, output: int, delays: Floats) -> Floats:
    """An output's rows with every delay undone, shape (rows, delays)."""
    moved = np.stack([shifted(y, delay * samples.rate) for delay in delays], axis=1)
    _, rows, moving = rows_taken(samples, moved)
    return rows if moving is None else rows[moving[:, output]]


def _margin(segment: Segment, delays: Floats) -> int:
    """Samples near an end that shifts would need values beyond the end for."""
    longest = float(delays[-1]) * segment.rate
    return int(np.ceil(longest)) + shift_reach(longest)


def _inner(samples: Samples, margin: int) -> Samples:
    """The samples without those near the ends."""
    return replace(
        samples,
        first=max(samples.first, margin),
        stop=min(samples.end, len(samples) - margin),
    )


def _rest(matrix: Floats, values: Floats) -> Floats:
    """Squares that no parameters explain, for each column of values."""
    if not len(matrix):
        return np.zeros(values.shape[1])
    R = upper_triangle(matrix)
    scales = safe_norms(R)
    singular, right = np.linalg.svd(R / scales)[1:]
    rank = int(
        np.sum(singular > np.finfo(float).eps * len(matrix) * singular.max(initial=0.0))
    )
    basis = matrix @ (right[:rank] / singular[:rank, None] / scales).T
    rest = values
    for _ in range(
        2
    ):  # what rounding leaves of the first projection, the second takes away
        rest = rest - basis @ (basis.T @ rest)
    squares: Floats = np.sum(rest**2, axis=0)
    return squares


def _between(delays: Floats, squares: Floats) -> tuple[Floats, Floats]:
    """Many more delays, and the squares of each output there by cubic splines."""
    with extra("identify"):
        from scipy.interpolate import CubicSpline
    many = np.linspace(delays[0], delays[-1], _BETWEEN * (len(delays) - 1) + 1)
    return many, np.maximum(
        CubicSpline(delays, squares)(many), _LEFT * squares.min(axis=0)
    )


def _best(
    delays: Floats, squares: Floats, before: float | None = None
) -> tuple[float, float]:
    """The delay with the smallest residuals, and the share it removes of the squares ``before``, or at delay zero."""
    told = squares[:, (squares > 0).all(axis=0)]
    if not told.size:
        return 0.0, 0.0
    errors = np.log(told).mean(axis=1)
    least = int(np.argmin(errors))
    if least in (0, len(delays) - 1):
        return 0.0, 0.0  # no minimum within reach: something else is wrong
    reference = errors[len(delays) // 2] if before is None else np.log(before)
    return float(delays[least]), float(1 - np.exp(errors[least] - reference))


_LOGS = 64  # logs that are looked at; of a long log, its first piece
_MOST_SAMPLES = (
    1 << 18
)  # samples that choices are made from; faults are looked for in the first piece of every log


@dataclass(frozen=True)
class Survey:
    """What a first look at the logs decides."""

    preparation: Preparation  # with every choice made
    findings: tuple[Finding, ...]
    noisy: Noisy | None = None  # what noise of the positions does to an estimate


def survey(
    setup: Setup, base: BaseModel, paths: Sequence[Path], unseen: Sequence[Path] = ()
) -> Survey:
    """Look at the logs and choose what the set-up leaves open."""
    segments: list[Segment] = []
    findings: list[Finding] = []
    for path in paths[:_LOGS]:
        piece = _first_piece(setup, path)
        findings += piece.findings
        if sum(map(len, segments)) < _MOST_SAMPLES:
            segments += piece.segments
    for path in unseen[:_LOGS]:
        findings += _first_piece(setup, path).findings
    if max(len(paths), len(unseen)) > _LOGS:
        text = f"only the first {_LOGS} of {len(paths)} fitted logs and of {len(unseen)} others were examined"
        findings.append(note("survey", "", text))
    log = Signals.of(segments, setup.mechanism)
    preparation, noisy = chosen(setup.preparation, log), None
    if setup.preparation.band is None:
        preparation, noisy = with_band(preparation, log, base)
        findings += [] if noisy is None else [noisy.finding]
    preparation = preparation.model_copy(update={"delays": setup.preparation.delays})
    preparation = with_delays(preparation, segments, base)
    findings += _short(preparation, segments, base)
    return Survey(preparation, tuple(findings), noisy)


def _short(
    preparation: Preparation, segments: Sequence[Segment], base: BaseModel
) -> list[Finding]:
    """What is said of stretches that filters leave nothing of."""
    short = [
        s
        for s in segments
        if PreparationPlan(preparation, base.mechanism, s.rate).is_short(s)
    ]
    if not short:
        return []
    needed = (
        PreparationPlan(preparation, base.mechanism, short[0].rate).needed
        / short[0].rate
    )
    lost = sum(len(segment) / segment.rate for segment in short)
    stretches = counted(len(short), "stretch is", "stretches are")
    text = f"{stretches} shorter than the {needed:.3g} s that filters need; left out ({lost:.3g} s in all)"
    return [warning("short", f"{short[0].source}, from {short[0].start:g} s", text)]


def _first_piece(setup: Setup, path: Path) -> LogPiece:
    piece = next(
        read_log(path, setup.mechanism, setup.columns, rate=setup.preparation.rate),
        None,
    )
    if piece is None:
        raise InputError("the log is empty", source=str(path))
    return piece


SAMPLES = 20_000  # samples that are looked at, over all logs: enough to see which parameters a motion excites


@dataclass(frozen=True)
class Travel:
    """How far and how fast a coordinate moves."""

    coordinate: str
    low: float  # rad or m
    high: float
    speed: float  # largest, rad/s or m/s


@dataclass(frozen=True)
class FirstLook:
    """What logs can show."""

    base: BaseModel
    seconds: float  # of what was looked at
    columns: tuple[
        ColumnMap, ...
    ]  # what the columns of each kind of log were taken for
    survey: Survey
    travels: tuple[Travel, ...]
    conditioning: Conditioning

    @property
    def missing(self) -> tuple[str, ...]:
        """What other motions would have to bring, in sentences."""
        return tuple(direction.advice for direction in self.conditioning.weak)


def first_look(setup: Setup, paths: Sequence[Path]) -> FirstLook:
    """Look at the beginnings of logs."""
    base = base_parameters(setup.mechanism, seed=setup.seed)
    surveyed = survey(setup, base, paths)
    plan = Plan(base, setup.columns, surveyed.preparation)
    samples = list(_beginnings(plan, paths))
    if not samples:
        raise InputError(
            "nothing of these logs is left after their preparation",
            source=", ".join(map(str, paths[:3])),
        )
    observation = without_rounding(
        ModelRows.of(base, samples).observation(), base.units
    )
    seen = conditioning(observation, 1 / noise_estimate(observation), base)
    seconds, travels = (
        sum(len(s) / s.rate for s in samples),
        tuple(_travels(base, samples)),
    )
    return FirstLook(base, seconds, setup.columns, surveyed, travels, seen)


def _beginnings(plan: Plan, paths: Sequence[Path]) -> Iterator[Samples]:
    left = SAMPLES
    for path in paths:
        for samples in islice(plan.samples(path), 1 + left // 100):
            if left > 0:
                yield samples
            left -= len(samples)
        if left <= 0:
            return


def _travels(base: BaseModel, samples: Sequence[Samples]) -> Iterator[Travel]:
    of = base.mechanism
    q, qd = (
        np.concatenate([getattr(some, name) for some in samples])
        for name in ("q", "qd")
    )
    names, rates = (
        signal_names(of, "q", q.shape[1]),
        signal_names(of, "qd", qd.shape[1]),
    )
    speeds: dict[str, Floats] = dict(zip(rates, qd.T, strict=True))
    for name, values in zip(names, q.T, strict=True):
        speed = float(np.abs(speeds[name]).max()) if name in speeds else float("nan")
        yield Travel(name, float(values.min()), float(values.max()), speed)


_NICE, _NEAR = (
    (1.0, 1.2, 1.25, 1.5, 2.0, 2.4, 2.5, 3.0, 4.0, 5.0, 6.0, 7.5, 8.0, 10.0),
    0.02,
)
"""Rates at which robots are logged, in powers of ten, and how near a rate is to one of them that it is."""
_EXPLAINED = 0.1  # of the outputs' spread, that is left with a rate that explains them


def explained_rate(setup: Setup, logs: Sequence[Path]) -> float | None:
    """The samples per second of a log without a clock with which a robot that can exist explains its outputs.

    The set-up states another rate.  Gravity has no time in it and inertia its square, so that they tell the rate where
    they share parameters; None if nothing does, or if it is none at which robots are logged.
    """
    columns, base = setup.columns[0], base_parameters(setup.mechanism, seed=setup.seed)
    preparation = survey(setup, base, logs).preparation
    samples = Plan(base, setup.columns, preparation).samples(logs[0])
    states = States.of(samples, preparation.band or np.inf, base, np.zeros(base.rank))
    readings = Readings(base, states, columns, "qd" in (preparation.measured or ()))
    found = Judge(base, states, readings).other_reading(only_clock=True)
    if found is None or columns.rate is None or found[0].after[0] > _EXPLAINED:
        return None
    rate = columns.rate * found[0].size
    ten = 10 ** np.floor(np.log10(rate))
    near = min((ten * n for n in _NICE), key=lambda nice: abs(np.log(nice / rate)))
    is_usual = abs(near / rate - 1) < _NEAR and fitting_units(1 / near)[:1] == ["s"]
    return float(near) if is_usual else None
