"""Which assembly mode the stated pose of a mechanism is in, found in doubles: relations are fitted to real motions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from echelon.base.modes import Mode
from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from echelon.regressor.evaluate import evaluate_floats
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.virtual_power import virtual_power_form
from echelon.seeds import DEFAULT_SEED, random_generator

_STATES, _NEAR = 20, 0.2
_FITS, _NOISE = 1e-6, 1e-8  # how well a mode's relations hold there, and what counts as nothing
_SAME_MARK = 1e-3  # coefficients that are simple rational numbers lie farther apart


def own_mode(mechanism: Mechanism, columns: Sequence[int], modes: Sequence[Mode]) -> Mode:
    """The mode that the mechanism's own assembly pose is in.

    Where that cannot be told, because symbols have no values or modes meet at the pose, it is the one with the lowest
    rank: equal lengths are there to make motions special.

    Parameters
    ----------
    mechanism : Mechanism
    columns : sequence of int
        Those of the mechanism's parameters that the modes count.
    modes : sequence of Mode
        Those with the lowest rank first.

    Returns
    -------
    Mode
        Without marks if it is only known up to modes with the same dependence.
    """
    own = modes[0] if len(modes) == 1 else _mode_of_pose(mechanism, columns, modes)
    return own or replace(modes[0], marks=None if modes[0].marks else modes[0].marks)


def _mode_of_pose(mechanism: Mechanism, columns: Sequence[int], modes: Sequence[Mode]) -> Mode | None:
    states = _STATES + 4 * len(columns) // max(1, len(mechanism.outputs))
    try:
        # near the pose: farther away the walk could pass to another mode
        real = Assembly(mechanism).random_closed_states(random_generator(DEFAULT_SEED), states, _NEAR)
        values = evaluate_floats(virtual_power_form(mechanism), mechanism, *real)
    except InputError:
        return None
    table = values.reshape(-1, values.shape[2])[:, list(columns)]
    # columns that vanish but for rounding stay small
    sizes = np.maximum(np.abs(table).max(axis=0), _NOISE * np.abs(table).max())
    return next((mode for mode in modes if _fits(mode, table / sizes, sizes)), None)


def _fits(mode: Mode, table: npt.NDArray[np.float64], sizes: npt.NDArray[np.float64]) -> bool:
    """Whether a mode's relations hold in real rows, whose columns were divided by their sizes."""
    pivots = [k for k in range(table.shape[1]) if k not in mode.dependence]
    others = list(mode.dependence)
    solution = np.linalg.lstsq(table[:, pivots], table[:, others], rcond=None)[0]
    if np.abs(table[:, others] - table[:, pivots] @ solution).max(initial=0.0) >= _FITS:
        return False
    for (column, source), mark in (mode.marks or {}).items():
        coefficient = solution[pivots.index(source), others.index(column)] * sizes[column] / sizes[source]
        if abs(coefficient - float(mark)) >= _SAME_MARK * max(1.0, abs(float(mark))):
            return False
    return True
