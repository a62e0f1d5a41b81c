"""HDF5 files, and MAT files of version 7.3, which are HDF5 with conventions of MATLAB's own.

MATLAB keeps structs as groups, and cells and arrays of structs as references.  It stores arrays by columns, so that
their axes come in reverse order.  Only what is stored in the file itself is read: no links to other files, no virtual
data sets.  Names and shapes come from the headers, and only the arrays that are asked for are read.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.extras import extra
from echelon.inputs.content import COLUMNS
from echelon.logs.files.log_file import decoding, existing_file
from echelon.logs.files.mat_file import MANY, plain_shape
from echelon.logs.files.numpy_file import ArrayFile, NamedArray

_KIND = "an HDF5 file"
_DEPTH = 16
_CLASS = "MATLAB_class"
_HIDDEN = ("#refs#", "#subsystem#")
_NUMBERS = (b"double", b"single", b"logical", b"int", b"uint")


class Hdf5File(ArrayFile):
    """An HDF5 file, or a MAT file of version 7.3.

    Data sets are arrays named by their groups, ``observations/qpos``, and their columns ``observations/qpos[0]``, ….
    In MAT files fields of structs are ``name.field``, those of struct arrays ``name.field[0]``, and cells ``name[0]``.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        with extra("identify"):
            import h5py
        found, source = existing_file(path), os.fspath(path)
        with decoding(source, _KIND), h5py.File(found, "r") as file:
            inside = _Inside(file, found)
            arrays = list(inside.arrays(file, "", 0))
        super().__init__(found, _KIND, arrays, inside.left_out, source)


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
        if depth > _DEPTH:
            self.left_out[name] = "lies too deep inside other groups"
        elif isinstance(item, h5py.Group):
            for key in item:
                if isinstance(item.get(key, getlink=True), h5py.HardLink) and key not in _HIDDEN:
                    inner = f"{name}{'.' if self._matlab else '/'}{key}" if name else str(key)
                    yield from self.arrays(item[key], inner, depth + 1)
        elif item.is_virtual or item.external:
            self.left_out[name] = "is stored in another file"
        elif item.dtype == h5py.ref_dtype:
            yield from self._referred(item, name, depth)
        elif self._is_plain(item, name):
            shape = plain_shape(item.shape[::-1]) if self._matlab else item.shape
            yield NamedArray(name, shape, item.dtype, partial(_read, self._path, item.name, shape))

    def _referred(self, cells: Any, name: str, depth: int) -> Iterator[NamedArray]:
        """What cells, or the fields of an array of structs, refer to."""
        if cells.size > MANY:
            self.left_out[name] = f"has {cells.size} structs or cells; at most {MANY} are opened"
            return
        for k, reference in enumerate(cells[()].ravel()):
            yield from self.arrays(self._file[reference], f"{name}[{k}]" if cells.size > 1 else name, depth + 1)

    def _is_plain(self, item: Any, name: str) -> bool:
        kind = item.attrs.get(_CLASS, b"double")
        if not self._matlab or (bytes(kind).startswith(_NUMBERS) and "MATLAB_empty" not in item.attrs):
            return True
        self.left_out[name] = f"is of MATLAB's class {bytes(kind).decode(errors='replace')}; save plain arrays"
        return False


def _read(path: Path, place: str, shape: tuple[int, ...]) -> npt.NDArray[Any]:
    with extra("identify"):
        import h5py

    with h5py.File(path, "r") as file:
        stored = np.asarray(file[place])
        return (stored.T if file.userblock_size else stored).reshape(shape)
