"""MAT files of versions 5 to 7, element by element.

Such a file is a tree of elements, each with a tag that says its type and its length.  scipy reads them too, but looks
types and lengths up without asking whether they can be: one wrong byte in a file without compression may end the whole
process or keep it busy for ever, where a log that is damaged should be an error.  What is no array of real numbers, a
struct or a cell is not decoded.

The format is described in MathWorks' "MAT-File Level 5 File Format".
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_COMPLEX = 0x0800
_OTHER = {
    _OBJECT: "is a MATLAB object; save its numbers as plain arrays",
    _CHAR: "holds text, not real numbers",
    _SPARSE: "is a sparse matrix; save it as a full one",
    _FUNCTION: "is a function",
    _OPAQUE: "is a MATLAB object; save its numbers as plain arrays",
}


@dataclass(frozen=True)
class Group:
    """A cell array or an array of structs.

    Attributes
    ----------
    fields : tuple of str
        Of the structs; empty for cells.
    members : list
        The values: of one struct or cell after another, columns of the array first.
    """

    fields: tuple[str, ...]
    members: list[Any]


@dataclass(frozen=True)
class Unread:
    """What is not decoded, and why."""

    reason: str


Value = npt.NDArray[Any] | Group | Unread


def variables(content: bytes) -> Iterator[tuple[str, Value]]:
    """The variables of a file, by name.

    Parameters
    ----------
    content : bytes
        The whole file.

    Raises
    ------
    ValueError, KeyError, struct.error, zlib.error
        If the file is damaged.
    """
    order = {b"IM": "<", b"MI": ">"}[content[126:_HEADER]]
    for kind, payload in _elements(memoryview(content)[_HEADER:], order):
        if kind == _COMPRESSED:
            ((kind, payload),) = _elements(memoryview(zlib.decompress(payload)), order)
        if kind != _MATRIX:
            raise ValueError(f"a variable cannot be an element of type {kind}")
        name, value = _variable(payload, order)
        if name:  # one without a name belongs to MATLAB's objects
            yield name, value


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Types and contents of consecutive elements."""
    place = 0
    while place < len(data):
        kind, length = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:  # short elements hold their content inside the tag
            kind, length, start, end = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        else:
            start = place + 8
            end = start + length + (0 if kind == _COMPRESSED else -length % 8)
        if start + length > min(end, len(data)):
            raise ValueError("an element is longer than what holds it")
        yield kind, data[start : start + length]
        place = end


def _variable(payload: memoryview, order: str) -> tuple[str, Value]:
    """Name and value of a matrix element."""
    if not payload:
        return "", np.empty((0, 0))
    parts = list(_elements(payload, order))
    flags = int(_numbers(parts[0], order)[0])
    kind = flags & 0xFF
    if kind == _OPAQUE:
        return _text(parts[1][1]), Unread(_OTHER[kind])
    shape = tuple(int(size) for size in _numbers(parts[1], order))
    return _text(parts[2][1]), _value(kind, flags, shape, parts[3:], order)


def _value(kind: int, flags: int, shape: tuple[int, ...], parts: list[tuple[int, memoryview]], order: str) -> Value:
    if kind in _OTHER:
        return Unread(_OTHER[kind])
    if flags & _COMPLEX:
        return Unread("holds complex numbers, not real numbers")
    if kind == _CELL:
        return _group((), shape, parts, order)
    if kind == _STRUCT:
        width = int(_numbers(parts[0], order)[0])
        names = bytes(parts[1][1])
        fields = tuple(_text(names[start : start + width]) for start in range(0, len(names), width))
        return _group(fields, shape, parts[2:], order)
    (numbers,) = parts
    return _numbers(numbers, order).reshape(shape, order="F")


def _group(fields: tuple[str, ...], shape: tuple[int, ...], parts: list[tuple[int, memoryview]], order: str) -> Group:
    """Cells if there are no fields, even if that is also what a struct without fields looks like: it has no parts."""
    width = len(fields) if fields or not parts else 1
    if len(parts) != np.prod(shape, dtype=float) * width or any(kind != _MATRIX for kind, _ in parts):
        raise ValueError("a struct or cell array has another size than its content")
    return Group(fields, [_variable(payload, order)[1] for _, payload in parts])


def _numbers(element: tuple[int, memoryview], order: str) -> npt.NDArray[Any]:
    kind, payload = element
    return np.frombuffer(payload, dtype=np.dtype(order + _NUMBERS[kind]))


def _text(payload: memoryview | bytes) -> str:
    return bytes(payload).split(b"\0")[0].decode()
