"""From column-major blocks to rows: ``@run`` computes a batch and writes every sample's result as one contiguous row.

A block of as many samples as a vector has lanes is computed and turned into rows tile by tile: squares are transposed
in registers.  Results larger than the caches go past them, a whole cache line at a time, which spares reading every
line before it is written.  Lines are whole for all rows alike only if rows are a multiple of a line; otherwise rows
first become an image in the cache, which is copied out while the next block is computed, because the memory is slower
than the processor and must never wait.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from echelon.machine.kernel_text import Block
from echelon.machine.text import Code, Vector

LINE = 8
"""Doubles in a cache line."""


class Way(Enum):
    """How rows get to the result."""

    CACHED = "written directly, to be read soon"
    STREAMED = "written directly, past the caches"
    IMAGED = "by way of an image, past the caches"


def way(columns: int, *, big: bool) -> Way:
    """The way for rows of some length."""
    if not big:
        return Way.CACHED
    return Way.IMAGED if columns % LINE else Way.STREAMED


def streamed_lines(vector: Vector, columns: int) -> int:
    """Cache lines of an image of rows that are whole wherever the image begins."""
    return max(0, vector.lanes * columns // LINE - 1)


@dataclass(frozen=True)
class Rows:
    """Rows made of a block's columns.

    Attributes
    ----------
    block : Block
        Of as many samples as its vectors have lanes.
    places : tuple of int
        For each column of the row, the entry of the block, or −1 for a structural zero.
    way : Way
    """

    block: Block
    places: tuple[int, ...]
    way: Way

    @property
    def image(self) -> int:
        """Offset of the image in the buffer."""
        return -(-self.block.doubles // LINE) * LINE

    @property
    def spare(self) -> int:
        """Offset of a place to which the first block streams, when there is no image yet."""
        return self.image + -(-self._room // LINE) * LINE

    @property
    def doubles(self) -> int:
        """Doubles that the buffer must hold; zero at first."""
        return self.spare + (self._room if self.way is Way.IMAGED else 0)

    @property
    def _room(self) -> int:
        return self.block.vector.lanes * len(self.places) + LINE


def rows_text(rows: Rows) -> str:
    """Definitions of ``@run`` and what it calls; to be put beside the block's ``@compute``."""
    laid = [_laying(rows, "lay", Way.IMAGED)]
    if rows.way is not Way.IMAGED:
        laid.append(_laying(rows, "lay_rows", rows.way))
    return "\n".join([_tables(rows), *laid, _COPY, _run(rows)])


def _tables(rows: Rows) -> str:
    """For each column, its offset in the buffer, and how many columns before it are not structurally zero."""
    zeros, samples = rows.block.zeros, rows.block.samples
    offsets = [place * samples if place >= 0 else zeros for place in rows.places]
    filled = [0]
    for place in rows.places:
        filled.append(filled[-1] + (place >= 0))
    shown = ((name, ", ".join(f"i32 {n}" for n in t), len(t)) for name, t in (("offsets", offsets), ("filled", filled)))
    return "\n".join(f"@{name} = private constant [{count} x i32] [{text}]" for name, text, count in shown) + "\n"


# -- turning a block ---------------------------------------------------------------------------------------------------


