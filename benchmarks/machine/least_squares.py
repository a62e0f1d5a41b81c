"""Least squares: fused with the generation of W, beside NumPy; and what remains of the digits on bad data."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from anchors.process import probe
from machine.cases import Case, urdf_case
from machine.throughput import THREADS

Floats = npt.NDArray[np.float64]

_SAMPLES = 1_000_000
_QUICK_SAMPLES = 20_000
# W, NumPy's copy of it and the states
_BYTES_PER_SAMPLE = 2.5 * 6 * 36 * 8 + 4 * 6 * 8
_POOLS = (
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "OMP_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)

_BITS = 400
_AMPLITUDES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4)
_STATES = 300


def speed(
    quick: bool, repeats: int, report: Callable[[str], None]
) -> list[dict[str, Any]]:
    """Seconds from states and torques to base parameters, on one thread and on all."""
    samples = (
        _QUICK_SAMPLES
        if quick
        else min(_SAMPLES, int(_free_bytes() / _BYTES_PER_SAMPLE))
    )
    rows = []
    for threads in dict.fromkeys((1, THREADS)):
        report(f"least squares on {threads} threads")
        pools = dict.fromkeys(_POOLS, str(threads))
        found = probe(
            "least_squares", str(samples), str(repeats), str(threads), environment=pools
        )
        rows.append({"samples": samples, "threads": threads} | found)
    return rows


def _free_bytes() -> float:
    try:
        return 0.8 * os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (ValueError, OSError):
        return 8e9


def bad_data(report: Callable[[str], None]) -> list[dict[str, Any]]:
    """Errors of three methods where motions become small, against the solution in high precision."""
    report("least squares on bad data")
    case = urdf_case("ur10", "UR10", "ur10_robot.urdf")
    return [_bad_row(case, amplitude) for amplitude in _AMPLITUDES]


def _bad_row(case: Case, amplitude: float) -> dict[str, Any]:
    base = case.base
    rng = np.random.default_rng(1)
    q, qd, qdd = (amplitude * part for part in case.states(_STATES))
    q = q + rng.uniform(-1, 1, q.shape[1])
    W = base.regressor(q, qd, qdd).reshape(-1, base.rank)
    y = W @ rng.uniform(0.5, 1.5, base.rank)
    scales = 2.0 ** np.round(
        np.log2(np.linalg.norm(W, axis=0))
    )  # powers of two scale without rounding
    truth, scaled = _exact_solution(W, y) * scales, W / scales
    log = {"q": q, "qd": qd, "qdd": qdd, "y": y.reshape(-1, case.outputs)}
    methods = {
        "fused QR": base.accumulate(log).combined().solve() * scales,
        "lstsq": np.linalg.lstsq(scaled, y, rcond=None)[0],
        "normal equations": np.linalg.solve(scaled.T @ scaled, scaled.T @ y),
    }
    errors = {
        name: float(np.linalg.norm(x - truth) / np.linalg.norm(truth))
        for name, x in methods.items()
    }
    return {
        "amplitude": amplitude,
        "condition": float(np.linalg.cond(scaled)),
        "errors": errors,
    }


def _exact_solution(W: Floats, y: Floats) -> Floats:
    """The least-squares solution for exactly these numbers, by normal equations with so many bits that none matters."""
    from flint import arb_mat, ctx

    precision, ctx.prec = ctx.prec, _BITS
    try:
        A, b = arb_mat(W.tolist()), arb_mat([[value] for value in y.tolist()])
        transposed = A.transpose()
        solution = (transposed * A).solve(transposed * b)
        return np.array([float(solution[i, 0]) for i in range(W.shape[1])])
    finally:
        ctx.prec = precision
