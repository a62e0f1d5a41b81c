"""What snapping changed: the literal rank beside the intended one, and the snaps that made the difference.

Underneath is a net: a float rank of the literal numbers at several tolerances.  It decides nothing, but where none of
them confirms the exact rank of the literal reading, that is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from echelon.base.matrix import BaseMatrix
from echelon.base.numeric_rank import numeric_ranks
from echelon.base.own import stated_structure
from echelon.errors import DegenerateSampleError, InputError
from echelon.exact.elimination import rank as rank_modulo
from echelon.exact.field import ARRAY_BITS, PrimeField
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.reading import Reading, Snap
from echelon.mechanism.stated import StatedValues, inexact_symbols, stated_values
from echelon.regressor.linear import LinearForms
from echelon.regressor.loops.assembly import Assembled
from echelon.regressor.loops.closing import assembled, closing_notes
from echelon.regressor.loops.coordinates import split_balls
from echelon.seeds import DEFAULT_SEED, random_generator

ROUNDING = 1e-9
"""Snaps up to this size are what decimals of a file cannot help, and part of the literal reading too."""


_MOST_COLUMNS = 300
"""Of more, float ranks would take too much of the time: so many neighbours are compared instead of all."""
_CLEAR_GAP = 1e3
"""Singular values that fall more evenly, as of motions that hardly leave a pose, tell nothing."""
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
    """How a file was read: the literal reading beside the intended one."""

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
    """What was snapped, and what the literal reading of the mechanism's file would give."""
    reading = mechanism.reading
    moved = assembled(mechanism) if mechanism.closures else None
    notes = (*(() if reading is None else reading.notes), *mechanism_notes(mechanism))
    if reading is None:
        doubt = _doubt(mechanism, recorded, rank, rank, matrix)
        return ReadingReport((), notes, doubt=doubt, assembled=moved)
    mimics = mimic_ranks(mechanism, rank, rng)
    coarse = [snap for snap in reading.snaps if snap.difference > ROUNDING]
    if not coarse:
        doubt = _doubt(mechanism, recorded, rank, rank, matrix)
        return ReadingReport(reading.snaps, notes, doubt=doubt, mimics=mimics, assembled=moved)
    literal_rank = stated_structure(reading.literal(), rng).rank
    decisive: list[Snap] = []
    if literal_rank != rank:
        elements = list(dict.fromkeys(snap.element for snap in coarse))
        chosen = set(_decisive(reading, elements, rank, len(mechanism.bodies), rng))
        decisive = [snap for snap in coarse if snap.element in chosen]
    doubt = _doubt(mechanism, recorded, literal_rank, rank, matrix if literal_rank == rank else None)
    return ReadingReport(reading.snaps, notes, literal_rank, tuple(decisive), doubt, mimics, moved)


def mechanism_notes(mechanism: Mechanism) -> list[str]:
    """What a user should know of a mechanism, whatever it was read from."""
    notes = [
        f"bodies {mechanism.carrier_name(k)} share the parameters of label '{mechanism.bodies[k].label}'"
        for k in mechanism.carriers
        if len(mechanism.sharing[k]) > 1
    ]
    if not mechanism.closures:
        return notes
    split = ", ".join(f"'{name}'" for name in split_balls(mechanism))
    what = "the loops leave a part of a free rotation open, such as the spin of a rod between two balls"
    return [*closing_notes(mechanism), *notes, *([f"{what}: independent is {split}"] if split else [])]


def doubt_of_directions(mechanism: Mechanism, rank: int) -> str:
    """What speaks against a rank with loops where directions have no exact values, such as (1, 2, 0); empty if nothing.

    Points that are stated along such a direction are not on it exactly.
    """
    coarse = mechanism.reading is not None and any(snap.difference > ROUNDING for snap in mechanism.reading.snaps)
    if not mechanism.closures or not inexact_symbols(mechanism) or coarse:
        return ""
    return _doubt(mechanism, None, rank, rank, None)


def _doubt(
    mechanism: Mechanism, recorded: LinearForms | None, literal: int, intended: int, matrix: BaseMatrix | None
) -> str:
    """What the float ranks of the literal numbers are, if none of them is what was expected.

    Snaps explain all ranks from the intended one to the literal one: what they move by little shows little.
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
        found = numeric_ranks(mechanism, near=high, recorded=recorded, columns=columns)
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


def _decisive(
    reading: Reading[Mechanism], elements: Sequence[str], rank: int, bodies: int, rng: np.random.Generator
) -> list[str]:
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
