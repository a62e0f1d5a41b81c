"""What snapping changed: the literal rank beside the intended one, and the snaps that made the difference.

Underneath is a net: what floating point says about the rank of the literal numbers.  The usual numeric way to base
parameters samples an observation matrix W, factors it by SVD or by QR with column pivoting, and counts what exceeds a
tolerance.  It answers a question of yes and no with a threshold, so here it decides nothing; but where no tolerance
confirms the exact rank of the literal reading and a clear gap is somewhere else, that is said.

A row of W is the power of the outputs in one random virtual motion at one random state; such rows have the null space
of X.  (Energies would be cheaper, but a constant that is large against what varies costs digits.)  Columns are scaled
to unit size.  Some hold nothing but rounding, which scaling would make as large as the others: the difference between
single and double precision tells how much rounding there is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats, independent_columns, pivoted_qr
from echelon.base.matrix import BaseMatrix
from echelon.base.stated_values import stated_structure
from echelon.errors import DegenerateSampleError, InputError
from echelon.exact.field import ARRAY_BITS, DEFAULT_SEED, PrimeField, random_generator
from echelon.exact.field import rank as rank_modulo
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.mechanism import RESTORED, Mechanism, Reading, Snap
from echelon.mechanism.stated import (
    StatedValues,
    characteristic_length,
    has_values,
    inexact_symbols,
    stated_values,
    symbol_roles,
    symbol_values,
)
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program
from echelon.regressor.evaluate import evaluate_floats
from echelon.regressor.linear_forms import LinearForms, virtual_power_form
from echelon.regressor.loops.assembly import Assembled, Assembly
from echelon.regressor.loops.closing import assembled, closing_notes, nearly_free
from echelon.regressor.loops.coordinates import split_balls

ROUNDING = 1e-9
"""Snaps up to this size are what decimals of a file cannot help, and part of the literal reading too."""


_MOST_COLUMNS = 300
"""Of more, float ranks would take too much of the time: so many neighbours are compared instead of all."""
_CLEAR_GAP = 1e3
"""Singular values that fall more evenly, as of motions that hardly leave a pose, tell nothing."""
_ROUNDED = 1e-4
"""What rounding to a few digits may move numbers by."""
_LARGEST_RANK = 1000
"""Above it, nothing is compared where no part of the columns can stand for all."""
_MOST_TRIALS, _FEWEST_TRIALS = 600, 8
"""Readings that are tried to find out which snaps matter, times the number of bodies, and at least."""


@dataclass(frozen=True)
class MimicRanks:
    """Ranks of a robot whose file couples joints: as they are coupled, and as if all were independent."""

    coupled: int
    independent: int

    def __str__(self) -> str:
        return f"as coupled {self.coupled}; as independent {self.independent}"


@dataclass(frozen=True)
class ReadingReport:
    """The literal reading of a file beside the intended one."""

    snaps: tuple[Snap, ...] = ()  # what was read as exact
    notes: tuple[str, ...] = ()  # what the reader wants its user to know
    literal_rank: int | None = None  # rank of the literal reading; None where nothing that matters was snapped
    decisive: tuple[Snap, ...] = ()  # snaps without any of which the rank would not be the intended one
    # where the float ranks of the literal numbers do not confirm the exact one, what they are; otherwise empty
    doubt: str = ""
    mimics: MimicRanks | None = None  # of files that couple joints
    # of mechanisms whose loops were not closed at the stated assembly pose: what was moved
    assembled: Assembled | None = None


def report_reading(
    mechanism: Mechanism,
    rank: int,
    rng: np.random.Generator,
    recorded: LinearForms | None = None,
    matrix: BaseMatrix | None = None,
) -> ReadingReport:
    """The numbers that were snapped, and the rank of the literal reading of the mechanism's file."""
    reading = mechanism.reading
    snaps, notes = ((), ()) if reading is None else (reading.snaps, reading.notes)
    notes = (*notes, *mechanism_notes(mechanism))
    mimics, moved = mimic_ranks(mechanism, rank, rng), assembled(mechanism) if mechanism.closures else None
    report = ReadingReport(snaps, notes, mimics=mimics, assembled=moved)
    coarse = [snap for snap in snaps if snap.difference > ROUNDING]
    if reading is None or not coarse:  # to double precision, the numbers as they are read are those of the file
        return replace(report, doubt=_doubt(mechanism, recorded, rank, rank, matrix, mechanism))
    try:
        literal = reading.literal()
        literal_rank = stated_structure(literal, rng).rank
    except InputError as error:  # rounding has locked loops
        return replace(report, notes=(*notes, f"the literal reading of the file has no answer: {error}"))
    chosen: set[str] = set()
    if literal_rank != rank:
        elements = list(dict.fromkeys(snap.element for snap in coarse))
        chosen = set(_decisive(reading, elements, rank, len(mechanism.bodies), rng))
    decisive = tuple(snap for snap in coarse if snap.element in chosen)
    doubt = _doubt(mechanism, None, literal_rank, rank, matrix if literal_rank == rank else None, literal)
    doubt = doubt or _faint(mechanism, rank, [snap.difference for snap in coarse])
    return replace(report, literal_rank=literal_rank, decisive=decisive, doubt=doubt)


