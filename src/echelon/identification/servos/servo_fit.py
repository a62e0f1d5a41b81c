"""Arms without torque sensors: servo gains, friction and base parameters from positions and position commands.

An output-error fit: the closed loop of the servos is simulated (``servo_motion``), and its parameters are those whose
motion is nearest to the measured one (Ljung, "System Identification", 1999, section 7.2).  Starting values are those
of the robot's file, and, for gains and friction, a least-squares fit of differentiated positions.

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
from math import sqrt
from pathlib import Path
from typing import Any

import numpy as np

from echelon.base import BaseModel, base_parameters, base_structure
from echelon.identification.estimators.estimate import Estimate
from echelon.identification.logs.faults.repeated_values import resolution
from echelon.identification.logs.finding import Finding, note
from echelon.identification.logs.read_log import read_log
from echelon.identification.logs.recording import Segment
from echelon.identification.scores import GOOD, UNEXPLAINED, USABLE
from echelon.identification.servos.output_error import OutputErrorProblem, ServoSolution
from echelon.identification.servos.servo_limits import Limits
from echelon.identification.servos.servo_motion import ServoMotion, Windows, smooth
from echelon.identification.servos.servo_start import (
    inertial,
    positive_parameters,
    prior_rows,
    servo_joints,
    smooth_states,
    start_values,
    stated_values,
)
from echelon.identification.setup.logs import with_logs
from echelon.identification.setup.setup import Setup, check_single, setup_of
from echelon.robot import Mechanism
from echelon.shared import Floats, InputError, one_thread, public

WINDOW = 1.0
"""Length of a window, and of the run-in before it, s: long against a servo's bandwidth, so that servos take away errors
of the first state, and short against drifts of a simulation."""

STILL = 0.005
"""Speed, by the usual one, within which simulated friction turns: small enough not to be seen, large enough to be
simulated."""

VAGUE = 5.0  # per cent of a gain, its standard deviation, from which on the scale of its joint is mostly the file's
SEEN = 0.005  # share of the samples that has to be beyond a limit, for it to be believed: a swing or two of a log

WORTH = 0.1
"""Sum of the logarithms of what joints have left, by which more limits have to reduce it: a tenth of one joint's."""


def is_unexplained(rms: float, step: float) -> bool:
    """Whether residuals of a joint's positions exceed those by steps of its encoder; 0 is an encoder without steps."""
    return rms > UNEXPLAINED * step / sqrt(12)


@dataclass(frozen=True)
class ServoScore:
    """How well simulated positions of a joint follow measured ones."""

    joint: str
    rms: float  # of the difference, rad or m
    r2: float  # 1 less the share of the variance of the positions that is left
    # share of what positions and commands differ by that the model explains: 0 for a joint that is where it is
    # commanded to be
    lag_r2: float
    step: float = 0.0  # of the encoder, rad or m; 0 if it shows none

    @property
    def lags(self) -> bool:
        """Whether a servo with gain and friction explains too little of the lag behind the commands."""
        return self.lag_r2 < USABLE and is_unexplained(self.rms, self.step)


@dataclass(frozen=True)
class ServoLimit:
    """A limit that a servo's data show."""

    joint: str
    kind: str  # torque, dead or speed
    # the error from which on the torque does not grow, that below which there is none, rad or m, or the speed at which
    # commands are followed at most, rad/s or m/s
    value: float
    std: float
    share: float  # of the samples, that are beyond it, or within a dead band

    def __str__(self) -> str:
        what = {
            "torque": f"pulls no more than at {self.value:.3g} from its command",
            "dead": f"does not pull within {self.value:.3g} of its command",
            "speed": f"follows commands at {self.value:.3g}/s at most",
        }[self.kind]
        return f"the servo of '{self.joint}' {what} (±{2 * self.std:.2g}), as in {self.share:.0%} of the samples"


