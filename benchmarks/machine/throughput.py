"""Regressors of many samples, from Python into a reused array, beside Pinocchio in C++, FIGAROH and the bare memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt

from anchors.build import UnavailableError
from anchors.figaroh_tool import regressor_builder
from anchors.memory import aligned, write_seconds
from machine.cases import Case, States, arms, humanoid
from ratios import Rounds, Timer, interleaved_rounds, settled, timed

Floats = npt.NDArray[np.float64]
Timers = dict[str, tuple[int, Timer]]

# so many that no cache holds W: 0.7, 0.5 and 0.5 GB in base columns
_SAMPLES = {"ur10": 400_000, "panda": 200_000, "talos": 10_000}
_QUICK = 20
_FIGAROH = 20  # it works on one sample of so many

THREADS = os.cpu_count() or 1
ONE, ALL = "1 thread", f"{THREADS} threads"
_THREADS = {ONE: 1} | ({ALL: THREADS} if THREADS > 1 else {})

JOBS = {
    "pinocchio": "Pinocchio C++ into W",
    "figaroh": "FIGAROH",
    "dense": "dense base W, reused `out`",
    "fresh": "dense base W, a fresh array",
    "entries": "entries that are not structurally zero",
    "standard": "dense standard W, reused `out`",
    "predict": "outputs from base parameters",
    "rnea": "Pinocchio C++ RNEA",
    "write": "filling an array as large as the dense base W",
}
RATIOS = (
    ("pinocchio", "dense"),
    ("pinocchio", "fresh"),
    ("pinocchio", "entries"),
    ("pinocchio", "standard"),
    ("figaroh", "dense"),
    ("rnea", "predict"),
    ("dense", "write"),
)


def measured(
    quick: bool, repeats: int, report: Callable[[str], None]
) -> list[dict[str, Any]]:
    """One row for each robot."""
    return [
        _row(case, quick, repeats) for case in _announced([*arms(), humanoid()], report)
    ]


def _announced(cases: Iterable[Case], report: Callable[[str], None]) -> Iterable[Case]:
    for case in cases:
        report(f"regressors of {case.label}")
        yield case


def _row(case: Case, quick: bool, repeats: int) -> dict[str, Any]:
    samples = _SAMPLES[case.name] // (_QUICK if quick else 1)
    rounds = interleaved_rounds(_timers(case, samples), repeats)
    base, shape = case.base, (case.outputs, case.base.rank)
    return {
        "robot": case.label,
        "name": case.name,
        "samples": samples,
        "shape": shape,
        "standard": len(base.parameters),
        "entries": _entries(case),
        "megabytes": round(samples * 8 * shape[0] * shape[1] / 1e6),
        "ns": {name: rounds.per_sample(name).as_dict() for name in rounds.seconds},
        "ratios": _ratios(rounds),
        "skipped": case.skipped,
    }


def _entries(case: Case) -> int:
    return int(case.base.sparsity.shape[1])


def _ratios(rounds: Rounds) -> dict[str, dict[str, float]]:
    found = {}
    for slower, faster in RATIOS:
        for threads in _THREADS:
            names = [
                name
                for name in (f"{slower}, {threads}", f"{faster}, {threads}")
                if name in rounds.seconds
            ]
            if len(names) == len((slower, faster)):
                found[f"{slower} : {faster}, {threads}"] = rounds.ratio(
                    *names
                ).as_dict()
    return found


def _timers(case: Case, samples: int) -> Timers:
    states, base = case.states(samples), case.base
    # one array in turn for all who fill one, so that all meet the same pages
    space = aligned((samples * case.outputs * len(base.parameters),))

    def array(*shape: int) -> Floats:
        return space[: int(np.prod(shape))].reshape(shape)

    dense = array(samples, case.outputs, base.rank)
    standard = array(samples, case.outputs, len(base.parameters))
    entries = array(samples, _entries(case))
    torques = np.zeros((samples, case.outputs))
    values = np.random.default_rng(2).uniform(-1, 1, base.rank)
    timers = _figaroh(case, states)
    for text, t in _THREADS.items():
        # jobs whose ratio counts stand side by side
        jobs: Timers = {
            "dense": (
                samples,
                timed(lambda t=t: base.regressor(*states, out=dense, threads=t)),
            ),
            **_pinocchio(case, states, standard, t),
            "entries": (
                samples,
                timed(
                    lambda t=t: base.regressor_entries(*states, out=entries, threads=t)
                ),
            ),
            "standard": (
                samples,
                timed(
                    lambda t=t: base.standard_regressor(
                        *states, out=standard, threads=t
                    )
                ),
            ),
            "predict": (
                samples,
                timed(
                    lambda t=t: base.predict(*states, values, out=torques, threads=t)
                ),
            ),
            **(_rnea(case, states, torques) if t == 1 else {}),
            **_write(case, dense, t),
            "fresh": (samples, timed(lambda t=t: base.regressor(*states, threads=t))),
        }
        timers |= {f"{name}, {text}": _job(name, *job) for name, job in jobs.items()}
    return timers


def _job(name: str, samples: int, timer: Timer) -> tuple[int, Timer]:
    """All but those who want new memory begin with the array in its place, whoever ran before them."""
    return samples, timer if name == "fresh" else settled(timer)


def _pinocchio(case: Case, states: States, out: Floats, threads: int) -> Timers:
    robot, theirs = case.cpp, case.theirs(states)
    return (
        {"pinocchio": (len(out), lambda: robot.regressor(theirs, out, threads))}
        if robot
        else {}
    )


def _rnea(case: Case, states: States, out: Floats) -> Timers:
    robot, theirs = case.cpp, case.theirs(states)
    return {"rnea": (len(out), lambda: robot.rnea(theirs, out))} if robot else {}


def _write(case: Case, out: Floats, threads: int) -> Timers:
    return (
        {"write": (len(out), lambda: write_seconds(out.reshape(-1), threads))}
        if case.cpp
        else {}
    )


def _figaroh(case: Case, states: States) -> Timers:
    count = -(-len(states[0]) // _FIGAROH)
    q, qd, qdd = (np.ascontiguousarray(part[:count]) for part in case.theirs(states))
    try:
        build = regressor_builder(case.model)
    except UnavailableError as error:
        case.skipped.append(str(error))
        return {}
    return {f"figaroh, {ONE}": (count, timed(lambda: build(q, qd, qdd)))}
