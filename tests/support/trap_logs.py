"""Simulated logs of real arms with one thing each that is not as the robot file says, and the words that name it."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from echelon.base.model import BaseModel
from echelon.identification.logs.finding import Finding, Severity
from echelon.identification.result import Identification
from support.robot_files import robot_file

Floats = npt.NDArray[np.float64]
Forces = Callable[[Floats, Floats, Floats], Floats]
"""Outputs of a robot, by positions, velocities and accelerations, all of shape (samples, joints)."""

ROBOTS = {
    "ur3": "ur3_robot",
    "ur5": "ur5_robot",
    "ur10": "ur10_robot",
    "xarm7": "xarm7",
    "panda": "panda",
    "kinova": "kinova",
    "z1": "z1",
    "so100": "so100",
}
"""Files of fixed-base serial arms, by short names."""

SECONDS, RATE = 60.0, 200.0
"""Length of logs, s, and samples per second."""
ENCODER = 1e-5
"""Steps of the encoders, rad."""
_FINGERS = re.compile("finger|gripper", re.IGNORECASE)
_SAME = 5e-4  # share of the outputs that a model may leave and still be right, as gravity found to some digits is
_STATES = 300  # random ones from which true base parameters are computed
_SMALLEST = (
    0.01  # of the largest torque: of joints with less the friction is of that size
)
_OF_ROWS = (
    "lost rows",
    "saturation",
)  # findings about rows, which name what is wrong as well
_KINDS = (
    "missing effect",
    "changes",
    "gravity",
    "gains",
    "joint",
    "setup error",
)  # of findings of hypotheses
_USUAL = re.compile(
    r"the acceleration qdd|the velocity qd;|the direction sign\(qd\);|nothing but a constant"
)
"""What nearly all robots have, and these have too."""


@dataclass(frozen=True)
class Arm:
    """An arm that is not quite the one of its file, with drives, and how it moves."""

    model: Any  # of Pinocchio, with the true inertias
    names: tuple[str, ...]
    time: Floats  # shape (samples,)
    q: Floats  # shape (samples, joints), as qd and qdd
    qd: Floats
    qdd: Floats
    centre: Floats  # of the motion, shape (joints,), as all below
    size: Floats  # standard deviation of the torques of the bodies
    viscous: Floats
    dry: Floats
    rotor: Floats
    offset: Floats
    noise: Floats
    reach: float
    seed: tuple[int, ...]

    @property
    def count(self) -> int:
        """Number of joints."""
        return len(self.names)

    @cached_property
    def strong(self) -> list[int]:
        """Joints that carry most, the strongest one first."""
        return [int(k) for k in np.argsort(-self.size)]

    @cached_property
    def chosen(self) -> list[int]:
        """The three strongest joints in some order."""
        return [self.strong[int(k)] for k in self.random(1).permutation(3)]

    def random(self, purpose: int) -> np.random.Generator:
        """A generator of random numbers for one purpose."""
        return np.random.default_rng([*self.seed, purpose])

    def bodies(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Torques that the bodies need, shape (samples, joints)."""
        data = self.model.createData()
        full = np.zeros((len(q), self.model.nq))
        for joint, angle in zip(list(self.model.joints)[1:], q.T, strict=True):
            turns = joint.nq == 2  # without limits: given by cosine and sine
            full[:, joint.idx_q : joint.idx_q + joint.nq] = np.stack(
                (np.cos(angle), np.sin(angle)) if turns else (angle,), axis=1
            )
        return np.array(
            [pin.rnea(self.model, data, *x) for x in zip(full, qd, qdd, strict=True)]
        )

    def drives(self, qd: Floats, qdd: Floats) -> Floats:
        """Torques of friction, offsets and rotors."""
        return (
            self.viscous * qd + self.dry * np.sign(qd) + self.offset + self.rotor * qdd
        )

    def forces(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Torques of all that the arm usually has."""
        return self.bodies(q, qd, qdd) + self.drives(qd, qdd)

    def with_load(self, mass: float) -> Arm:
        """The arm with a tool whose mass is a share of its own."""
        model, size = self.model.copy(), 0.12 * self.reach
        own = mass * sum(body.mass for body in model.inertias)
        box = np.diag([0.1, 0.12, 0.05]) * own * size**2
        model.inertias[self.count] = model.inertias[self.count] + pin.Inertia(
            own, np.array([0.1, 0.2, 1.0]) * size, box
        )
        return replace(self, model=model)

    def under(self, gravity: Floats) -> Arm:
        """The arm under another gravity, m/s²."""
        model = self.model.copy()
        model.gravity.linear = gravity
        return replace(self, model=model)


def arm(robot: str, seed: int) -> Arm:
    """An arm of :data:`ROBOTS` with random deviations from its file, drives and motion."""
    model = pin.buildModelFromUrdf(str(robot_file(ROBOTS[robot])))
    fingers = [k for k in range(1, model.njoints) if _FINGERS.search(model.names[k])]
    model = pin.buildReducedModel(model, fingers, pin.neutral(model))
    origin = (seed, *robot.encode())
    rng = np.random.default_rng(origin)
    reach = sum(
        float(np.linalg.norm(place.translation)) for place in model.jointPlacements
    )
    for k in range(1, model.njoints):
        model.inertias[k] = _changed(model.inertias[k], rng, reach)
    time = np.arange(round(SECONDS * RATE)) / RATE
    q, qd, qdd, centre = _motion(model, rng, time)
    none = np.zeros(model.nv)
    names = tuple(model.names)[1:]
    still = Arm(
        model,
        names,
        time,
        q,
        qd,
        qdd,
        centre,
        none,
        none,
        none,
        none,
        none,
        none,
        reach,
        origin,
    )
    size = still.bodies(q, qd, qdd).std(axis=0)
    size = np.maximum(size, _SMALLEST * size.max())
    return replace(
        still,
        size=size,
        viscous=rng.uniform(0.1, 0.4, model.nv) * size / qd.std(axis=0),
        dry=rng.uniform(0.1, 0.4, model.nv) * size,
        rotor=rng.uniform(0.05, 0.2, model.nv) * size / qdd.std(axis=0),
        offset=rng.uniform(-0.05, 0.05, model.nv) * size,
        noise=rng.uniform(0.01, 0.03, model.nv) * size,
    )


def _changed(body: Any, rng: np.random.Generator, reach: float) -> Any:
    """Another body that can exist."""
    factor, turned = rng.uniform(0.8, 1.25), rng.uniform(0.9, 1.1)
    lever = body.lever + 0.015 * reach * rng.uniform(-1, 1, 3)
    inertia = factor * turned * body.inertia
    moments = np.linalg.eigvalsh(inertia)
    lacking = max(moments[2] - moments[1] - moments[0], 0.0) + 1e-6 * max(
        moments[2], 1e-6
    )
    return pin.Inertia(
        factor * max(body.mass, 1e-3), lever, inertia + lacking * np.eye(3)
    )


def _motion(
    model: Any, rng: np.random.Generator, time: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """A Fourier series within limits: positions, velocities, accelerations and centres."""
    joints, base, harmonics = (
        model.nv,
        2 * np.pi * rng.uniform(0.04, 0.07),
        np.arange(1, rng.integers(5, 10)),
    )
    q, qd, qdd = np.zeros((3, len(time), joints))
    centre = np.zeros(joints)
    for k, joint in enumerate(list(model.joints)[1:]):
        low, high = -2.5, 2.5
        if joint.nq == 1:
            low = max(low, model.lowerPositionLimit[joint.idx_q])
            high = min(high, model.upperPositionLimit[joint.idx_q])
        w = base * harmonics
        a, b = rng.normal(size=(2, len(harmonics)))
        angles = time[:, None] * w
        sine, cosine = np.sin(angles), np.cos(angles)
        amplitude = min(rng.uniform(0.7, 1.6), 0.48 * (high - low))
        scale = amplitude / np.abs(sine @ a + cosine @ b).max()
        centre[k] = rng.uniform(low + amplitude, high - amplitude)
        q[:, k] = centre[k] + scale * (sine @ a + cosine @ b)
        qd[:, k] = scale * (cosine @ (a * w) - sine @ (b * w))
        qdd[:, k] = -scale * (sine @ (a * w * w) + cosine @ (b * w * w))
    return q, qd, qdd, centre


# -- logs --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TrapLog:
    """A log and what is true of it."""

    columns: dict[str, Floats]
    joints: tuple[str, ...]
    states: tuple[Floats, Floats, Floats]
    names: (
        str | None
    )  # a regular expression of what has to be said; None where nothing is to be named
    forces: (
        Forces | None
    )  # what the outputs are without noise; None where they depend on more than the state

    def truth(self, base: BaseModel) -> Floats | None:
        """True base parameters, shape (r,); None where the model cannot have the forces of the robot."""
        if self.forces is None:
            return None
        order = [self.joints.index(name) for name in base.mechanism.positions]
        rng = np.random.default_rng(0)
        q, qd, qdd = (
            rng.permuted(x[:: max(len(x) // _STATES, 1)], axis=0) for x in self.states
        )
        outputs = [self.joints.index(output.name) for output in base.mechanism.outputs]
        tau = self.forces(q, qd, qdd)[:, outputs]
        X = base.regressor(q[:, order], qd[:, order], qdd[:, order])
        weights = 1 / np.maximum(tau.std(axis=0), 1e-12)
        rows, right = (
            (X * weights[:, None]).reshape(-1, base.rank),
            (tau * weights).ravel(),
        )
        scales = np.maximum(np.linalg.norm(rows, axis=0), 1e-300)
        found = np.linalg.lstsq(rows / scales, right, rcond=None)[0]
        left = rows / scales @ found - right
        return found / scales if np.sqrt(np.mean(left**2)) < _SAME else None

    def coverage(self, result: Identification) -> tuple[int, int] | None:
        """How many true base parameters are in their intervals of 95 %, and how many there are."""
        true = self.truth(result.base)
        if true is None:
            return None
        low, high = result.estimate.interval().T
        return int(np.sum((low <= true) & (true <= high))), len(true)

    def named(self, result: Identification) -> bool:
        """Whether some finding or the verdict says what has to be said."""
        texts = [
            *(f"{finding.kind}: {finding.text}" for finding in result.findings),
            result.verdict,
            *result.reasons,
        ]
        return self.names is not None and any(
            re.search(self.names, text) for text in texts
        )

    def named_first(self, result: Identification) -> bool:
        """Whether the hypothesis that explains most, of those that are not usual, is the right one."""
        found = [some for some in judged(result) if not _USUAL.search(some.text)]
        return (
            bool(found)
            and self.names is not None
            and re.search(self.names, _text(found[0])) is not None
        )

    def wrong(self, result: Identification) -> list[Finding]:
        """Hypotheses that are said to be true and are not."""
        right = (
            re.compile(f"{self.names}|{_USUAL.pattern}")
            if self.names is not None
            else _USUAL
        )
        return [
            finding for finding in judged(result) if not right.search(_text(finding))
        ]


def judged(result: Identification) -> list[Finding]:
    """Findings about hypotheses: warnings first."""
    found = [
        f
        for f in result.findings
        if (f.kind in _KINDS and f.where == "") or f.kind in _OF_ROWS
    ]
    return sorted(found, key=lambda finding: finding.severity is not Severity.WARNING)


def _text(finding: Finding) -> str:
    return f"{finding.kind}: {finding.text}"


def _log(
    arm: Arm,
    tau: Floats,
    names: str | None,
    forces: Forces | None = None,
    *,
    q: Floats | None = None,
    step: float = ENCODER,
) -> TrapLog:
    """A log with noise of the sensors and steps of the encoders."""
    rng = arm.random(2)
    q = arm.q if q is None else q
    seen = step * np.round((q + 0.5 * ENCODER * rng.standard_normal(q.shape)) / step)
    measured = tau + arm.noise * rng.standard_normal(tau.shape)
    columns = {"t": arm.time}
    columns |= {f"q_{name}": some for name, some in zip(arm.names, seen.T, strict=True)}
    columns |= {
        f"tau_{name}": some for name, some in zip(arm.names, measured.T, strict=True)
    }
    return TrapLog(columns, arm.names, (arm.q, arm.qd, arm.qdd), names, forces)


def usual_log(arm: Arm, names: str | None = None, **more: Any) -> TrapLog:
    """The log of an arm as the model has it."""
    return _log(arm, arm.forces(arm.q, arm.qd, arm.qdd), names, arm.forces, **more)


def _of(words: str, names: list[str], *, every: bool = False) -> str:
    """Words with one of some names, or with all of them."""
    texts = [words.format(re.escape(name)) for name in names]
    return "".join(f"(?=.*{text})" for text in texts) if every else "|".join(texts)


# -- traps -------------------------------------------------------------------------------------------------------------


def _clean(arm: Arm) -> TrapLog:
    return usual_log(arm)


def _tool(arm: Arm) -> TrapLog:
    return usual_log(arm.with_load(0.05))


def _tilt(arm: Arm) -> TrapLog:
    turn = pin.rpy.rpyToMatrix(*np.radians(arm.random(3).choice([-5, 5], 2)), 0)
    return usual_log(arm.under(turn @ [0, 0, -9.81]), "gravity: the base is tilted")


def _side(arm: Arm) -> TrapLog:
    return usual_log(
        arm.under(np.array([9.81, 0, 0])), r"gravity: gravity is along x of the base"
    )


def _jitter(arm: Arm) -> TrapLog:
    times = np.sort(arm.time + arm.random(3).normal(0, 0.3 / RATE, len(arm.time)))
    q, qd, qdd = (_at(arm.time, x, times) for x in (arm.q, arm.qd, arm.qdd))
    moved = replace(arm, q=q, qd=qd, qdd=qdd)
    return usual_log(moved)


def _at(time: Floats, values: Floats, times: Floats) -> Floats:
    """Smooth signals at other times."""
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(time, values)(times))


def _length(arm: Arm) -> TrapLog:
    model = arm.model.copy()
    lengths = [
        float(np.linalg.norm(place.translation)) for place in model.jointPlacements
    ]
    for k in sorted(range(2, arm.count + 1), key=lambda k: -lengths[k])[:2]:
        place = model.jointPlacements[k]
        place.translation = 1.02 * place.translation
        model.jointPlacements[k] = place
    return usual_log(
        replace(arm, model=model), "link length|lengths of|geometr|kinematic|dimension"
    )


def _payload_mid(arm: Arm) -> TrapLog:
    begin = round(0.45 * len(arm.time))
    tau = arm.forces(arm.q, arm.qd, arm.qdd)
    tau[begin:] = arm.with_load(0.07).forces(arm.q, arm.qd, arm.qdd)[begin:]
    return _log(arm, tau, "changes: .* carries another load")


def _gravcomp(arm: Arm) -> TrapLog:
    return usual_log(arm.under(np.zeros(3)), "contain no weight")


def _gaspring(arm: Arm) -> TrapLog:
    joint, long, short = arm.strong[0], 0.35, 0.25

    def force(q: Floats) -> Floats:
        angle = q[:, joint] - arm.centre[joint] + 0.7
        length = np.sqrt(long**2 + short**2 - 2 * long * short * np.cos(angle))
        pull: Floats = -np.sin(angle) / length / (1 - 0.8 * (length - 0.4))
        return pull

    peak = np.abs(force(arm.q)).max()

    def forces(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        tau = arm.forces(q, qd, qdd)
        tau[:, joint] += 1.5 * arm.size[joint] / peak * force(q)
        return tau

    about = r"(position|sin\(|q² and q³).*\({0} "
    return _log(
        arm, forces(arm.q, arm.qd, arm.qdd), _of(about, [arm.names[joint]]), forces
    )


def _carried(arm: Arm, count: int) -> list[int]:
    """The joints that carry most, in their order along the arm."""
    return sorted(arm.strong[:count])


def _temp(arm: Arm) -> TrapLog:
    decay = np.exp(-arm.time / 20)[:, None]
    viscous, dry = arm.viscous * arm.qd, arm.dry * np.sign(arm.qd)
    tau = arm.forces(arm.q, arm.qd, arm.qdd) + decay * viscous + 0.4 * decay * dry
    return _log(arm, tau, "changes: friction falls as drives warm up")


def _coupled(arm: Arm) -> TrapLog:
    """The last drive turns by the last two joints."""
    last, before = arm.count - 1, arm.count - 2
    T = np.eye(arm.count)
    T[last, before] = 1.0
    back = np.linalg.inv(T)
    drives = tuple(x @ T.T for x in (arm.q, arm.qd, arm.qdd))

    def forces(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Torques of the drives, by their positions."""
        return arm.bodies(*(x @ back.T for x in (q, qd, qdd))) @ back + arm.drives(
            qd, qdd
        )

    words = re.escape(
        f"the drive of '{arm.names[last]}' turns by {arm.names[last]} + {arm.names[before]}"
    )
    q, qd, qdd = drives
    return _log(replace(arm, q=q, qd=qd, qdd=qdd), forces(q, qd, qdd), words, forces)


def _coupled2(arm: Arm) -> TrapLog:
    return _coupled(arm.with_load(0.05))


def _sea(arm: Arm) -> TrapLog:
    soft = _carried(arm, 2)
    load = arm.bodies(arm.q, arm.qd, arm.qdd)
    q, qd, qdd = arm.q.copy(), arm.qd.copy(), arm.qdd.copy()
    for k in soft:
        bent = 0.03 * load[:, k] / arm.size[k]
        rate = np.gradient(bent, 1 / RATE)
        q[:, k] += bent
        qd[:, k] += rate
        qdd[:, k] += np.gradient(rate, 1 / RATE)
    return _log(
        arm,
        load + arm.drives(qd, qdd),
        _of("'{0}' gives way", [arm.names[k] for k in soft]),
        q=q,
    )


def _backlash(arm: Arm) -> TrapLog:
    loose, q = _carried(arm, 2), arm.q.copy()
    load = arm.bodies(arm.q, arm.qd, arm.qdd)
    q[:, loose] += 0.01 * np.tanh(load[:, loose] / (0.02 * arm.size[loose]))
    tau = arm.forces(arm.q, arm.qd, arm.qdd)
    return _log(
        arm,
        tau,
        _of("the gear of '{0}' has a play", [arm.names[k] for k in loose]),
        q=q,
    )


def _zero(arm: Arm, size: float = 0.05) -> TrapLog:
    """An encoder whose zero is not that of the robot; gravity tells the second strongest joint's."""
    joint, q = arm.strong[1], arm.q.copy()
    q[:, joint] -= size
    words = _of("the zero of the position of '{0}' .* rad off", [arm.names[joint]])
    return _log(arm, arm.forces(arm.q, arm.qd, arm.qdd), words, q=q)


def _zero20(arm: Arm) -> TrapLog:
    return _zero(arm, 0.02)


def _late(arm: Arm, outputs: list[int], samples: int, words: str) -> TrapLog:
    """Outputs that are measured some samples after the positions."""
    log = usual_log(arm, words)
    columns = {name: values[samples:] for name, values in log.columns.items()}
    for name in (f"tau_{arm.names[k]}" for k in outputs):
        columns[name] = log.columns[name][:-samples]
    return replace(log, columns=columns)


def _delay(arm: Arm) -> TrapLog:
    return _late(
        arm,
        list(range(arm.count)),
        20,
        r"the outputs are 0\.(1|100\d|09[89]\d) ± \S+ s late",
    )


def _delay1(arm: Arm) -> TrapLog:
    joint = arm.strong[1]
    return _late(
        arm,
        [joint],
        10,
        _of(
            r"the output of '{0}' is 0\.0(5|50\d|49\d) ± \S+ s late", [arm.names[joint]]
        ),
    )


def _scaled(arm: Arm, factors: Floats, names: str) -> TrapLog:
    def forces(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return arm.forces(q, qd, qdd) * factors

    return _log(
        replace(arm, noise=arm.noise * np.abs(factors)),
        forces(arm.q, arm.qd, arm.qdd),
        names,
        forces,
    )


def _gain_of(arm: Arm, joint: int, factor: float) -> TrapLog:
    factors = np.where(np.arange(arm.count) == joint, factor, 1.0)
    return _scaled(
        arm,
        factors,
        _of("the output of '{0}' is .* times its true size", [arm.names[joint]]),
    )


def _gain(arm: Arm) -> TrapLog:
    return _gain_of(arm, arm.strong[1], 0.8)


def _gain50(arm: Arm) -> TrapLog:
    return _gain_of(arm, arm.strong[1], 0.5)


def _negative(arm: Arm) -> TrapLog:
    """A wrong sign and another unit at once."""
    return _gain_of(arm, arm.strong[1], -0.5)


def _gain2(arm: Arm) -> TrapLog:
    return _gain_of(arm, arm.strong[0], 0.8)


def _currents(arm: Arm) -> TrapLog:
    """Motor currents in place of torques, with another constant of every drive."""
    return _scaled(
        arm,
        1 / arm.random(3).uniform(4, 16, arm.count),
        "times its true size|current",
    )


def _sign(arm: Arm) -> TrapLog:
    joint = int(arm.random(3).integers(arm.count))
    factors = np.where(np.arange(arm.count) == joint, -1.0, 1.0)
    return _scaled(
        arm,
        factors,
        _of("the sign of the output of '{0}'.* is wrong", [arm.names[joint]]),
    )


def _exchanged(arm: Arm) -> TrapLog:
    order = np.arange(arm.count)
    one, other = sorted(arm.random(3).permutation(arm.count)[:2])
    order[[one, other]] = other, one

    def forces(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return arm.forces(q, qd, qdd)[:, order]

    words = _of(
        "the output of '{0}'.*exchanged", [arm.names[one], arm.names[other]], every=True
    )
    return _log(
        replace(arm, noise=arm.noise[order]),
        forces(arm.q, arm.qd, arm.qdd),
        words,
        forces,
    )


def _stribeck(arm: Arm) -> TrapLog:
    speed, extra = 0.15 * arm.qd.std(axis=0), 0.8 * arm.dry

    def forces(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        slow: Floats = np.sign(qd) * np.exp(-((qd / speed) ** 2))
        return arm.forces(q, qd, qdd) + extra * slow

    return _log(arm, forces(arm.q, arm.qd, arm.qdd), "Stribeck", forces)


def _smooth(arm: Arm) -> TrapLog:
    """Dry friction that turns smoothly, within a twentieth of the usual speeds."""
    width = 0.05 * float(np.median(arm.qd.std(axis=0)))

    def forces(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        change: Floats = np.tanh(qd / width) - np.sign(qd)
        return arm.forces(q, qd, qdd) + arm.dry * change

    return _log(arm, forces(arm.q, arm.qd, arm.qdd), "smooth_coulomb", forces)


def _lag(arm: Arm) -> TrapLog:
    """Sensors that follow Coulomb friction, and all else, within 20 ms."""
    tau = arm.forces(arm.q, arm.qd, arm.qdd)
    kept = np.exp(-1 / (0.02 * RATE))
    for k in range(1, len(tau)):
        tau[k] = kept * tau[k - 1] + (1 - kept) * tau[k]
    return _log(arm, tau, None)


def _quant(arm: Arm) -> TrapLog:
    return usual_log(arm, step=3e-3)


def _saturate(arm: Arm) -> TrapLog:
    joint = arm.strong[0]
    log = usual_log(arm, "saturat|limit|clipped")
    column = f"tau_{arm.names[joint]}"
    most = float(np.percentile(np.abs(log.columns[column]), 80))
    return replace(
        log, columns={**log.columns, column: np.clip(log.columns[column], -most, most)}
    )


def _dropout(arm: Arm) -> TrapLog:
    """Lost samples that the time stamps do not show, as they are counted by a logger."""
    log = usual_log(arm, "lost|missing|clock|rate is")
    kept = arm.random(3).random(len(arm.time)) > 0.03
    columns = {name: values[kept] for name, values in log.columns.items()}
    columns["t"] = np.arange(int(kept.sum())) / RATE
    return replace(log, columns=columns, forces=None)


TRAPS: dict[str, Callable[[Arm], TrapLog]] = {
    "clean": _clean,
    "tool": _tool,
    "tilt": _tilt,
    "side": _side,
    "jitter": _jitter,
    "length": _length,
    "payload_mid": _payload_mid,
    "gravcomp": _gravcomp,
    "gaspring": _gaspring,
    "temp": _temp,
    "coupled": _coupled,
    "coupled2": _coupled2,
    "sea": _sea,
    "backlash": _backlash,
    "zero": _zero,
    "zero20": _zero20,
    "delay": _delay,
    "delay1": _delay1,
    "gain": _gain,
    "gain50": _gain50,
    "gain2": _gain2,
    "negative": _negative,
    "currents": _currents,
    "sign": _sign,
    "exchanged": _exchanged,
    "stribeck": _stribeck,
    "smooth": _smooth,
    "lag": _lag,
    "quant": _quant,
    "saturate": _saturate,
    "dropout": _dropout,
}
"""What is wrong, by name."""


def trap_log(trap: str, robot: str, seed: int) -> TrapLog:
    """The log of an arm of :data:`ROBOTS` with one of :data:`TRAPS`."""
    return TRAPS[trap](arm(robot, seed))
