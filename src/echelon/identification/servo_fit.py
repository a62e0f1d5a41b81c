"""Arms without torque sensors: servo gains, friction and base parameters from positions and position commands.

An output-error fit: the closed loop of the servos is simulated (:mod:`echelon.identification.servo_motion`), and its
parameters are those whose motion is nearest to the measured one, by Gauss–Newton steps with Levenberg's damping (Ljung,
"System Identification", 1999, section 7.2).  Starting values are those of the robot's file, and, for gains and
friction, a least-squares fit of differentiated positions.

The equation y(q, q̇, q̈; u) = X̄ ζ̄ = 0 is homogeneous: a heavier robot with stronger servos moves alike.  How many such
scales there are is decided exactly, by the ranks of what the joints' rows see: joints whose row spaces meet only in 0
have scales of their own.  A known parameter fixes a scale; otherwise the forces that the file's inertial parameters
need along the log keep their size.  A servo's damping gain is one with viscous friction.

What motions of hobby arms show of the smaller inertial parameters is little, so each of them is expected within its
body's own size of the file's value; what the data say more precisely replaces that.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from echelon.arrays import Flags, Floats
from echelon.base.derive import base_parameters, base_structure
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.correlation import CorrelationSums
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.servo_motion import ServoMotion, Windows, smooth
from echelon.logs.finding import Finding
from echelon.logs.read_log import read_log
from echelon.logs.recording import Segment
from echelon.machine.target import one_thread
from echelon.mechanism.mechanism import Mechanism
from echelon.setup.logs import with_logs
from echelon.setup.setup import Setup
from echelon.signals.derivatives import derivatives
from echelon.signals.filters import lowpass

_WINDOW, _RUN_IN = 1.0, 1.0  # s
_STEPS = 60
_STUCK = 1e8  # damping from which on no step helps
_SETTLED = 1e-2  # standard deviations by which a last step moves
_STILL = 0.005
_PRIOR = 1.0  # standard deviation of inertial parameters, in sizes of their bodies
_ANYTHING = 1e3  # standard deviation of effects, in the largest parameters of bodies
_DELAYS = tuple(k / 100 for k in range(16))  # s
_SLIGHT = 1e-3  # of a gain, that friction has at least at the start
_CERTAIN = 10.0  # standard errors of a gain that is a good start
_VAGUE = 5.0  # per cent
_WELL = 0.98  # R² of positions
_SERVO = "q - i"


@dataclass(frozen=True)
class ServoScore:
    """How well simulated positions of a joint follow measured ones.

    Attributes
    ----------
    joint : str
    rms : float
        Of the difference, rad or m.
    r2 : float
        1 less the share of the variance of the positions that is left.
    lag_r2 : float
        Share of what positions and commands differ by that the model explains: 0 for a joint that is where it is
        commanded to be.
    """

    joint: str
    rms: float
    r2: float
    lag_r2: float


@dataclass(frozen=True, repr=False)
class ServoFit:
    """A robot with servos, fitted to positions and commands.

    Attributes
    ----------
    base : BaseModel
        Base parameters in closed form, gains and friction among them.
    estimate : Estimate
        Their values; noise in rad or m.
    delay, delay_std : float
        By which commands come late, s.
    hidden : tuple of str
        What positions and commands cannot tell, in sentences.
    fitted, held_out : tuple of ServoScore
        On rows of the fit, and on those it did not see.
    findings : tuple of Finding
    logs : tuple of str
    converged : bool
    """

    base: BaseModel
    estimate: Estimate
    delay: float
    delay_std: float
    hidden: tuple[str, ...]
    fitted: tuple[ServoScore, ...]
    held_out: tuple[ServoScore, ...]
    findings: tuple[Finding, ...]
    logs: tuple[str, ...]
    converged: bool

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why the model should not be used; empty if nothing speaks against it."""
        scores = self.held_out or self.fitted
        found = [f"joint '{s.joint}' is not where the model says (R² {s.r2:.3f})" for s in scores if not s.r2 >= _WELL]
        return (*found, *(() if self.converged else ("the steps of the fit did not come to an end",)))

    def __repr__(self) -> str:
        worst = min((score.r2 for score in self.held_out or self.fitted), default=float("nan"))
        return f"ServoFit({self.base.mechanism.name}: {self.base.rank} parameters, R² at least {worst:.3f})"


