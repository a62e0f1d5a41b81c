"""Start of a fit of servos: the file's values, least squares of differentiated positions, and a prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.base import BaseModel
from echelon.identification.estimators.estimate import CLEAR
from echelon.identification.logs.recording import Segment
from echelon.identification.servos.servo_limits import LIMITS, Limits
from echelon.identification.setup.setup import Setup
from echelon.identification.signals.filters import derivatives, lowpass
from echelon.robot import Mechanism
from echelon.shared import Flags, Floats, InputError, extra

ANYTHING = 1e3  # standard deviation of effects, in the largest parameters of bodies: data alone tell them
CERTAIN = (
    2 * CLEAR
)  # standard errors of a gain that is a good start: it is right to a tenth
SLIGHT = 1e-3  # of a gain, that friction has at least at the start: logarithms need something to begin with

FAR_LESS = 0.7
"""Share of a row's squares that a limit leaves at most: smaller ones are found by the fit itself."""

_DELAYS = tuple(k / 100 for k in range(16))  # s
# shares of samples that are below a limit that is tried
_SATURATED = (0.995, 0.98, 0.95, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2, 0.1)
_IDLE = (0.1, 0.2, 0.35, 0.5)  # and within a dead band


def servo_joints(mechanism: Mechanism) -> dict[str, str]:
    """Joints with a servo, and the names of the servos' gains."""
    return {
        effect.actions[0].at: effect.parameter
        for effect in mechanism.effects
        if len(effect.actions) == 1 and effect.actions[0].kind == "servo"
    }


def inertial(base: BaseModel) -> Floats:
    """1 for base parameters of bodies, 0 for those of effects, shape (r,)."""
    return np.array(
        [float(base.mechanism.columns[p].body is not None) for p in base.matrix.pivots]
    )


def _band(rate: float) -> float:
    """Hz; what hobby servos hardly exceed, within what samples can show."""
    return min(5.0, rate / 5)


def smooth_states(segments: Sequence[Segment]) -> tuple[Floats, Floats, Floats]:
    """Positions with smooth derivatives, all segments on end."""
    filtered = [lowpass(s.signals["q"], _band(s.rate), s.rate) for s in segments]
    parts = [derivatives(q, s.rate) for q, s in zip(filtered, segments, strict=True)]
    qd, qdd = (np.vstack([part[k] for part in parts]) for k in range(2))
    return np.vstack(filtered), qd, qdd


def stated_values(setup: Setup, base: BaseModel) -> Floats:
    """Base parameters of the file's bodies; effects without values count as none."""
    mechanism = setup.prior or setup.mechanism
    given = dict(zip(mechanism.parameters, mechanism.standard_values(), strict=True))
    standard = [given.get(name) for name in setup.mechanism.parameters]
    lacking = [
        c.name
        for c, v in zip(setup.mechanism.columns, standard, strict=True)
        if v is None and c.body
    ]
    if lacking:
        raise InputError(
            f"the robot's file gives no values of {', '.join(lacking[:4])}{' …' * (len(lacking) > 4)}: a fit of servos "
            "starts from them; name a file that has them under identification: prior: file",
            source=setup.source,
        )
    return base.values(np.array([0.0 if v is None else v for v in standard]))


