"""Without LLVM, NumPy gives the same numbers, and says so where that takes long."""

from __future__ import annotations

import numpy as np
import pytest

from echelon.algebra.program.tape import Scalar
from echelon.compute.machine import kernel
from echelon.compute.machine.kernel import Columns, Kernel, batch
from echelon.shared.errors import SlowWarning
from support.small_kernels import function

SAMPLES = 1000


def record(
    x: list[Scalar], v: list[Scalar], p: list[Scalar]
) -> dict[tuple[int, ...], Scalar]:
    """A matrix with a structural zero, a constant, and the same value twice."""
    wave = x[0].sin() * v[0] + p[0] * p[1]
    return {
        (0, 0): wave,
        (0, 2): x[1].program.one,
        (1, 0): v[1] / p[1],
        (1, 1): wave,
        (1, 2): (x[1] * v[0]).tanh(),
    }


MADE = function(record, {"x": 2, "v": 2}, {"p": 2}, shape=(2, 3))
RNG = np.random.default_rng(3)
VALUES = {
    "x": RNG.normal(size=(SAMPLES, 2)),
    "v": RNG.normal(size=(SAMPLES, 2)),
    "p": np.array([0.7, -1.2]),
}


@pytest.fixture
def no_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel, "compiles", lambda: False)
    monkeypatch.setattr(kernel, "_TOGETHER", 1 << 10)  # several pieces


@pytest.mark.parametrize("sparse", [False, True])
def test_results_are_those_of_machine_code(
    sparse: bool, request: pytest.FixtureRequest
) -> None:
    compiled = Kernel(MADE, sparse=sparse)(VALUES)
    request.getfixturevalue("no_compiler")
    run = Kernel(MADE, sparse=sparse)
    out = np.full_like(compiled, np.nan)
    assert run(VALUES, out) is out
    np.testing.assert_allclose(out, compiled, rtol=0, atol=1e-14)
    assert run({**VALUES, "x": np.zeros((0, 2)), "v": np.zeros((0, 2))}).shape == (
        0,
        *run.shape,
    )
    assert repr(run).endswith("NumPy)")


def test_columns_are_those_of_machine_code(request: pytest.FixtureRequest) -> None:
    given = batch(MADE.arguments, VALUES)
    compiled = np.concatenate(
        [block.copy() for block in Columns(MADE, 384)(given)], axis=1
    )
    request.getfixturevalue("no_compiler")
    np.testing.assert_allclose(
        np.concatenate([*Columns(MADE, 384)(given)], axis=1),
        compiled,
        rtol=0,
        atol=1e-14,
    )


@pytest.mark.usefixtures("no_compiler")
def test_what_takes_long_says_how_to_make_it_fast(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    Kernel(MADE)(VALUES)  # warnings are errors here
    monkeypatch.setattr(kernel, "_LARGE", SAMPLES)
    with pytest.warns(SlowWarning, match=r'pip install "echelon-robotics\[fast\]"'):
        Kernel(MADE)(VALUES)