def servo_joints(mechanism: Mechanism) -> dict[str, str]:
    """Joints with a servo, and the names of the servos' gains."""
    return {
        effect.actions[0].at: effect.parameter
        for effect in mechanism.effects
        if len(effect.actions) == 1 and effect.actions[0].term == _SERVO
    }


def fit_servos(setup: Any, logs: Any, *, on_step: Callable[[str], None] | None = None) -> ServoFit:
    """Fit servo gains, friction and base parameters to measured positions and position commands.

    Parameters
    ----------
    setup : Setup, or what load_setup takes
        A robot with a ``servo`` effect at every joint, whose logs have the commanded positions as inputs.  The fit
        starts from its values, or those of ``prior``; ``settings.known`` fixes parameters, and ``settings.holdout`` is
        the share of each stretch that validates.
    logs : path, dict of arrays, data frame, or several of them
        A directory stands for all logs in it, that of a LeRobot dataset for its episodes.
    on_step : callable, optional
        Is told what is being done.

    Returns
    -------
    ServoFit

    Raises
    ------
    InputError
        If joints have no servo, logs cannot be read or are too short, or the robot has no inertial values.

    Examples
    --------
    >>> import echelon as ec
    >>> setup = ec.load_setup("examples/logs/so101.yaml")
    >>> fit = ec.fit_servos(setup, ["episodes/"])                                               # doctest: +SKIP
    """
    setup, paths, _ = with_logs(setup, logs)
    step, mechanism = on_step or (lambda _: None), setup.mechanism
    names = _checked_joints(mechanism)
    with one_thread():
        step("deriving the base parameters")
        base = base_parameters(mechanism, seed=setup.seed)
        groups = scale_groups(mechanism)

        step("reading the logs")
        segments, findings = _segments(setup, paths)
        windows, unseen = _windows(segments, setup.settings.holdout)

        step("finding starting values")
        moving = replace(base, mechanism=smooth(mechanism, _STILL * _speed(segments)))
        motion = ServoMotion(moving, names, tuple(base.pivots.index(servo_joints(mechanism)[n]) for n in names))
        stated = _stated(setup, base)
        start, delay = _start(base, names, segments, stated, setup.settings.known)
        fixed, hidden = _scales(base, groups, segments, start, setup.settings.known)

        step("simulating")
        problem = _Problem(motion, windows, start, delay, _positive(base), _prior(setup, base), fixed)
        values, delay, covariance, noise, converged = problem.solve(step)
        step("validating")
        scores = _scores(motion, windows, values, delay)
        others = () if unseen is None else _scores(motion, unseen, values, delay)
    rows = windows.measured.shape[0] * windows.measured.shape[1]
    estimate = Estimate(
        "output error",
        base.pivots,
        base.units,
        values,
        covariance[:-1, :-1],
        names,
        noise,
        (rows,) * len(names),
        float(rows * len(names) - len(values) - 1 + len(fixed)),
        {"converged": converged},
    )
    return ServoFit(
        base,
        estimate,
        delay,
        float(np.sqrt(covariance[-1, -1])),
        (*hidden, *_damping(mechanism, names), *_unclear(estimate, servo_joints(mechanism))),
        scores,
        others,
        findings,
        tuple(map(str, paths)),
        converged,
    )


# -- what the robot allows ------------------------------------------------------------------------------------------


