"""Tiles: products of a few columns with a few others, in registers, over the rows of a block.

A block holds K rows and is column-major.  Columns are read a vector of rows at a time; a tile of 4 × C inner products
keeps 4·C vectors of partial sums in registers and needs 4 + C loads for 4·C multiply-adds, so that the arithmetic
units and not the cache set the pace.  The partial sums are then added across their lanes all together, by transposing:
a sum across lanes alone is a chain of dependent shuffles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from echelon.machine.target import Target
from echelon.machine.text import Vector
from echelon.observe.routine import Routine

GROUP = 4
"""Reflectors that are applied together, and rows of a tile."""
_MANY = 32


@dataclass(frozen=True)
class Tiling:
    """How a kernel cuts its work.

    Attributes
    ----------
    vector : Vector
    columns : int
        Columns of a tile, C: the widest for which a tile fits into the registers.
    rows : int
        Rows of a block, K, a multiple of the vector's lanes.  Where K·8 bytes divides 4096 the columns compete for the
        same lines of the cache, so K is rather 152 than 128 or 256.
    """

    vector: Vector
    columns: int
    rows: int

    @property
    def alignment(self) -> int:
        """Bytes to which vectors in blocks are aligned."""
        return 8 * self.vector.lanes

    def tiles(self, width: int) -> list[range]:
        """Columns 0 … width−1, cut into tiles."""
        return [range(start, min(start + self.columns, width)) for start in range(0, width, self.columns)]

    def columns_at(self, routine: Routine, base: str, numbers: range) -> list[str]:
        """Addresses of some of the columns that lie one after another."""
        return [routine.at(base, number * self.rows) for number in numbers]

    def listed(self, routine: Routine, first: str, count: int) -> list[str]:
        """Addresses in ``%buffer`` of columns whose numbers are in ``%columns``, from one of these on."""
        base = routine.let(f"getelementptr i64, ptr %columns, i64 {first}")
        numbers = (routine.entry("i64", base, k) for k in range(count))
        return [routine.at("%buffer", routine.let(f"mul i64 {number}, {self.rows}")) for number in numbers]

    def load(self, routine: Routine, column: str, row: str) -> str:
        """A vector of rows of a column."""
        return routine.let(f"load {self.vector.type}, ptr {routine.at(column, row)}, align {self.alignment}")

    def store(self, routine: Routine, value: str, column: str, row: str) -> None:
        """Write a vector of rows of a column."""
        routine.do(f"store {self.vector.type} {value}, ptr {routine.at(column, row)}, align {self.alignment}")

    def add_product(self, routine: Routine, a: str, b: str, total: str) -> str:
        """total + a·b, fused where the processor can."""
        return routine.add_product(self.vector.type, a, b, total)

    def subtract_product(self, routine: Routine, a: str, b: str, total: str) -> str:
        """total − a·b, fused where the processor can."""
        product = routine.let(f"fmul contract {self.vector.type} {a}, {b}")
        return routine.let(f"fsub contract {self.vector.type} {total}, {product}")


def tiling(target: Target, rows: int = 152) -> Tiling:
    """The tiling for a processor.

    Parameters
    ----------
    target : Target
    rows : int
        K, a multiple of the vector's lanes.
    """
    return Tiling(Vector(target.lanes), 4 if target.registers == _MANY else 2, rows)


def row_at(routine: Routine, i: int) -> str:
    """The address of row i of the part of R at ``%top``."""
    return routine.at("%top", routine.let(f"mul i64 %size, {i}"))


def broadcast(routine: Routine, lanes: int, scalar: str) -> str:
    """A vector with the same value in all lanes."""
    kind = f"<{lanes} x double>"
    first = routine.let(f"insertelement {kind} poison, double {scalar}, i64 0")
    return routine.let(f"shufflevector {kind} {first}, {kind} poison, <{lanes} x i32> zeroinitializer")


def shuffle(routine: Routine, lanes: int, a: str, b: str, mask: Sequence[int]) -> str:
    """Some lanes of two vectors side by side."""
    kind = f"<{lanes} x double>"
    chosen = ", ".join(f"i32 {lane}" for lane in mask)
    return routine.let(f"shufflevector {kind} {a}, {kind} {b}, <{len(mask)} x i32> <{chosen}>")


def sums(routine: Routine, vector: Vector, partial: Sequence[str]) -> list[str]:
    """The sum over the lanes of every vector, as scalars.

    Parameters
    ----------
    routine : Routine
    vector : Vector
    partial : sequence of str
        Vectors of partial sums.
    """
    found = []
    for start in range(0, len(partial), vector.lanes):
        some = list(partial[start : start + vector.lanes])
        total, stride = _transposed_sum(routine, vector.lanes, some)
        found += [routine.let(f"extractelement {vector.type} {total}, i64 {i * stride}") for i in range(len(some))]
    return found


def sum_rows(routine: Routine, vector: Vector, partial: Sequence[str], width: int) -> list[str]:
    """The sums over the lanes of rows of vectors, every row of sums as a vector.

    Parameters
    ----------
    routine : Routine
    vector : Vector
    partial : sequence of str
        Vectors of partial sums, row by row.
    width : int
        Vectors in a row, and lanes of the results; at most the vector's lanes.
    """
    found = []
    together = vector.lanes // width * width
    for start in range(0, len(partial), together):
        some = list(partial[start : start + together])
        total, stride = _transposed_sum(routine, vector.lanes, some)
        for first in range(0, len(some), width):
            mask = [(first + i) * stride for i in range(width)]
            found.append(shuffle(routine, vector.lanes, total, "poison", mask))
    return found


def _transposed_sum(routine: Routine, lanes: int, some: list[str]) -> tuple[str, int]:
    """A vector that holds the lane sums of up to `lanes` vectors, in order, each repeated `stride` times."""
    count = 1 << (len(some) - 1).bit_length()
    full = count == lanes
    vectors = some + [some[-1]] * (count - len(some))
    if full:  # the last step takes even lanes from one side and odd lanes from the other, within 128 bits
        vectors = vectors[0::2] + vectors[1::2]
    parts = lanes
    while len(vectors) > (2 if full else 1):
        vectors = [_halved(routine, lanes, parts, a, b) for a, b in zip(vectors[0::2], vectors[1::2], strict=True)]
        parts //= 2
    kind = f"<{lanes} x double>"
    if full:
        a, b = vectors
        low = [lane for pair in range(0, lanes, 2) for lane in (pair, lanes + pair)]
        left, right = shuffle(routine, lanes, a, b, low), shuffle(routine, lanes, a, b, [lane + 1 for lane in low])
        return routine.let(f"fadd {kind} {left}, {right}"), 1
    total, stride = vectors[0], parts
    while parts > 1:
        turned = [s * parts + (r + parts // 2) % parts for s in range(lanes // parts) for r in range(parts)]
        # pairs at a distance of parts/2 within each segment are added; afterwards half a segment is enough
        total = routine.let(f"fadd {kind} {total}, {shuffle(routine, lanes, total, 'poison', turned)}")
        parts //= 2
    return total, stride


def _halved(routine: Routine, lanes: int, parts: int, a: str, b: str) -> str:
    """Vectors with segments of `parts` partial sums, joined into one with segments half as long."""
    half = parts // 2
    low = [side + s * parts + r for side in (0, lanes) for s in range(lanes // parts) for r in range(half)]
    left, right = shuffle(routine, lanes, a, b, low), shuffle(routine, lanes, a, b, [lane + half for lane in low])
    return routine.let(f"fadd <{lanes} x double> {left}, {right}")