def mechanism_notes(mechanism: Mechanism) -> list[str]:
    """Notes on a mechanism, whatever file it was read from."""
    notes = [
        f"bodies {mechanism.carrier_name(k)} share the parameters of label '{mechanism.bodies[k].label}'"
        for k in mechanism.carriers
        if len(mechanism.sharing[k]) > 1
    ]
    if not mechanism.closures:
        return notes
    split = ", ".join(f"'{name}'" for name in split_balls(mechanism))
    what = "the loops leave part of a free rotation undetermined, such as the spin of a rod between two ball joints"
    return [*closing_notes(mechanism), *notes, *([f"{what}: {split} is independent"] if split else [])]


def doubt_of_loops(mechanism: Mechanism, rank: int) -> str:
    """Evidence against a rank with loops; empty if there is none.

    Points that are stated along directions without exact values, such as (1, 2, 0), are not on them exactly, and
    rounding may break relations that are not among those that are restored.
    """
    if not mechanism.closures:
        return ""
    snaps = () if mechanism.reading is None else mechanism.reading.snaps
    coarse = [snap.difference for snap in snaps if snap.difference > ROUNDING]
    if coarse:
        doubt = _faint(mechanism, rank, coarse)
    else:
        doubt = _doubt(mechanism, None, rank, rank, None, mechanism) if inexact_symbols(mechanism) else ""
    # rounding may have locked what is meant to move, but not where lengths have names and frames are as they are stated
    rounded = has_values(mechanism) and (mechanism.closed_at or not symbol_roles(mechanism).lengths)
    return doubt or "".join(nearly_free(mechanism) if rounded else ())


def _doubt(
    mechanism: Mechanism,
    recorded: LinearForms | None,
    literal: int,
    intended: int,
    matrix: BaseMatrix | None,
    as_stated: Mechanism,
) -> str:
    """The float ranks of the literal numbers, if none of them is the expected one; else empty.

    Snaps explain all ranks from the intended one to the literal one: what they move by little shows little.
    ``as_stated`` has the literal numbers, as far as they differ in double precision.
    """
    low, high = sorted((literal, intended))
    columns, where = None, ""
    if len(mechanism.parameters) > _MOST_COLUMNS and matrix is not None and matrix.numbers is None:
        columns = _neighbours(len(matrix.parameters))
        part = _rank_of_columns(matrix, columns, stated_values(mechanism))
        if part is None:
            columns = None
        else:
            low = high = part
            where = f", for the parameters {matrix.parameters[columns[0]]} to {matrix.parameters[columns[-1]]}"
    if high > _LARGEST_RANK:
        return f"not compared with float ranks, as {high} is more than {_LARGEST_RANK}"
    try:
        found = numeric_ranks(as_stated, literal=False, near=high, recorded=recorded, columns=columns)
    except InputError:  # values are missing, or loops do not close at the stated ones
        return ""
    widest = found.widest_gap()
    if widest is None or widest[1] < _CLEAR_GAP or any(low <= r <= high for r in (*found.ranks, widest[0])):
        return ""
    if mechanism.effects and max(found.ranks) < low:  # random states may miss small regions of signs
        return ""
    ranks = ", ".join(f"{r} at {t:.0e}" for r, t in zip(found.ranks, found.tolerances, strict=True))
    expected = literal if columns is None else high
    return f"the file's numbers in floating point do not confirm {expected}{where}: rank {ranks}"


