"""From column-major blocks to rows: ``@run`` computes a batch and writes every sample's result as one contiguous row.

A block of as many samples as a vector has lanes is computed, turned tile by tile into an image of the rows it becomes
(squares are transposed in registers), and the image is copied out.  Where the whole result is larger than the caches
the copy bypasses them, which spares reading every line before it is written.  Structural zeros cost only the copy: they
are zero in the image from the start.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from echelon.machine.kernel_text import Block
from echelon.machine.text import Code, Vector

_LINE = 8  # doubles in a cache line


@dataclass(frozen=True)
class Rows:
    """Rows made of a block's columns.

    Attributes
    ----------
    block : Block
        Of as many samples as its vectors have lanes.
    places : tuple of int
        For each column of the row, the entry of the block, or −1 for a structural zero.
    """

    block: Block
    places: tuple[int, ...]

    @property
    def image(self) -> int:
        """Offset of the image in the buffer."""
        return -(-self.block.doubles // _LINE) * _LINE

    @property
    def doubles(self) -> int:
        """Doubles that the buffer must hold; zero at first."""
        lanes = self.block.vector.lanes
        return self.image + lanes * len(self.places) + lanes

    def tiles(self) -> list[tuple[int, tuple[int, ...]]]:
        """First column, and offsets in the buffer of the columns, of tiles that are not all zero; the last comes first.

        The last tile of a row may reach into the next row, so later tiles must overwrite what it leaves there.
        """
        lanes, samples = self.block.vector.lanes, self.block.samples
        padded = [*self.places, *(-1,) * (-len(self.places) % lanes)]
        found = []
        for first in range(0, len(padded), lanes):
            tile = padded[first : first + lanes]
            if any(place >= 0 for place in tile):
                found.append((first, tuple(p * samples if p >= 0 else self.block.zeros for p in tile)))
        return found[::-1]


def rows_text(rows: Rows) -> str:
    """Definitions of ``@run`` and what it calls; to be put beside the block's ``@compute``."""
    return "\n".join([_tables(rows), _transposing(rows), _copying("plain"), _copying("streamed"), _run(rows)])


def _tables(rows: Rows) -> str:
    tiles = rows.tiles()
    firsts = ", ".join(f"i32 {first}" for first, _ in tiles)
    offsets = ", ".join(f"i32 {offset}" for _, tile in tiles for offset in tile)
    count, lanes = len(tiles), rows.block.vector.lanes
    return (
        f"@firsts = private constant [{count} x i32] [{firsts}]\n"
        f"@offsets = private constant [{count * lanes} x i32] [{offsets}]\n"
    )


def _transposing(rows: Rows) -> str:
    """``@lay``: all tiles of a block into the image."""
    v, code = rows.block.vector, Code()
    if not rows.tiles():
        return "define internal void @lay(ptr %buffer, ptr %image) {\n  ret void\n}\n"
    code.do("br label %loop")
    code.label("loop")
    code.do("%t = phi i64 [ 0, %entry ], [ %next, %loop ]")
    begin = code.let(f"mul i64 %t, {v.lanes}")
    columns = []
    for lane in range(v.lanes):
        at = code.let(f"getelementptr i32, ptr @offsets, i64 {code.let(f'add i64 {begin}, {lane}')}")
        offset = code.let(f"zext i32 {code.let(f'load i32, ptr {at}')} to i64")
        pointer = code.let(f"getelementptr double, ptr %buffer, i64 {offset}")
        columns.append(code.let(f"load {v.type}, ptr {pointer}"))
    first_at = code.let("getelementptr i32, ptr @firsts, i64 %t")
    first = code.let(f"zext i32 {code.let(f'load i32, ptr {first_at}')} to i64")
    target = code.let(f"getelementptr double, ptr %image, i64 {first}")
    for lane, value in enumerate(transposed(code, v, columns)):
        pointer = code.let(f"getelementptr double, ptr {target}, i64 {lane * len(rows.places)}")
        code.do(f"store {v.type} {value}, ptr {pointer}, align 8")
    code.do("%next = add i64 %t, 1")
    more = code.let(f"icmp slt i64 %next, {len(rows.tiles())}")
    code.do(f"br i1 {more}, label %loop, label %done")
    code.label("done")
    code.do("ret void")
    head = "define internal void @lay(ptr noalias %buffer, ptr noalias %image) noinline {\nentry:\n"
    return f"{head}{code.text()}\n}}\n"


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


