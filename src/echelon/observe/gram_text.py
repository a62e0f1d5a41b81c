"""The kernel that sums the Gram matrices of blocks of samples, as LLVM text.

Half the work of R-factors, for half their digits: the condition number of WᵀW is the square of W's.
"""

from __future__ import annotations

from echelon.observe.routine import Routine
from echelon.observe.tiles import GROUP, Tiling, sum_rows


def gram_update_text(tiling: Tiling) -> str:
    """``@update``: the upper triangle of an output's Gram matrix, with a block added.

    Its arguments are those of the kernel for R-factors; the number of columns is a multiple of 4.  Entries below the
    diagonal have no meaning.
    """
    routine = Routine()
    arguments = "ptr %buffer, ptr %columns, i64 %size, ptr %r, ptr %v, ptr %t"

    def band(i: str) -> None:
        routine.while_below((i, "%size", tiling.columns), lambda j: _add_tile(routine, tiling, i, j))

    routine.while_below((0, "%size", GROUP), band)
    return routine.function(f"define void @update({arguments}) nounwind")


def _add_tile(routine: Routine, tiling: Tiling, i: str, j: str) -> None:
    """Inner products of four columns with those of a tile."""
    left, right = tiling.listed(routine, i, GROUP), tiling.listed(routine, j, tiling.columns)

    def turn(row: str, totals: list[str]) -> list[str]:
        x = [tiling.load(routine, column, row) for column in left]
        y = [tiling.load(routine, column, row) for column in right]
        pairs = [(a, b) for a in x for b in y]
        return [tiling.add_product(routine, a, b, total) for (a, b), total in zip(pairs, totals, strict=True)]

    start = [(tiling.vector.type, "zeroinitializer")] * (GROUP * tiling.columns)
    totals = routine.loop((0, tiling.rows, tiling.vector.lanes), start, turn)
    kind = f"<{tiling.columns} x double>"
    for k, products in enumerate(sum_rows(routine, tiling.vector, totals, tiling.columns)):
        line = routine.let(f"mul i64 {routine.let(f'add i64 {i}, {k}')}, %size")
        place = routine.at("%r", routine.let(f"add i64 {line}, {j}"))
        routine.store(kind, routine.let(f"fadd {kind} {routine.load(kind, place)}, {products}"), place)
