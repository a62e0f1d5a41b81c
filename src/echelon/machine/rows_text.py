"""From column-major blocks to rows: ``@run`` computes a batch and writes each sample's result as one contiguous row."""

from __future__ import annotations

from echelon.machine.laying_text import laying, tables
from echelon.machine.layout import LINE, Rows, Way
from echelon.machine.text import Code, prefetched

_DOUBLE, _PAGE = 8, 4096  # bytes


def rows_text(rows: Rows) -> str:
    """Definitions of ``@run`` and what it calls; to be put beside the block's ``@compute``."""
    laid = [laying(rows, "lay", Way.IMAGED)]
    if rows.way is not Way.IMAGED:
        laid.append(laying(rows, "lay_rows", rows.way))
    return "\n".join([tables(rows), *laid, _run(rows)])


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
{ahead}
  br label %loop
done:
  %left.bytes = mul i64 %filled, {row}
  call void @llvm.memcpy.p0.p0.i64(ptr %previous, ptr %image, i64 %left.bytes, i1 false)
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
        "row": width * _DOUBLE,
    }
    if rows.way is not Way.IMAGED:
        # lines matter only where they are written past the caches; a row shorter than its head has none
        return _RUN.format(**values, mask=63 if rows.way is Way.STREAMED else 0)
    lanes, ahead = block.vector.lanes, Code()
    prefetched(ahead, "%to", width * _DOUBLE, lanes, _PAGE, str(width * _DOUBLE))
    run = _RUN_IMAGED.format(
        **values,
        spare=rows.spare,
        streamed=block.streamed * LINE,
        lines=rows.lines * LINE,
        whole=lanes * width,
        ahead=ahead.text(),
    )
    return _STREAM + run
