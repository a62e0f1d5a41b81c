"""MATLAB's files, versions 4 to 7.

Files of version 7.3 are HDF5 with conventions of MATLAB's own; MATLAB writes the older format on request (``-v7``), and
the error says so.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from typing import Any

import numpy.typing as npt

from echelon.errors import InputError
from echelon.logs.files.access import decoding, existing_file
from echelon.logs.files.arrays import ArrayColumns, NamedArray
from echelon.logs.files.mat_elements import Group, Unread, Value, old_variables, variables
from echelon.logs.table import CHUNK, Table

_KIND = "a MAT file"
_HDF5 = b"\x89HDF\r\n\x1a\n"


class MatFile:
    """A MAT file.

    Rows and columns of numbers are columns of the log, a matrix gives ``name[0]``, ``name[1]``, …; fields of structs
    are ``name.field``, entries of struct arrays ``name[0].field``, those of cells ``name[0]``.  The log has as many
    rows as most arrays; the others are left out.  The format has no index: all of it is read when it is opened.

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
        If the file cannot be read, is damaged or of version 7.3, or holds no arrays of numbers.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        found, self.source = existing_file(path), os.fspath(path)
        content = found.read_bytes()  # as large as the file is on disk
        if content.startswith(b"MATLAB 7.3") or _HDF5 in content[:520]:
            problem = "is a MAT file of version 7.3, which is not read; save it in MATLAB with  save(…, '-v7')"
            raise InputError(problem, source=self.source)
        self._left_out: dict[str, str] = {}
        with decoding(self.source, _KIND):
            arrays = list(self._arrays(content))
        self._columns = ArrayColumns(self.source, arrays, self._left_out, len(content))
        self.names: tuple[str, ...] = self._columns.names

    def tables(self, names: Sequence[str] | None = None, rows: int = CHUNK) -> Iterator[Table]:
        """Pieces of the file, as :meth:`echelon.logs.table.LogFile.tables` describes.

        Parameters
        ----------
        names : sequence of str, optional
            Columns; all if omitted.
        rows : int
            Rows of a piece.

        Raises
        ------
        InputError
            If a column is missing.
        """
        yield from self._columns.tables(names, rows)

    def _arrays(self, content: bytes) -> Iterator[NamedArray]:
        for name, value in old_variables(content) if 0 in content[:4] else variables(content):
            yield from self._inside(name, value)

    def _inside(self, name: str, value: Value) -> Iterator[NamedArray]:
        """The arrays in a variable, with structs and cells opened."""
        if isinstance(value, Unread):
            self._left_out[name] = value.reason
        elif isinstance(value, Group):
            yield from self._opened(name, value)
        else:
            array = _without_singletons(value)
            yield NamedArray(name, array.shape, array.dtype, lambda: array)

    def _opened(self, name: str, value: Group) -> Iterator[NamedArray]:
        fields = value.fields or ("",)
        count = len(value.members) // len(fields)
        for index, member in enumerate(value.members):
            element, field = divmod(index, len(fields))
            label = name if count == 1 else f"{name}[{element}]"
            yield from self._inside(f"{label}.{fields[field]}".removesuffix("."), member)


def _without_singletons(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """MATLAB has no vectors: what is a single row or column becomes one, a single number loses its axes."""
    if array.size == 1 and array.ndim <= 2:
        return array.reshape(())
    return array.reshape(-1) if array.ndim == 2 and 1 in array.shape else array
