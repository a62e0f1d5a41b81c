"""Maps of columns by a pattern, tables of random numbers, and the gears of the TX40."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

import echelon as ec
from echelon.formats.robot_file import load
from echelon.identification.logs.columns.column_guess import guess
from echelon.identification.logs.columns.column_map import Channel, ColumnMap

Floats = npt.NDArray[np.float64]

PENDULUM = load("examples/double_pendulum.yaml")
TX40 = load("examples/tx40.yaml")

N = np.diag([32.0, 32, 45, -48, 45, 32])
N[5, 4] = 32.0
"""θ = N q of the TX40, as its README in the measured logs says; τ_q = Nᵀ τ_θ."""

MOTORS = ["m1", "m2", "m3", "m4", "m5", "m6"]


def guess_columns(
    names: Sequence[str], mechanism: ec.Mechanism, source: str = "log", **more: Any
) -> ColumnMap:
    """The columns of a log, or an error that says all that is not clear."""
    found = guess(names, mechanism, **more)
    if found.problems:
        raise ec.InputError("; ".join(found.problems), source=source)
    return found.columns


def channels(
    pattern: str, names: tuple[str, ...] | list[str], **settings: str | float
) -> dict[str, Channel]:
    return {
        name: Channel(pattern.format(n=n, name=name), **settings)
        for n, name in enumerate(names, 1)
    }  # type: ignore[arg-type]


def random_columns(
    names: list[str], count: int = 40, seed: int = 3
) -> dict[str, Floats]:
    random = np.random.default_rng(seed)
    return {name: random.normal(size=count) for name in names}
