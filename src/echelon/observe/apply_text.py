"""Four Householder reflectors at once, applied to later columns of a block and to R above them, as LLVM text.

The product of four reflectors is I − V T Vᵀ with a 4 × 4 triangle T (Schreiber and Van Loan, SIAM J. Sci. Stat. Comput.
10, 1989), so a tile of columns is read once for their inner products with V and once to subtract.
"""

from __future__ import annotations

from echelon.observe.routine import Routine
from echelon.observe.tiles import GROUP, Tiling, broadcast, row_at, sum_rows


def apply_text(tiling: Tiling, width: int) -> str:
    """``@apply{width}``: four reflectors applied to some columns and to the rows of R above them.

    Its arguments are V (four columns), T, the first of the four rows of R at the first of the columns, the row length
    of R, where the columns go, and a list of where they come from.
    """
    routine = Routine()
    waiting = None
    # the sums of one tile are added up while the products of the next are formed
    for tile in tiling.tiles(width):
        weights = _weights(routine, tiling, tile)
        if waiting is not None:
            _subtract(routine, tiling, *waiting)
        waiting = (tile, weights)
    if waiting is not None:
        _subtract(routine, tiling, *waiting)
    return routine.function(
        f"define internal void @apply{width}(ptr %v, ptr %t, ptr %top, i64 %size, ptr %a, ptr %from) noinline nounwind"
    )


def _sources(routine: Routine, tile: range) -> list[str]:
    return [routine.entry("ptr", "%from", c) for c in tile]


def _weights(routine: Routine, tiling: Tiling, tile: range) -> list[str]:
    """Tᵀ (R + Vᵀ A) for a tile, subtracted from R: four vectors with a lane for each column."""
    v, a = tiling.columns_at(routine, "%v", range(GROUP)), _sources(routine, tile)
    kind = tiling.vector.type

    def turn(row: str, totals: list[str]) -> list[str]:
        left = [tiling.load(routine, column, row) for column in v]
        right = [tiling.load(routine, column, row) for column in a]
        pairs = [(x, y) for x in left for y in right]
        return [tiling.add_product(routine, x, y, total) for (x, y), total in zip(pairs, totals, strict=True)]

    start = [(kind, "zeroinitializer")] * (GROUP * len(tile))
    totals = routine.loop((0, tiling.rows, tiling.vector.lanes), start, turn)
    row = f"<{len(tile)} x double>"
    places = [routine.at(row_at(routine, i), tile[0]) for i in range(GROUP)]
    tops = [routine.load(row, place) for place in places]
    products = sum_rows(routine, tiling.vector, totals, len(tile))
    inner = [routine.let(f"fadd {row} {top}, {product}") for top, product in zip(tops, products, strict=True)]
    weights = [_combined(routine, len(tile), inner, j) for j in range(GROUP)]
    for place, top, weight in zip(places, tops, weights, strict=True):
        routine.store(row, routine.let(f"fsub {row} {top}, {weight}"), place)
    return weights


def _combined(routine: Routine, width: int, inner: list[str], j: int) -> str:
    """Row j of Tᵀ times the inner products."""
    row, total = f"<{width} x double>", ""
    for i in range(j + 1):
        entry = routine.load("double", routine.at("%t", i * GROUP + j))
        factor = broadcast(routine, width, entry)
        if total:
            total = routine.add_product(row, factor, inner[i], total)
        else:
            total = routine.let(f"fmul contract {row} {factor}, {inner[i]}")
    return total


def _subtract(routine: Routine, tiling: Tiling, tile: range, weights: list[str]) -> None:
    """A − V w for a tile."""
    v, sources = tiling.columns_at(routine, "%v", range(GROUP)), _sources(routine, tile)
    targets = tiling.columns_at(routine, "%a", tile)
    row = f"<{len(tile)} x double>"
    spread = [
        [
            broadcast(routine, tiling.vector.lanes, routine.let(f"extractelement {row} {weight}, i64 {c}"))
            for c in range(len(tile))
        ]
        for weight in weights
    ]

    def turn(index: str, _: list[str]) -> list[str]:
        left = [tiling.load(routine, column, index) for column in v]
        for c, (source, target) in enumerate(zip(sources, targets, strict=True)):
            value = tiling.load(routine, source, index)
            for reflector, factors in zip(left, spread, strict=True):
                value = tiling.subtract_product(routine, reflector, factors[c], value)
            tiling.store(routine, value, target, index)
        return []

    routine.loop((0, tiling.rows, tiling.vector.lanes), [], turn)