def _checked_joints(mechanism: Mechanism) -> tuple[str, ...]:
    """Names of the joints, each of which has one servo and one output."""
    names = mechanism.velocities
    servos = servo_joints(mechanism)
    lacking = [name for name in names if name not in servos]
    if lacking:
        raise InputError(
            f"joints {', '.join(lacking)} have no servo: add effects '- {{type: servo, at: all}}', or lock "
            "the joints that do not move"
        )
    geared = any(len(actuator.terms) > 1 for actuator in mechanism.transmission.actuators)
    outputs = tuple(output.name for output in mechanism.outputs)
    if mechanism.closures or mechanism.couplings or geared or not mechanism.positions == names == outputs:
        raise InputError(
            "a fit of servos needs a tree of revolute and prismatic joints, each with one servo and without couplings; "
            "leave 'outputs' and 'actuators' out"
        )
    return names


def scale_groups(mechanism: Mechanism) -> tuple[tuple[str, ...], ...]:
    """Outputs whose rows have one scale, decided by exact ranks.

    Rows scaled by factors of their own, D X ζ, are those of other parameters, X ζ', for every ζ just where the groups'
    row spaces are independent: then each group's part of ζ can be scaled alone.
    """
    bare = replace(mechanism, effects=())
    known: dict[frozenset[str], int] = {}

    def rank(names: frozenset[str]) -> int:
        if names not in known:
            some = tuple(output for output in bare.outputs if output.name in names)
            known[names] = base_structure(replace(bare, measured=some)).rank
        return known[names]

    groups = [frozenset([output.name]) for output in bare.outputs]
    while True:
        meeting = next((p for p in combinations(groups, 2) if rank(p[0] | p[1]) < rank(p[0]) + rank(p[1])), None)
        if meeting is None:
            break
        groups = [g for g in groups if g not in meeting] + [meeting[0] | meeting[1]]
    whole = frozenset().union(*groups)
    if len(groups) > 1 and rank(whole) < sum(map(rank, groups)):
        groups = [whole]
    order = [output.name for output in bare.outputs]
    return tuple(
        tuple(name for name in order if name in group)
        for group in sorted(groups, key=lambda g: min(map(order.index, g)))
    )


def _scales(
    base: BaseModel,
    groups: Sequence[Sequence[str]],
    segments: Sequence[Segment],
    start: Floats,
    known: Mapping[str, float],
) -> tuple[Floats, tuple[str, ...]]:
    """Directions that are held, as rows over the base parameters, and what is hidden, in words."""
    rows = [np.eye(len(start))[base.pivots.index(name)] for name in known]
    hidden = []
    outputs = [output.name for output in base.mechanism.outputs]
    q, qd, qdd = _states(segments)
    inputs = {name: np.zeros(len(q)) for name in outputs}
    regressor = base.regressor(q, qd, qdd, inputs=inputs)
    inertial = _inertial(base)
    for group in groups:
        places = [outputs.index(name) for name in group]
        seen = np.abs(regressor[:, places]).max(axis=(0, 1)) > 0
        fixing = [name for name in known if seen[base.pivots.index(name)]]
        what = "all joints" if len(group) == len(outputs) else ", ".join(group)
        if fixing:
            hidden.append(f"the scale of forces of {what} is that of {', '.join(fixing)}, which was given")
            continue
        block = regressor[:, places].reshape(-1, len(start)) * inertial
        forces = block @ start
        if not forces.any():
            raise InputError(
                f"nothing fixes the scale of {what}: the file has no masses there; state one parameter under "
                "identification: known"
            )
        rows.append(block.T @ forces / (forces @ forces))
        hidden.append(
            f"positions and commands tell only ratios of masses, friction and gains of {what}: their common scale is "
            "that of the file's masses; state a weighed mass or one gain under identification: known to fix it"
        )
    return np.array(rows), tuple(hidden)


def _damping(mechanism: Mechanism, names: Sequence[str]) -> tuple[str, ...]:
    rubbing = [e.parameter for e in mechanism.effects if any(a.term == "qd" and a.at in names for a in e.actions)]
    return (f"{', '.join(rubbing)} hold the servos' damping gains as well as viscous friction",) if rubbing else ()


def _unclear(estimate: Estimate, servos: Mapping[str, str]) -> Sequence[str]:
    """Joints whose forces have a scale that motion hardly shows."""
    relative = dict(zip(estimate.parameters, estimate.relative_std, strict=True))
    return [
        f"the forces of {joint} are known to ±{2 * relative[gain]:.0f} % only: it moves too little mass for the other "
        "joints to feel, so that its scale is mostly the file's"
        for joint, gain in servos.items()
        if relative[gain] > _VAGUE
    ]


