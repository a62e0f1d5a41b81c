"""Delays too long for derivatives: those with which outputs are explained best by least-squares fits of their own.

The regressor stays and outputs are shifted, so that one orthogonal basis of an output's columns serves all delays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from echelon.identification.judge.evidence import OutputRows, States
from echelon.shared import Floats

LONGEST = 0.5
"""Delays that are looked for, s: no bus or recorder is later; beyond it files were merged at a wrong time."""
_PER_PERIOD = 8  # delays that are tried in a period of the band's edge: between two of them a derivative finds the rest
_MOST = 40  # delays to either side that are tried where nothing limits the band


def scanned_delays(rows: Sequence[OutputRows], states: States) -> Floats:
    """Delays that leave least of all outputs, then of each, shape (1 + outputs,), s; 0 where none within reach does.

    What is left of outputs together is the mean of logarithms.
    """
    shortest = min(len(piece) / piece.rate for piece in states.pieces)
    longest = min(LONGEST, shortest / 4)
    step = max(
        1 / (_PER_PERIOD * states.band), float(1 / states.rate.min()), longest / _MOST
    )
    tried = step * np.arange(-int(longest / step), int(longest / step) + 1)
    inner = replace(states, late=longest).fitted
    outputs = range(len(rows))
    left = np.zeros((len(tried), len(rows)))
    shifts = [states.earlier(list(outputs), delay).y for delay in tried]
    for k, own in zip(outputs, rows, strict=True):
        kept = own.fitted & inner[:, k]
        basis = np.linalg.qr(own.table[kept[own.fitted], :-1])[0]
        y = states.rows(np.stack([y[:, k] for y in shifts], axis=1))[kept]
        rest = y - basis @ (basis.T @ y)
        left[:, k] = np.log(np.maximum(np.sum(rest**2, axis=0), np.finfo(float).tiny))
    marks = np.column_stack([left.mean(axis=1), left])
    best = np.argmin(marks, axis=0)
    return np.where((best > 0) & (best < len(tried) - 1), tried[best], 0.0)