def _faint(mechanism: Mechanism, rank: int, moved: Sequence[float]) -> str:
    """Which part of a rank with loops shows no more than rounding of the file's numbers does; empty if none.

    Relations such as three points on a line may be broken by rounding, and not among those that are restored.
    """
    snaps = () if mechanism.reading is None else mechanism.reading.snaps
    restored = max((snap.difference for snap in snaps if snap.literal == RESTORED), default=0.0)
    most = max((restored, *(difference for difference in moved if difference < _ROUNDED)))
    if not (mechanism.closures and most):
        return ""
    try:
        found = numeric_ranks(mechanism, literal=False)
    except InputError:  # values are missing, or loops do not close at the stated ones
        return ""
    singular = found.singular[:rank]
    clear = next((k for k in range(1, rank) if ROUNDING < singular[k] < most and found.gap(k) > _CLEAR_GAP), None)
    faint = sum(value < restored / 10 for value in singular)
    if clear is not None:
        shown = f"{rank - clear} of {rank} base parameters show {found.gap(clear):.0e} times less than the others"
        meant = f"{clear}"
    elif faint:
        shown, meant = f"{faint} of {rank} base parameters hardly show", f"perhaps fewer than {rank}"
    else:
        return ""
    return (
        f"{shown}, not more than rounding of the file does ({most:.0e}): if lengths are meant to be equal, or points "
        f"to lie on one line, there are {meant}; state them with more digits"
    )


def _neighbours(count: int) -> range:
    """Columns of links that follow one another, from a random one on."""
    start = int(random_generator(DEFAULT_SEED).integers(count - _MOST_COLUMNS + 1))
    return range(start, start + _MOST_COLUMNS)


def _rank_of_columns(matrix: BaseMatrix, columns: Sequence[int], values: StatedValues) -> int | None:
    """Rank of some columns of B at the stated values, which is that of X, modulo a random prime.

    None where the values have no residues (the tangent of half of a half turn) or make a denominator zero.
    """
    rng = random_generator(DEFAULT_SEED)
    field = PrimeField.random(rng, ARRAY_BITS)
    try:
        dense = matrix.dense_modulo(values.draw(matrix.symbols, field, rng), field, columns)
    except DegenerateSampleError:
        return None
    return rank_modulo(dense[dense.any(axis=1)], field)


def mimic_ranks(mechanism: Mechanism, rank: int, rng: np.random.Generator) -> MimicRanks | None:
    """The rank beside that of the other reading of mimic joints; None without mimic joints."""
    reading = mechanism.reading
    try:
        other = None if reading is None else reading.recoupled()
    except InputError:
        return None  # couplings that make no sense, ignored on request
    if other is None:
        return None
    found = stated_structure(other, rng).rank
    return MimicRanks(rank, found) if len(mechanism.couplings) > len(other.couplings) else MimicRanks(found, rank)