def _copying(kind: str) -> str:
    """``@plain`` or ``@streamed``: copy doubles to any address, whole cache lines at a time."""
    line = f"<{_LINE} x double>"
    hint = ", !nontemporal !1" if kind == "streamed" else ""
    return f"""define internal void @{kind}(ptr noalias %from, ptr noalias %to, i64 %count) noinline {{
entry:
  %address = ptrtoint ptr %to to i64
  %back = sub i64 0, %address
  %bytes = and i64 %back, 63
  %head = lshr i64 %bytes, 3
  %first = call i64 @llvm.smin.i64(i64 %head, i64 %count)
  %left = sub i64 %count, %first
  %lines = and i64 %left, -{_LINE}
  %end = add i64 %first, %lines
  br label %before
before:
  %b = phi i64 [ 0, %entry ], [ %b1, %before_one ]
  %b.more = icmp slt i64 %b, %first
  br i1 %b.more, label %before_one, label %middle
before_one:
  %b.from = getelementptr double, ptr %from, i64 %b
  %b.to = getelementptr double, ptr %to, i64 %b
  %b.value = load double, ptr %b.from
  store double %b.value, ptr %b.to
  %b1 = add i64 %b, 1
  br label %before
middle:
  %m = phi i64 [ %first, %before ], [ %m1, %middle_one ]
  %m.more = icmp slt i64 %m, %end
  br i1 %m.more, label %middle_one, label %after
middle_one:
  %m.from = getelementptr double, ptr %from, i64 %m
  %m.to = getelementptr double, ptr %to, i64 %m
  %m.value = load {line}, ptr %m.from, align 8
  store {line} %m.value, ptr %m.to, align 64{hint}
  %m1 = add i64 %m, {_LINE}
  br label %middle
after:
  %a = phi i64 [ %end, %middle ], [ %a1, %after_one ]
  %a.more = icmp slt i64 %a, %count
  br i1 %a.more, label %after_one, label %done
after_one:
  %a.from = getelementptr double, ptr %from, i64 %a
  %a.to = getelementptr double, ptr %to, i64 %a
  %a.value = load double, ptr %a.from
  store double %a.value, ptr %a.to
  %a1 = add i64 %a, 1
  br label %after
done:
  ret void
}}
"""


def _run(rows: Rows) -> str:
    lanes, width = rows.block.vector.lanes, len(rows.places)
    arguments = "ptr %inputs, ptr %strides, ptr %uniforms, i64 %first, i64 %end, ptr %buffer, ptr %out, i1 %big"
    return f"""define void @run({arguments}) {{
entry:
  %image = getelementptr double, ptr %buffer, i64 {rows.image}
  br label %loop
loop:
  %k = phi i64 [ %first, %entry ], [ %next, %copied ]
  %more = icmp slt i64 %k, %end
  br i1 %more, label %block, label %done
block:
  %next = add i64 %k, {lanes}
  %left = sub i64 %end, %k
  %count = call i64 @llvm.smin.i64(i64 %left, i64 {lanes})
  call void @compute(ptr %inputs, ptr %strides, ptr %uniforms, i64 %k, i64 %count, ptr %buffer)
  call void @lay(ptr %buffer, ptr %image)
  %offset = mul i64 %k, {width}
  %to = getelementptr double, ptr %out, i64 %offset
  %doubles = mul i64 %count, {width}
  br i1 %big, label %stream, label %keep
stream:
  call void @streamed(ptr %image, ptr %to, i64 %doubles)
  br label %copied
keep:
  call void @plain(ptr %image, ptr %to, i64 %doubles)
  br label %copied
copied:
  br label %loop
done:
  fence seq_cst
  ret void
}}
!1 = !{{i32 1}}
"""
