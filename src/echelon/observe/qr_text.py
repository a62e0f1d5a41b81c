"""The kernel that turns blocks of samples into R-factors, as LLVM text.

One kernel serves every robot: which columns an output has is data.  A block's columns are brought up to date with the
reflectors of all earlier columns eight at a time (left-looking), which reads every stored reflector once for eight
columns and writes every column once.
"""

from __future__ import annotations

from functools import partial

from echelon.machine.text import Vector
from echelon.observe.apply_text import apply_text
from echelon.observe.norm_text import scaled_norm_text
from echelon.observe.reflectors import factor_text
from echelon.observe.routine import Routine
from echelon.observe.tiles import GROUP, Tiling

_PANEL = 2 * GROUP


def qr_text(tiling: Tiling) -> str:
    """``@update`` and ``@merge``."""
    widths = [*range(1, GROUP + 1), _PANEL]
    parts = [_declarations(tiling.vector), scaled_norm_text(tiling)]
    parts += [apply_text(tiling, width) for width in widths]
    parts += [factor_text(tiling, width) for width in range(1, GROUP + 1)]
    parts += [_panel_text(tiling, width) for width in widths]
    return "\n".join([*parts, _update_text(), _merge_text(tiling)])


def _declarations(v: Vector) -> str:
    """Intrinsic functions that reflectors and norms use."""
    return (
        f"declare double @llvm.sqrt.f64(double)\ndeclare double @llvm.copysign.f64(double, double)\n"
        f"declare double @llvm.fabs.f64(double)\ndeclare {v.type} @llvm.fabs.{v.suffix}({v.type})\n"
    )


def _panel_text(tiling: Tiling, width: int) -> str:
    """``@panel{width}``: columns j … j+width−1, brought up to date and cleared.

    They are read where the generator left them and written behind the columns of V before them.
    """
    routine = Routine()
    rows = tiling.rows
    given, own = (routine.let(f"alloca [{width} x ptr], align 8") for _ in range(2))
    first = routine.at("%v", routine.let(f"mul i64 %j, {rows}"))
    sources = tiling.listed(routine, "%j", width)
    targets = tiling.columns_at(routine, first, range(width))
    for table, pointers in ((given, sources), (own, targets)):
        for c, pointer in enumerate(pointers):
            routine.do(f"store ptr {pointer}, ptr {routine.let(f'getelementptr ptr, ptr {table}, i64 {c}')}")
    groups = routine.let(f"lshr i64 %j, {GROUP.bit_length() - 1}")
    routine.when(routine.let("icmp eq i64 %j, 0"), lambda: _copy(routine, tiling, sources, targets))

    def apply(group: str) -> None:
        v = routine.at("%v", routine.let(f"mul i64 {group}, {GROUP * rows}"))
        t = routine.at("%t", routine.let(f"mul i64 {group}, {GROUP * GROUP}"))
        line = routine.let(f"mul i64 {routine.let(f'mul i64 {group}, {GROUP}')}, %size")
        top = routine.at("%r", routine.let(f"add i64 {line}, %j"))
        new = routine.let(f"icmp eq i64 {group}, 0")
        table = routine.let(f"select i1 {new}, ptr {given}, ptr {own}")
        routine.do(f"call void @apply{width}(ptr {v}, ptr {t}, ptr {top}, i64 %size, ptr {first}, ptr {table})")

    routine.while_below((0, groups, 1), apply)
    _clear_columns(routine, tiling, width, first, own, groups)
    head = f"@panel{width}(ptr %buffer, ptr %columns, i64 %size, ptr %r, ptr %v, ptr %t, i64 %j)"
    return routine.function(f"define internal void {head} noinline nounwind")


def _clear_columns(routine: Routine, tiling: Tiling, width: int, first: str, own: str, groups: str) -> None:
    """Reflectors of columns that are up to date, four at a time."""
    t = routine.at("%t", routine.let(f"mul i64 {groups}, {GROUP * GROUP}"))
    diagonal = routine.at("%r", routine.let(f"mul i64 %j, {routine.let('add i64 %size, 1')}"))
    routine.do(f"call void @factor{min(width, GROUP)}(ptr {first}, ptr {t}, ptr {diagonal}, i64 %size)")
    if width <= GROUP:
        return
    second, right = routine.at(first, GROUP * tiling.rows), routine.at(diagonal, GROUP)
    table = routine.let(f"getelementptr ptr, ptr {own}, i64 {GROUP}")
    routine.do(f"call void @apply{GROUP}(ptr {first}, ptr {t}, ptr {right}, i64 %size, ptr {second}, ptr {table})")
    t, below = routine.at(t, GROUP * GROUP), routine.at(right, routine.let(f"mul i64 %size, {GROUP}"))
    routine.do(f"call void @factor{GROUP}(ptr {second}, ptr {t}, ptr {below}, i64 %size)")