def _decisive(reading: Reading, elements: Sequence[str], rank: int, bodies: int, rng: np.random.Generator) -> list[str]:
    """Elements that change the rank when taken literally, by bisection; whole groups once enough has been tried."""
    trials = iter(range(max(_FEWEST_TRIALS, _MOST_TRIALS // bodies)))

    def bisected(group: Sequence[str]) -> list[str]:
        if next(trials, None) is None:
            return list(group)
        if stated_structure(reading.literal(group), rng).rank == rank:
            return []
        if len(group) == 1:
            return list(group)
        middle = len(group) // 2
        return [*bisected(group[:middle]), *bisected(group[middle:])] or list(group)  # only together do they matter

    return bisected(elements)


# -- ranks in floating point -------------------------------------------------------------------------------------------

TOLERANCES = (1e-6, 1e-8, 1e-10, 1e-12)
"""Customary thresholds, relative to the largest singular value."""

_ROWS_PER_COLUMN = 1.5
_FEWEST_ROWS = 32
_MARGIN = 32
_MOST_SINGULAR_VALUES = 400
_RATE, _ACCELERATION = 3.0, 10.0  # largest random ones, rad/s and rad/s²
_BLOCK = 128  # states that are evaluated together
_FEW_STATES, _MOTIONS = 100, 3  # closed states, of which more share poses: even one freedom shows as much at each
_ROUNDS = 8  # of drawing, where states outside a function's domain are left out
_ROUNDING = float(np.finfo(np.float64).eps)
_SINGLE_TO_DOUBLE = _ROUNDING / float(np.finfo(np.float32).eps)
_NOISE = 1e4  # times the rounding: what is smaller is nothing else
_FIRM = 1e-7  # what is left of a column of size 1 that is surely independent of others
_NOISE_AT_CLOSED_STATES = 1e-3
"""Columns smaller than this part of the largest are not scaled up: states are closed to 1e-12 only."""


@dataclass(frozen=True)
class NumericRanks:
    """Singular values of a sampled observation matrix with scaled columns, and the ranks that they suggest.

    >>> import echelon as ec
    >>> from echelon.base.reading_report import numeric_ranks
    >>> found = numeric_ranks(ec.load("examples/panda.yaml"))
    >>> found.ranks, found.gap(43) > 1e9
    ((43, 43, 43, 43), True)
    """

    columns: int  # number of standard parameters
    rows: int  # number of sampled rows
    tolerances: tuple[float, ...]  # relative to the largest value
    singular: tuple[float, ...]  # singular values, descending, as fractions of the largest
    # |R_kk| of a QR factorisation with column pivoting, as fractions of the first; empty if not asked for
    diagonal: tuple[float, ...] = ()

    @property
    def ranks(self) -> tuple[int, ...]:
        """Numbers of singular values above each tolerance."""
        return tuple(_above(self.singular, tolerance) for tolerance in self.tolerances)

    @property
    def ranks_by_qr(self) -> tuple[int, ...]:
        """Numbers of diagonal entries of R above each tolerance; empty if R was not asked for."""
        return tuple(_above(self.diagonal, tolerance) for tolerance in self.tolerances) if self.diagonal else ()

    def gap(self, rank: int) -> float:
        """The smallest singular value that a rank keeps by the largest that it drops.

        Values below what rounding leaves count as rounding; infinite if nothing is kept or nothing dropped.
        """
        if not 0 < rank < len(self.singular):
            return float("inf")
        return max(self.singular[rank - 1], _ROUNDING) / max(self.singular[rank], _ROUNDING)

    def widest_gap(self, besides: int | None = None) -> tuple[int, float] | None:
        """The rank with the widest gap, and the gap; None where there is none."""
        gaps = [(self.gap(rank), rank) for rank in range(1, len(self.singular)) if rank != besides]
        widest = max(gaps, key=lambda found: (found[0], -found[1]), default=None)
        return None if widest is None else (widest[1], widest[0])

    def __repr__(self) -> str:
        ranks = ", ".join(f"{r} at {t:.0e}" for r, t in zip(self.ranks, self.tolerances, strict=True))
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
    little more than r × r if only ranks near a given r are of interest.
    """
    reading = mechanism.reading
    if literal and reading is not None and reading.snaps:
        mechanism, recorded = reading.literal(), None
    rng = random_generator(seed)
    columns = range(len(mechanism.parameters)) if columns is None else columns
    # rows at few closed states are hardly independent
    if near is None or near + 2 * _MARGIN >= len(columns) or mechanism.closures:
        return ranks_of_matrix(_sampled(mechanism, columns, rng, None, symbols, recorded), tolerances, pivoted=pivoted)
    matrix = _sampled(mechanism, columns, rng, near + 2 * _MARGIN, symbols, recorded)
    mixed = matrix @ rng.standard_normal((matrix.shape[1], near + _MARGIN))
    if near <= _MOST_SINGULAR_VALUES:
        return ranks_of_matrix(mixed, tolerances, pivoted=pivoted)
    # columns that were mixed at random come in no bad order, so plain QR reveals the rank at a fraction of the cost
    diagonal = np.sort(np.abs(np.diag(np.linalg.qr(mixed, mode="r"))))[::-1]
    return NumericRanks(mixed.shape[1], mixed.shape[0], tuple(tolerances), _fractions(diagonal))


def ranks_of_matrix(matrix: Floats, tolerances: Sequence[float] = TOLERANCES, *, pivoted: bool = False) -> NumericRanks:
    """Singular values of a matrix as fractions of the largest.  Shapes: matrix (rows, columns)."""
    rows, columns = matrix.shape
    triangle: Floats = np.asarray(np.linalg.qr(matrix, mode="r")) if rows > columns else matrix
    singular: Floats = np.linalg.svd(triangle, compute_uv=False).astype(np.float64)
    diagonal: Floats = np.zeros(0)
    if pivoted:
        diagonal = pivoted_qr(triangle)[0]
    return NumericRanks(columns, rows, tuple(tolerances), _fractions(singular), _fractions(diagonal))


def firm_first(
    mechanism: Mechanism, order: Sequence[int], classical: Sequence[int], rng: np.random.Generator
) -> tuple[int, ...]:
    """An order of columns in which those that depend on earlier ones up to rounding come last.

    With rounded numbers or frames, a column that is zero in truth may be tiny and yet independent; as a representative
    it would give others coefficients of the size of 1/rounding.  The order stays where columns that are independent in
    double precision are not as many as the classical representatives, or are these.
    """
    firm = [order[k] for k in independent_columns(_sampled(mechanism, order, rng, None, None, None), _FIRM)]
    if len(firm) != len(classical) or (firm == list(classical) and sorted(order) == list(order)):
        return tuple(order)
    return (*firm, *(column for column in order if column not in set(firm)))


def _sampled(
    mechanism: Mechanism,
    columns: Sequence[int],
    rng: np.random.Generator,
    rows: int | None,
    symbols: Mapping[str, float] | None,
    recorded: LinearForms | None,
) -> Floats:
    """Rows uᵀX at random states and virtual velocities u, columns scaled to unit size.

    Rotations are any, translations of the size of the links, rates within 3 rad/s and accelerations within 10 rad/s².
    If omitted, there are at least half as many rows again as columns.
    """
    rows = rows or max(_FEWEST_ROWS, int(_ROWS_PER_COLUMN * len(columns)))
    if mechanism.closures:
        closed = Assembly(mechanism, symbols)
        count = -(-rows // max(1, len(mechanism.outputs)))
        states = closed.determined_states(rng, count, motions=_MOTIONS if count > _FEW_STATES else 1)
        found = evaluate_floats(virtual_power_form(mechanism), mechanism, *states, symbols, assembly=closed)
        stacked = found.reshape(-1, found.shape[2])[:, list(columns)]
        length = characteristic_length(mechanism)
        stacked *= np.array([length ** mechanism.columns[column].length_degree for column in columns])
        sizes = np.linalg.norm(stacked, axis=0)
        scaled: Floats = stacked / np.maximum(sizes, _NOISE_AT_CLOSED_STATES * sizes.max(initial=1e-300))
        return scaled
    forms = (virtual_power_form(mechanism) if recorded is None else recorded).columns(columns)
    stacked, rounding = _at_states(mechanism, forms, rng, rows, symbols)
    sizes = np.linalg.norm(stacked, axis=0)
    seen = sizes > _NOISE * rounding
    return np.where(seen, stacked, 0.0) / np.where(seen, sizes, 1.0)


def _at_states(
    mechanism: Mechanism, forms: LinearForms, rng: np.random.Generator, rows: int, given: Mapping[str, float] | None
) -> tuple[Floats, Floats]:
    """Rows at random states where all entries are finite, and the size of the rounding in every column."""
    program, entries = forms.program, forms.entries
    schedule = Schedule(program, list(entries.values()))
    names = [program.inputs[node].name for node in schedule.leaves if program.inputs[node].role == "symbol"]
    symbols, scales = symbol_values(mechanism, names, given), _scales(mechanism)
    blocks: list[Floats] = []
    count, rounding = 0, np.zeros(forms.shape[1])
    for _ in range(_ROUNDS + rows // _BLOCK):
        leaves = _random_inputs(program, symbols, scales, rng)
        precisions = (FloatArithmetic(), *([] if count else [_SinglePrecision()]))  # one block shows the rounding
        found = np.zeros((len(precisions), _BLOCK, forms.shape[1]))
        for matrix, arithmetic in zip(found, precisions, strict=True):
            with np.errstate(all="ignore"):
                values = schedule.run(arithmetic, {node: leaves[node] for node in schedule.leaves}, _BLOCK)
            matrix[:, [column for _, column in entries]] = values.T
        found = found[:, np.isfinite(found).all(axis=(0, 2))]
        if not count and found.shape[1]:
            rounding = _SINGLE_TO_DOUBLE * np.linalg.norm(found[1] - found[0], axis=0) * sqrt(rows / found.shape[1])
        blocks.append(found[0])
        count += found.shape[1]
        if count >= rows:
            return np.concatenate(blocks)[:rows], rounding
    raise InputError("no random states are found at which the regressor is finite")


class _SinglePrecision(FloatArithmetic):
    dtype: npt.DTypeLike = np.float32


def _random_inputs(
    program: Program, symbols: Mapping[str, float], scales: Mapping[str, float], rng: np.random.Generator
) -> dict[int, Floats]:
    """Random values of a program's inputs; what has no scale is within ±1."""
    drawn = {}
    for node, given in program.inputs.items():
        value = symbols.get(given.name, 0.0)
        random = scales.get(given.name, 1.0) * rng.uniform(-1.0, 1.0, _BLOCK)
        drawn[node] = np.full(_BLOCK, value) if given.role == "symbol" else random
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
        turn = 1.0 if motion.kind in (MotionKind.TRANSLATION, MotionKind.BALL) else np.pi
        scales |= {f"q[{name}]": unit * turn for name in motion.positions}
        for name in motion.velocities:
            scales |= {f"qd[{name}]": unit * _RATE, f"qdd[{name}]": unit * _ACCELERATION}
    return scales


def _above(values: Sequence[float], tolerance: float) -> int:
    return sum(value > tolerance for value in values)


def _fractions(values: Floats) -> tuple[float, ...]:
    """Values as fractions of the first, which is the largest."""
    largest = float(values[0]) if len(values) else 0.0
    return tuple(float(value) / largest if largest else 0.0 for value in values)
