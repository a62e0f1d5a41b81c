"""MATLAB's files of every version, and HDF5.

Files of versions 5 to 7 are read by scipy.  They are a tree of elements, each with a tag that says its type and its
length, which scipy looks up without asking whether they can be: one wrong byte in a file without compression may end
the whole process or keep it busy for ever.  So tags and sizes are checked before, and a damaged log is an error.
What is not an array of real numbers, a struct or a cell is left out.  The format is described in MathWorks' "MAT-File
Level 5 File Format".

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
from enum import IntEnum
from functools import partial
from itertools import count
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.files.log_file import decoding, existing_file
from echelon.identification.logs.files.numpy_file import ArrayFile, NamedArray
from echelon.shared import (
    COLUMNS,
    DEPTH,
    ENTRIES,
    InputError,
    check_unpacked,
    extra,
    most_unpacked,
)

_KIND = "a MAT file"


class _Type(IntEnum):
    """Types of elements that are no plain numbers or texts, and a class of arrays."""

    MATRIX = 14
    COMPRESSED = 15
    CELL = 1


_PLAIN = frozenset([*range(1, 8), 9, 12, 13, 16, 17, 18])
"""Types of elements that are numbers or texts."""

_OF_ARRAYS = (_Type.CELL, 2, 3)
"""Classes of arrays that hold others: cells, structs, objects."""

_NUMBERS = {4: 1, 5: 3, **dict.fromkeys(range(6, 16), 1)}
"""Elements with the data of an array, by its class: of text, of a sparse matrix, of numbers."""

_CODE = (16, 17)
"""Classes of functions and of objects in a format of their own."""


class MatFile(ArrayFile):
    """A MAT file.

    Rows and columns of numbers are columns of the log, a matrix gives ``name[0]``, ``name[1]``, …; fields of structs
    are ``name.field``, entries of struct arrays ``name[0].field``, those of cells ``name[0]``.  The log has as many
    rows as most arrays; the others are left out.  The format has no index: all of it is read when it is opened.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        with extra("identify"):
            from scipy.io import loadmat
        found, source = existing_file(path), os.fspath(path)
        content = found.read_bytes()  # as large as the file is on disk
        if 0 in content[:4]:
            problem = "is a MAT file of version 4, which is not read; save it in MATLAB with  save(…, '-v7')"
            raise InputError(problem, source=source)
        left_out: dict[str, str] = {}
        with decoding(source, _KIND):
            check_elements(content)
            variables = {
                name: value
                for name, value in loadmat(str(found)).items()
                if name[:2] != "__"
            }
            arrays = [
                array
                for name, value in variables.items()
                for array in _inside(name, value, left_out)
            ]
        super().__init__(found, _KIND, arrays, left_out, source)


def check_elements(content: bytes) -> None:
    """Refuse a file with tags or sizes that cannot be, or that unpacks to far more than its size."""
    order = {b"IM": "<", b"MI": ">"}[content[126:128]]
    unpacked, matrices = 0, count(1)
    for kind, payload in _elements(memoryview(content)[128:], order):
        if kind == _Type.COMPRESSED:
            plain = zlib.decompressobj().decompress(
                payload, most_unpacked(len(content)) + 1
            )
            unpacked += len(plain)
            check_unpacked(unpacked, len(content))
            ((kind, payload),) = _elements(memoryview(plain), order)
        if kind != _Type.MATRIX:
            raise ValueError(f"a variable cannot be an element of type {kind}")
        _check_matrix(payload, order, matrices, 0)


def _elements(data: memoryview, order: str) -> Iterator[tuple[int, memoryview]]:
    """Types and contents of consecutive elements."""
    place = 0
    while place < len(data):
        kind, length = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:  # short elements hold their content inside the tag
            kind, length, start, end = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        else:
            start = place + 8
            end = start + length + (0 if kind == _Type.COMPRESSED else -length % 8)
        if start + length > min(end, len(data)):
            raise ValueError("an element is longer than what holds it")
        yield kind, data[start : start + length]
        place = end


def _check_matrix(
    payload: memoryview, order: str, matrices: Iterator[int], depth: int
) -> None:
    """Refuse an array whose parts have other types or another size than it says."""
    COLUMNS.check(next(matrices))
    DEPTH.check(depth)
    if not payload:
        return
    parts = list(_elements(payload, order))
    strange = {kind for kind, _ in parts} - _PLAIN - {_Type.MATRIX}
    if strange:
        raise ValueError(f"there is no type {strange.pop()} of elements")
    (_, first), (_, dimensions), *rest = parts
    (flags,) = struct.unpack_from(f"{order}I", first)
    array_class, is_complex = flags & 0xFF, bool(flags & 0x0800)
    inner = [part for kind, part in parts if kind == _Type.MATRIX]
    if array_class in (*_OF_ARRAYS, *_NUMBERS):
        sizes = np.frombuffer(dimensions, f"{order}i4").tolist()
        if len(sizes) < 2:
            raise ValueError("an array has at least two dimensions")
    if array_class in _OF_ARRAYS:
        most = len(inner) if inner or array_class == _Type.CELL else COLUMNS.most
        if min(sizes) < 0 or prod(sizes) > most:
            raise ValueError("a struct or cell array has another size than its content")
    elif array_class in _NUMBERS and (
        inner or len(rest) != 1 + _NUMBERS[array_class] + is_complex
    ):
        raise ValueError("an array has more or fewer parts than its class")
    elif array_class not in (*_NUMBERS, *_CODE):
        raise ValueError(f"there is no class {array_class} of arrays")
    for part in inner:
        _check_matrix(part, order, matrices, depth + 1)


def _inside(name: str, value: Any, left_out: dict[str, str]) -> Iterator[NamedArray]:
    """The arrays in a variable, with structs and cells opened."""
    kind = getattr(value, "dtype", np.dtype(object))
    if not isinstance(value, np.ndarray) or (type(value) is not np.ndarray):
        left_out[name] = (
            "is a MATLAB object, a function or a sparse matrix; save its numbers as plain full arrays"
        )
    elif kind.kind == "U":
        left_out[name] = "holds text, not real numbers"
    elif kind.names is None and kind.kind != "O":
        array = value.reshape(plain_shape(value.shape))
        yield NamedArray(name, array.shape, array.dtype, lambda: array)
    elif value.size > ENTRIES.most:
        left_out[name] = (
            f"has {value.size} structs or cells; at most {ENTRIES.most} are opened"
        )
    else:
        for k, entry in enumerate(value.ravel(order="F")):
            label = name if value.size == 1 else f"{name}[{k}]"
            if kind.names is None:
                yield from _inside(label, entry, left_out)
            for field in kind.names or ():
                yield from _inside(f"{label}.{field}", entry[field], left_out)


def plain_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """MATLAB has no vectors: what is a single row or column becomes one, a single number loses its axes."""
    if prod(shape) == 1 and len(shape) <= 2:
        return ()
    return (prod(shape),) if len(shape) == 2 and 1 in shape else shape


# -- HDF5 --------------------------------------------------------------------------------------------------------------


_HDF5 = "an HDF5 file"
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
            inside = _DataSets(file, found)
            arrays = list(inside.arrays(file, "", 0))
        super().__init__(found, _HDF5, arrays, inside.left_out, source)


class _DataSets:
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
        if depth > DEPTH.most:
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
        elif refers and item.size > ENTRIES.most:
            self.left_out[name] = (
                f"has {item.size} structs or cells; at most {ENTRIES.most} are opened"
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