def start_values(
    base: BaseModel,
    names: Sequence[str],
    segments: Sequence[Segment],
    X: Floats,
    stated: Floats,
    known: Mapping[str, float],
) -> tuple[Floats, float, Limits]:
    """Stated values of bodies, and gains, friction, a delay and limits that fit differentiated positions best.

    A joint's row over its gain, q − u + Σ (f/Kp) x + (1/Kp) τ = 0, has the signal with the least noise alone.  Where
    the bodies' forces τ are too small to tell the gain, it is taken to be like that of the other joints.  ``X`` is the
    regressor at smooth positions, without commands.  A limit is taken where it explains far more.
    """
    start, servos = stated.copy(), servo_joints(base.mechanism)
    for name, value in known.items():
        if name not in base.pivots:
            raise InputError(
                f"'{name}' is not a base parameter", element="identification.known"
            )
        start[base.pivots.index(name)] = value
    bodies, given = inertial(base) > 0, np.isin(base.pivots, list(known))
    gains = [base.pivots.index(servos[name]) for name in names]
    rows, positive = [], positive_parameters(base)
    for k, gain in enumerate(gains):
        places = np.flatnonzero(~bodies & ~given & (np.abs(X[:, k]).max(axis=0) > 0))
        free = [int(place) for place in places if place != gain]
        held = np.where(bodies | given, start, 0.0)
        held[gain] = 0.0
        rows.append(_JointEquation(free, X[:, k, free], X[:, k] @ held, positive[free]))
    found, delay, limits = _limited(rows, segments, names)
    told = [1 / weight for _, weight, certain, _ in found if certain]
    if not told and not given[gains].any():
        raise InputError(
            "no joint's positions follow its commands against the weight of the bodies as a servo's would: are columns "
            "exchanged, or signs or units wrong? Else state one gain under identification: known"
        )
    for (shares, weight, certain, _), row, gain in zip(found, rows, gains, strict=True):
        if not given[gain]:
            start[gain] = (
                1 / weight if certain else np.median(told or start[gains][given[gains]])
            )
        start[row.free] = (
            np.where(row.positive, np.maximum(shares, SLIGHT), shares) * start[gain]
        )
    return start, delay, limits


def _limited(
    rows: Sequence[_JointEquation], segments: Sequence[Segment], names: Sequence[str]
) -> tuple[list[tuple[Floats, float, bool, float]], float, Limits]:
    """Solutions of all joints' rows, with the delay and the limits of servos that leave least."""

    def solved(
        delay: float, limits: Limits
    ) -> tuple[list[tuple[Floats, float, bool, float]], Floats]:
        pulls = _pulls(segments, names, delay, limits)
        found = [row.solved(pull) for row, pull in zip(rows, pulls.T, strict=True)]
        return found, np.array(
            [
                one[3] / max(pull @ pull, 1e-300)
                for one, pull in zip(found, pulls.T, strict=True)
            ]
        )

    limits = Limits.none(len(names))
    delay = min(_DELAYS, key=lambda d: solved(d, limits)[1].sum())
    found, left = solved(delay, limits)
    errors = np.abs(_errors(segments, names, delay, limits))
    speeds = np.abs(
        np.vstack([np.diff(s.signals["q"], axis=0) * s.rate for s in segments])
    )
    candidates = {
        "torque": np.quantile(errors, _SATURATED, axis=0),
        "speed": np.quantile(speeds, _SATURATED, axis=0),
        "dead": np.quantile(errors, _IDLE, axis=0),
    }
    for _ in candidates:  # a servo may have one of each
        best, of = left * FAR_LESS, limits
        for kind, levels in candidates.items():
            for level in levels:
                tried = replace(limits, **{kind: level})
                misfit = solved(delay, tried)[1]
                for joint in map(int, np.flatnonzero(misfit < best)):
                    for other in LIMITS:
                        of = of.having(
                            other, joint, float(getattr(limits, other)[joint])
                        )
                    of = of.having(kind, joint, float(level[joint]))
                best = np.minimum(best, misfit)
        if of.active == limits.active:
            break
        limits = of
        delay = min(_DELAYS, key=lambda d: solved(d, limits)[1].sum())
        found, left = solved(delay, limits)
    return found, delay, limits