def _inertial(base: BaseModel) -> Floats:
    """1 for base parameters of bodies, 0 for those of effects, shape (r,)."""
    return np.array([float(base.mechanism.columns[p].body is not None) for p in base.matrix.pivots])


# -- data --------------------------------------------------------------------------------------------------------------


def _segments(setup: Setup, paths: Sequence[Path]) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    segments: list[Segment] = []
    findings: list[Finding] = []
    names = setup.mechanism.velocities
    for path in paths:
        for piece in read_log(path, setup.mechanism, setup.columns, rate=setup.preparation.rate, outputs=False):
            findings += piece.findings
            segments += piece.segments
            lacking = [name for name in names if any(name not in s.inputs for s in piece.segments)]
            if lacking:
                problem = (
                    f"the log has no commands of {', '.join(lacking)}: map them as input, {{{lacking[0]}: column}}"
                )
                raise InputError(problem, source=str(path))
    return tuple(segments), tuple(dict.fromkeys(findings))


def _windows(segments: Sequence[Segment], holdout: float) -> tuple[Windows, Windows | None]:
    """Windows of the first parts of all segments, and of the last ones."""
    rate = segments[0].rate
    run_in, length = round(_RUN_IN * rate), round(_WINDOW * rate)
    first: list[tuple[int, int]] = []
    last: list[tuple[int, int]] = []
    for k, segment in enumerate(segments):
        cut = round((1 - holdout) * len(segment))
        first += [(k, b) for b in range(0, cut - run_in - length, length)]
        last += [(k, b) for b in range(max(cut - run_in, 0), len(segment) - run_in - length, length)] if holdout else []
    if any(abs(s.rate / rate - 1) > 1e-3 for s in segments):
        raise InputError("the logs have different rates: give one under preparation: rate")
    if not first:
        raise InputError(f"no stretch is as long as {_RUN_IN + _WINDOW:g} s within the part that is fitted")

    def made(some: list[tuple[int, int]]) -> Windows:
        return Windows(tuple(segments), np.array(some, dtype=np.intp), run_in, length, rate)

    return made(first), made(last) if last else None


def _band(rate: float) -> float:
    """Hz; what hobby servos hardly exceed, within what samples can show."""
    return min(5.0, rate / 5)


def _states(segments: Sequence[Segment]) -> tuple[Floats, Floats, Floats]:
    """Positions with smooth derivatives, all segments on end."""
    filtered = [lowpass(s.signals["q"], _band(s.rate), s.rate) for s in segments]
    parts = [derivatives(q, s.rate) for q, s in zip(filtered, segments, strict=True)]
    qd, qdd = (np.vstack([part[k] for part in parts]) for k in range(2))
    return np.vstack(filtered), qd, qdd


def _speed(segments: Sequence[Segment]) -> float:
    """Rms speed of the joints, rad/s or m/s."""
    return float(max(np.sqrt(np.mean(_states(segments)[1] ** 2)), 1e-3))


# -- starting values -------------------------------------------------------------------------------------------------


def _stated(setup: Setup, base: BaseModel) -> Floats:
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


