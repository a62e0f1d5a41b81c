"""Mistakes that are planted in set-ups of simulated arms: which of them `identify` names, and what it says without any.

python benchmarks/mistakes.py                 twelve mistakes for each of five arms, and the same set-ups without any
python benchmarks/mistakes.py --robots ur5    of some

Arms move as Pinocchio computes, with masses, centres and inertias up to 40 % off those of their files, with friction,
an encoder's steps and noise of the torques.  A mistake is named if the one finding about culprits says what was done.
"""

from __future__ import annotations

import argparse
import sysconfig
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
import numpy.typing as npt
import pinocchio as pin

import echelon as ec
from tabular import table

Floats = npt.NDArray[np.float64]

SHARE = Path(sysconfig.get_path("purelib")) / "cmeel.prefix" / "share"
ROBOTS = {
    "ur5": "ur_description/urdf/ur5_robot.urdf",
    "xarm7": "xarm_description/urdf/xarm7.urdf",
    "z1": "z1_description/urdf/z1.urdf",
    "kinova": "kinova_description/robots/kinova.urdf",
    "so100": "so_arm_description/urdf/so100.urdf",
}
RATE, SECONDS, STEP, NOISE = 200.0, 30.0, 1e-5, 0.01
"""Sampling (Hz) and length (s) of logs, steps of encoders (rad), and noise as a share of an output's deviation."""


@dataclass(frozen=True)
class Log:
    """What a log says: columns by quantity, and the rate that a set-up states."""

    q: Floats
    tau: Floats
    rate: float = RATE


def urdf(name: str) -> Path:
    """The file of a robot."""
    return SHARE / "example-robot-data" / "robots" / ROBOTS[name]


def simulated(name: str, seed: int) -> Log:
    """A log of a random smooth motion of a robot that is not quite that of its file."""
    rng, model = np.random.default_rng(seed), pin.buildModelFromUrdf(str(urdf(name)))
    for i in range(1, model.njoints):
        body = model.inertias[i]
        change = rng.uniform(0.7, 1.4)
        model.inertias[i] = pin.Inertia(
            body.mass * change,
            body.lever + rng.normal(0, 0.01, 3),
            body.inertia * change,
        )
    q, qd, qdd = _motion(rng, model.nv)
    data = model.createData()
    tau = np.array(
        [
            pin.rnea(model, data, _full(model, x), v, a)
            for x, v, a in zip(q, qd, qdd, strict=True)
        ]
    )
    size, speed = tau.std(axis=0), qd.std(axis=0)
    viscous, dry = rng.uniform(0.05, 0.3, (2, model.nv)) * size
    tau += (
        viscous * qd / speed
        + dry * np.sign(qd)
        + NOISE * size * rng.standard_normal(tau.shape)
    )
    return Log(STEP * np.round(q / STEP), tau)


def _motion(rng: np.random.Generator, joints: int) -> tuple[Floats, Floats, Floats]:
    t = np.arange(round(SECONDS * RATE))[:, None] / RATE
    q, qd, qdd = np.zeros((3, len(t), joints))
    for k in range(1, 7):
        w, (a, b) = (
            2 * np.pi * k / 10 + rng.uniform(0, 0.1, joints),
            0.3 * rng.normal(size=(2, joints)) / k**0.5,
        )
        q += a * np.sin(w * t) + b * np.cos(w * t)
        qd += w * (a * np.cos(w * t) - b * np.sin(w * t))
        qdd -= w * w * (a * np.sin(w * t) + b * np.cos(w * t))
    return q + rng.uniform(-0.5, 0.5, joints), qd, qdd


def _full(model: pin.Model, angles: Floats) -> Floats:
    """A configuration, in which joints that turn without limits are given by cosine and sine."""
    found = pin.neutral(model)
    for joint in list(model.joints)[1:]:
        angle = angles[joint.idx_v]
        found[joint.idx_q : joint.idx_q + joint.nq] = (
            (np.cos(angle), np.sin(angle)) if joint.nq == 2 else (angle,)
        )
    return found


# -- mistakes ----------------------------------------------------------------------------------------------------------


def _flipped(values: Floats, joint: int, factor: float = -1.0) -> Floats:
    return values * np.where(np.arange(values.shape[1]) == joint, factor, 1.0)


def _exchanged(values: Floats, i: int, j: int) -> Floats:
    order = list(range(values.shape[1]))
    order[i], order[j] = j, i
    return values[:, order]


