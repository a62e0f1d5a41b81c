"""Turning a block: columns of samples in, rows of results out.  Squares are transposed in registers."""

from __future__ import annotations

from collections.abc import Sequence

from echelon.machine.layout import LINE, Rows, Way
from echelon.machine.text import Code, Vector


def tables(rows: Rows) -> str:
    """For each column, its offset in the buffer, and how many columns before it are not structurally zero."""
    zeros, samples = rows.block.zeros, rows.block.samples
    offsets = [place * samples if place >= 0 else zeros for place in rows.places]
    filled = [0]
    for place in rows.places:
        filled.append(filled[-1] + (place >= 0))
    shown = ((name, ", ".join(f"i32 {n}" for n in t), len(t)) for name, t in (("offsets", offsets), ("filled", filled)))
    return "\n".join(f"@{name} = private constant [{count} x i32] [{text}]" for name, text, count in shown) + "\n"


def laying(rows: Rows, name: str, towards: Way) -> str:
    """A function that writes the rows of a block: single columns up to ``%head``, tiles, and the columns left over.

    Parameters
    ----------
    rows : Rows
    name : str
    towards : Way
        ``IMAGED`` for an image, where structural zeros need not be written: they are zero from the start.
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
    squares = [_transposed(code, v, _columns(code, v, first)) for first in range(0, LINE, v.lanes)]
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
    value = code.let(f"load {v.type}, ptr {_column(code, f'%{name}.c')}")
    for lane in range(v.lanes):
        pointer = code.let(f"getelementptr double, ptr {target}, i64 {lane * len(rows.places)}")
        code.do(f"store double {code.let(f'extractelement {v.type} {value}, i32 {lane}')}, ptr {pointer}")
    code.do(f"br label %{name}")


def _column(code: Code, column: str) -> str:
    """Address of a column of the block."""
    at = code.let(f"getelementptr i32, ptr @offsets, i64 {column}")
    offset = code.let(f"zext i32 {code.let(f'load i32, ptr {at}')} to i64")
    return code.let(f"getelementptr double, ptr %buffer, i64 {offset}")


def _columns(code: Code, v: Vector, first: int) -> list[str]:
    """Addresses of a tile's columns, as many as a vector has lanes."""
    return [_column(code, code.let(f"add i64 %t, {first + lane}")) for lane in range(v.lanes)]


def _store_line(code: Code, v: Vector, target: str, offset: int, values: Sequence[str], towards: Way) -> None:
    """A line of one row."""
    hint = f"align {8 * v.lanes}, !nontemporal !1" if towards is Way.STREAMED else "align 8"
    for k, value in enumerate(values):
        pointer = code.let(f"getelementptr double, ptr {target}, i64 {offset + k * v.lanes}")
        code.do(f"store {v.type} {value}, ptr {pointer}, {hint}")


def _transposed(code: Code, v: Vector, columns: Sequence[str]) -> list[str]:
    """The transpose of a square, from the addresses of its columns.

    Squares off the diagonal are exchanged: the largest while loading, which joins halves of two columns and needs no
    shuffle, then ever larger ones in registers.
    """
    half = v.lanes // 2
    current = [_joined(code, v, columns[k % half], columns[k % half + half], k // half * half) for k in range(v.lanes)]
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
    parts = []
    for column in (first, second):
        pointer = code.let(f"getelementptr double, ptr {column}, i64 {start}")
        parts.append(code.let(f"load {kind}, ptr {pointer}"))
    mask = ", ".join(f"i32 {k}" for k in range(v.lanes))
    return code.let(f"shufflevector {kind} {parts[0]}, {kind} {parts[1]}, <{v.lanes} x i32> <{mask}>")


def _shuffled(code: Code, v: Vector, a: str, b: str, picked: Sequence[int]) -> str:
    mask = ", ".join(f"i32 {k}" for k in picked)
    return code.let(f"shufflevector {v.type} {a}, {v.type} {b}, <{v.lanes} x i32> <{mask}>")
