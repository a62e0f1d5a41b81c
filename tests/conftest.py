"""Fixtures of the tests of machine code; and collection without the collector of garbage, which finds none."""

from __future__ import annotations

import gc
from collections.abc import Iterator

import pytest

from echelon.compute.machine import kernel
from echelon.compute.machine.target import Target, host
from support.small_kernels import LANES, Fences

# generated programs, which would be imported in search of examples
collect_ignore = ["goldens"]

gc.disable()  # a fifth of the time in which modules are imported and tests are found; all that they make stays


def pytest_collection_finish() -> None:
    gc.set_threshold(10_000)
    gc.enable()
    gc.freeze()


@pytest.fixture(params=LANES)
def target(request: pytest.FixtureRequest) -> Target:
    """The processor at hand with vectors of every width that it has."""
    return host(request.param)


@pytest.fixture(params=["cached", "big"])
def any_size(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> Iterator[str]:
    """Results are written as if they stayed in the caches, or as if they did not, whatever their size.

    The memory that kernels use stands between fences, and nothing is written beyond them.
    """
    monkeypatch.setattr(
        kernel, "_CACHED_BYTES", 0 if request.param == "big" else 1 << 60
    )
    fences = Fences()
    monkeypatch.setattr(kernel, "aligned", fences.aligned)
    yield request.param
    fences.check()
