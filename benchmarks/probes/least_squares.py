"""Least squares over many samples of UR10: fused with generation, beside NumPy on a ready matrix.

python -m probes.least_squares samples repeats threads

The threads of NumPy's linear algebra are set by the environment of this process.
"""

from __future__ import annotations

import gc
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import echelon as ec
from ratios import Rounds, interleaved_rounds, timed
from robots import find_urdf

Floats = npt.NDArray[np.float64]

_NOISE = 0.01  # N·m
_STATUS = Path("/proc/self/status")
_RESET = Path("/proc/self/clear_refs")


def main() -> None:
    samples, repeats, threads = map(int, sys.argv[1:])
    base = ec.base_parameters(ec.load(find_urdf("ur10_robot.urdf")))
    rng = np.random.default_rng(1)
    q, qd, qdd = (rng.uniform(-a, a, (samples, 6)) for a in (3.0, 3.0, 10.0))
    values = rng.uniform(-1, 1, base.rank)
    y = base.predict(q, qd, qdd, values)
    y += _NOISE * rng.standard_normal(y.shape)

    log = {"q": q, "qd": qd, "qdd": qdd, "y": y}

    def fused() -> Floats:
        return base.accumulate(log, threads=threads).combined().solve()

    def fused_gram() -> Floats:
        return base.normal_equations(log, threads=threads).solve()

    grown = memory_growth(fused)
    W = np.empty((samples, 6, base.rank))
    base.regressor(q, qd, qdd, out=W)
    stacked, right = W.reshape(-1, base.rank), y.reshape(-1)
    found: dict[str, Floats] = {}

    def lstsq() -> None:
        found["lstsq"] = np.linalg.lstsq(stacked, right, rcond=None)[0]

    jobs = {"fused": timed(fused), "lstsq": timed(lstsq), "gram": timed(fused_gram)}
    rounds = interleaved_rounds({name: (1, job) for name, job in jobs.items()}, repeats)
    print(
        json.dumps(
            _results(rounds, found["lstsq"], fused(), stacked) | {"megabytes": grown}
        )
    )


def _results(
    rounds: Rounds, expected: Floats, ours: Floats, stacked: Floats
) -> dict[str, Any]:
    scales = np.sqrt(
        np.einsum("ij,ij->j", stacked, stacked)
    )  # parameters have several units
    return {
        "seconds": {
            name: rounds.per_sample(name).scaled(1e-9).as_dict()
            for name in rounds.seconds
        },
        "ratio": rounds.ratio("lstsq", "fused").as_dict(),
        "difference": float(
            np.linalg.norm(scales * (ours - expected))
            / np.linalg.norm(scales * expected)
        ),
        "W_gigabytes": round(stacked.nbytes / 1e9, 2),
    }


def memory_growth(job: Callable[[], Any]) -> float | None:
    """Megabytes by which a job's first run raises the peak of this process's memory; None where that is not known."""
    gc.collect()
    try:
        _RESET.write_text("5")  # forget the peak so far
        before = _kilobytes("VmRSS")
        job()
        return round((_kilobytes("VmHWM") - before) / 1000, 1)
    except OSError:
        return None


def _kilobytes(name: str) -> int:
    line = next(
        line for line in _STATUS.read_text().splitlines() if line.startswith(name)
    )
    return int(line.split()[1])


if __name__ == "__main__":
    main()
