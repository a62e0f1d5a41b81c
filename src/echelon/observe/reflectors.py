"""Householder reflectors that clear columns of a block below a triangle, as LLVM text.

For a column with the entry α in the triangle R and x in the block below it,

    β = −sign(α) √(α² + xᵀx),   u = α − β,   v = x/u,   τ = −u/β

and H = I − τ [1; v] [1; v]ᵀ makes it [β; 0] (Golub and Van Loan, Matrix Computations, 4th ed., 5.1).  The rows of R
above and below α are not touched, so the heads of different reflectors never meet and only the tails v are stored.

Reflectors are made in groups of four, with the triangle T of their product.  The inner products that T needs are taken
together with those that the next column needs, in one pass over the columns for each reflector.
"""

from __future__ import annotations

from echelon.machine.text import number
from echelon.observe.routine import Routine
from echelon.observe.tiles import GROUP, Tiling, broadcast, row_at, sums

_SMALLEST, _LARGEST = 1e-280, 1e280  # squares outside lose digits or overflow: then the norm is taken of scaled values


def factor_text(tiling: Tiling, width: int) -> str:
    """``@factor{width}``: reflectors that clear some columns; V, T and R for four, R alone for fewer.

    Its arguments are the columns (which V replaces), T, the diagonal entry of R at the first column, and the row length
    of R.
    """
    panel = _Panel(tiling, width)
    for j in range(width):
        panel.reflect(j, panel.products(j))
    if panel.full:
        panel.scale_last()
        panel.triangle()
    return panel.routine.function(
        f"define internal void @factor{width}(ptr %a, ptr %t, ptr %top, i64 %size) noinline nounwind"
    )


