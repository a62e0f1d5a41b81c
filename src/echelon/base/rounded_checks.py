"""Check of a set whose relations hold to the last decimals of a file only, as rounding has broken what is meant.

Its representatives are shown to be independent in ball arithmetic.  What it leaves of the other columns at fresh closed
states must be explained by rounding, and must be no more than the best coefficients leave there.
"""

from __future__ import annotations

from math import log10

import flint
import numpy as np

from echelon.algebra import BALL_BITS
from echelon.base.ball_checks import BallEvidence
from echelon.base.ball_rows import ball_rows
from echelon.base.ball_tables import combinations_of, doubles
from echelon.base.elimination import SMALLEST_SHARE
from echelon.base.matrix import BaseMatrix
from echelon.base.spectrum import EXPLAINED, units_of
from echelon.dynamics import LinearForms
from echelon.robot import Mechanism
from echelon.shared import CertificateError, Floats, InputError

ROWS_PER_REPRESENTATIVE = 3
"""Sampled rows, relative to the number of representatives."""
LARGEST_RESIDUAL = 0.1
"""Share of a column that a set may leave, however coarse the file is."""
LARGEST_EXCESS = 30.0
"""Residual of a set, relative to that of the best coefficients, which have more digits."""


def check_to_rounding(
    regressor: LinearForms,
    matrix: BaseMatrix,
    mechanism: Mechanism,
    rng: np.random.Generator,
) -> BallEvidence:
    """Show that representatives are independent, and that the set reproduces the others to the file's last decimals.

    Raises
    ------
    CertificateError
        If it is too large, incomplete or wrong.
    """
    count = ROWS_PER_REPRESENTATIVE * matrix.rank
    with flint.ctx.workprec(BALL_BITS):
        try:
            table = ball_rows(regressor, {}, count, rng)
        except InputError as error:
            raise CertificateError(str(error)) from None
        if combinations_of(table, matrix.pivots, ()) is None:
            raise CertificateError(
                f"the set is too large: its {matrix.rank} representatives are not independent"
            )
    rows = doubles(table)
    sizes = _sizes(rows, mechanism)
    claimed = matrix.floats({})
    pivots = list(matrix.pivots)
    best = np.linalg.lstsq(rows[:, pivots], rows, rcond=None)[0]
    left, least = (
        np.abs(rows - rows[:, pivots] @ b).max(axis=0) / sizes for b in (claimed, best)
    )
    explained = EXPLAINED * mechanism.rounding
    allowed = min(LARGEST_RESIDUAL, max(explained, LARGEST_EXCESS * float(least.max())))
    wrong = np.flatnonzero(left > allowed)
    if wrong.size:
        name = matrix.parameters[int(left.argmax())]
        raise CertificateError(
            f"the set is incomplete or wrong: it misses {left.max():.0e} of the effect of {name}, and the last "
            f"decimals of the file explain only {allowed:.0e}"
        )
    return BallEvidence(len(rows), log10(max(float(left.max()), np.finfo(float).tiny)))


def _sizes(rows: Floats, mechanism: Mechanism) -> Floats:
    """Sizes of columns, those that hold little beside others in comparable units taken for larger."""
    units = np.array(units_of(mechanism, range(rows.shape[1]), 0))
    sizes = np.abs(rows).max(axis=0, initial=0.0)
    inertial = np.isfinite(units)
    least = (
        SMALLEST_SHARE
        * float((sizes / units)[inertial].max(initial=0.0))
        * np.where(inertial, units, 0.0)
    )
    return np.asarray(np.maximum(np.maximum(sizes, least), np.finfo(float).tiny))