def _errors(
    segments: Sequence[Segment], names: Sequence[str], delay: float, limits: Limits
) -> Floats:
    """Commands as servos hold and follow them, late by a delay, less positions, shape (N, n)."""
    parts = []
    for s in segments:
        times = np.arange(len(s)) / s.rate
        asked = np.stack([s.inputs[name] for name in names], axis=1)
        held = limits.followed(asked, s.rate, 1)[0]
        late = [
            np.interp(times - delay - 0.5 / s.rate, times, column) for column in held.T
        ]
        parts.append(np.stack(late, axis=1) - s.signals["q"])
    return np.vstack(parts)


def _pulls(
    segments: Sequence[Segment], names: Sequence[str], delay: float, limits: Limits
) -> Floats:
    """Smooth pulls of the servos over their gains, shape (N, n)."""
    pulls = limits.held(_errors(segments, names, delay, limits))
    ends = np.cumsum([len(s) for s in segments])
    parts = zip(np.split(pulls, ends[:-1]), segments, strict=True)
    return np.vstack([lowpass(part, _band(s.rate), s.rate) for part, s in parts])


@dataclass(frozen=True)
class _JointEquation:
    """A joint's equation: effects with unknown parameters, and forces that are known but for their scale."""

    free: list[int]
    effects: Floats
    forces: Floats
    positive: Flags

    def solved(self, pull: Floats) -> tuple[Floats, float, bool, float]:
        """Effects over the gain, one over the gain, whether that is certain, and squares that are left."""
        with extra("identify"):
            from scipy.optimize import lsq_linear

        columns = np.column_stack([self.effects, self.forces])
        scales = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        low = np.where(np.append(self.positive, True), 0.0, -np.inf)
        found = lsq_linear(columns / scales, pull, (low, np.inf)).x
        squares = float(np.sum((pull - columns / scales @ found) ** 2))
        inverse = np.linalg.pinv(
            (columns / scales).T @ (columns / scales), hermitian=True
        )
        error = np.sqrt(squares / len(pull) * inverse[-1, -1])
        return (
            found[:-1] / scales[:-1],
            float(found[-1] / scales[-1]),
            bool(found[-1] > CERTAIN * error),
            squares,
        )


def positive_parameters(base: BaseModel) -> Flags:
    """Base parameters that are positive: gains, friction and rotor inertia."""
    effects = base.mechanism.effects
    positive = {
        e.parameter
        for e in effects
        if all(a.is_positive or a.kind == "servo" for a in e.actions)
    }
    return np.array([name in positive for name in base.pivots])


def prior_rows(setup: Setup, base: BaseModel) -> Floats:
    """Rows whose product with a change of base parameters is in standard deviations of the prior, shape (i, r).

    Standard parameters of a body deviate from the file's by their size each, and by a common factor; effects, such as
    rotors whose inertia joins that of a body, may have any value.
    """
    mechanism, columns = setup.prior or setup.mechanism, setup.mechanism.columns
    given = dict(zip(mechanism.parameters, mechanism.standard_values(), strict=True))
    value = np.array(
        [given.get(c.name) or 0.0 if c.body is not None else 0.0 for c in columns]
    )
    anything = ANYTHING * (np.abs(value).max() or 1.0)
    covariance = np.diag([0.0 if c.body is not None else anything**2 for c in columns])
    for body in {c.body for c in columns if c.body is not None}:
        own = np.array([c.body == body for c in columns])
        for unit in {c.unit for c in columns if c.body == body}:
            some = own & np.array([c.unit == unit for c in columns])
            covariance[some, some] = np.sum(value[some] ** 2)
        covariance += np.outer(value * own, value * own)
    B, bodies = base.B_float(), np.flatnonzero(inertial(base))
    spread = (B @ covariance @ B.T)[np.ix_(bodies, bodies)]
    scale = np.sqrt(np.maximum(np.diagonal(spread), 1e-300))
    rows = np.zeros((len(bodies), len(B)))
    factor = np.linalg.cholesky(
        spread / np.outer(scale, scale) + 1e-9 * np.eye(len(bodies))
    )
    rows[:, bodies] = np.linalg.solve(factor, np.diag(1 / scale))
    return rows
