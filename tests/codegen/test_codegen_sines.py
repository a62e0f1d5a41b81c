"""Sines and cosines of generated C: units in the last place, against ball arithmetic."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import flint
import numpy as np
import numpy.typing as npt
import pytest

from echelon.codegen import TARGETS, Precision
from echelon.codegen.source import Subject, printed
from echelon.program.function import Argument, Function
from echelon.program.tape import Program
from support import generated_code as generated

Floats = npt.NDArray[Any]


def circle() -> Function:
    program = Program()
    q = [program.input(f"q[{k}]") for k in range(4)]
    entries = {(0, k): x.sin().node for k, x in enumerate(q)} | {(1, k): x.cos().node for k, x in enumerate(q)}
    argument = Argument("q", tuple(x.node for x in q), tuple("abcd"), ("rad",) * 4)
    return Function("circle", program, (argument,), entries, (("sine", "cosine"), tuple("abcd")), (), "circle points")


FAST = ("-O3", "-march=native", "-ffp-contract=fast")
BUILDS = [("c", ()), ("c", FAST), ("cpp", ()), ("cpp", FAST)]


def build(folder: Path, target: str, flags: tuple[str, ...]) -> generated.Call:
    files = printed([circle()], TARGETS[target], Precision.DOUBLE, "turn", Subject("turn", (), {}))
    for name, text in files.items():
        (folder / name).write_text(text)
    return generated.RUNNERS[target](generated.Build(folder, "turn", (circle(),), "double", flags))


def ulps(x: float, found: float, cosine: bool) -> float:
    exact = flint.arb(x).cos() if cosine else flint.arb(x).sin()
    return abs(float((flint.arb(found) - exact) / np.spacing(abs(float(exact)))))


@pytest.mark.parametrize(("target", "flags"), BUILDS)
def test_errors_in_units_in_the_last_place(target: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    multiples = rng.integers(-60_000, 60_000, 1500) * (np.pi / 2)
    pieces = [
        rng.uniform(-1e5, 1e5, 1500),
        rng.uniform(-7, 7, 1500),
        multiples,
        np.nextafter(multiples, 1e9),
        rng.integers(-120_000, 120_000, 500) * (np.pi / 4),
        10.0 ** rng.uniform(-300, 0, 500),
        np.array([1e5, -1e5, 0.0, 5e-324]),
    ]
    q = np.concatenate(pieces)
    q = q[np.abs(q) <= 1e5]
    q = q[: len(q) // 4 * 4].reshape(-1, 4)
    found = build(tmp_path, target, flags)(circle(), {"q": q})
    with flint.ctx.workprec(300):
        sines = [ulps(float(x), float(y), False) for x, y in zip(q.ravel(), found[:, 0].ravel(), strict=True)]
        cosines = [ulps(float(x), float(y), True) for x, y in zip(q.ravel(), found[:, 1].ravel(), strict=True)]
    assert max(sines) < 2
    assert max(cosines) < 2


@pytest.mark.parametrize(("target", "flags"), BUILDS)
def test_the_library_takes_over(target: str, flags: tuple[str, ...], tmp_path: Path) -> None:
    q = np.array([[1.0, 1e6, -1e22, 3.0], [np.nan, 1.0, 2.0, 3.0], [np.inf, 1.0, -np.inf, 0.5], [1e300, 0.0, 1.0, 2.0]])
    found = build(tmp_path, target, flags)(circle(), {"q": q})
    with np.errstate(invalid="ignore"):
        np.testing.assert_allclose(found, np.stack([np.sin(q), np.cos(q)], axis=1), rtol=1e-15)
