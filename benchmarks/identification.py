"""Identification from logs: time by stage, memory, processes, and what a fleet's year would take.

python benchmarks/identification.py               an arm of seven joints, a million samples at 1 kHz
python benchmarks/identification.py --samples 200000 --repeats 1
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, process_time

import numpy as np

import echelon as ec
from echelon.identification.cluster import connect
from echelon.identification.identifying import identify
from echelon.identification.logs.preparation.prepare import Preparation
from echelon.identification.rows.rows import stacked
from echelon.identification.setup.setup import Setup, load_setup

ROOT = Path(__file__).parent.parent
RATE, JOINTS = 1000.0, 7
ROBOTS, SECONDS_A_YEAR = 10_000, 365.25 * 86400


def panda() -> Setup:
    """The arm with every choice of the preparation left to the data, and without a physical fit."""
    setup = load_setup(ROOT / "examples" / "logs" / "panda.yaml")
    return replace(setup, preparation=Preparation()).with_settings(physical=False)


def write_log(path: Path, samples: int, seed: int) -> None:
    """A simulated log with noise in positions, velocities and torques."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    base, rng = ec.base_parameters(panda().mechanism), np.random.default_rng(seed)
    t = np.arange(samples) / RATE
    q, qd, qdd = np.zeros((3, samples, JOINTS))
    for joint in range(JOINTS):
        for frequency in rng.uniform(0.05, 1.0, 6):
            w, phase = 2 * np.pi * frequency, rng.uniform(0, 2 * np.pi)
            size = rng.uniform(0.05, 0.35) / (1 + frequency)
            q[:, joint] += size * np.sin(w * t + phase)
            qd[:, joint] += size * w * np.cos(w * t + phase)
            qdd[:, joint] -= size * w**2 * np.sin(w * t + phase)
    y = base.predict(q, qd, qdd, np.random.default_rng(1).normal(size=base.rank))
    signals = {
        "q_rad": (q, 1e-5),
        "v_rads": (qd, 1e-3),
        "tau_J_Nm": (y, 0.02 * np.abs(y).mean(axis=0)),
    }
    columns = {"t_s": t}
    for name, (values, noise) in signals.items():
        noisy = values + noise * rng.standard_normal(values.shape)
        columns |= {f"{name}_{joint + 1}": noisy[:, joint] for joint in range(JOINTS)}
    pq.write_table(pa.table(columns), path)


def identified(log: str) -> None:
    """What a fresh process needs: once with all that is imported and compiled on first use, once warm."""
    found = []
    for _ in range(2):
        setup, stages = panda(), []
        begin, processor = perf_counter(), process_time()
        identify(
            setup,
            [log],
            on_step=lambda text, stages=stages: stages.append((text, perf_counter())),
        )
        ends = [time for _, time in stages[1:]] + [perf_counter()]
        seconds = {
            text: end - start for (text, start), end in zip(stages, ends, strict=True)
        }
        found.append(
            {
                "total": perf_counter() - begin,
                "processor": process_time() - processor,
                "stages": seconds,
            }
        )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(json.dumps({"first": found[0], "warm": found[1], "peak": peak}))


def one_log(folder: Path, samples: int, repeats: int) -> dict[str, float]:
    """Times of one long log, medians over fresh processes."""
    log = folder / "long.parquet"
    write_log(log, samples, seed=0)
    runs = []
    for _ in range(repeats):
        command = [sys.executable, __file__, "--identify", str(log)]
        runs.append(
            json.loads(
                subprocess.run(
                    command, check=True, capture_output=True, text=True
                ).stdout
            )
        )
    print(
        f"{samples} samples, {JOINTS} joints, {log.stat().st_size / 1e6:.0f} MB of Parquet, {repeats} runs (medians)"
    )
    for name in ("first", "warm"):
        total, processor = (
            float(np.median([run[name][key] for run in runs]))
            for key in ("total", "processor")
        )
        print(
            f"  {name + ' run of a process':<44}{total:8.2f} s, {processor:.2f} s of processor"
        )
    for stage in runs[0]["warm"]["stages"]:
        seconds = float(np.median([run["warm"]["stages"][stage] for run in runs]))
        print(f"    {stage:<42}{seconds:8.2f} s")
    print(f"  {'peak memory':<44}{np.median([run['peak'] for run in runs]):8.0f} MB")
    processor = float(np.median([run["warm"]["processor"] for run in runs]))
    return {"processor": processor / samples, "bytes": log.stat().st_size / samples}


def seconds_of(call: Callable[[], object]) -> float:
    begin = perf_counter()
    call()
    return perf_counter() - begin


def processes(folder: Path, logs: int, samples: int) -> None:
    """The same logs on one worker and on two; the first log warms workers up."""
    many = folder / "many"
    many.mkdir()
    for k in range(logs):
        write_log(many / f"run{k}.parquet", samples, seed=k)
    paths = sorted(many.iterdir())
    times = {}
    print(f"{logs} logs of {samples} samples on a local cluster")
    for workers in (1, 2):
        with connect(str(workers)) as client:
            identify(panda(), paths[:workers], paths[:1], client=client)
            times[workers] = seconds_of(
                lambda client=client: identify(panda(), paths, paths[:1], client=client)
            )
        print(
            f"  {workers} worker{'s' if workers > 1 else ' '}{'':<35}{times[workers]:8.2f} s"
        )
    print(f"  {'speed-up':<44}{times[1] / times[2]:8.2f}")


def merging(folder: Path) -> tuple[float, float]:
    """Seconds and bytes of one merge of two R-factors."""
    from echelon.identification.passes_over_data import PassesOverData
    from echelon.identification.rows.plan import LogPlan
    from echelon.identification.surveying import survey

    setup, log = panda(), next((folder / "many").iterdir())
    base = ec.base_parameters(setup.mechanism)
    plan = LogPlan(base, setup.columns, survey(setup, base, [log]).preparation)
    whole = PassesOverData(plan, [log]).observation
    seconds = float(
        np.median([seconds_of(lambda: stacked(whole, whole)) for _ in range(200)])
    )
    size = sum(R.nbytes for R in whole.factors)
    print(
        f"{base.rank} base parameters: two sets of R-factors ({size / 1e3:.0f} kB) are merged in {1e3 * seconds:.2f} ms"
    )
    return seconds, size


def fleet(cost: dict[str, float], merge: float, size: float) -> None:
    """What 10⁴ such robots would take that log for a year without a pause."""
    samples = ROBOTS * SECONDS_A_YEAR * RATE
    logs = ROBOTS * SECONDS_A_YEAR / 3600
    print(f"{ROBOTS} robots for a year at {RATE:g} Hz, a log an hour, by these figures")
    print(
        f"  {samples:.3g} samples, {samples * cost['bytes'] / 1e15:.0f} PB of Parquet, {logs:.3g} logs"
    )
    print(f"  {samples * cost['processor'] / 3600:.3g} hours of one processor")
    print(
        f"  merges: {logs * merge / 3600:.2g} hours of one processor, up to {logs * size / 1e12:.2g} TB to send"
    )
    print(f"  depth of the tree of one batch: {int(np.ceil(np.log2(logs / 40)))}")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(
        description="Identification from logs: time, memory, processes."
    )
    parser.add_argument("--samples", type=int, default=1_000_000)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--identify", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.identify:
        identified(options.identify)
        return
    print(f"{os.cpu_count()} processors")
    with TemporaryDirectory() as folder:
        cost = one_log(Path(folder), options.samples, options.repeats)
        processes(Path(folder), 8, options.samples // 8)
        fleet(cost, *merging(Path(folder)))


if __name__ == "__main__":
    main()