class _Panel:
    """The columns of one group while their reflectors are made."""

    def __init__(self, tiling: Tiling, width: int) -> None:
        self.tiling, self.width = tiling, width
        self.full = width == GROUP  # fewer are the last ones: no column follows to which they would be applied
        self.routine = Routine()
        self.columns = tiling.columns_at(self.routine, "%a", range(width))
        self.inverse: list[str] = []  # 1/u of each reflector
        self.tau: list[str] = []
        self.factors: dict[int, str] = {}  # of the last reflector, by later column, in all lanes
        self.gram: dict[tuple[int, int], str] = {}

    def products(self, j: int) -> list[str]:
        """Apply reflector j−1 to the later columns; xᵀx, xᵀ a_k of the later ones and v_iᵀ x of the earlier ones."""
        routine, tiling = self.routine, self.tiling
        earlier = range(j if self.full else 0)
        later = range(j, self.width)
        scale = broadcast(routine, tiling.vector.lanes, self.inverse[-1]) if j else ""

        def turn(row: str, totals: list[str]) -> list[str]:
            read = sorted({*earlier, *later, *range(max(j - 1, 0), j)})
            value = {k: tiling.load(routine, self.columns[k], row) for k in read}
            if j:
                self._apply_previous(j, row, value, scale)
            pairs = [(j, k) for k in later] + [(i, j) for i in earlier]
            return [
                tiling.add_product(routine, value[i], value[k], total)
                for (i, k), total in zip(pairs, totals, strict=True)
            ]

        start = [(tiling.vector.type, "zeroinitializer")] * (len(earlier) + len(later))
        totals = routine.loop((0, tiling.rows, tiling.vector.lanes), start, turn)
        return sums(routine, tiling.vector, totals)

    def _apply_previous(self, j: int, row: str, value: dict[int, str], scale: str) -> None:
        tiling, routine = self.tiling, self.routine
        v = routine.let(f"fmul {tiling.vector.type} {value[j - 1]}, {scale}")
        value[j - 1] = v
        if self.full:
            tiling.store(routine, v, self.columns[j - 1], row)
        for k in range(j, self.width):
            value[k] = tiling.subtract_product(routine, v, self.factors[k], value[k])
            tiling.store(routine, value[k], self.columns[k], row)

    def reflect(self, j: int, products: list[str]) -> None:
        """Reflector j from its inner products; its row of R."""
        routine, tiling = self.routine, self.tiling
        place = routine.at(row_at(routine, j), j)
        alpha = routine.load("double", place)
        norm, zero = self._norm(j, alpha, products[0])
        signed = routine.let(f"call double @llvm.copysign.f64(double {norm}, double {alpha})")
        beta = routine.let(f"fneg double {signed}")
        u = routine.let(f"fsub double {alpha}, {beta}")
        one = number(1.0)
        nothing = number(0.0)
        over_u = routine.let(f"fdiv double {one}, {u}")
        over_beta = routine.let(f"fdiv double {one}, {signed}")  # −1/β
        over_u = routine.let(f"select i1 {zero}, double {nothing}, double {over_u}")
        over_beta = routine.let(f"select i1 {zero}, double {nothing}, double {over_beta}")
        self.inverse.append(over_u)
        self.tau.append(routine.let(f"fmul double {u}, {over_beta}"))
        routine.store("double", routine.let(f"select i1 {zero}, double {alpha}, double {beta}"), place)
        later = range(j + 1, self.width)
        self.factors = {}
        for k, product in zip(later, products[1:], strict=False):
            above = routine.at(place, k - j)
            top = routine.load("double", above)
            inner = routine.add_product("double", u, top, product)
            factor = routine.let(f"fmul double {inner}, {over_beta}")
            routine.store("double", routine.let(f"fsub double {top}, {factor}"), above)
            self.factors[k] = broadcast(routine, tiling.vector.lanes, factor)
        for i, product in enumerate(products[1 + len(later) :]):
            self.gram[i, j] = routine.let(f"fmul double {product}, {over_u}")

    def _norm(self, j: int, alpha: str, square: str) -> tuple[str, str]:
        """√(α² + xᵀx), and whether x is zero."""
        routine = self.routine
        total = routine.add_product("double", alpha, alpha, square)
        fast = routine.let(f"call double @llvm.sqrt.f64(double {total})")
        empty = routine.let(f"fcmp oeq double {square}, 0.0")
        small = routine.let(f"fcmp ult double {total}, {number(_SMALLEST)}")
        large = routine.let(f"fcmp ugt double {total}, {number(_LARGEST)}")
        outside = routine.let(f"or i1 {small}, {large}")
        before, rare, after = routine.block, routine.fresh("rare"), routine.fresh("norm")
        routine.do(f"br i1 {outside}, label %{rare}, label %{after}")
        routine.label(rare)
        pair = routine.let(f"call {{ double, i1 }} @scaled_norm(ptr {self.columns[j]}, double {alpha})")
        careful, none = (
            routine.let(f"extractvalue {{ double, i1 }} {pair}, 0"),
            routine.let(f"extractvalue {{ double, i1 }} {pair}, 1"),
        )
        routine.do(f"br label %{after}")
        routine.label(after)
        norm = routine.let(f"phi double [ {fast}, %{before} ], [ {careful}, %{rare} ]")
        return norm, routine.let(f"phi i1 [ {empty}, %{before} ], [ {none}, %{rare} ]")

    def scale_last(self) -> None:
        """The tail of the last reflector."""
        routine, tiling, column = self.routine, self.tiling, self.columns[-1]
        scale = broadcast(routine, tiling.vector.lanes, self.inverse[-1])

        def turn(row: str, _: list[str]) -> list[str]:
            value = tiling.load(routine, column, row)
            tiling.store(routine, routine.let(f"fmul {tiling.vector.type} {value}, {scale}"), column, row)
            return []

        routine.loop((0, tiling.rows, tiling.vector.lanes), [], turn)

    def triangle(self) -> None:
        """T, column by column: T_ij = −τ_j Σ_l T_il v_lᵀ v_j."""
        routine = self.routine
        t = {(j, j): tau for j, tau in enumerate(self.tau)}
        for j in range(GROUP):
            for i in range(j):
                total = number(0.0)
                for k in range(i, j):
                    total = routine.add_product("double", t[i, k], self.gram[k, j], total)
                t[i, j] = routine.let(f"fneg double {routine.let(f'fmul double {total}, {self.tau[j]}')}")
        for (i, j), value in t.items():
            routine.store("double", value, routine.at("%t", i * GROUP + j))