def _laying(rows: Rows, name: str, towards: Way) -> str:
    """A function that writes the rows of a block: single columns up to ``%head``, tiles, and the columns left over.

    Into an image structural zeros need not be written: there they are zero from the start.
    """
    v, width, code = rows.block.vector, len(rows.places), Code()
    rest = code.let(f"sub i64 {width}, %head")
    end = code.let(f"add i64 %head, {code.let(f'and i64 {rest}, -{LINE}')}")
    code.do("br label %left")
    _single_columns(code, rows, "left", "0", "%head", "tiles")
    code.label("tiles")
    code.do("%t = phi i64 [ %head, %left ], [ %t.next, %tile.done ]")
    code.do(f"br i1 {code.let(f'icmp slt i64 %t, {end}')}, label %tile, label %right.begin")
    code.label("tile")
    code.do(f"%t.next = add i64 %t, {LINE}")
    target = code.let("getelementptr double, ptr %target, i64 %t")
    counts = [
        code.let(f"load i32, ptr {code.let(f'getelementptr i32, ptr @filled, i64 {n}')}") for n in ("%t", "%t.next")
    ]
    empty = code.let(f"icmp eq i32 {counts[0]}, {counts[1]}")
    code.do(f"br i1 {empty}, label %{'tile.done' if towards is Way.IMAGED else 'empty'}, label %turn")
    if towards is not Way.IMAGED:
        code.label("empty")
        for lane in range(v.lanes):
            _store_line(code, v, target, lane * width, [v.of(0.0)] * (LINE // v.lanes), towards)
        code.do("br label %tile.done")
    code.label("turn")
    squares = [transposed(code, v, _columns(code, v, first)) for first in range(0, LINE, v.lanes)]
    for lane in range(v.lanes):
        _store_line(code, v, target, lane * width, [square[lane] for square in squares], towards)
    code.do("br label %tile.done")
    code.label("tile.done")
    code.do("br label %tiles")
    code.label("right.begin")
    code.do("br label %right")
    _single_columns(code, rows, "right", end, str(width), "done", before="right.begin")
    code.label("done")
    code.do("ret void")
    head = f"define internal void @{name}(ptr noalias %buffer, ptr noalias %target, i64 %head) noinline {{\nentry:\n"
    return f"{head}{code.text()}\n}}\n"


def _single_columns(code: Code, rows: Rows, name: str, first: str, end: str, then: str, before: str = "entry") -> None:
    """A loop over columns that are written sample by sample."""
    v = rows.block.vector
    code.label(name)
    code.do(f"%{name}.c = phi i64 [ {first}, %{before} ], [ %{name}.next, %{name}.one ]")
    code.do(f"br i1 {code.let(f'icmp slt i64 %{name}.c, {end}')}, label %{name}.one, label %{then}")
    code.label(f"{name}.one")
    code.do(f"%{name}.next = add i64 %{name}.c, 1")
    target = code.let(f"getelementptr double, ptr %target, i64 %{name}.c")
    value = _column(code, v, f"%{name}.c")
    for lane in range(v.lanes):
        pointer = code.let(f"getelementptr double, ptr {target}, i64 {lane * len(rows.places)}")
        code.do(f"store double {code.let(f'extractelement {v.type} {value}, i32 {lane}')}, ptr {pointer}")
    code.do(f"br label %{name}")


def _column(code: Code, v: Vector, column: str) -> str:
    at = code.let(f"getelementptr i32, ptr @offsets, i64 {column}")
    offset = code.let(f"zext i32 {code.let(f'load i32, ptr {at}')} to i64")
    return code.let(f"load {v.type}, ptr {code.let(f'getelementptr double, ptr %buffer, i64 {offset}')}")


def _columns(code: Code, v: Vector, first: int) -> list[str]:
    """Columns of a tile, as many as a vector has lanes."""
    return [_column(code, v, code.let(f"add i64 %t, {first + lane}")) for lane in range(v.lanes)]


def _store_line(code: Code, v: Vector, target: str, offset: int, values: Sequence[str], towards: Way) -> None:
    """A line of one row."""
    hint = f"align {8 * v.lanes}, !nontemporal !1" if towards is Way.STREAMED else "align 8"
    for k, value in enumerate(values):
        pointer = code.let(f"getelementptr double, ptr {target}, i64 {offset + k * v.lanes}")
        code.do(f"store {v.type} {value}, ptr {pointer}, {hint}")


def transposed(code: Code, v: Vector, columns: Sequence[str]) -> list[str]:
    """The transpose of a square of vectors, by exchanging ever larger squares off the diagonal."""
    current = list(columns)
    size = 1
    while size < v.lanes:
        low = [k if not k & size else k - size + v.lanes for k in range(v.lanes)]
        high = [k + size if not k & size else k + v.lanes for k in range(v.lanes)]
        following = current.copy()
        for k in range(v.lanes):
            if not k & size:
                a, b = current[k], current[k + size]
                following[k] = _shuffled(code, v, a, b, low)
                following[k + size] = _shuffled(code, v, a, b, high)
        current, size = following, 2 * size
    return current


def _shuffled(code: Code, v: Vector, a: str, b: str, picked: Sequence[int]) -> str:
    mask = ", ".join(f"i32 {k}" for k in picked)
    return code.let(f"shufflevector {v.type} {a}, {v.type} {b}, <{v.lanes} x i32> <{mask}>")


# -- the loop over blocks ----------------------------------------------------------------------------------------------

_RUN = """define void @run({arguments}) {{
entry:
  %image = getelementptr double, ptr %buffer, i64 {image}
  %start = mul i64 %first, {width}
  %begin = getelementptr double, ptr %out, i64 %start
  %address = ptrtoint ptr %begin to i64
  %back = sub i64 0, %address
  %bytes = and i64 %back, {mask}
  %head = lshr i64 %bytes, 3
  br label %loop
loop:
  %k = phi i64 [ %first, %entry ], [ %next, %laid ]
  %more = icmp slt i64 %k, %end
  br i1 %more, label %block, label %done
block:
  %next = add i64 %k, {lanes}
  %left = sub i64 %end, %k
  %count = call i64 @llvm.smin.i64(i64 %left, i64 {lanes})
  call void @compute(ptr %inputs, ptr %strides, ptr %uniforms, i64 %k, i64 %count, ptr %buffer)
  %offset = mul i64 %k, {width}
  %to = getelementptr double, ptr %out, i64 %offset
  %full = icmp eq i64 %count, {lanes}
  br i1 %full, label %whole, label %part
whole:
  call void @lay_rows(ptr %buffer, ptr %to, i64 %head)
  br label %laid
part:
  call void @lay(ptr %buffer, ptr %image, i64 0)
  %doubles = mul i64 %count, {width}
  call void @copy(ptr %image, ptr %to, i64 0, i64 %doubles)
  br label %laid
laid:
  br label %loop
done:
  fence seq_cst
  ret void
}}
"""

_COPY = """define internal void @copy(ptr noalias %from, ptr noalias %to, i64 %start, i64 %end) noinline {
entry:
  %count = sub i64 %end, %start
  %whole = and i64 %count, -8
  %middle = add i64 %start, %whole
  br label %lines
lines:
  %m = phi i64 [ %start, %entry ], [ %m1, %line ]
  %m.more = icmp slt i64 %m, %middle
  br i1 %m.more, label %line, label %rest
line:
  %m.from = getelementptr double, ptr %from, i64 %m
  %m.to = getelementptr double, ptr %to, i64 %m
  %m.value = load <8 x double>, ptr %m.from, align 8
  store <8 x double> %m.value, ptr %m.to, align 8
  %m1 = add i64 %m, 8
  br label %lines
rest:
  %a = phi i64 [ %middle, %lines ], [ %a1, %one ]
  %a.more = icmp slt i64 %a, %end
  br i1 %a.more, label %one, label %done
one:
  %a.from = getelementptr double, ptr %from, i64 %a
  %a.to = getelementptr double, ptr %to, i64 %a
  %a.value = load double, ptr %a.from
  store double %a.value, ptr %a.to
  %a1 = add i64 %a, 1
  br label %rest
done:
  ret void
}
"""

_RUN_IMAGED = """define void @run({arguments}) {{
entry:
  %image = getelementptr double, ptr %buffer, i64 {image}
  %spare = getelementptr double, ptr %buffer, i64 {spare}
  br label %loop
loop:
  %k = phi i64 [ %first, %entry ], [ %next, %block ]
  %doubles = phi i64 [ 0, %entry ], [ %doubles1, %block ]
  %previous = phi ptr [ %spare, %entry ], [ %to, %block ]
  %more = icmp slt i64 %k, %end
  br i1 %more, label %block, label %done
block:
  %next = add i64 %k, {lanes}
  %left = sub i64 %end, %k
  %count = call i64 @llvm.smin.i64(i64 %left, i64 {lanes})
  %address = ptrtoint ptr %previous to i64
  %back = sub i64 0, %address
  %bytes = and i64 %back, 63
  %head = lshr i64 %bytes, 3
  %tail = add i64 %head, {streamed}
  %stream.from = getelementptr double, ptr %image, i64 %head
  %stream.to = getelementptr double, ptr %previous, i64 %head
  call void @compute(ptr %inputs, ptr %strides, ptr %uniforms, i64 %k, i64 %count, ptr %buffer,
                     ptr %stream.from, ptr %stream.to)
  call void @copy(ptr %image, ptr %previous, i64 0, i64 %head)
  call void @copy(ptr %image, ptr %previous, i64 %tail, i64 {whole})
  call void @lay(ptr %buffer, ptr %image, i64 0)
  %offset = mul i64 %k, {width}
  %to = getelementptr double, ptr %out, i64 %offset
  %doubles1 = mul i64 %count, {width}
  br label %loop
done:
  call void @copy(ptr %image, ptr %previous, i64 0, i64 %doubles)
  fence seq_cst
  ret void
}}
"""


def _run(rows: Rows) -> str:
    block, width = rows.block, len(rows.places)
    values = {
        "arguments": "ptr %inputs, ptr %strides, ptr %uniforms, i64 %first, i64 %end, ptr %buffer, ptr %out",
        "image": rows.image,
        "lanes": block.vector.lanes,
        "width": width,
    }
    if rows.way is not Way.IMAGED:
        # lines matter only where they are written past the caches; a row shorter than its head has none
        return _RUN.format(**values, mask=63 if rows.way is Way.STREAMED else 0)
    whole = block.vector.lanes * width
    return _RUN_IMAGED.format(**values, spare=rows.spare, streamed=block.streamed * LINE, whole=whole)
