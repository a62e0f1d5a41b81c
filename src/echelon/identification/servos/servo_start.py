"""What a fit of servos starts from: the file's values, least squares of differentiated positions, and a prior."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.extras import extra
from echelon.logs.recording import Segment
from echelon.mechanism.effect import KINDS
from echelon.mechanism.mechanism import Mechanism
from echelon.setup.setup import Setup
from echelon.signals.filters import derivatives, lowpass

_PRIOR = 1.0  # standard deviation of inertial parameters, in sizes of their bodies
_ANYTHING = 1e3  # standard deviation of effects, in the largest parameters of bodies
_DELAYS = tuple(k / 100 for k in range(16))  # s
_SLIGHT = 1e-3  # of a gain, that friction has at least at the start
_CERTAIN = 10.0  # standard errors of a gain that is a good start
_SERVO = KINDS["servo"][0].term


def servo_joints(mechanism: Mechanism) -> dict[str, str]:
    """Joints with a servo, and the names of the servos' gains."""
    return {
        effect.actions[0].at: effect.parameter
        for effect in mechanism.effects
        if len(effect.actions) == 1 and effect.actions[0].term == _SERVO
    }


def inertial(base: BaseModel) -> Floats:
    """1 for base parameters of bodies, 0 for those of effects, shape (r,)."""
    return np.array([float(base.mechanism.columns[p].body is not None) for p in base.matrix.pivots])


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
    lacking = [c.name for c, v in zip(setup.mechanism.columns, standard, strict=True) if v is None and c.body]
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
    q: Floats,
    X: Floats,
    stated: Floats,
    known: Mapping[str, float],
) -> tuple[Floats, float]:
    """Stated values of bodies, and gains, friction and a delay that fit differentiated positions best.

    A joint's row over its gain, q − u + Σ (f/Kp) x + (1/Kp) τ = 0, has the signal with the least noise alone.  Where
    the bodies' forces τ are too small to tell the gain, it is taken to be like that of the other joints.  ``q`` and
    ``X`` are the smooth positions and the regressor without commands.
    """
    start, servos = stated.copy(), servo_joints(base.mechanism)
    for name, value in known.items():
        if name not in base.pivots:
            raise InputError(f"'{name}' is not a base parameter", element="identification.known")
        start[base.pivots.index(name)] = value
    bodies, given = inertial(base) > 0, np.isin(base.pivots, list(known))
    gains = [base.pivots.index(servos[name]) for name in names]
    rows, positive = [], positive_parameters(base)
    for k, gain in enumerate(gains):
        places = np.flatnonzero(~bodies & ~given & (np.abs(X[:, k]).max(axis=0) > 0))
        free = [int(place) for place in places if place != gain]
        held = np.where(bodies | given, start, 0.0)
        held[gain] = 0.0
        rows.append(_Row(free, X[:, k, free], X[:, k] @ held, positive[free]))
    pulls = {delay: _pulls(segments, names, delay) - q for delay in _DELAYS}
    solved = {d: [row.solved(pull) for row, pull in zip(rows, p.T, strict=True)] for d, p in pulls.items()}
    misfits = {d: sum(f[3] / (p @ p) for f, p in zip(solved[d], pulls[d].T, strict=True)) for d in _DELAYS}
    delay = min(misfits, key=lambda d: misfits[d])
    found = solved[delay]
    told = [1 / weight for _, weight, certain, _ in found if certain]
    if not told and not given[gains].any():
        raise InputError(
            "no joint's positions follow its commands against the weight of the bodies as a servo's would: are columns "
            "exchanged, or signs or units wrong? Else state one gain under identification: known"
        )
    for (shares, weight, certain, _), row, gain in zip(found, rows, gains, strict=True):
        if not given[gain]:
            start[gain] = 1 / weight if certain else np.median(told or start[gains][given[gains]])
        start[row.free] = np.where(row.positive, np.maximum(shares, _SLIGHT), shares) * start[gain]
    return start, delay


def _pulls(segments: Sequence[Segment], names: Sequence[str], delay: float) -> Floats:
    """Smooth commands as servos hold them, late by a delay, shape (N, n)."""
    parts = []
    for s in segments:
        times = np.arange(len(s)) / s.rate
        late = [np.interp(times - delay - 0.5 / s.rate, times, s.inputs[name]) for name in names]
        parts.append(lowpass(np.stack(late, axis=1), _band(s.rate), s.rate))
    return np.vstack(parts)


@dataclass(frozen=True)
class _Row:
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
        inverse = np.linalg.pinv((columns / scales).T @ (columns / scales), hermitian=True)
        error = np.sqrt(squares / len(pull) * inverse[-1, -1])
        return found[:-1] / scales[:-1], float(found[-1] / scales[-1]), bool(found[-1] > _CERTAIN * error), squares


def positive_parameters(base: BaseModel) -> Flags:
    """Base parameters that are positive: gains, friction and rotor inertia."""
    terms = {e.parameter: {a.term for a in e.actions} for e in base.mechanism.effects}
    return np.array([bool(terms.get(p, {""}) <= {"qd", "sign(qd)", "qdd", _SERVO}) for p in base.pivots])


def prior_rows(setup: Setup, base: BaseModel) -> Floats:
    """Rows whose product with a change of base parameters is in standard deviations of the prior, shape (i, r).

    Standard parameters of a body deviate from the file's by their size each, and by a common factor; effects, such as
    rotors whose inertia joins that of a body, may have any value.
    """
    mechanism, columns = setup.prior or setup.mechanism, setup.mechanism.columns
    given = dict(zip(mechanism.parameters, mechanism.standard_values(), strict=True))
    value = np.array([given.get(c.name) or 0.0 if c.body is not None else 0.0 for c in columns])
    anything = _ANYTHING * (np.abs(value).max() or 1.0)
    covariance = np.diag([0.0 if c.body is not None else anything**2 for c in columns])
    for body in {c.body for c in columns if c.body is not None}:
        own = np.array([c.body == body for c in columns])
        for unit in {c.unit for c in columns if c.body == body}:
            some = own & np.array([c.unit == unit for c in columns])
            covariance[some, some] = _PRIOR**2 * np.sum(value[some] ** 2)
        covariance += _PRIOR**2 * np.outer(value * own, value * own)
    B, bodies = base.B_float(), np.flatnonzero(inertial(base))
    spread = (B @ covariance @ B.T)[np.ix_(bodies, bodies)]
    scale = np.sqrt(np.maximum(np.diagonal(spread), 1e-300))
    rows = np.zeros((len(bodies), len(B)))
    factor = np.linalg.cholesky(spread / np.outer(scale, scale) + 1e-9 * np.eye(len(bodies)))
    rows[:, bodies] = np.linalg.solve(factor, np.diag(1 / scale))
    return rows