def mistakes(
    log: Log, names: list[str], rng: np.random.Generator
) -> Iterator[tuple[str, Log, tuple[str, ...]]]:
    """Twelve mistakes: what was done, the log that it gives, and words that have to be in the finding."""
    n = len(names)
    first, second, third, fourth = rng.permutation(n)[:4]
    i, j = sorted(rng.permutation(n)[:2])
    k, m = sorted(rng.permutation(n)[:2])
    sign, exchanged = "sign of the", "exchanged"
    yield (
        "sign of a torque",
        Log(log.q, _flipped(log.tau, first)),
        (sign, "output", f"'{names[first]}'"),
    )
    yield (
        "sign of another torque",
        Log(log.q, _flipped(log.tau, second)),
        (sign, "output", f"'{names[second]}'"),
    )
    yield "signs of all torques", Log(log.q, -log.tau), ("signs of all outputs",)
    yield (
        "sign of a position",
        Log(_flipped(log.q, third), log.tau),
        (sign, "position", f"'{names[third]}'"),
    )
    yield (
        "sign of another position",
        Log(_flipped(log.q, fourth), log.tau),
        (sign, "position", f"'{names[fourth]}'"),
    )
    yield (
        "exchanged torques",
        Log(log.q, _exchanged(log.tau, i, j)),
        (exchanged, "output", names[i], names[j]),
    )
    yield (
        "exchanged positions",
        Log(_exchanged(log.q, k, m), log.tau),
        (exchanged, "position", names[k], names[m]),
    )
    yield (
        "one position in deg",
        Log(_flipped(log.q, first, np.degrees(1)), log.tau),
        ("degrees", names[first]),
    )
    yield (
        "one torque in mN·m",
        Log(log.q, _flipped(log.tau, second, 1e3)),
        ("mN·m", names[second]),
    )
    yield (
        "one torque in A",
        Log(log.q, _flipped(log.tau, fourth, 1 / 9)),
        ("are they currents", names[fourth]),
    )
    yield "all torques in mN·m", Log(log.q, 1e3 * log.tau), ("mN·m",)
    yield "half the rate", Log(log.q, log.tau, RATE / 2), ("rate is about",)


def identified(name: str, log: Log, folder: Path) -> ec.Identification:
    """What is made of a log."""
    n = log.q.shape[1]
    head = ",".join(
        [f"q_{k + 1}" for k in range(n)] + [f"tau_{k + 1}" for k in range(n)]
    )
    np.savetxt(
        folder / "log.csv",
        np.hstack([log.q, log.tau]),
        delimiter=",",
        header=head,
        comments="",
        fmt="%.9g",
    )
    effects = "[{type: viscous, at: all}, {type: coulomb, at: all}]"
    text = f"echelon: 1\nrobot: {{file: {urdf(name)}}}\neffects: {effects}\n"
    text += f"log: {{rate: {log.rate}, position: 'q_{{n}}', output: 'tau_{{n}}'}}\n"
    (folder / "setup.yaml").write_text(text)
    return ec.identify(ec.load_setup(folder / "setup.yaml"), [folder / "log.csv"])


def said(run: Callable[[], ec.Identification]) -> tuple[str, str]:
    """The finding about culprits, or the error that stops the run; and the verdict."""
    try:
        found = run()
    except ec.InputError as error:
        return str(error), "refused"
    culprits = [
        finding.text
        for finding in found.findings
        if finding.kind in ("culprit", "units", "gains")
    ]
    return " ".join(culprits), found.verdict


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--robots", nargs="*", default=list(ROBOTS))
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    rows, named, planted = [], 0, 0
    with TemporaryDirectory() as place:
        for name in chosen.robots:
            log, rng = simulated(name, chosen.seed), np.random.default_rng(chosen.seed)
            names = list(ec.load(urdf(name)).positions)
            begin = perf_counter()
            correct = identified(name, log, Path(place))
            distance = (
                correct.feasibility.distance if correct.feasibility else float("nan")
            )
            wrong = [
                finding.text
                for finding in correct.findings
                if finding.kind in ("culprit", "gains")
            ]
            seconds = perf_counter() - begin
            rows.append(
                [
                    name,
                    "none",
                    "named wrongly" if wrong else "",
                    f"{distance:.2g} σ",
                    f"{seconds:.1f}",
                ]
            )
            print(
                name,
                "none",
                wrong,
                f"{distance:.2g} σ",
                correct.verdict,
                f"{seconds:.1f} s",
                flush=True,
            )
            for what, changed, words in mistakes(log, names, rng):
                begin = perf_counter()
                text, verdict = said(
                    lambda changed=changed, name=name: identified(
                        name, changed, Path(place)
                    )
                )
                right = all(word in text for word in words)
                named, planted = named + right, planted + 1
                seconds = perf_counter() - begin
                rows.append(
                    [
                        name,
                        what,
                        "named" if right else "NOT named",
                        verdict[:60],
                        f"{seconds:.1f}",
                    ]
                )
                print(
                    name,
                    what,
                    "named" if right else f"NOT named: {text} | {verdict}",
                    f"{seconds:.1f} s",
                    flush=True,
                )
    print(table(["robot", "mistake", "", "verdict", "s"], rows))
    print(f"{named} of {planted} mistakes are named")


if __name__ == "__main__":
    main()
