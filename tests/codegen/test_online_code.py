"""Generated recursive least squares agrees with that in Python and with the batch."""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import echelon as ec
from echelon.codegen.source import generate
from echelon.identification.estimators.least_squares import wls
from support.generated_code import WARNINGS, compiled
from support.paths import ROOT
from support.selection import slow_unless
from support.system_tools import tool


@cache
def base_of(name: str) -> ec.BaseModel:
    return ec.base_parameters(ec.load(ROOT / f"examples/{name}.yaml"))


class Generated:
    """The functions of one build."""

    def __init__(
        self, base: ec.BaseModel, folder: Path, precision: str = "double"
    ) -> None:
        self.dtype = np.float64 if precision == "double" else np.float32
        self.real = ctypes.c_double if precision == "double" else ctypes.c_float
        files = generate(base, "c", ["online"], name="arm", precision=precision)
        for name, text in files.items():
            (folder / name).write_text(text)
        command = [tool("gcc"), "-std=c99", *WARNINGS, "-O2", "-shared", "-fPIC"]
        library = folder / "arm.so"
        source = str(folder / "arm.c")
        self._library = compiled([*command, source, "-o", str(library), "-lm"], library)
        self.size = (base.rank + 1) * (base.rank + 2) // 2
        self.rank = base.rank
        self.state = np.zeros(self.size, self.dtype)

    def _pointers(self, arrays: Any) -> list[Any]:
        self._kept = [np.ascontiguousarray(a, self.dtype) for a in arrays]
        return [a.ctypes.data_as(ctypes.c_void_p) for a in self._kept]

    def update(self, *arrays: Any, noise: Any, forgetting: float = 1.0) -> None:
        given = self._pointers([*arrays, 1 / np.asarray(noise)])
        state = self.state.ctypes.data_as(ctypes.c_void_p)
        self._library.arm_online_update(*given, self.real(forgetting), state)

    def estimate(self, prior: Any = None) -> tuple[int, np.ndarray]:
        found = np.full(self.rank, np.nan, self.dtype)
        work = np.zeros(self.size, self.dtype)
        first = None
        if prior is not None:
            made = np.full(self.size, np.nan, self.dtype)
            where = made.ctypes.data_as(ctypes.c_void_p)
            self._library.arm_online_prior(*self._pointers(prior), where)
            first = where
        pointers = [
            a.ctypes.data_as(ctypes.c_void_p) for a in (self.state, work, found)
        ]
        status = self._library.arm_online_estimate(pointers[0], first, *pointers[1:])
        return status, found


def log(base: ec.BaseModel, samples: int) -> tuple[list[np.ndarray], np.ndarray]:
    """States and outputs, and the noise."""
    rng = np.random.default_rng(0)
    sizes = [len(a) for a in base.function("regressor").arguments[:3]]
    states = [rng.normal(size=(samples, size)) for size in sizes]
    outputs = len(base.mechanism.outputs)
    noise = rng.uniform(0.05, 0.5, outputs)
    y = base.predict(*states, rng.normal(size=base.rank))
    return [*states, y + noise * rng.normal(size=y.shape)], noise


ROBOTS = slow_unless(
    ("double_pendulum", "furuta"), ["double_pendulum", "furuta", "panda", "tx40"]
)


@pytest.mark.parametrize("name", ROBOTS)
def test_it_is_the_batch_without_forgetting(name: str, tmp_path: Path) -> None:
    base = base_of(name)
    data, noise = log(base, 300)
    code = Generated(base, tmp_path)
    for sample in zip(*data, strict=True):
        code.update(*sample, noise=noise)
    status, found = code.estimate()
    batch = base.accumulate(dict(zip(("q", "qd", "qdd", "y"), data, strict=True)))
    wanted = wls(batch, base.units, noise)
    np.testing.assert_allclose(found, wanted.values, rtol=1e-9, atol=1e-9)
    assert status == 0
    residual = batch.combined(1 / noise).residual
    np.testing.assert_allclose(code.state[-1], residual, rtol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_it_is_the_estimator_in_python(name: str, tmp_path: Path) -> None:
    base = base_of(name)
    data, noise = log(base, 120)
    data[3][10:30, 0] = np.nan
    prior = np.full(base.rank, 0.3), np.linspace(0.5, 2, base.rank)
    known = {"prior": prior[0], "covariance": prior[1]}
    both = [
        ec.online(base, noise=noise, forgetting=0.95, **options)
        for options in ({}, known)
    ]
    code = Generated(base, tmp_path)
    for k, sample in enumerate(zip(*data, strict=True)):
        code.update(*sample, noise=noise, forgetting=0.95)
        for estimator in both:
            estimator.update(*sample)
        if k in (2, 60, 119):
            wanted = both[1].estimate().values
            np.testing.assert_allclose(code.estimate(prior)[1], wanted, atol=1e-8)
    plain = both[0].estimate().values
    np.testing.assert_allclose(code.estimate()[1], plain, rtol=1e-8, atol=1e-9)


def test_single_precision(tmp_path: Path) -> None:
    base = base_of("double_pendulum")
    data, noise = log(base, 300)
    code = Generated(base, tmp_path, "single")
    for sample in zip(*data, strict=True):
        code.update(*sample, noise=noise, forgetting=0.99)
    estimator = ec.online(base, noise=noise, forgetting=0.99)
    estimator.update(*data)
    status, found = code.estimate()
    assert status == 0
    np.testing.assert_allclose(found, estimator.estimate().values, atol=1e-4)


def test_what_is_not_told_is_named(tmp_path: Path) -> None:
    """At rest the arm shows its weight alone, and a state that is not finite changes nothing."""
    base = base_of("double_pendulum")
    code = Generated(base, tmp_path)
    rest = np.zeros(2)
    assert code.estimate()[0] == 1
    for q in np.random.default_rng(1).normal(size=(20, 2)):
        y = base.gravity(q, np.ones(6))[0]
        code.update(q, rest, rest, y, noise=[1, 1])
    status, found = code.estimate()
    assert base.pivots[status - 1] == "ZZ1"
    assert np.isnan(found).all()
    kept = code.state.copy()
    code.update([np.nan, 0], rest, rest, rest, noise=[1, 1])
    code.update(rest, rest, rest, [np.inf, np.nan], noise=[1, 1])
    code.update(rest, rest, rest, rest, noise=[np.inf, np.inf])
    np.testing.assert_array_equal(code.state, kept)
    status, found = code.estimate((np.full(6, 3.0), np.ones(6)))
    assert status == 0
    np.testing.assert_allclose(found[[0, 3]], 3.0)


@pytest.mark.parametrize("target", ["cpp", "cuda", "python", "rust"])
def test_other_languages_refuse(target: str) -> None:
    with pytest.raises(
        ec.InputError, match=rf"not written in {target} \(valid targets: c\)"
    ):
        generate(base_of("double_pendulum"), target, ["gravity", "online"])


def test_it_stands_beside_other_functions() -> None:
    functions = ["gravity", "online", "regressor"]
    source = generate(base_of("double_pendulum"), "c", functions, name="arm")
    assert [f.name for f in source.functions] == ["regressor", "gravity"]
    assert source["arm.h"].count("void arm_regressor(") == 1
    assert (
        "online" not in generate(base_of("double_pendulum"), "c", name="arm")["arm.h"]
    )
