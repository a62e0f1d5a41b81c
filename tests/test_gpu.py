"""Batches on a GPU against machine code; kernels run on the processor everywhere, and on a GPU where there is one."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import arms
import cupy_on_cpu
import echelon as ec
from conftest import gpu_at_hand
from echelon.codegen.numbers import Precision
from echelon.errors import InputError, MissingExtraError
from echelon.gpu import Gpu, batches
from echelon.gpu.batches import DeviceFunction
from echelon.gpu.device import Device
from echelon.program.function import Argument, Function
from echelon.program.tape import Program
from echelon.regressor.loops.assembly import Assembly
from oracles import random_states
from test_dynamics import EVERYTHING, SENSORS

EXAMPLES = Path(__file__).parent.parent / "examples"
CURRENT = np.random.default_rng(8).normal(size=300)
MODELS: dict[str, Callable[[], ec.Mechanism]] = {
    "double pendulum": lambda: ec.load(EXAMPLES / "double_pendulum.yaml"),
    "panda": lambda: ec.load(EXAMPLES / "panda.yaml"),
    "floating tree": lambda: ec.load(EXAMPLES / "floating_tree.yaml"),
    "actuators, rotors and friction": lambda: ec.load(EXAMPLES / "tx40.yaml"),
    "nothing to identify": arms.rigid,
}


def close(found: Any, wanted: npt.NDArray[np.float64], tolerance: float = 1e-12) -> None:
    """Equal up to rounding errors relative to the largest value."""
    assert found.shape == wanted.shape
    np.testing.assert_allclose(found, wanted, rtol=0, atol=tolerance * max(np.abs(wanted).max(initial=0), 1))


def state_of(mechanism: ec.Mechanism, samples: int) -> dict[str, npt.NDArray[np.float64]]:
    return dict(zip(("q", "qd", "qdd"), random_states(mechanism, samples), strict=True))


@pytest.fixture(scope="module")
def panda() -> ec.BaseModel:
    return ec.base_parameters(MODELS["panda"]())


@pytest.mark.parametrize("samples", [1, 33, 128, 129])
@pytest.mark.parametrize("name", MODELS)
def test_regressors(name: str, samples: int, cupy: ModuleType) -> None:
    base = ec.base_parameters(MODELS[name]())
    gpu, state = Gpu(base), state_of(base.mechanism, samples)
    found = gpu.regressor(**state)
    assert isinstance(found, cupy.ndarray)
    close(cupy.asnumpy(found), base.regressor(**state))
    entries = gpu.regressor_entries(**state)
    assert entries.T.flags.c_contiguous
    if base.rank:
        close(cupy.asnumpy(entries), base.regressor_entries(**state))


@pytest.mark.parametrize("name", ["panda", "floating tree", "actuators, rotors and friction"])
def test_functions(name: str, cupy: ModuleType) -> None:
    base = ec.base_parameters(MODELS[name]())
    gpu, state = Gpu(base), state_of(base.mechanism, 40)
    values = np.random.default_rng(2).normal(size=base.rank)
    close(cupy.asnumpy(gpu.predict(**state, values=values)), base.predict(**state, values=values))
    q, qd = state["q"], state["qd"]
    wanted = {
        "gravity": base.gravity(q, values),
        "coriolis": base.coriolis(q, qd, values),
        "effects": base.effects(q, qd, values),
        "mass_matrix": base.mass_matrix(q, values),
        "inverse_dynamics_derivatives": np.dstack(base.inverse_dynamics_derivatives(**state, values=values)),
    }
    for function, result in wanted.items():
        close(cupy.asnumpy(gpu.evaluate(function, {**state, "parameters": values})), result)


def test_measured_inputs_and_sensors(tmp_path: Path, cupy: ModuleType) -> None:
    (tmp_path / "robot.yaml").write_text(EVERYTHING + SENSORS, encoding="utf-8")
    base = ec.base_parameters(ec.load(tmp_path / "robot.yaml"))
    state = state_of(base.mechanism, 50)
    wanted = base.regressor(**state, inputs={"j1": CURRENT[:50]})
    for current in (CURRENT[:50], cupy.asarray(CURRENT[:50])):
        close(cupy.asnumpy(Gpu(base).regressor(**state, inputs={"j1": current})), wanted)
    with pytest.raises(InputError, match=r"the measured input i\[j1\] is needed"):
        Gpu(base).regressor(**state)


def test_symbols(cupy: ModuleType) -> None:
    base = ec.base_parameters(MODELS["double pendulum"]())
    gpu, state = Gpu(base), state_of(base.mechanism, 5)
    close(cupy.asnumpy(gpu.regressor(**state, symbols={"l1": 2.5})), base.regressor(**state, symbols={"l1": 2.5}))


@pytest.mark.parametrize("name", ["four_bar", pytest.param("delta", marks=pytest.mark.slow)])
def test_loops(name: str, cupy: ModuleType) -> None:
    base = ec.base_parameters(ec.load(EXAMPLES / f"loops/{name}.yaml"))
    states = Assembly(base.mechanism).random_closed_states(np.random.default_rng(3), 20)
    state = dict(zip(("q", "qd", "qdd"), states, strict=True))
    gpu, values = Gpu(base), np.random.default_rng(2).normal(size=base.rank)
    close(cupy.asnumpy(gpu.regressor(**state)), base.regressor(**state))
    sent = {name: cupy.asarray(array) for name, array in state.items()}
    close(cupy.asnumpy(gpu.predict(**sent, values=values)), base.predict(**state, values=values))
    close(cupy.asnumpy(gpu.regressor_entries(**state)), base.regressor_entries(**state))
    mass = gpu.evaluate("mass_matrix", {**sent, "parameters": values})
    close(cupy.asnumpy(mass), base.mass_matrix(state["q"], values))


def test_arrays_on_the_device(panda: ec.BaseModel, cupy: ModuleType) -> None:
    state = state_of(panda.mechanism, 60)
    wanted = panda.regressor(**state)
    gpu = Gpu(panda)
    out = cupy.empty(wanted.shape)
    sent = {
        "q": cupy.asarray(state["q"]),
        "qd": cupy.asarray(state["qd"].T.copy()).T,
        "qdd": state["qdd"][:, ::-1][:, ::-1],
    }
    assert gpu.regressor(**sent, out=out) is out
    close(cupy.asnumpy(out), wanted)
    wide = cupy.asarray(np.hstack([state["q"], state["q"]]))
    close(cupy.asnumpy(gpu.regressor(wide[:, :7], state["qd"].tolist(), state["qdd"])), wanted)
    close(cupy.asnumpy(gpu.regressor(*(array[3] for array in state.values()))), wanted[3:4])
    assert gpu.regressor(*(array[:0] for array in state.values())).shape == (0, *wanted.shape[1:])


def test_blocks(panda: ec.BaseModel, cupy: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(batches, "_SCRATCH", 1)
    monkeypatch.setattr(batches, "_FEWEST", 96)
    state = state_of(panda.mechanism, 250)
    close(cupy.asnumpy(Gpu(panda).regressor(**state)), panda.regressor(**state))


@pytest.mark.parametrize("name", ["double pendulum", "floating tree"])
def test_single_precision(name: str, cupy: ModuleType) -> None:
    base = ec.base_parameters(MODELS[name]())
    gpu, state = Gpu(base, "single"), state_of(base.mechanism, 70)
    state = {name: array.astype(np.float32).astype(float) for name, array in state.items()}
    found = gpu.regressor(**state)
    assert found.dtype == np.float32
    close(cupy.asnumpy(found), base.regressor(**state), 1e-5)
    values = np.ones(base.rank, dtype=np.float32)
    close(cupy.asnumpy(gpu.predict(**state, values=values)), base.predict(**state, values=values), 1e-5)
    assert repr(gpu).endswith("single precision)")


def test_structural_zeros_and_wide_rows(cupy: ModuleType) -> None:
    program = Program()
    x = program.input("x")
    argument = Argument("x", (x.node,), ("x",), ("m",))
    places = [(i, j) for i in range(5) for j in range(13) if (i * j) % 3 == 1]
    entries = {(i, j): (x * (13 * i + j)).node for i, j in places}
    axes = (tuple("abcde"), tuple(f"p{k}" for k in range(13)))
    made = DeviceFunction(Device(), Function("table", program, (argument,), entries, axes), Precision.DOUBLE)
    values = np.linspace(1, 2, 70)
    wanted = np.zeros((70, 5, 13))
    for i, j in places:
        wanted[:, i, j] = values * (13 * i + j)
    np.testing.assert_array_equal(cupy.asnumpy(made({"x": values[:, None]})), wanted)


def test_threads_may_run_in_any_order(panda: ec.BaseModel, cupy: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    state = state_of(panda.mechanism, 100)
    found = cupy.asnumpy(Gpu(panda).regressor(**state))
    monkeypatch.setattr(cupy_on_cpu, "backwards", True)
    np.testing.assert_array_equal(cupy.asnumpy(Gpu(panda).regressor(**state)), found)


def test_device() -> None:
    if not gpu_at_hand():
        pytest.skip("no CuPy or no GPU: kernels were run on the processor only")


def test_wrong_arguments(panda: ec.BaseModel, cupy: ModuleType) -> None:
    gpu, state = Gpu(panda), state_of(panda.mechanism, 11)
    q, qd, qdd = state.values()
    with pytest.raises(InputError, match=r"q has shape \(11, 6\); expected \(samples, 7\): j1, j2"):
        gpu.regressor(q[:, :6], qd, qdd)
    with pytest.raises(InputError, match="different numbers of samples: q 11, qd 11, qdd 4"):
        gpu.regressor(q, cupy.asarray(qd), qdd[:4])
    with pytest.raises(InputError, match=r"parameters has shape \(42,\); expected \(43,\): ZZ1, "):
        gpu.predict(q, qd, qdd, cupy.asarray(np.ones(42)))
    with pytest.raises(InputError, match="parameters is missing"):
        gpu.evaluate("gravity", {"q": q})
    with pytest.raises(InputError, match="q holds complex128 values"):
        gpu.regressor(cupy.asarray(q * 1j), qd, qdd)
    with pytest.raises(InputError, match="there is no function 'weight'"):
        gpu.evaluate("weight", state)
    with pytest.raises(InputError, match=r"there is no precision 'half' \(valid: double, single\)"):
        Gpu(panda, "half")


def test_wrong_out(panda: ec.BaseModel, cupy: ModuleType) -> None:
    gpu, state = Gpu(panda), state_of(panda.mechanism, 11)
    with pytest.raises(InputError, match="out is a ndarray; expected a CuPy array"):
        gpu.regressor(**state, out=np.zeros((11, 7, 43)))
    with pytest.raises(InputError, match=r"out has shape \(11, 7, 42\) and type float64; expected \(11, 7, 43\)"):
        gpu.regressor(**state, out=cupy.empty((11, 7, 42)))
    with pytest.raises(InputError, match="C-contiguous"):
        gpu.regressor(**state, out=cupy.empty((43, 7, 11)).T)
    both = cupy.asarray(state["q"])
    with pytest.raises(InputError, match="out overlaps an input"):
        gpu.predict(both, state["qd"], state["qdd"], np.ones(43), out=both)


def test_without_cupy(panda: ec.BaseModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cupy", None)
    with pytest.raises(MissingExtraError, match=r"'cupy': install it with  pip install 'echelon\[cuda\]'"):
        Gpu(panda)


@pytest.mark.parametrize(
    ("module", "reason"),
    [
        (cupy_on_cpu.module(0), "CUDA finds no device"),
        (cupy_on_cpu.module(error=RuntimeError("cudaErrorInsufficientDriver")), "cudaErrorInsufficientDriver"),
    ],
)
def test_without_device(module: ModuleType, reason: str, panda: ec.BaseModel, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cupy", module)
    with pytest.raises(InputError, match=f"no GPU can be used: {reason}"):
        Gpu(panda)


def test_copies_say_the_same(panda: ec.BaseModel, cupy: ModuleType) -> None:
    """Also after use, when they hold kernels and memory of the device."""
    gpu, state = Gpu(panda, "single"), state_of(panda.mechanism, 40)
    wanted, y = cupy.asnumpy(gpu.regressor(**state)), np.zeros((40, 7))
    factors = gpu.accumulate({**state, "y": y}).factors
    for copied in (pickle.loads(pickle.dumps(gpu)), deepcopy(gpu)):
        assert repr(copied) == repr(gpu)
        np.testing.assert_array_equal(cupy.asnumpy(copied.regressor(**state)), wanted)
        np.testing.assert_equal(copied.accumulate({**state, "y": y}).factors, factors)
