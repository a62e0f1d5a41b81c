"""R-factors made on a GPU against those made on the processor."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import cupy_on_cpu
import echelon as ec
from echelon.errors import InputError
from echelon.gpu import Gpu, accumulate
from echelon.gpu.accumulate import DeviceObserver
from echelon.gpu.device import Device
from echelon.observe.observation import Observation
from echelon.observe.triangle import column_norms
from echelon.regressor.loops.assembly import Assembly
from observations import SERIAL, data_of, observer, random_problem, table
from oracles import random_states

EXAMPLES = Path(__file__).parent.parent / "examples"
Log = dict[str, Any]


@pytest.fixture
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of few rows, so that short logs need many levels, and blocks of few threads."""
    monkeypatch.setattr(accumulate, "_FEWEST_ROWS", 32)
    monkeypatch.setattr(accumulate, "_FACTORING", 64)


def same(found: Observation, wanted: Observation, tolerance: float = 1e-12) -> None:
    """Factors are equal up to rounding errors, with columns scaled to norm 1.

    Factors of outputs that do not determine their parameters alone are not unique, but RᵀR is.
    """
    assert found.layout == wanted.layout
    assert found.samples == wanted.samples
    for R, S in zip(found.factors, wanted.factors, strict=True):
        assert np.array_equal(R, np.triu(R))
        norms = column_norms(S)
        norms[norms <= 1e-12 * norms.max(initial=0)] = 1  # zeros, and entries that cancel to rounding errors
        R, S = R / norms, S / norms
        np.testing.assert_allclose(R.T @ R, S.T @ S, rtol=0, atol=tolerance)
        if np.linalg.cond(S) < 1e3:
            np.testing.assert_allclose(R, S, rtol=0, atol=tolerance)
    R, S = found.combined().R, wanted.combined().R
    if np.linalg.matrix_rank(S) == len(S):
        np.testing.assert_allclose(R, S, rtol=0, atol=1e-11 * np.abs(S).max(initial=0))


def log_of(base: ec.BaseModel, samples: int, seed: int = 0) -> Log:
    q, qd, qdd = random_states(base.mechanism, samples)
    y = np.random.default_rng(seed).normal(size=(samples, len(base.mechanism.outputs)))
    return {"q": q, "qd": qd, "qdd": qdd, "y": y}


def cut(log: Mapping[str, Any], *ends: int) -> list[Log]:
    edges = [0, *ends, len(log["y"])]
    return [{k: v[a:b] for k, v in log.items()} for a, b in pairwise(edges)]


@pytest.fixture(scope="module")
def panda() -> ec.BaseModel:
    return ec.base_parameters(ec.load(EXAMPLES / "panda.yaml"))


@pytest.mark.usefixtures("cupy", "short_chunks")
@pytest.mark.parametrize("samples", [0, 1, 9, 10, 63, 64, 65, 640, 3001])
def test_any_number_of_samples(samples: int) -> None:
    W, _, y = random_problem(np.random.default_rng(1), samples, SERIAL)
    data = data_of(W, y, SERIAL)
    found = DeviceObserver(table(SERIAL), Device())(data, block=1000)
    same(found, observer(SERIAL, method="numpy")(data))


@pytest.mark.usefixtures("cupy")
@pytest.mark.parametrize("name", ["panda", "tx40", "floating_tree"])
def test_robots(name: str) -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / f"{name}.yaml"))
    log = log_of(base, 1500)
    found = Gpu(base).accumulate(log)
    same(found, base.accumulate(log))
    same(Gpu(base).accumulate(log, block=700), found)


@pytest.mark.usefixtures("cupy", "short_chunks")
def test_levels_blocks_and_solution() -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "double_pendulum.yaml"))
    log = log_of(base, 5000)
    values = np.arange(1.0, base.rank + 1)
    log["y"] = base.predict(log["q"], log["qd"], log["qdd"], values)
    found = Gpu(base).accumulate(log, block=2048)
    same(found, base.accumulate(log))
    np.testing.assert_allclose(found.combined().solve(), values, rtol=1e-11)


@pytest.mark.usefixtures("short_chunks")
def test_pieces_do_not_change_a_bit(cupy: ModuleType) -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / "double_pendulum.yaml"))
    log, gpu = log_of(base, 900), Gpu(base)
    wanted = gpu.accumulate(log, block=200)
    sent = {name: cupy.asarray(array) for name, array in log.items()}
    mixed = [
        dict(zip(p, map(cupy.asarray, p.values()), strict=True)) if k % 2 else p
        for k, p in enumerate(cut(log, 30, 599))
    ]
    for pieces in (log, cut(log, 1, 199, 200, 201, 700), iter(cut(log, 450, 450)), sent, cut(sent, 333), mixed):
        found = gpu.accumulate(pieces, block=200)
        assert all(np.array_equal(R, S) for R, S in zip(found.factors, wanted.factors, strict=True))
        assert found.samples == 900


@pytest.mark.usefixtures("cupy")
def test_merges_with_the_processor(panda: ec.BaseModel) -> None:
    log = log_of(panda, 600)
    first, second = cut(log, 250)
    same(Gpu(panda).accumulate(first) + panda.accumulate(second), panda.accumulate(log))