def _copy(routine: Routine, tiling: Tiling, sources: list[str], targets: list[str]) -> None:
    """Copy columns."""

    def turn(row: str, _: list[str]) -> list[str]:
        for source, target in zip(sources, targets, strict=True):
            tiling.store(routine, tiling.load(routine, source, row), target, row)
        return []

    routine.loop((0, tiling.rows, tiling.vector.lanes), [], turn)


def _update_text() -> str:
    """``@update``: R of an output, brought up to date with a block.

    Its arguments are the block, the numbers of the output's columns in it, how many there are, R (row-major), and room
    for V and T.
    """
    routine = Routine()
    arguments = "ptr %buffer, ptr %columns, i64 %size, ptr %r, ptr %v, ptr %t"

    def panel(width: int, j: str) -> None:
        routine.do(f"call void @panel{width}({arguments}, i64 {j})")

    whole = routine.let(f"and i64 %size, -{_PANEL}")
    routine.while_below((0, whole, _PANEL), lambda j: panel(_PANEL, j))
    half = routine.let(f"and i64 %size, {GROUP}")
    routine.when(routine.let(f"icmp ne i64 {half}, 0"), lambda: panel(GROUP, whole))
    start = routine.let(f"add i64 {whole}, {half}")
    rest = routine.let(f"sub i64 %size, {start}")
    for width in range(1, GROUP):
        routine.when(routine.let(f"icmp eq i64 {rest}, {width}"), partial(panel, width, start))
    return routine.function(f"define void @update({arguments}) nounwind")


def _merge_text(tiling: Tiling) -> str:
    """``@merge``: the R of all outputs, brought up to date with others.

    Its arguments are the R one after another, the others likewise, the number of outputs and the sizes of their R, a
    block, the numbers 0, 1, … of its columns, and room for V and T.
    """
    routine = Routine()

    def output(number: str, carried: list[str]) -> list[str]:
        factor, other = carried
        size = routine.entry("i64", "%sizes", number)
        routine.while_below((0, size, tiling.rows), lambda first: _merge_rows(routine, tiling, carried, size, first))
        cells = routine.let(f"mul i64 {size}, {size}")
        return [routine.at(factor, cells), routine.at(other, cells)]

    routine.loop((0, "%outputs", 1), [("ptr", "%factors"), ("ptr", "%others")], output)
    head = "@merge(ptr %factors, ptr %others, i64 %outputs, ptr %sizes, ptr %buffer, ptr %columns, ptr %v, ptr %t)"
    return "declare i64 @llvm.smin.i64(i64, i64)\n" + routine.function(f"define void {head} nounwind")


def _merge_rows(routine: Routine, tiling: Tiling, pair: list[str], size: str, first: str) -> None:
    """Bring an R up to date with some rows of another, which fill a block."""
    factor, other = pair
    rows, v = tiling.rows, tiling.vector
    cells = routine.let(f"mul i64 {size}, {rows}")
    routine.while_below((0, cells, v.lanes), lambda cell: tiling.store(routine, v.of(0.0), "%buffer", cell))
    end = routine.let(f"call i64 @llvm.smin.i64(i64 {routine.let(f'add i64 {first}, {rows}')}, i64 {size})")

    def copy(row: str) -> None:
        line = routine.at(other, routine.let(f"mul i64 {row}, {size}"))
        target = routine.at("%buffer", routine.let(f"sub i64 {row}, {first}"))

        def entry(column: str) -> None:
            value = routine.load("double", routine.at(line, column))
            routine.store("double", value, routine.at(target, routine.let(f"mul i64 {column}, {rows}")))

        routine.while_below((row, size, 1), entry)

    routine.while_below((first, end, 1), copy)
    routine.do(f"call void @update(ptr %buffer, ptr %columns, i64 {size}, ptr {factor}, ptr %v, ptr %t)")
