"""Effect of snapping: the literal rank beside the intended one, and the snaps that made the difference.

Underneath is a net: what floating point says about the rank of the literal numbers (:mod:`echelon.base.numeric_ranks`).
It decides nothing; but where no tolerance confirms the exact rank of the literal reading and a clear gap is somewhere
else, that is said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echelon.algebra import ARRAY_BITS, DEFAULT_SEED, PrimeField, random_generator
from echelon.algebra import rank as rank_modulo
from echelon.base.matrix import BaseMatrix
from echelon.base.numeric_ranks import numeric_ranks
from echelon.base.spectrum import CLEAR_GAP, RankSpectrum
from echelon.base.stated_values import MOST_STRUCTURES, stated_structure
from echelon.dynamics import LinearForms, assembly_of, joints_locked_by_loops
from echelon.robot import (
    Assembled,
    Mechanism,
    Reading,
    Snap,
    StatedValues,
    has_values,
    shown_loops,
    split_balls,
    stated_values,
)
from echelon.shared import (
    DegenerateSampleError,
    InputError,
    SingularPoseError,
    in_quotes,
)

ROUNDING = 1e-9
"""Snaps up to this size are what decimals of a file cannot help, and part of the literal reading too."""

MOST_COLUMNS = 300
"""Columns whose float rank is compared; of more, a stretch of so many neighbours."""
LARGEST_RANK = 1000
"""Rank above which float ranks, which then take minutes, are not compared."""
FEWEST_TRIALS = 8
"""Readings that are tried to find out which snaps matter, however many bodies there are."""


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
    literal_rank: int | None = (
        None  # rank of the literal reading; None where nothing that matters was snapped
    )
    decisive: tuple[
        Snap, ...
    ] = ()  # snaps without any of which the rank would not be the intended one
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
    spectrum: RankSpectrum | None = None,
) -> ReadingReport:
    """The numbers that were snapped, and the rank of the literal reading of the mechanism's file.

    Of loops the spectrum says what rounding of lengths and directions makes.
    """
    counted = rank if spectrum is None else spectrum.literal
    report = _compared(mechanism, counted, rng, recorded, matrix, spectrum)
    report = replace(report, mimics=mimic_ranks(mechanism, rank, rng))
    if spectrum is not None and spectrum.note:
        literal_rank = report.literal_rank or spectrum.literal
        report = replace(
            report, notes=(*report.notes, spectrum.note), literal_rank=literal_rank
        )
    return replace(report, doubt=_together(report.doubt, _locked_drives(mechanism)))


def _compared(
    mechanism: Mechanism,
    rank: int,
    rng: np.random.Generator,
    recorded: LinearForms | None,
    matrix: BaseMatrix | None,
    spectrum: RankSpectrum | None,
) -> ReadingReport:
    reading = mechanism.reading
    snaps, notes = ((), ()) if reading is None else (reading.snaps, reading.notes)
    notes = (*notes, *mechanism_notes(mechanism))
    report = ReadingReport(snaps, notes, assembled=moved_to_close(mechanism))
    coarse = [snap for snap in snaps if snap.difference > ROUNDING]
    if (
        reading is None or not coarse
    ):  # to double precision, the numbers as they are read are those of the file
        return replace(
            report,
            doubt=_doubt(mechanism, recorded, rank, rank, matrix, mechanism, spectrum),
        )
    try:
        literal = reading.literal()
        literal_rank = _to_the_letter(literal, rng)
    except (InputError, SingularPoseError) as error:  # rounding has locked loops
        return replace(
            report,
            notes=(*notes, f"the literal reading of the file has no answer: {error}"),
        )
    chosen: set[str] = set()
    if literal_rank != rank:
        elements = list(dict.fromkeys(snap.element for snap in coarse))
        chosen = set(_decisive(reading, elements, rank, len(mechanism.bodies), rng))
    decisive = tuple(snap for snap in coarse if snap.element in chosen)
    known = matrix if literal_rank == rank else None
    doubt = _doubt(mechanism, None, literal_rank, rank, known, literal, spectrum)
    return replace(report, literal_rank=literal_rank, decisive=decisive, doubt=doubt)


def mechanism_notes(mechanism: Mechanism) -> list[str]:
    """Notes on a mechanism, whatever file it was read from."""
    notes = [
        f"bodies {mechanism.carrier_name(k)} share the parameters of label '{mechanism.bodies[k].label}'"
        for k in mechanism.carriers
        if len(mechanism.sharing[k]) > 1 and not mechanism.experiments
    ]
    held = [c.name for c in mechanism.contacts if c.kind.held_axes]
    if held:
        notes.append(
            f"the ground under {in_quotes(held)} may have any slope; level ground alone may show fewer"
        )
    if locked := joints_locked_by_loops(mechanism):
        notes.append(
            f"cannot move, because of {shown_loops(mechanism, locked[0])}: {in_quotes(locked)}"
        )
    split = ", ".join(f"'{name}'" for name in split_balls(mechanism))
    what = "the loops leave part of a free rotation open, such as the spin of a rod between two ball joints"
    return [*notes, *([f"{what}: {split} is independent"] if split else [])]


def moved_to_close(mechanism: Mechanism) -> Assembled | None:
    """Moves that closed the loops of a mechanism; None without loops, or if symbols have no values."""
    closed = assembly_of(mechanism) if has_values(mechanism) else None
    return None if closed is None else closed.assembled


def doubt_of_loops(mechanism: Mechanism) -> str:
    """Evidence against what loops let move; empty if there is none."""
    return _locked_drives(mechanism)


def _locked_drives(mechanism: Mechanism) -> str:
    """That joints with drives cannot move, if there are such; else empty."""
    stated = () if mechanism.reading is None else mechanism.reading.driven
    driven = {
        *stated,
        *(name for actuator in mechanism.actuators for name, _ in actuator.terms),
    }
    locked = (
        [name for name in joints_locked_by_loops(mechanism) if name in driven]
        if driven
        else []
    )
    if not locked:
        return ""
    return (
        f"the loops lock joints that have drives: {in_quotes(locked)}.  To let them move, give a closure a kind "
        "that holds less, such as  joint: spherical  (in MJCF connect instead of weld)"
    )


def _together(*doubts: str) -> str:
    return "; ".join(doubt for doubt in doubts if doubt)


def _doubt(
    mechanism: Mechanism,
    recorded: LinearForms | None,
    literal: int,
    intended: int,
    matrix: BaseMatrix | None,
    as_stated: Mechanism,
    spectrum: RankSpectrum | None,
) -> str:
    """The float ranks of the literal numbers, if none of them is the expected one; else empty, as with loops.

    Snaps explain all ranks from the intended one to the literal one: what they move by little shows little.
    ``as_stated`` has the literal numbers, as far as they differ in double precision.
    """
    if spectrum is not None:  # ball arithmetic tells the size of all singular values
        return ""
    low, high = sorted((literal, intended))
    columns, where = None, ""
    if (
        len(mechanism.parameters) > MOST_COLUMNS
        and matrix is not None
        and matrix.numbers is None
    ):
        columns = _neighbours(len(matrix.parameters))
        part = _rank_of_columns(matrix, columns, stated_values(mechanism))
        if part is None:
            columns = None
        else:
            low = high = part
            where = f", for the parameters {matrix.parameters[columns[0]]} to {matrix.parameters[columns[-1]]}"
    if high > LARGEST_RANK:
        return f"not compared with float ranks, as {high} is more than {LARGEST_RANK}"
    try:
        found = numeric_ranks(
            as_stated, literal=False, near=high, recorded=recorded, columns=columns
        )
    except InputError:  # values are missing, or loops do not close at the stated ones
        return ""
    widest = found.widest_gap()
    if (
        widest is None
        or widest[1] < CLEAR_GAP
        or any(low <= r <= high for r in (*found.ranks, widest[0]))
    ):
        return ""
    if (
        mechanism.effects and max(found.ranks) < low
    ):  # random states may miss small regions of signs
        return ""
    ranks = ", ".join(
        f"{r} at {t:.0e}" for r, t in zip(found.ranks, found.tolerances, strict=True)
    )
    expected = literal if columns is None else high
    return f"floating point with the file's numbers does not confirm {expected}{where}: rank {ranks}"


def _neighbours(count: int) -> range:
    """Columns of links that follow one another, from a random one on."""
    start = int(random_generator(DEFAULT_SEED).integers(count - MOST_COLUMNS + 1))
    return range(start, start + MOST_COLUMNS)


def _rank_of_columns(
    matrix: BaseMatrix, columns: Sequence[int], values: StatedValues
) -> int | None:
    """Rank of some columns of B at the stated values, which is that of X, modulo a random prime.

    None where the values make a denominator zero.
    """
    rng = random_generator(DEFAULT_SEED)
    field = PrimeField.random(rng, ARRAY_BITS)
    try:
        dense = matrix.dense_modulo(
            values.draw(matrix.symbols, field, rng), field, columns
        )
    except DegenerateSampleError:
        return None
    return rank_modulo(dense[dense.any(axis=1)], field)


def mimic_ranks(
    mechanism: Mechanism, rank: int, rng: np.random.Generator
) -> MimicRanks | None:
    """The rank beside that of the other reading of mimic joints; None without mimic joints."""
    reading = mechanism.reading
    try:
        other = None if reading is None else reading.recoupled()
    except InputError:
        return None  # couplings that make no sense, ignored on request
    if other is None:
        return None
    found = stated_structure(other, rng).rank
    if len(mechanism.couplings) > len(other.couplings):
        return MimicRanks(rank, found)
    return MimicRanks(found, rank)


def _to_the_letter(mechanism: Mechanism, rng: np.random.Generator) -> int:
    """The rank, what rounding makes included."""
    structure = stated_structure(mechanism, rng)
    return structure.rank if structure.spectrum is None else structure.spectrum.literal


def _decisive(
    reading: Reading,
    elements: Sequence[str],
    rank: int,
    bodies: int,
    rng: np.random.Generator,
) -> list[str]:
    """Elements that change the rank when taken literally, by bisection; whole groups once enough has been tried."""
    trials = iter(range(max(FEWEST_TRIALS, MOST_STRUCTURES // bodies)))

    def bisected(group: Sequence[str]) -> list[str]:
        if next(trials, None) is None:
            return list(group)
        if _to_the_letter(reading.literal(group), rng) == rank:
            return []
        if len(group) == 1:
            return list(group)
        middle = len(group) // 2
        return [*bisected(group[:middle]), *bisected(group[middle:])] or list(
            group
        )  # only together do they matter

    return bisected(elements)
