"""Writing LLVM's textual intermediate representation: one instruction per line, fresh names.

Text, because building it is several times faster than building instruction objects, and because it can be read.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

LARGE_FRAME = '"no-stack-arg-probe"'
"""Attribute of functions that spill much: Windows would probe their stack by a function that is not linked here."""


@dataclass(frozen=True)
class Vector:
    """The type of a vector of doubles, or of a plain double if it has one lane."""

    lanes: int

    @property
    def type(self) -> str:
        """Its name."""
        return f"<{self.lanes} x double>" if self.lanes > 1 else "double"

    @property
    def suffix(self) -> str:
        """Its name in those of intrinsic functions."""
        return f"v{self.lanes}f64" if self.lanes > 1 else "f64"

    @property
    def integers(self) -> str:
        """The type of as many 64-bit integers."""
        return f"<{self.lanes} x i64>" if self.lanes > 1 else "i64"

    @property
    def bits(self) -> str:
        """The type of as many truth values."""
        return f"<{self.lanes} x i1>" if self.lanes > 1 else "i1"

    def of(self, value: float) -> str:
        """A constant with the same value in all lanes."""
        return self._filled("double", number(value))

    def of_integer(self, value: int) -> str:
        """A constant with the same integer in all lanes."""
        return self._filled("i64", str(value))

    def _filled(self, kind: str, text: str) -> str:
        return "<" + ", ".join([f"{kind} {text}"] * self.lanes) + ">" if self.lanes > 1 else text


def number(value: float) -> str:
    """A double, bit for bit.

    >>> number(1.0)
    '0x3FF0000000000000'
    """
    return f"0x{struct.unpack('>Q', struct.pack('>d', value))[0]:016X}"


@dataclass
class Code:
    """Instructions of one function body under construction."""

    lines: list[str] = field(default_factory=list)
    _count: int = 0

    def let(self, instruction: str) -> str:
        """Append an instruction that has a value; returns the value's name."""
        self._count += 1
        name = f"%t{self._count}"
        self.lines.append(f"  {name} = {instruction}")
        return name

    def do(self, instruction: str) -> None:
        """Append an instruction without a value."""
        self.lines.append(f"  {instruction}")

    def label(self, name: str) -> None:
        """Begin a block."""
        self.lines.append(f"{name}:")

    def text(self) -> str:
        """The body."""
        return "\n".join(self.lines)


_LINE = "<8 x double>"
_AHEAD = 4  # vectors of samples


def prefetched(code: Code, address: str, row: int, lanes: int, every: int, stride: str) -> None:
    """Ask for memory that will be used a few vectors of samples later.

    ``address`` is that of this vector's first row, ``row`` the bytes of a row, ``stride`` those from row to row.
    ``every`` is a cache line for what is read, and a page for what is written past the caches, whose translation alone
    is wanted.
    """
    offset = code.let(f"mul i64 {stride}, {_AHEAD * lanes}")
    ahead = code.let(f"getelementptr i8, ptr {address}, i64 {offset}")
    for start in range(0, lanes * row, every):
        place = code.let(f"getelementptr i8, ptr {ahead}, i64 {start}")
        code.do(f"call void @llvm.prefetch.p0(ptr {place}, i32 0, i32 3, i32 1)")


def stream_line(code: Code, offset: str) -> None:
    """Copy a cache line from ``%from`` to ``%to``, past the caches, at some offset in doubles from both."""
    source, target = (code.let(f"getelementptr double, ptr %{end}, i64 {offset}") for end in ("from", "to"))
    value = code.let(f"load {_LINE}, ptr {source}, align 8")
    code.do(f"store {_LINE} {value}, ptr {target}, align 64, !nontemporal !1")


def module_text(*texts: str) -> str:
    """One module of several texts; what more than one of them declares is declared once."""
    heads: dict[str, None] = {}
    bodies: list[str] = []
    for line in "\n".join(texts).splitlines():
        if line.startswith(("declare ", "!")):
            heads[line] = None
        else:
            bodies.append(line)
    return "\n".join([*heads, *bodies]) + "\n"
