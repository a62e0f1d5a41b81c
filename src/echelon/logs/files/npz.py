"""NumPy's files: archives of named arrays (NPZ) and single arrays (NPY).

Names and shapes come from the headers of the archive's members, so that only the arrays that are asked for are read.
Pickled objects are never loaded: they can run code.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Iterator, Sequence
from functools import partial
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from echelon.errors import InputError
from echelon.inputs.limits import COLUMNS
from echelon.logs.files.access import decoding, existing_file
from echelon.logs.files.arrays import ArrayColumns, NamedArray
from echelon.logs.table import CHUNK, Table

_ENDING = ".npy"
_KIND = "a NumPy file"


class NpzFile:
    """An archive of arrays, or a single array.

    A vector is a column of its name, an array of more dimensions gives ``name[0]``, ``name[1]``, …, a structured array
    ``name.field``.  In a file with a single array these names begin with the index or the field: ``0``, ``1``, … or
    ``field``.  The log has as many rows as most arrays; the others are left out.

    Parameters
    ----------
    path : path

    Attributes
    ----------
    source : str
    names : tuple of str
        As of :class:`echelon.logs.table.LogFile`.

    Raises
    ------
    InputError
        If the file cannot be read, is damaged, or holds no arrays of numbers.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path, self.source = existing_file(path), os.fspath(path)
        with decoding(self.source, _KIND):
            arrays = _members(self._path) if zipfile.is_zipfile(self._path) else [self._single()]
        self._columns = ArrayColumns(self.source, arrays, {}, self._path.stat().st_size)
        self.names: tuple[str, ...] = self._columns.names

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """Pieces of the file, as :meth:`echelon.logs.table.LogFile.tables` describes.

        Parameters
        ----------
        names : sequence of str, optional
            Columns to read; all if omitted.
        rows : int
            Rows of a piece.

        Raises
        ------
        InputError
            If a column is missing or its array damaged.
        """
        pieces = self._columns.tables(names, rows)
        while True:
            with decoding(self.source, _KIND):
                piece = next(pieces, None)
            if piece is None:
                return
            yield piece

    def _single(self) -> NamedArray:
        """The array of an NPY file, which stays on disk until its rows are asked for."""
        with self._path.open("rb") as stream:
            shape, kind = _header(stream)
            rest = os.fstat(stream.fileno()).st_size - stream.tell()
        if kind.hasobject:
            raise InputError(
                "holds pickled Python objects, which are not loaded: they can run code", source=self.source
            )
        _check_complete(shape, kind, rest)
        return NamedArray("", shape, kind, lambda: np.load(self._path, mmap_mode="r", allow_pickle=False))


def _members(path: Path) -> list[NamedArray]:
    """The arrays of an archive, by their headers."""
    arrays = []
    with zipfile.ZipFile(path) as archive:
        members = [member for member in archive.infolist() if member.filename.endswith(_ENDING)]
        COLUMNS.check(len(members))
        for info in members:
            member = info.filename
            with archive.open(info) as stream:
                shape, kind = _header(stream)
                _check_complete(shape, kind, info.file_size - stream.tell())
            name = member.removesuffix(_ENDING)
            arrays.append(NamedArray(name, shape, kind, partial(_loaded, path, member)))
    return arrays


def _loaded(path: Path, member: str) -> npt.NDArray[Any]:
    with zipfile.ZipFile(path) as archive, archive.open(member) as stream:
        array: npt.NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
        return array


def _check_complete(shape: tuple[int, ...], kind: np.dtype[Any], rest: int) -> None:
    """The array cannot be larger than what follows its header; its product is exact, however large."""
    if kind.itemsize * prod(shape) > rest and not kind.hasobject:
        raise ValueError(f"an array of shape {shape} needs more than the {rest} bytes that follow")


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and dtype of an array that is stored in NumPy's format."""
    version = np.lib.format.read_magic(stream)
    if version == (1, 0):
        shape, _, kind = np.lib.format.read_array_header_1_0(stream)
    elif version == (2, 0):
        shape, _, kind = np.lib.format.read_array_header_2_0(stream)
    else:
        raise ValueError(f"version {version[0]}.{version[1]} of the format is not known")
    return shape, kind
