"""The loop over blocks that fuses a generator with a kernel, as LLVM text.

The generator fills a block that fits into the caches, and the kernel uses it up before the next is made: the
observation matrix never exists.
"""

from __future__ import annotations

from echelon.observe.routine import Routine
from echelon.observe.tiles import Tiling


def observe_text(tiling: Tiling) -> str:
    """``@observe``: all outputs' factors, brought up to date with samples that a generator computes.

    Its arguments are the generator with what it wants to know; the first sample and how many, at least one; the block
    and its number of entries; the number of outputs, the sizes of their factors, the numbers of their columns one
    output after the other, their factors one after the other; and room for V and T.
    """
    routine = Routine()
    rows = tiling.rows
    stop = routine.let("add i64 %first, %count")

    def block(sample: str, _: list[str]) -> list[str]:
        left = routine.let(f"sub i64 {stop}, {sample}")
        count = routine.let(f"call i64 @llvm.smin.i64(i64 {left}, i64 {rows})")
        generator = "ptr %inputs, ptr %strides, ptr %uniforms"
        routine.do(f"call void %compute({generator}, i64 {sample}, i64 {count}, ptr %buffer)")
        routine.when(routine.let(f"icmp slt i64 {count}, {rows}"), lambda: _clear(routine, tiling, count))
        _update_all(routine)
        return []

    routine.loop(("%first", stop, rows), [], block)
    generator = "ptr %compute, ptr %inputs, ptr %strides, ptr %uniforms, i64 %first, i64 %count"
    layout = "i64 %entries, i64 %outputs, ptr %sizes, ptr %columns, ptr %factors"
    head = f"define void @observe({generator}, ptr %buffer, {layout}, ptr %v, ptr %t) nounwind"
    return "declare i64 @llvm.smin.i64(i64, i64)\n" + routine.function(head)


def _clear(routine: Routine, tiling: Tiling, count: str) -> None:
    """Rows of the block that hold no sample, set to zero."""

    def column(entry: str) -> None:
        base = routine.at("%buffer", routine.let(f"mul i64 {entry}, {tiling.rows}"))
        routine.while_below((count, tiling.rows, 1), lambda row: routine.store("double", "0.0", routine.at(base, row)))

    routine.while_below((0, "%entries", 1), column)


def _update_all(routine: Routine) -> None:
    """Every output's R brought up to date with the block."""

    def output(number: str, carried: list[str]) -> list[str]:
        columns, factor = carried
        size = routine.entry("i64", "%sizes", number)
        arguments = f"ptr %buffer, ptr {columns}, i64 {size}, ptr {factor}, ptr %v, ptr %t"
        routine.do(f"call void @update({arguments})")
        following = routine.let(f"getelementptr i64, ptr {columns}, i64 {size}")
        return [following, routine.at(factor, routine.let(f"mul i64 {size}, {size}"))]

    routine.loop((0, "%outputs", 1), [("ptr", "%columns"), ("ptr", "%factors")], output)
