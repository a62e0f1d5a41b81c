"""Norms of columns whose squares would overflow or vanish, as LLVM text."""

from __future__ import annotations

from echelon.machine.text import number
from echelon.observe.routine import Routine
from echelon.observe.tiles import Tiling, broadcast, sums


def scaled_norm_text(tiling: Tiling) -> str:
    """``@scaled_norm``: √(α² + xᵀx) where the squares would overflow or vanish, and whether x is zero."""
    v, routine = tiling.vector, Routine()

    def largest(row: str, carried: list[str]) -> list[str]:
        size = routine.let(f"call {v.type} @llvm.fabs.{v.suffix}({v.type} {tiling.load(routine, '%x', row)})")
        more = routine.let(f"fcmp ogt {v.type} {size}, {carried[0]}")
        return [routine.let(f"select {v.bits} {more}, {v.type} {size}, {v.type} {carried[0]}")]

    lanes = routine.loop((0, tiling.rows, v.lanes), [(v.type, "zeroinitializer")], largest)[0]
    tail = _largest_lane(routine, tiling, lanes)
    head = routine.let("call double @llvm.fabs.f64(double %alpha)")
    scale = _maximum(routine, head, tail)
    nothing = routine.let(f"fcmp oeq double {scale}, 0.0")
    divisor = routine.let(f"select i1 {nothing}, double {number(1.0)}, double {scale}")
    divisors = broadcast(routine, v.lanes, divisor)

    def squares(row: str, totals: list[str]) -> list[str]:
        value = routine.let(f"fdiv {v.type} {tiling.load(routine, '%x', row)}, {divisors}")
        return [tiling.add_product(routine, value, value, totals[0])]

    total = sums(routine, v, routine.loop((0, tiling.rows, v.lanes), [(v.type, "zeroinitializer")], squares))[0]
    alpha = routine.let(f"fdiv double %alpha, {divisor}")
    whole = routine.let(f"fadd double {total}, {routine.let(f'fmul double {alpha}, {alpha}')}")
    norm = routine.let(f"fmul double {divisor}, {routine.let(f'call double @llvm.sqrt.f64(double {whole})')}")
    # not-a-number must show in R: comparisons with it are false, so it could pass for a zero column
    number_ = routine.let(f"fcmp ord double {norm}, {norm}")
    zero = routine.let(f"and i1 {number_}, {routine.let(f'fcmp oeq double {tail}, 0.0')}")
    pair = routine.let(f"insertvalue {{ double, i1 }} poison, double {norm}, 0")
    result = routine.let(f"insertvalue {{ double, i1 }} {pair}, i1 {zero}, 1")
    head_text = "define internal { double, i1 } @scaled_norm(ptr %x, double %alpha) noinline nounwind cold"
    return f"{head_text} {{\nentry:\n{routine.text()}\n  ret {{ double, i1 }} {result}\n}}\n"


def _maximum(routine: Routine, a: str, b: str) -> str:
    more = routine.let(f"fcmp ogt double {a}, {b}")
    return routine.let(f"select i1 {more}, double {a}, double {b}")


def _largest_lane(routine: Routine, tiling: Tiling, vector: str) -> str:
    kind = tiling.vector.type
    lanes = [routine.let(f"extractelement {kind} {vector}, i64 {i}") for i in range(tiling.vector.lanes)]
    found = lanes[0]
    for lane in lanes[1:]:
        found = _maximum(routine, found, lane)
    return found
