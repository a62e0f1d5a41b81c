"""Ranks in floating point: singular values of sampled rows.

The usual numeric way to base parameters samples an observation matrix W, factors it by SVD or by QR with column
pivoting, and counts what exceeds a tolerance.  It answers a question of yes and no with a threshold, so here it only
checks what exact arithmetic says.

A row of W is the power of the outputs in one random virtual motion at one random state; such rows have the null space
of X.  (Energies would be cheaper, but a constant that is large against what varies costs digits.)  Columns are scaled
to unit size.  Some hold nothing but rounding, which scaling would make as large as the others: the difference between
single and double precision tells how much rounding there is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from echelon.algebra import (
    DEFAULT_SEED,
    MOST_ATTEMPTS,
    FloatArithmetic,
    Program,
    Schedule,
    random_generator,
)
from echelon.dynamics import LinearForms, evaluate_floats, virtual_power_form
from echelon.robot import Mechanism, MotionKind, characteristic_length, symbol_values
from echelon.shared import Floats, InputError, pivoted_qr

TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
"""Customary thresholds, relative to the largest singular value."""

ROWS_PER_COLUMN = 1.5
"""Rows of a sampled observation matrix, relative to its columns."""
FEWEST_ROWS = 32
"""Rows of a sampled observation matrix at least, and rows beyond an expected rank."""
MOST_SINGULAR_VALUES = 400
"""Expected rank above which a QR decomposition replaces the singular values, which take too long."""
_RATES = {"qd": 3.0, "qdd": 10.0}
"""Largest random velocities and accelerations, rad/s and rad/s² or characteristic lengths."""
BLOCK = 128
"""States that are evaluated together, so that the table of intermediate values stays small."""
FEW_STATES = 100
"""Closed states of which each has a pose of its own."""
SHARED_MOTIONS = 3
"""Motions through each pose of more states: even one freedom shows as much at each."""
_ROUNDING = float(np.finfo(np.float64).eps)
_SINGLE_TO_DOUBLE = _ROUNDING / float(np.finfo(np.float32).eps)
NOISE_FACTOR = 1e4
"""Size of a column, relative to the rounding of its entries, from which it is a signal."""
NOISE_AT_CLOSED_STATES = 1e-3
"""Share of the largest column below which one is not scaled up: states close to 1e-12 only."""


@dataclass(frozen=True)
class NumericRanks:
    """Singular values of a sampled observation matrix with scaled columns, and the ranks that they suggest.

    >>> import echelon as ec
    >>> from echelon.base.numeric_ranks import numeric_ranks
    >>> found = numeric_ranks(ec.load("examples/panda.yaml"))
    >>> found.ranks, found.gap(43) > 1e9
    ((43, 43, 43, 43), True)
    """

    columns: int  # number of standard parameters
    rows: int  # number of sampled rows
    tolerances: tuple[float, ...]  # relative to the largest value
    singular: tuple[
        float, ...
    ]  # singular values, descending, as fractions of the largest
    # |R_kk| of a QR factorisation with column pivoting, as fractions of the first; empty if not asked for
    diagonal: tuple[float, ...] = ()

    @property
    def ranks(self) -> tuple[int, ...]:
        """Numbers of singular values above each tolerance."""
        return tuple(_above(self.singular, tolerance) for tolerance in self.tolerances)

    @property
    def ranks_by_qr(self) -> tuple[int, ...]:
        """Numbers of diagonal entries of R above each tolerance; empty if R was not asked for."""
        if self.diagonal:
            return tuple(
                _above(self.diagonal, tolerance) for tolerance in self.tolerances
            )
        return ()

    def gap(self, rank: int) -> float:
        """The smallest singular value that a rank keeps by the largest that it drops.

        Values below what rounding leaves count as rounding; infinite if nothing is kept or nothing dropped.
        """
        if not 0 < rank < len(self.singular):
            return float("inf")
        return max(self.singular[rank - 1], _ROUNDING) / max(
            self.singular[rank], _ROUNDING
        )

    def widest_gap(self, besides: int | None = None) -> tuple[int, float] | None:
        """The rank with the widest gap, and the gap; None where there is none."""
        gaps = [
            (self.gap(rank), rank)
            for rank in range(1, len(self.singular))
            if rank != besides
        ]
        widest = max(gaps, key=lambda found: (found[0], -found[1]), default=None)
        return None if widest is None else (widest[1], widest[0])

    def __repr__(self) -> str:
        ranks = ", ".join(
            f"{r} at {t:.0e}" for r, t in zip(self.ranks, self.tolerances, strict=True)
        )
        return f"NumericRanks({self.rows} × {self.columns}: {ranks})"


def numeric_ranks(
    mechanism: Mechanism,
    seed: int = DEFAULT_SEED,
    tolerances: Sequence[float] = TOLERANCES,
    *,
    literal: bool = True,
    pivoted: bool = False,
    near: int | None = None,
    symbols: Mapping[str, float] | None = None,
    recorded: LinearForms | None = None,
    columns: Sequence[int] | None = None,
) -> NumericRanks:
    """Singular values of the regressor at random states, in double precision.

    The cost is that of a factorisation of about 1.5n × n numbers, n being the number of standard parameters, or of
    little more than r × r if only ranks near a given r are of interest, without loops.
    """
    reading = mechanism.reading
    if literal and reading is not None and reading.snaps:
        mechanism, recorded = reading.literal(), None
    rng = random_generator(seed)
    columns = range(len(mechanism.parameters)) if columns is None else columns
    forms = virtual_power_form(mechanism) if recorded is None else recorded
    # rows at few closed states are hardly independent
    if (
        near is None
        or near + 2 * FEWEST_ROWS >= len(columns)
        or forms.loops is not None
    ):
        return ranks_of_matrix(
            _sampled(mechanism, forms, columns, rng, None, symbols),
            tolerances,
            pivoted=pivoted,
        )
    matrix = _sampled(mechanism, forms, columns, rng, near + 2 * FEWEST_ROWS, symbols)
    mixed = matrix @ rng.standard_normal((matrix.shape[1], near + FEWEST_ROWS))
    if near <= MOST_SINGULAR_VALUES:
        return ranks_of_matrix(mixed, tolerances, pivoted=pivoted)
    # columns that were mixed at random come in no bad order, so plain QR reveals the rank at a fraction of the cost
    diagonal = np.sort(np.abs(np.diag(np.linalg.qr(mixed, mode="r"))))[::-1]
    return NumericRanks(
        mixed.shape[1], mixed.shape[0], tuple(tolerances), _fractions(diagonal)
    )


def ranks_of_matrix(
    matrix: Floats, tolerances: Sequence[float] = TOLERANCES, *, pivoted: bool = False
) -> NumericRanks:
    """Singular values of a matrix as fractions of the largest.  Shapes: matrix (rows, columns)."""
    rows, columns = matrix.shape
    triangle: Floats = (
        np.asarray(np.linalg.qr(matrix, mode="r")) if rows > columns else matrix
    )
    singular: Floats = np.linalg.svd(triangle, compute_uv=False).astype(np.float64)
    diagonal: Floats = np.zeros(0)
    if pivoted:
        diagonal = pivoted_qr(triangle)[0]
    return NumericRanks(
        columns, rows, tuple(tolerances), _fractions(singular), _fractions(diagonal)
    )


def reconstruction_error(
    mechanism: Mechanism,
    forms: LinearForms,
    pivots: Sequence[int],
    matrix: Floats,
    rng: np.random.Generator,
) -> float:
    """Largest relative error of a column of X̄ B at random states of a mechanism without loops."""
    stacked, rounding = _at_states(mechanism, forms, rng, FEWEST_ROWS, None)
    missed = np.linalg.norm(stacked - stacked[:, list(pivots)] @ matrix, axis=0)
    sizes = np.linalg.norm(stacked, axis=0)
    seen = sizes > NOISE_FACTOR * rounding
    return float((missed[seen] / sizes[seen]).max(initial=0.0))


def _sampled(
    mechanism: Mechanism,
    forms: LinearForms,
    columns: Sequence[int],
    rng: np.random.Generator,
    rows: int | None,
    symbols: Mapping[str, float] | None,
) -> Floats:
    """Rows uᵀX at random states and virtual velocities u, columns scaled to unit size.

    Rotations are any, translations of the size of the links, rates within 3 rad/s and accelerations within 10 rad/s².
    If omitted, there are at least half as many rows again as columns.
    """
    rows = rows or max(FEWEST_ROWS, int(ROWS_PER_COLUMN * len(columns)))
    if forms.loops is not None:
        closed = forms.loops.assembly_at(symbols)
        count = -(-rows // max(1, len(mechanism.outputs)))
        states = closed.determined_states(
            rng, count, motions=SHARED_MOTIONS if count > FEW_STATES else 1
        )
        found = evaluate_floats(forms, mechanism, *states, symbols, assembly=closed)
        stacked = found.reshape(-1, found.shape[2])[:, list(columns)]
        length = characteristic_length(mechanism)
        stacked *= np.array(
            [length ** mechanism.columns[column].length_degree for column in columns]
        )
        sizes = np.linalg.norm(stacked, axis=0)
        scaled: Floats = stacked / np.maximum(
            sizes, NOISE_AT_CLOSED_STATES * sizes.max(initial=1e-300)
        )
        return scaled
    forms = forms.columns(columns)
    stacked, rounding = _at_states(mechanism, forms, rng, rows, symbols)
    sizes = np.linalg.norm(stacked, axis=0)
    seen = sizes > NOISE_FACTOR * rounding
    return np.where(seen, stacked, 0.0) / np.where(seen, sizes, 1.0)


def _at_states(
    mechanism: Mechanism,
    forms: LinearForms,
    rng: np.random.Generator,
    rows: int,
    given: Mapping[str, float] | None,
) -> tuple[Floats, Floats]:
    """Rows at random states where all entries are finite, and the size of the rounding in every column."""
    program, entries = forms.program, forms.entries
    schedule = Schedule(program, list(entries.values()))
    names = [
        program.inputs[node].name
        for node in schedule.leaves
        if program.inputs[node].role == "symbol"
    ]
    symbols, scales = symbol_values(mechanism, names, given), _scales(mechanism)
    blocks: list[Floats] = []
    count, rounding = 0, np.zeros(forms.shape[1])
    for _ in range(MOST_ATTEMPTS + rows // BLOCK):
        leaves = _random_inputs(program, symbols, scales, rng)
        precisions = (
            FloatArithmetic(),
            *([] if count else [_SinglePrecision()]),
        )  # one block shows the rounding
        found = np.zeros((len(precisions), BLOCK, forms.shape[1]))
        for matrix, arithmetic in zip(found, precisions, strict=True):
            with np.errstate(all="ignore"):
                values = schedule.run(
                    arithmetic, {node: leaves[node] for node in schedule.leaves}, BLOCK
                )
            matrix[:, [column for _, column in entries]] = values.T
        found = found[:, np.isfinite(found).all(axis=(0, 2))]
        if not count and found.shape[1]:
            rounding = (
                _SINGLE_TO_DOUBLE
                * np.linalg.norm(found[1] - found[0], axis=0)
                * sqrt(rows / found.shape[1])
            )
        blocks.append(found[0])
        count += found.shape[1]
        if count >= rows:
            return np.concatenate(blocks)[:rows], rounding
    raise InputError("no random states are found at which the regressor is finite")


class _SinglePrecision(FloatArithmetic):
    dtype: npt.DTypeLike = np.float32


def _random_inputs(
    program: Program,
    symbols: Mapping[str, float],
    scales: Mapping[str, float],
    rng: np.random.Generator,
) -> dict[int, Floats]:
    """Random values of a program's inputs; what has no scale is within ±1."""
    drawn = {}
    for node, given in program.inputs.items():
        value = symbols.get(given.name, 0.0)
        random = scales.get(given.name, 1.0) * rng.uniform(-1.0, 1.0, BLOCK)
        drawn[node] = np.full(BLOCK, value) if given.role == "symbol" else random
    for group in program.unit_groups:
        length = np.sqrt(sum(drawn[node] ** 2 for node in group))
        drawn |= {node: drawn[node] / length for node in group}
    return drawn


def _scales(mechanism: Mechanism) -> dict[str, float]:
    """Largest random value of every coordinate's position, velocity and acceleration, by the input's name."""
    length = characteristic_length(mechanism)
    scales: dict[str, float] = {}
    for motion in mechanism.motions:
        unit = length if motion.kind is MotionKind.TRANSLATION else 1.0
        turn = (
            1.0 if motion.kind in (MotionKind.TRANSLATION, MotionKind.BALL) else np.pi
        )
        scales |= {f"q[{name}]": unit * turn for name in motion.positions}
        for name in motion.velocities:
            scales |= {f"{kind}[{name}]": unit * r for kind, r in _RATES.items()}
    return scales


def _above(values: Sequence[float], tolerance: float) -> int:
    return sum(value > tolerance for value in values)


def _fractions(values: Floats) -> tuple[float, ...]:
    """Values as fractions of the first, which is the largest."""
    largest = float(values[0]) if len(values) else 0.0
    return tuple(float(value) / largest if largest else 0.0 for value in values)
