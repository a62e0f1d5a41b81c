"""From column-major blocks to rows: ``@run`` computes a batch and writes each sample's result as one contiguous row.

Results larger than the caches go past them, a whole cache line at a time, which spares reading every line before it is
written.  Memory is slower than the processor, so it must never wait: rows first become an image in the cache, and the
image of one block is copied out while the next block is computed.  Images that do not fit the innermost cache would
have to be read back from the next one; then rows go straight out, if their lines are whole.  Squares of a block are
transposed in registers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

from echelon.compute.machine.kernel_text import DOUBLE, LINE, KernelBlock
from echelon.compute.machine.operations_text import Code, Lowered, Vector

_LARGEST_IMAGE = 2560  # doubles, 20 kB of an innermost cache of 32 kB
# operations for each line that is copied among them: with images that fit, and with long ones, mostly copied apart
_OPERATIONS = {True: 3, False: 64}


class Way(Enum):
    """How rows get to the result."""

    CACHED = "written directly, to be read soon"
    STREAMED = "written directly, past the caches"
    IMAGED = "by way of an image, past the caches"


@dataclass(frozen=True)
class StoredRows:
    """Rows made of a block's columns."""

    block: KernelBlock  # of as many samples as its vectors have lanes
    places: tuple[
        int, ...
    ]  # for each column of the row, the entry of the block, or −1 for a structural zero
    way: Way

    @property
    def image(self) -> int:
        """Offset of the image in the buffer; zero at first."""
        return -(-self.block.doubles // LINE) * LINE

    @property
    def lines(self) -> int:
        """Lines of an image that are whole wherever its copy begins."""
        return max(0, self.block.vector.lanes * len(self.places) // LINE - 1)

    @property
    def spare(self) -> int:
        """Offset of a place to which the first block streams, when there is no image yet."""
        return self.image + self._room

    @property
    def doubles(self) -> int:
        """Doubles that the buffer must hold."""
        return self.spare + (self._room if self.way is Way.IMAGED else 0)

    @property
    def _room(self) -> int:
        return -(-(self.block.vector.lanes * len(self.places) + LINE) // LINE) * LINE


def rows_of(
    lowered: Lowered, vector: Vector, places: tuple[int, ...], *, big: bool
) -> StoredRows:
    """The best way for rows; ``big`` says whether the whole result is larger than the caches."""
    direct = StoredRows(KernelBlock(lowered, vector, vector.lanes), places, Way.CACHED)
    fits = vector.lanes * len(places) <= _LARGEST_IMAGE
    if big and not fits and not len(places) % LINE:
        return replace(direct, way=Way.STREAMED)
    streamed = min(direct.lines, lowered.length // _OPERATIONS[fits])
    if not (big and streamed):
        return direct
    return StoredRows(replace(direct.block, streamed=streamed), places, Way.IMAGED)


def rows_text(rows: StoredRows) -> str:
    """Definitions of ``@run`` and what it calls; to be put beside the block's ``@compute``."""
    laid = [] if rows.way is Way.CACHED else [laying(rows, "lay", Way.IMAGED)]
    if rows.way is not Way.IMAGED:
        laid.append(laying(rows, "lay_rows", rows.way))
    return "\n".join([tables(rows), *laid, _run(rows)])


# -- the loop over a batch ---------------------------------------------------------------------------------------------

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
  call void @{part}(ptr %buffer, ptr %image, i64 0)
  %bytes.part = mul i64 %count, {row}
  call void @llvm.memcpy.p0.p0.i64(ptr %to, ptr %image, i64 %bytes.part, i1 false)
  br label %laid
laid:
  br label %loop
done:
  fence seq_cst
  ret void
}}
"""

_STREAM = """define internal void @stream(ptr noalias %from, ptr noalias %to, i64 %start, i64 %end) noinline {
entry:
  br label %loop
loop:
  %m = phi i64 [ %start, %entry ], [ %next, %line ]
  %more = icmp slt i64 %m, %end
  br i1 %more, label %line, label %done
line:
  %source = getelementptr double, ptr %from, i64 %m
  %target = getelementptr double, ptr %to, i64 %m
  %value = load <8 x double>, ptr %source, align 8
  store <8 x double> %value, ptr %target, align 64, !nontemporal !1
  %next = add i64 %m, 8
  br label %loop
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
  %filled = phi i64 [ 0, %entry ], [ %count, %block ]
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
  %after = add i64 %head, {lines}
  %tail = sub i64 {whole}, %after
  %tail.bytes = shl i64 %tail, 3
  %tail.from = getelementptr double, ptr %image, i64 %after
  %tail.to = getelementptr double, ptr %previous, i64 %after
  %stream.from = getelementptr double, ptr %image, i64 %head
  %stream.to = getelementptr double, ptr %previous, i64 %head
  call void @compute(ptr %inputs, ptr %strides, ptr %uniforms, i64 %k, i64 %count, ptr %buffer,
                     ptr %stream.from, ptr %stream.to)
  call void @stream(ptr %stream.from, ptr %stream.to, i64 {streamed}, i64 {lines})
  call void @llvm.memcpy.p0.p0.i64(ptr %previous, ptr %image, i64 %bytes, i1 false)
  call void @llvm.memcpy.p0.p0.i64(ptr %tail.to, ptr %tail.from, i64 %tail.bytes, i1 false)
  call void @lay(ptr %buffer, ptr %image, i64 0)
  %offset = mul i64 %k, {width}
  %to = getelementptr double, ptr %out, i64 %offset
  br label %loop
done:
  %left.bytes = mul i64 %filled, {row}
  call void @llvm.memcpy.p0.p0.i64(ptr %previous, ptr %image, i64 %left.bytes, i1 false)
  fence seq_cst
  ret void
}}
"""


def _run(rows: StoredRows) -> str:
    block, width = rows.block, len(rows.places)
    values = {
        "arguments": "ptr %inputs, ptr %strides, ptr %uniforms, i64 %first, i64 %end, ptr %buffer, ptr %out",
        "image": rows.image,
        "lanes": block.vector.lanes,
        "width": width,
        "row": width * DOUBLE,
    }
    if rows.way is not Way.IMAGED:
        # lines matter only where they are written past the caches; a row shorter than its head has none
        mask, part = (63, "lay") if rows.way is Way.STREAMED else (0, "lay_rows")
        return _RUN.format(**values, mask=mask, part=part)
    spare, lines, whole = rows.spare, rows.lines * LINE, block.vector.lanes * width
    return _STREAM + _RUN_IMAGED.format(
        **values, spare=spare, streamed=block.streamed * LINE, lines=lines, whole=whole
    )


# -- transposition -----------------------------------------------------------------------------------------------------


def tables(rows: StoredRows) -> str:
    """For each column, its offset in the buffer, and how many columns before it are not structurally zero."""
    zeros, samples = rows.block.zeros, rows.block.samples
    offsets = [place * samples if place >= 0 else zeros for place in rows.places]
    filled = [0]
    for place in rows.places:
        filled.append(filled[-1] + (place >= 0))
    shown = (
        (name, ", ".join(f"i32 {n}" for n in t), len(t))
        for name, t in (("offsets", offsets), ("filled", filled))
    )
    return (
        "\n".join(
            f"@{name} = private constant [{count} x i32] [{text}]"
            for name, text, count in shown
        )
        + "\n"
    )


def laying(rows: StoredRows, name: str, towards: Way) -> str:
    """A function that writes the rows of a block: single columns up to ``%head``, tiles, and the columns left over."""
    v, width, code = rows.block.vector, len(rows.places), Code()
    head = f"define internal void @{name}(ptr noalias %buffer, ptr noalias %target, i64 %head) noinline {{\nentry:\n"
    if width < LINE:
        code.do("br label %all")
        _single_columns(code, rows, "all", "0", str(width), "done")
        return f"{head}{code.text()}\ndone:\n  ret void\n}}\n"
    rest = code.let(f"sub i64 {width}, %head")
    end = code.let(f"add i64 %head, {code.let(f'and i64 {rest}, -{LINE}')}")
    code.do("br label %left")
    _single_columns(code, rows, "left", "0", "%head", "tiles")
    code.label("tiles")
    code.do("%t = phi i64 [ %head, %left ], [ %t.next, %tile.done ]")
    code.do(
        f"br i1 {code.let(f'icmp slt i64 %t, {end}')}, label %tile, label %right.begin"
    )
    code.label("tile")
    code.do(f"%t.next = add i64 %t, {LINE}")
    target = code.at("%target", "%t")
    counts = [code.load("i32", code.at("@filled", n, "i32")) for n in ("%t", "%t.next")]
    empty = code.let(f"icmp eq i32 {counts[0]}, {counts[1]}")
    code.do(
        f"br i1 {empty}, label %{'tile.done' if towards is Way.IMAGED else 'empty'}, label %turn"
    )
    if towards is not Way.IMAGED:
        code.label("empty")
        for lane in range(v.lanes):
            _store_line(
                code, v, target, lane * width, [v.of(0.0)] * (LINE // v.lanes), towards
            )
        code.do("br label %tile.done")
    code.label("turn")
    squares = [
        _transposed(code, v, _columns(code, v, first))
        for first in range(0, LINE, v.lanes)
    ]
    for lane in range(v.lanes):
        _store_line(
            code, v, target, lane * width, [square[lane] for square in squares], towards
        )
    code.do("br label %tile.done")
    code.label("tile.done")
    code.do("br label %tiles")
    code.label("right.begin")
    code.do("br label %right")
    _single_columns(code, rows, "right", end, str(width), "done", before="right.begin")
    code.label("done")
    code.do("ret void")
    return f"{head}{code.text()}\n}}\n"


def _single_columns(
    code: Code,
    rows: StoredRows,
    name: str,
    first: str,
    end: str,
    then: str,
    before: str = "entry",
) -> None:
    """A loop over columns that are written sample by sample."""
    v = rows.block.vector
    code.label(name)
    code.do(
        f"%{name}.c = phi i64 [ {first}, %{before} ], [ %{name}.next, %{name}.one ]"
    )
    code.do(
        f"br i1 {code.let(f'icmp slt i64 %{name}.c, {end}')}, label %{name}.one, label %{then}"
    )
    code.label(f"{name}.one")
    code.do(f"%{name}.next = add i64 %{name}.c, 1")
    target = code.at("%target", f"%{name}.c")
    value = code.load(v.type, _column(code, f"%{name}.c"))
    for lane in range(v.lanes):
        place = code.at(target, lane * len(rows.places))
        code.store(
            place, f"double {code.let(f'extractelement {v.type} {value}, i32 {lane}')}"
        )
    code.do(f"br label %{name}")


def _column(code: Code, column: str) -> str:
    """Address of a column of the block."""
    at = code.at("@offsets", column, "i32")
    offset = code.let(f"zext i32 {code.let(f'load i32, ptr {at}')} to i64")
    return code.at("%buffer", offset)


def _columns(code: Code, v: Vector, first: int) -> list[str]:
    """Addresses of a tile's columns, as many as a vector has lanes."""
    return [
        _column(code, code.let(f"add i64 %t, {first + lane}"))
        for lane in range(v.lanes)
    ]


def _store_line(
    code: Code, v: Vector, target: str, offset: int, values: Sequence[str], towards: Way
) -> None:
    """A line of one row."""
    hint = (
        f"align {8 * v.lanes}, !nontemporal !1"
        if towards is Way.STREAMED
        else "align 8"
    )
    for k, value in enumerate(values):
        code.store(
            code.at(target, offset + k * v.lanes), f"{v.type} {value}", f", {hint}"
        )


def _transposed(code: Code, v: Vector, columns: Sequence[str]) -> list[str]:
    """The transpose of a square, from the addresses of its columns."""
    # squares off the diagonal are exchanged: the largest while loading, which joins halves of two columns and needs no
    # shuffle, then ever larger ones in registers
    half = v.lanes // 2
    current = [
        _joined(code, v, columns[k % half], columns[k % half + half], k // half * half)
        for k in range(v.lanes)
    ]
    size = 1
    while size < half:
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


def _joined(code: Code, v: Vector, first: str, second: str, start: int) -> str:
    """Half of a column and half of another, from some lane on."""
    half = v.lanes // 2
    kind = f"<{half} x double>"
    parts = [code.load(kind, code.at(column, start)) for column in (first, second)]
    mask = ", ".join(f"i32 {k}" for k in range(v.lanes))
    return code.let(
        f"shufflevector {kind} {parts[0]}, {kind} {parts[1]}, <{v.lanes} x i32> <{mask}>"
    )


def _shuffled(code: Code, v: Vector, a: str, b: str, picked: Sequence[int]) -> str:
    mask = ", ".join(f"i32 {k}" for k in picked)
    return code.let(
        f"shufflevector {v.type} {a}, {v.type} {b}, <{v.lanes} x i32> <{mask}>"
    )
