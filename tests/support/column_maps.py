"""Maps of columns by a pattern, tables of random numbers, and the gears of the TX40."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.formats.robot_file import load
from echelon.logs.columns.column_map import Channel

Floats = npt.NDArray[np.float64]

PENDULUM = load("examples/double_pendulum.yaml")
TX40 = load("examples/tx40.yaml")

N = np.diag([32.0, 32, 45, -48, 45, 32])
N[5, 4] = 32.0
"""θ = N q of the TX40, as its README in the measured logs says; τ_q = Nᵀ τ_θ."""

MOTORS = ["m1", "m2", "m3", "m4", "m5", "m6"]


def channels(pattern: str, names: tuple[str, ...] | list[str], **settings: str | float) -> dict[str, Channel]:
    return {name: Channel(pattern.format(n=n, name=name), **settings) for n, name in enumerate(names, 1)}  # type: ignore[arg-type]


def random_columns(names: list[str], count: int = 40, seed: int = 3) -> dict[str, Floats]:
    random = np.random.default_rng(seed)
    return {name: random.normal(size=count) for name in names}
