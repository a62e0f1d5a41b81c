"""Exact ranks of mechanisms with loops against singular values of X at random closed states."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.base.structure import find_structure
from echelon.dynamics.evaluate import evaluate_floats
from echelon.dynamics.linear_forms import virtual_power_form
from echelon.formats.robot_file import RobotFile
from echelon.formats.snapping import ReadingOptions
from echelon.loops.assembly import Assembly
from echelon.robot.mechanism import Mechanism

Array = npt.NDArray[np.float64]


def read(text: str) -> Mechanism:
    if text.lstrip().startswith("<"):
        return RobotFile.of(text.encode(), "robot.xml").mechanism(ReadingOptions())
    return RobotFile.of(f"echelon: 1\n{text}".encode(), "robot.yaml").mechanism(
        ReadingOptions()
    )


def states(mechanism: Mechanism, count: int = 120) -> tuple[Array, Array, Array]:
    return Assembly(mechanism).random_closed_states(np.random.default_rng(3), count)


def table(mechanism: Mechanism, count: int) -> Array:
    """Rows at random closed states; columns of about equal size, unless there is only noise in them."""
    rows = evaluate_floats(
        virtual_power_form(mechanism), mechanism, *states(mechanism, count)
    )
    rows = np.linalg.qr(rows.reshape(-1, rows.shape[2]), mode="r")
    sizes = np.linalg.norm(rows, axis=0)
    scaled: Array = rows / np.maximum(sizes, 1e-6 * sizes.max())
    return scaled


def check(mechanism: Mechanism, rank: int) -> None:
    """The exact rank is the expected one, and that of the rows in double precision, by a clear gap."""
    structure = find_structure(mechanism, np.random.default_rng(1))
    assert structure.rank == rank
    rows = table(mechanism, max(120, 3 * rank))
    singular = np.linalg.svd(rows, compute_uv=False)
    beyond = singular[rank] if rank < len(singular) else 0.0
    assert beyond < 1e-7 * singular[0]
    assert singular[rank - 1] > 30 * beyond
    pivots = list(structure.pivots)
    solution = np.linalg.lstsq(rows[:, pivots], rows, rcond=None)[0]
    assert np.abs(rows - rows[:, pivots] @ solution).max() < 1e-6