def _start(
    base: BaseModel, names: Sequence[str], segments: Sequence[Segment], stated: Floats, known: Mapping[str, float]
) -> tuple[Floats, float]:
    """Stated values of bodies, and gains, friction and a delay that fit differentiated positions best.

    A joint's row over its gain, q − u + Σ (f/Kp) x + (1/Kp) τ = 0, has the signal with the least noise alone.  Where
    the bodies' forces τ are too small to tell the gain, it is taken to be like that of the other joints.
    """
    q, qd, qdd = _states(segments)
    X = base.regressor(q, qd, qdd, inputs={name: np.zeros(len(q)) for name in names})
    start, servos = stated.copy(), servo_joints(base.mechanism)
    for name, value in known.items():
        if name not in base.pivots:
            raise InputError(f"'{name}' is not a base parameter", element="identification.known")
        start[base.pivots.index(name)] = value
    bodies, given = _inertial(base) > 0, np.isin(base.pivots, list(known))
    gains = [base.pivots.index(servos[name]) for name in names]
    rows, positive = [], _positive(base)
    for k, gain in enumerate(gains):
        places = np.flatnonzero(~bodies & ~given & (np.abs(X[:, k]).max(axis=0) > 0))
        free = [int(place) for place in places if place != gain]
        held = np.where(bodies | given, start, 0.0)
        held[gain] = 0.0
        rows.append(_Row(free, X[:, k, free], X[:, k] @ held, positive[free]))
    pulls = {delay: _pulls(segments, names, delay) - q for delay in _DELAYS}
    misfits = {
        d: sum(r.solved(pull)[3] / (pull @ pull) for r, pull in zip(rows, p.T, strict=True)) for d, p in pulls.items()
    }
    delay = min(misfits, key=lambda d: misfits[d])
    found = [row.solved(pull) for row, pull in zip(rows, pulls[delay].T, strict=True)]
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
        from scipy.optimize import lsq_linear

        columns = np.column_stack([self.effects, self.forces])
        scales = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        low = np.where(np.append(self.positive, True), 0.0, -np.inf)
        found = lsq_linear(columns / scales, pull, (low, np.inf)).x
        squares = float(np.sum((pull - columns / scales @ found) ** 2))
        inverse = np.linalg.pinv((columns / scales).T @ (columns / scales), hermitian=True)
        error = np.sqrt(squares / len(pull) * inverse[-1, -1])
        return found[:-1] / scales[:-1], float(found[-1] / scales[-1]), bool(found[-1] > _CERTAIN * error), squares


def _positive(base: BaseModel) -> Flags:
    """Base parameters that are positive: gains, friction and rotor inertia."""
    terms = {e.parameter: {a.term for a in e.actions} for e in base.mechanism.effects}
    return np.array([bool(terms.get(p, {""}) <= {"qd", "sign(qd)", "qdd", _SERVO}) for p in base.pivots])


def _prior(setup: Setup, base: BaseModel) -> Floats:
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
    B, bodies = base.B_float(), np.flatnonzero(_inertial(base))
    spread = (B @ covariance @ B.T)[np.ix_(bodies, bodies)]
    scale = np.sqrt(np.maximum(np.diagonal(spread), 1e-300))
    rows = np.zeros((len(bodies), len(B)))
    factor = np.linalg.cholesky(spread / np.outer(scale, scale) + 1e-9 * np.eye(len(bodies)))
    rows[:, bodies] = np.linalg.solve(factor, np.diag(1 / scale))
    return rows