@public
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
    limits : tuple of ServoLimit
        Limits of torque and speed and dead bands of servos that the data show; they are part of the model.
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
    limits: tuple[ServoLimit, ...] = ()

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reasons not to use the model; empty if there are none."""
        scores = self.held_out or self.fitted
        found = [
            f"joint '{s.joint}' does not follow the model (R² {s.r2:.3f})"
            for s in scores
            if not s.r2 >= GOOD
        ]
        found += [
            f"of what joint '{s.joint}' lags behind its commands the model explains {max(s.lag_r2, 0):.0%} only: "
            "is there backlash, or does its controller do more than pull with a gain up to a limit?"
            for s in scores
            if s.r2 >= GOOD and s.lags
        ]
        return (
            *found,
            *(() if self.converged else ("the fit did not converge",)),
        )

    def __repr__(self) -> str:
        worst = min(
            (score.r2 for score in self.held_out or self.fitted), default=float("nan")
        )
        return f"ServoFit({self.base.mechanism.name}: {self.base.rank} parameters, R² at least {worst:.3f})"


@public
def fit_servos(
    setup: Any, logs: Any, *, on_step: Callable[[str], None] | None = None
) -> ServoFit:
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
    setup, paths, _ = with_logs(check_single(setup_of(setup)), logs)
    step, mechanism = on_step or (lambda _: None), setup.mechanism
    names = _checked_joints(mechanism)
    with one_thread():
        step("deriving the base parameters")
        base = base_parameters(mechanism, seed=setup.seed)

        step("reading the logs")
        segments, findings = _segments(setup, paths)
        windows, unseen = _windows(segments, setup.settings.holdout)

        step("finding starting values")
        problem, hidden = _problem(setup, base, names, segments, windows)

        step("simulating")
        solution, motion = _solved(problem, step), problem.motion
        found = _limits(motion, windows, solution)

        step("validating")
        scores = _scores(motion, windows, solution)
        others = () if unseen is None else _scores(motion, unseen, solution)
    values = solution.values
    covariance = solution.covariance
    noise = solution.noise
    converged = solution.converged
    rows = windows.measured.shape[0] * windows.measured.shape[1]
    estimate = Estimate(
        "output error",
        base.pivots,
        base.units,
        values,
        covariance[: base.rank, : base.rank],
        names,
        noise,
        (rows,) * len(names),
        float(rows * len(names) - len(covariance) + len(problem.fixed)),
        {"converged": converged},
    )
    return ServoFit(
        base,
        estimate,
        solution.delay,
        float(np.sqrt(covariance[base.rank, base.rank])),
        (
            *hidden,
            *_damping(mechanism, names),
            *_unclear(estimate, servo_joints(mechanism)),
        ),
        scores,
        others,
        (*findings, *(note("servo limits", "", str(limit)) for limit in found)),
        tuple(map(str, paths)),
        converged,
        found,
    )


def _problem(
    setup: Setup,
    base: BaseModel,
    names: tuple[str, ...],
    segments: Sequence[Segment],
    windows: Windows,
) -> tuple[OutputErrorProblem, tuple[str, ...]]:
    """The fit with its starting values, and what positions and commands cannot tell."""
    q, qd, qdd = smooth_states(segments)
    X = base.regressor(q, qd, qdd, inputs={name: np.zeros(len(q)) for name in names})
    speed = float(max(np.sqrt(np.mean(qd**2)), 1e-3))  # rad/s or m/s
    servos = servo_joints(setup.mechanism)
    moving = replace(base, mechanism=smooth(setup.mechanism, STILL * speed))
    motion = ServoMotion(
        moving, names, tuple(base.pivots.index(servos[name]) for name in names)
    )
    known = setup.settings.known
    start, delay, limits = start_values(
        base, names, segments, X, stated_values(setup, base), known
    )
    fixed, hidden = _scales(base, scale_groups(setup.mechanism), X, start, known)
    prior = prior_rows(setup, base)
    return OutputErrorProblem(
        motion, windows, start, delay, limits, positive_parameters(base), prior, fixed
    ), hidden


def _solved(problem: OutputErrorProblem, step: Callable[[str], None]) -> ServoSolution:
    """The motion nearest to the measured one, with those limits of servos that the data show."""
    solution = _shown(problem, problem.solve(step), step)
    more = _more_limits(problem.motion, problem.windows, solution)
    if more.active == solution.limits.active:
        return solution
    other = _shown(
        problem, replace(problem, delay=solution.delay, limits=more).solve(step), step
    )
    gain = np.sum(np.log(solution.noise)) - np.sum(np.log(other.noise))
    return other if gain > WORTH else solution


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
    geared = any(
        len(actuator.terms) > 1 for actuator in mechanism.transmission.actuators
    )
    outputs = tuple(output.name for output in mechanism.outputs)
    if (
        mechanism.couplings
        or geared
        or not mechanism.positions == mechanism.independent_velocities == outputs
    ):
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
        meeting = next(
            (
                p
                for p in combinations(groups, 2)
                if rank(p[0] | p[1]) < rank(p[0]) + rank(p[1])
            ),
            None,
        )
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
    regressor: Floats,
    start: Floats,
    known: Mapping[str, float],
) -> tuple[Floats, tuple[str, ...]]:
    """Directions that are held, as rows over the base parameters, and what is hidden, in words."""
    rows = [np.eye(len(start))[base.pivots.index(name)] for name in known]
    hidden = []
    outputs = [output.name for output in base.mechanism.outputs]
    of_bodies = inertial(base)
    for group in groups:
        places = [outputs.index(name) for name in group]
        seen = np.abs(regressor[:, places]).max(axis=(0, 1)) > 0
        fixing = [name for name in known if seen[base.pivots.index(name)]]
        what = "all joints" if len(group) == len(outputs) else ", ".join(group)
        if fixing:
            hidden.append(
                f"the scale of forces of {what} is that of {', '.join(fixing)}, which was given"
            )
            continue
        block = regressor[:, places].reshape(-1, len(start)) * of_bodies
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
    rubbing = [
        e.parameter
        for e in mechanism.effects
        if any(a.kind == "viscous" and a.at in names for a in e.actions)
    ]
    if rubbing:
        return (
            f"{', '.join(rubbing)} hold the servos' damping gains as well as viscous friction",
        )
    return ()


def _unclear(estimate: Estimate, servos: Mapping[str, str]) -> Sequence[str]:
    """Joints whose forces have a scale that motion hardly shows."""
    relative = dict(zip(estimate.parameters, estimate.relative_std, strict=True))
    return [
        f"the forces of {joint} are known to ±{2 * relative[gain]:.0f} % only: it moves too little mass to affect "
        "the other joints, so its scale comes mostly from the file"
        for joint, gain in servos.items()
        if relative[gain] > VAGUE
    ]


# -- data --------------------------------------------------------------------------------------------------------------


def _segments(
    setup: Setup, paths: Sequence[Path]
) -> tuple[tuple[Segment, ...], tuple[Finding, ...]]:
    segments: list[Segment] = []
    findings: list[Finding] = []
    names = setup.mechanism.velocities
    for path in paths:
        for piece in read_log(
            path,
            setup.mechanism,
            setup.columns,
            rate=setup.preparation.rate,
            outputs=False,
        ):
            findings += piece.findings
            segments += piece.segments
            lacking = [
                name
                for name in names
                if any(name not in s.inputs for s in piece.segments)
            ]
            if lacking:
                problem = (
                    f"the log has no commands of {', '.join(lacking)}: map them as "
                    f"input, {{{lacking[0]}: column}}"
                )
                raise InputError(problem, source=str(path))
    return tuple(segments), tuple(dict.fromkeys(findings))


def _windows(
    segments: Sequence[Segment], holdout: float
) -> tuple[Windows, Windows | None]:
    """Windows of the first parts of all segments, and of the last ones."""
    rate = segments[0].rate
    run_in = length = round(WINDOW * rate)
    first: list[tuple[int, int]] = []
    last: list[tuple[int, int]] = []
    for k, segment in enumerate(segments):
        cut = round((1 - holdout) * len(segment))
        first += [(k, b) for b in range(0, cut - run_in - length, length)]
        end = len(segment) - run_in - length
        last += [(k, b) for b in range(max(cut - run_in, 0), end, length)]
    if any(abs(s.rate / rate - 1) > 1e-3 for s in segments):
        raise InputError(
            "the logs have different rates: give one under preparation: rate"
        )
    if not first:
        raise InputError(
            f"no stretch is as long as {2 * WINDOW:g} s within the part that is fitted"
        )

    def made(some: list[tuple[int, int]]) -> Windows:
        return Windows(
            tuple(segments), np.array(some, dtype=np.intp), run_in, length, rate
        )

    return made(first), made(last) if last else None


def _scores(
    motion: ServoMotion, windows: Windows, solution: ServoSolution
) -> tuple[ServoScore, ...]:
    found = motion.positions(windows, solution.values, solution.delay, solution.limits)
    measured = windows.measured
    commands = _commanded(motion, windows, 0.0, Limits.none(len(motion.names)))
    squares = np.mean((found - measured) ** 2, axis=(0, 1))
    spread = np.var(measured.reshape(-1, measured.shape[2]), axis=0)
    lag = np.mean((commands - measured) ** 2, axis=(0, 1))
    with np.errstate(divide="ignore", invalid="ignore"):
        return tuple(
            ServoScore(
                name,
                float(np.sqrt(s)),
                float(1 - s / v),
                float(1 - s / g),
                resolution(q.ravel()) or 0.0,
            )
            for name, s, v, g, q in zip(
                motion.names,
                squares,
                spread,
                lag,
                np.moveaxis(measured, 2, 0),
                strict=True,
            )
        )


def _commanded(
    motion: ServoMotion, windows: Windows, delay: float, limits: Limits
) -> Floats:
    """Commands at the samples that count, shape (W, length, n)."""
    means = windows.commands(motion.names, delay, limits).means
    last = (windows.run_in + 1) * windows.substeps - 1
    return np.moveaxis(means[last :: windows.substeps], 0, 1)


def _limits(
    motion: ServoMotion, windows: Windows, solution: ServoSolution
) -> tuple[ServoLimit, ...]:
    """The limits of a solution, with their deviations and the share of samples that show them."""
    limits, count = solution.limits, len(solution.values) + 1
    followed = _commanded(motion, windows, solution.delay, limits)
    asked = _commanded(motion, windows, solution.delay, Limits.none(len(motion.names)))
    error = np.abs(followed - windows.measured)
    beyond = {
        "torque": error > limits.torque + limits.dead,
        "dead": error < limits.dead,
        "speed": np.abs(asked - followed) > 0.5 * limits.speed / windows.rate,
    }
    stds = np.sqrt(np.diagonal(solution.covariance)[count:])
    return tuple(
        ServoLimit(
            motion.names[joint],
            kind,
            float(value),
            float(std),
            float(np.mean(beyond[kind][..., joint])) if std < value / 2 else 0.0,
        )
        for (kind, joint), value, std in zip(
            limits.active, limits.values, stds, strict=True
        )
    )


def _shown(
    problem: OutputErrorProblem, solution: ServoSolution, step: Callable[[str], None]
) -> ServoSolution:
    """A solution with those limits only that the data show."""
    motion, found = problem.motion, _limits(problem.motion, problem.windows, solution)
    doubtful = [
        (some.kind, motion.names.index(some.joint))
        for some in found
        if some.share < SEEN
    ]
    if not doubtful:
        return solution
    return replace(
        problem, delay=solution.delay, limits=solution.limits.without(doubtful)
    ).solve(step)


def _more_limits(
    motion: ServoMotion, windows: Windows, solution: ServoSolution
) -> Limits:
    """The limits with a dead band and a limit of torque at joints whose encoders show that something is missing."""
    limits = solution.limits
    error = np.abs(
        _commanded(motion, windows, solution.delay, limits) - windows.measured
    )
    for joint, noise in enumerate(solution.noise):
        step = resolution(windows.measured[..., joint].ravel()) or 0.0
        if is_unexplained(float(noise), step):
            low, high = np.quantile(error[..., joint], (0.1, 0.98))
            if not limits.dead[joint] > 0:
                limits = limits.having("dead", joint, float(max(low, 1e-6)))
            if not np.isfinite(limits.torque[joint]):
                limits = limits.having("torque", joint, float(high))
    return limits
