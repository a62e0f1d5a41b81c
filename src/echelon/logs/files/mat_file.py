"""MATLAB's files of every version, and HDF5.

Files of versions 5 to 7 are a tree of elements, each with a tag that says its type and its length.  scipy reads them
too, but looks types and lengths up without asking whether they can be: one wrong byte in a file without compression may
end the whole process or keep it busy for ever, where a log that is damaged should be an error.  What is not an array of
real numbers, a struct or a cell is not decoded.  The format is described in MathWorks' "MAT-File Level 5 File Format".

Files of version 7.3 are HDF5 with conventions of MATLAB's own, which keeps structs as groups, and cells and arrays of
structs as references, and stores arrays by columns, so that their axes come in reverse order.  Only what is stored in
the file itself is read: no links to other files, no virtual data sets.  Names and shapes come from the headers, and
only the arrays that are asked for are read.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.extras import extra
from echelon.inputs import COLUMNS, check_unpacked, most_unpacked
from echelon.logs.files.log_file import decoding, existing_file
from echelon.logs.files.numpy_file import ArrayFile, NamedArray

_HEADER = 128
_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {
    1: "i1",
    2: "u1",
    3: "i2",
    4: "u2",
    5: "i4",
    6: "u4",
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_COMPLEX = 0x0800
_COMPLEX_NUMBERS = "holds complex numbers, not real numbers"
MANY = 256  # structs or cells of an array that are opened
_OTHER = {
    _OBJECT: "is a MATLAB object; save its numbers as plain arrays",
    _CHAR: "holds text, not real numbers",
    _SPARSE: "is a sparse matrix; save it as a full one",
    _FUNCTION: "is a function",
    _OPAQUE: "is a MATLAB object; save its numbers as plain arrays",
}

_KIND = "a MAT file"


@dataclass(frozen=True)
class Group:
    """A cell array or an array of structs."""

    fields: tuple[str, ...]  # of the structs; empty for cells
    members: list[
        Any
    ]  # the values: of one struct or cell after another, columns of the array first


@dataclass(frozen=True)
class Unread:
    """What is not decoded, and why."""

    reason: str


Value = npt.NDArray[Any] | Group | Unread


def variables(content: bytes) -> Iterator[tuple[str, Value]]:
    """The variables of a file, by name; a damaged one raises what the decoder stumbles over."""
    order = {b"IM": "<", b"MI": ">"}[content[126:_HEADER]]
    reader, unpacked = _Reader(order), 0
    for kind, payload in _elements(memoryview(content)[_HEADER:], order):
        if kind == _COMPRESSED:
            plain = zlib.decompressobj().decompress(
                payload, most_unpacked(len(content)) + 1
            )
            unpacked += len(plain)
            check_unpacked(unpacked, len(content))
            ((kind, payload),) = _elements(memoryview(plain), order)
        if kind != _MATRIX:
            raise ValueError(f"a variable cannot be an element of type {kind}")
        name, value = reader.variable(payload)
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


class _Reader:
    """Decodes matrix elements of a file, not more of them than a log can have columns."""

    def __init__(self, order: str) -> None:
        self._order = order
        self._count = 0

    def variable(self, payload: memoryview) -> tuple[str, Value]:
        """Name and value of a matrix element."""
        self._count += 1
        COLUMNS.check(self._count)
        if not payload:
            return "", np.empty((0, 0))
        parts = _elements(payload, self._order)
        flags = int(_numbers(next(parts), self._order)[0])
        second = next(parts)
        if flags & 0xFF == _OPAQUE:
            return _text(second[1]), Unread(_OTHER[_OPAQUE])
        shape = tuple(int(size) for size in _numbers(second, self._order))
        return _text(next(parts)[1]), self._value(flags, shape, parts)

    def _value(
        self,
        flags: int,
        shape: tuple[int, ...],
        parts: Iterator[tuple[int, memoryview]],
    ) -> Value:
        kind = flags & 0xFF
        if kind in _OTHER:
            return Unread(_OTHER[kind])
        if flags & _COMPLEX:
            return Unread(_COMPLEX_NUMBERS)
        if kind == _CELL:
            return self._group((), shape, parts)
        if kind == _STRUCT:
            width = int(_numbers(next(parts), self._order)[0])
            names = bytes(next(parts)[1])
            fields = tuple(
                _text(names[start : start + width])
                for start in range(0, len(names), width)
            )
            return self._group(fields, shape, parts)
        (numbers,) = parts
        return _numbers(numbers, self._order).reshape(shape, order="F")

    def _group(
        self,
        fields: tuple[str, ...],
        shape: tuple[int, ...],
        parts: Iterator[tuple[int, memoryview]],
    ) -> Value:
        """Cells if there are no fields, although a struct without fields looks the same: it has no parts."""
        count = prod(shape)
        if count > MANY:
            return Unread(f"has {count} structs or cells; at most {MANY} are opened")
        found = list(islice(parts, count * max(len(fields), 1) + 1))
        width = len(fields) if fields or not found else 1
        if len(found) != count * width or any(kind != _MATRIX for kind, _ in found):
            raise ValueError("a struct or cell array has another size than its content")
        return Group(fields, [self.variable(payload)[1] for _, payload in found])


def _numbers(element: tuple[int, memoryview], order: str) -> npt.NDArray[Any]:
    kind, payload = element
    return np.frombuffer(payload, dtype=np.dtype(order + _NUMBERS[kind]))


def _text(payload: memoryview | bytes) -> str:
    return bytes(payload).split(b"\0")[0].decode()


class MatFile(ArrayFile):
    """A MAT file.

    Rows and columns of numbers are columns of the log, a matrix gives ``name[0]``, ``name[1]``, …; fields of structs
    are ``name.field``, entries of struct arrays ``name[0].field``, those of cells ``name[0]``.  The log has as many
    rows as most arrays; the others are left out.  The format has no index: all of it is read when it is opened.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        found, source = existing_file(path), os.fspath(path)
        content = found.read_bytes()  # as large as the file is on disk
        if 0 in content[:4]:
            problem = "is a MAT file of version 4, which is not read; save it in MATLAB with  save(…, '-v7')"
            raise InputError(problem, source=source)
        left_out: dict[str, str] = {}
        with decoding(source, _KIND):
            arrays = [
                array
                for name, value in variables(content)
                for array in _inside(name, value, left_out)
            ]
        super().__init__(found, _KIND, arrays, left_out, source)