# -- the fit ---------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Problem:
    """Weighted squares of the differences between measured and simulated positions, and of those from the file."""

    motion: ServoMotion
    windows: Windows
    start: Floats
    delay: float  # at the start, s
    positive: Flags  # shape (r,)
    prior: Floats  # see _prior
    fixed: Floats  # shape (c, r): directions along which nothing changes

    def solve(self, step: Callable[[str], None]) -> tuple[Floats, float, Floats, Floats, bool]:
        """Values, delay, covariance of both, noise of the joints, and whether steps became small."""
        free = self._free()
        values = np.append(self.start, self.delay)
        rest, slopes = self._linearised(values)
        if not np.isfinite(rest).all():
            raise InputError("the robot with its starting values cannot be simulated: is its mass matrix positive?")
        noise, damping, converged, count = _noise(rest), 1e-3, False, 0
        while not converged and count < _STEPS and damping < _STUCK:
            count += 1
            step(f"simulating (step {count} of at most {_STEPS})")
            hessian, gradient = self._normal(rest, slopes, noise, values, free)
            change = -np.linalg.solve(hessian + damping * np.diag(np.diagonal(hessian)), gradient)
            tried = self._moved(values, free @ change)
            new, new_slopes = self._linearised(tried)
            if np.isfinite(new).all() and self._cost(new, noise, tried) <= self._cost(rest, noise, values):
                converged = bool(np.sqrt(change @ hessian @ change / len(change)) < _SETTLED)
                values, rest, slopes, noise, damping = tried, new, new_slopes, _noise(new), max(damping / 5, 1e-9)
            else:
                damping *= 8
        inflated = noise * np.sqrt(_inflation(rest))
        hessian, _ = self._normal(rest, slopes, inflated, values, free)
        scale = 1 / np.sqrt(np.diagonal(hessian))
        inverse = scale[:, None] * np.linalg.pinv(hessian * np.outer(scale, scale), hermitian=True) * scale
        return values[:-1], float(values[-1]), free @ inverse @ free.T, noise, converged

    def _free(self) -> Floats:
        """Basis of the changes that are allowed, of parameters and delay, shape (r + 1, d)."""
        count = len(self.start)
        held = np.hstack([self.fixed, np.zeros((len(self.fixed), 1))])
        sizes = np.abs(self.start)
        scale = np.append(np.where(sizes > 0, sizes, 1.0), 1e-2)
        _, singular, right = np.linalg.svd(held * scale, full_matrices=True)
        rank = int(np.sum(singular > 1e-12 * singular.max(initial=1e-300)))
        basis: Floats = scale[:, None] * right[rank:].T
        return basis.reshape(count + 1, -1)

    def _moved(self, values: Floats, change: Floats) -> Floats:
        """Values after a step that leaves positive ones positive: their logarithms change, by no more than 1."""
        tried = values + change
        some = np.flatnonzero(self.positive)
        tried[some] = values[some] * np.exp(np.clip(change[some] / values[some], -1.0, 1.0))
        return tried

    def _linearised(self, values: Floats) -> tuple[Floats, Floats]:
        found, slopes = self.motion.derivatives(self.windows, values[:-1], float(values[-1]))
        return found - self.windows.measured, slopes

    def _cost(self, rest: Floats, noise: Floats, values: Floats) -> float:
        return float(np.sum((rest / noise) ** 2) + np.sum((self.prior @ (values[:-1] - self.start)) ** 2))

    def _normal(
        self, rest: Floats, slopes: Floats, noise: Floats, values: Floats, free: Floats
    ) -> tuple[Floats, Floats]:
        along = (slopes / noise[:, None]).reshape(-1, slopes.shape[-1]) @ free
        weighted = (rest / noise).reshape(-1)
        prior = self.prior @ free[:-1]
        hessian = along.T @ along + prior.T @ prior
        gradient = along.T @ weighted + prior.T @ (self.prior @ (values[:-1] - self.start))
        return hessian, gradient


def _noise(rest: Floats) -> Floats:
    """Standard deviations of joints, shape (n,)."""
    found: Floats = np.maximum(np.sqrt(np.mean(rest**2, axis=(0, 1))), 1e-9)
    return found


def _inflation(rest: Floats) -> Floats:
    """Samples that say as much as one, because differences resemble their neighbours, shape (n,)."""
    found = []
    for joint in range(rest.shape[2]):
        sums = CorrelationSums(rest.shape[1])
        for window, values in enumerate(rest[:, :, joint]):
            sums.add(np.arange(float(len(values))), values, window)
        found.append(max(1.0, sums.result().time))
    return np.array(found)


def _scores(motion: ServoMotion, windows: Windows, values: Floats, delay: float) -> tuple[ServoScore, ...]:
    found, measured = motion.positions(windows, values, delay), windows.measured
    commands = windows.commands(motion.names, 0.0)[0][:, windows.run_in * windows.substeps :: windows.substeps]
    squares = np.mean((found - measured) ** 2, axis=(0, 1))
    spread = np.var(measured.reshape(-1, measured.shape[2]), axis=0)
    lag = np.mean((commands - measured) ** 2, axis=(0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return tuple(
            ServoScore(name, float(np.sqrt(s)), float(1 - s / v), float(1 - s / g))
            for name, s, v, g in zip(motion.names, squares, spread, lag, strict=True)
        )