@pytest.mark.usefixtures("cupy", "short_chunks")
def test_threads_may_run_in_any_order(panda: ec.BaseModel, monkeypatch: pytest.MonkeyPatch) -> None:
    log = log_of(panda, 300)
    wanted = Gpu(panda).accumulate(log)
    monkeypatch.setattr(cupy_on_cpu, "backwards", True)
    found = Gpu(panda).accumulate(log)
    assert all(np.array_equal(R, S) for R, S in zip(found.factors, wanted.factors, strict=True))


@pytest.mark.usefixtures("cupy", "short_chunks")
@pytest.mark.parametrize("kind", ["zero column", "equal columns", "small", "large", "zeros"])
def test_hard_matrices(kind: str) -> None:
    W, _, y = random_problem(np.random.default_rng(4), 500, SERIAL)
    if kind == "zero column":
        W[:, :, 4] = 0
    elif kind == "equal columns":
        W[:, :, 5] = W[:, :, 4]
    elif kind == "zeros":
        W[:], y[:] = 0, 0
    else:
        W *= {"small": 1e-300, "large": 1e300}[kind]
    data = data_of(W, y, SERIAL)
    found = DeviceObserver(table(SERIAL), Device())(data)
    for output, R in enumerate(found.factors):
        columns = [*found.layout.columns[output]]
        whole = np.column_stack([W[:, output, columns], y[:, output]])
        sizes = np.where(np.abs(whole).max(axis=0), np.abs(whole).max(axis=0), 1)
        scaled = whole / sizes
        np.testing.assert_allclose((R / sizes).T @ (R / sizes), scaled.T @ scaled, rtol=0, atol=1e-11 * 500)


@pytest.mark.usefixtures("cupy")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("name", "sample", "column"), [("q", 0, 6), ("qdd", 299, 0), ("y", 277, 3), ("y", 205, 6)])
def test_values_that_are_not_finite(name: str, sample: int, column: int, value: float, panda: ec.BaseModel) -> None:
    log = log_of(panda, 300)
    log[name][sample, column] = value
    with pytest.raises(InputError) as wanted:
        panda.accumulate(log)
    with pytest.raises(InputError) as found:
        Gpu(panda).accumulate(log, block=100)
    assert str(found.value) == str(wanted.value)
    assert f"in sample {sample};" in str(found.value)


@pytest.mark.parametrize("name", ["four_bar", "delta"])
def test_loops(name: str, cupy: ModuleType) -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / f"loops/{name}.yaml"))
    states = Assembly(base.mechanism).random_closed_states(np.random.default_rng(3), 60)
    log = dict(zip(("q", "qd", "qdd"), states, strict=True))
    log["y"] = np.random.default_rng(5).normal(size=(60, len(base.mechanism.outputs)))
    wanted = base.accumulate(log)
    same(Gpu(base).accumulate(log, block=32), wanted)
    same(Gpu(base).accumulate({k: cupy.asarray(v) for k, v in log.items()}), wanted)


@pytest.mark.usefixtures("cupy")
def test_measured_inputs(tmp_path: Path, cupy: ModuleType) -> None:
    text = (EXAMPLES / "double_pendulum.yaml").read_text()
    text += "effects:\n  - {parameter: Kt, unit: N·m/A, acts: [{at: j1, term: i}]}\n"
    (tmp_path / "robot.yaml").write_text(text, encoding="utf-8")
    base = ec.base_parameters(ec.load(tmp_path / "robot.yaml"))
    current = np.random.default_rng(6).normal(size=90)
    log = log_of(base, 90) | {"inputs": {"j1": current}}
    same(Gpu(base).accumulate(log), base.accumulate(log))
    same(Gpu(base).accumulate(log | {"inputs": {"j1": cupy.asarray(current)}}), base.accumulate(log))


@pytest.mark.usefixtures("cupy")
def test_wrong_logs(panda: ec.BaseModel) -> None:
    gpu, log = Gpu(panda), log_of(panda, 10)
    with pytest.raises(InputError, match=r"y has shape \(10, 6\); expected \(samples, 7\)"):
        gpu.accumulate(log | {"y": log["y"][:, :6]})
    with pytest.raises(InputError, match="y is missing"):
        gpu.accumulate({name: log[name] for name in ("q", "qd", "qdd")})
    with pytest.raises(InputError, match="block is 0"):
        gpu.accumulate(log, block=0)
    with pytest.raises(InputError, match="normal equations are not made on the GPU"):
        DeviceObserver(table(SERIAL), Device()).normal_equations({})


@pytest.mark.usefixtures("cupy")
def test_blocks_have_a_size_in_memory(panda: ec.BaseModel, monkeypatch: pytest.MonkeyPatch) -> None:
    engine = Gpu(panda)._observer.engine
    assert engine.block == 65_536
    monkeypatch.setattr(accumulate, "_SCRATCH", 1 << 22)
    assert 1024 <= engine.block < 4096
    monkeypatch.setattr(accumulate, "_SCRATCH", 1)
    assert engine.block == 512


@pytest.mark.usefixtures("short_chunks")
def test_memory_is_constant(cupy: ModuleType) -> None:
    if cupy.ndarray is not cupy_on_cpu.ndarray:
        pytest.skip("memory is counted on the processor only")
    usage, most = cupy_on_cpu.Usage, []
    for samples in (1000, 4000):
        W, _, y = random_problem(np.random.default_rng(1), samples, SERIAL)
        usage.most = before = usage.now
        DeviceObserver(table(SERIAL), Device())(data_of(W, y, SERIAL), block=200)
        most.append(usage.most - before)
    assert most[0] == most[1] < 4000 * 8 * 18
