"""Fixtures of the tests of machine code and of kernels for GPUs."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from importlib import import_module
from types import ModuleType

import pytest

import cupy_on_cpu
from echelon.machine import batch, kernel
from echelon.machine.target import Target, host
from kernels import LANES, Fences


@pytest.fixture(params=LANES)
def target(request: pytest.FixtureRequest) -> Target:
    """The processor at hand with vectors of every width that it has."""
    return host(request.param)


@pytest.fixture(params=["cached", "big"])
def any_size(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """Results are written as if they stayed in the caches, or as if they did not, whatever their size.

    The memory that kernels use stands between fences, and nothing is written beyond them.
    """
    monkeypatch.setattr(kernel, "_CACHED_BYTES", 0 if request.param == "big" else 1 << 60)
    fences = Fences()
    for module in (kernel, batch):
        monkeypatch.setattr(module, "aligned", fences.aligned)
    yield request.param
    fences.check()


def gpu_at_hand() -> bool:
    """Whether CuPy and a GPU are there."""
    try:
        return bool(import_module("cupy").cuda.is_available())
    except ImportError:
        return False


@pytest.fixture(params=["processor", "device"] if gpu_at_hand() else ["processor"])
def cupy(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """CuPy: a stand-in that runs kernels on the processor, and the real one where there is a GPU."""
    if request.param == "device":
        return import_module("cupy")
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    monkeypatch.setitem(sys.modules, "cupy", cupy_on_cpu.module())
    return sys.modules["cupy"]