def _inside(name: str, value: Value, left_out: dict[str, str]) -> Iterator[NamedArray]:
    """The arrays in a variable, with structs and cells opened."""
    if isinstance(value, Unread):
        left_out[name] = value.reason
    elif isinstance(value, Group):
        fields = value.fields or ("",)
        count = len(value.members) // len(fields)
        for index, member in enumerate(value.members):
            element, field = divmod(index, len(fields))
            label = name if count == 1 else f"{name}[{element}]"
            yield from _inside(
                f"{label}.{fields[field]}".removesuffix("."), member, left_out
            )
    else:
        array = value.reshape(plain_shape(value.shape))
        yield NamedArray(name, array.shape, array.dtype, lambda: array)


def plain_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """MATLAB has no vectors: what is a single row or column becomes one, a single number loses its axes."""
    if prod(shape) == 1 and len(shape) <= 2:
        return ()
    return (prod(shape),) if len(shape) == 2 and 1 in shape else shape


# -- HDF5 --------------------------------------------------------------------------------------------------------------


_HDF5 = "an HDF5 file"
_DEPTH = 16
_CLASS = "MATLAB_class"
_HIDDEN = ("#refs#", "#subsystem#")
_CLASSES = (b"double", b"single", b"logical", b"int", b"uint")


class Hdf5File(ArrayFile):
    """An HDF5 file, or a MAT file of version 7.3.

    Data sets are arrays named by their groups, ``observations/qpos``, and their columns ``observations/qpos[0]``, ….
    In MAT files fields of structs are ``name.field``, those of struct arrays ``name.field[0]``, and cells ``name[0]``.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        with extra("identify"):
            import h5py
        found, source = existing_file(path), os.fspath(path)
        with decoding(source, _HDF5), h5py.File(found, "r") as file:
            inside = _Inside(file, found)
            arrays = list(inside.arrays(file, "", 0))
        super().__init__(found, _HDF5, arrays, inside.left_out, source)


class _Inside:
    """The data sets in an open file."""

    def __init__(self, file: Any, path: Path) -> None:
        self._file, self._path = file, path
        self._matlab = file.userblock_size > 0
        self._count = 0
        self.left_out: dict[str, str] = {}

    def arrays(self, item: Any, name: str, depth: int) -> Iterator[NamedArray]:
        """The arrays in a group or data set."""
        with extra("identify"):
            import h5py

        self._count += 1
        COLUMNS.check(self._count)
        kind = bytes(item.attrs.get(_CLASS, b"double")) if self._matlab else b"double"
        refers = (
            not isinstance(item, h5py.Group)
            and h5py.check_ref_dtype(item.dtype) is not None
        )
        if depth > _DEPTH:
            self.left_out[name] = "lies too deep inside other groups"
        elif isinstance(item, h5py.Group):
            for key in item:
                if (
                    isinstance(item.get(key, getlink=True), h5py.HardLink)
                    and key not in _HIDDEN
                ):
                    inner = (
                        f"{name}{'.' if self._matlab else '/'}{key}"
                        if name
                        else str(key)
                    )
                    yield from self.arrays(item[key], inner, depth + 1)
        elif item.is_virtual or item.external:
            self.left_out[name] = "is stored in another file"
        elif refers and item.size > MANY:
            self.left_out[name] = (
                f"has {item.size} structs or cells; at most {MANY} are opened"
            )
        elif refers:  # cells, or the fields of an array of structs
            for k, reference in enumerate(item[()].ravel()):
                yield from self.arrays(
                    self._file[reference],
                    f"{name}[{k}]" if item.size > 1 else name,
                    depth + 1,
                )
        elif not kind.startswith(_CLASSES) or (
            self._matlab and "MATLAB_empty" in item.attrs
        ):
            self.left_out[name] = (
                f"is of MATLAB's class {kind.decode(errors='replace')}; save plain arrays"
            )
        else:
            shape = plain_shape(item.shape[::-1]) if self._matlab else item.shape
            yield NamedArray(
                name, shape, item.dtype, partial(_read, self._path, item.name, shape)
            )


def _read(path: Path, place: str, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    with extra("identify"):
        import h5py

    with h5py.File(path, "r") as file:
        stored = np.asarray(file[place])
        return (stored.T if file.userblock_size else stored).reshape(shape)
