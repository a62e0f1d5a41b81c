"""Regressors whose entries are given numbers, so that observation matrices can be anything."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra.program.function import Argument, Function
from echelon.algebra.program.tape import Program
from echelon.compute.observe.accumulate import Observer

Floats = npt.NDArray[np.float64]

SERIAL = np.arange(9) >= 3 * np.arange(3)[:, None]
"""Which parameters the outputs of a serial arm with three joints see."""


def table(pattern: npt.ArrayLike) -> Function:
    """A regressor whose structurally non-zero entries are columns of its argument ``x``."""
    program = Program()
    places = [(int(i), int(j)) for i, j in np.argwhere(pattern)]
    nodes = tuple(program.input(f"x[{i},{j}]").node for i, j in places)
    labels = tuple(f"{i},{j}" for i, j in places)
    argument = Argument("x", nodes, labels, ("",) * len(nodes))
    m, n = np.shape(pattern)
    axes = (
        tuple(f"joint{i + 1}" for i in range(m)),
        tuple(f"p{j + 1}" for j in range(n)),
    )
    return Function(
        "table",
        program,
        (argument,),
        dict(zip(places, nodes, strict=True)),
        axes,
        ("N·m",) * m,
    )


def data_of(W: Floats, y: Floats, pattern: npt.ArrayLike) -> dict[str, Floats]:
    """Arguments that give an observation matrix of shape (N, m, n)."""
    return {"x": np.ascontiguousarray(W[:, np.asarray(pattern)]), "y": y}


def random_problem(
    rng: np.random.Generator, samples: int, pattern: npt.ArrayLike, noise: float = 0.1
) -> tuple[Floats, Floats, Floats]:
    """W of shape (N, m, n) with structural zeros, parameters, and measured outputs."""
    W = rng.standard_normal((samples, *np.shape(pattern))) * pattern
    parameters = rng.standard_normal(np.shape(pattern)[1])
    return (
        W,
        parameters,
        W @ parameters + noise * rng.standard_normal((samples, len(pattern))),
    )


def observer(pattern: npt.ArrayLike, **options: Any) -> Observer:
    return Observer(table(pattern), **options)
