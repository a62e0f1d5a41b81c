"""Arrays that go into and come out of kernels, checked once where they enter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.program.function import Argument

_DOUBLE = 8
_LINE = 64


@dataclass(frozen=True)
class Batch:
    """Arguments of many samples."""

    samples: int
    columns: tuple[Floats, ...]  # arguments that vary, of shape (samples, size), each row contiguous
    uniform: Floats  # the others, one after another

    @property
    def addresses(self) -> npt.NDArray[np.uint64]:
        """Where the first row of each array starts."""
        return np.array([a.ctypes.data for a in self.columns], dtype=np.uint64)

    @property
    def strides(self) -> npt.NDArray[np.int64]:
        """Bytes from row to row."""
        return np.array([a.strides[0] for a in self.columns], dtype=np.int64)

    def part(self, first: int, end: int) -> Batch:
        """Some of the samples, in place."""
        return Batch(end - first, tuple(column[first:end] for column in self.columns), self.uniform)

    def copy(self) -> Batch:
        """A copy of the samples, which no other code can change."""
        return Batch(self.samples, tuple(column.copy() for column in self.columns), self.uniform)

    @staticmethod
    def joined(pieces: Sequence[Batch]) -> Batch:
        """The samples of several batches of the same function; those of one stay where they are."""
        if len(pieces) == 1:
            return pieces[0]
        columns = zip(*(piece.columns for piece in pieces), strict=True)
        joined = tuple(np.concatenate(some) for some in columns)
        return Batch(sum(piece.samples for piece in pieces), joined, pieces[0].uniform)


def batch(arguments: Sequence[Argument], values: Mapping[str, npt.ArrayLike]) -> Batch:
    """Check and arrange values of arguments: of shape (samples, size), or (size,) for one sample and uniform ones."""
    columns, uniform = [], [np.zeros(0)]
    for argument in arguments:
        array = real_array(argument.name, value_of(argument, values))
        _check_shape(argument, array.shape)
        if argument.uniform:
            uniform.append(array)
            continue
        array = np.atleast_2d(array)
        whole = array.strides[1] == _DOUBLE or len(argument) < 2
        columns.append(array if whole and array.flags.aligned else np.ascontiguousarray(array))
    return Batch(_sample_count(arguments, [len(c) for c in columns]), tuple(columns), np.concatenate(uniform))


def value_of(argument: Argument, values: Mapping[str, Any]) -> Any:
    """The value of an argument."""
    if argument.name not in values:
        raise InputError(f"{argument.name} is missing; it holds {_contents(argument)}")
    return values[argument.name]


def _check_shape(argument: Argument, shape: tuple[int, ...]) -> None:
    """Check that an array fits an argument: (size,) for uniform ones and single samples, else (samples, size)."""
    size = len(argument)
    if shape != (size,) and (argument.uniform or len(shape) != 2 or shape[1] != size):
        expected = f"({size},)" if argument.uniform else f"(samples, {size})"
        raise InputError(f"{argument.name} has shape {shape}; expected {expected}: {_contents(argument)}")


def _sample_count(arguments: Sequence[Argument], lengths: Sequence[int]) -> int:
    """The number of samples, given that of each argument that varies; 1 if none does."""
    counts = dict(zip((a.name for a in arguments if not a.uniform), lengths, strict=True))
    if len(set(lengths)) > 1:
        shown = ", ".join(f"{name} {count}" for name, count in counts.items())
        raise InputError(f"arguments have different numbers of samples: {shown}")
    return lengths[0] if lengths else 1


def real_array(name: str, values: npt.ArrayLike) -> Floats:
    """An array in double precision; one that already is stays where it is."""
    if np.ma.is_masked(values):
        raise InputError(f"{name} has masked values; leave out samples that are not complete")
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(f"{name} is not an array of numbers: {error}") from None
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} holds {array.dtype} values; expected real numbers")
    return array.astype(np.float64, copy=False)


def result_array(shape: tuple[int, ...], out: Floats | None, inputs: Sequence[Floats]) -> Floats:
    """The array to write a result to: a new one, or the caller's after a check."""
    if out is None:
        return aligned(shape)
    if not isinstance(out, np.ndarray):
        raise InputError(f"out is a {type(out).__name__}; expected a NumPy array")
    if out.dtype != np.float64 or not out.dtype.isnative:
        raise InputError(f"out holds {out.dtype} values; expected float64")
    if out.shape != shape:
        raise InputError(f"out has shape {out.shape}; expected {shape}")
    if not out.flags.writeable:
        raise InputError("out is read-only")
    if not (out.flags.c_contiguous and out.flags.aligned):
        raise InputError("out is not contiguous in C order; rows are written one after another")
    if any(np.may_share_memory(out, array) for array in inputs):
        raise InputError("out overlaps an input, which would change while it is read")
    return out


def aligned(shape: tuple[int, ...], *, zero: bool = False, boundary: int = _LINE) -> Floats:
    """A new array that starts on a cache line, or on another multiple of bytes."""
    count = prod(shape)
    raw = (np.zeros if zero else np.empty)(count * _DOUBLE + boundary, dtype=np.uint8)
    start = -raw.ctypes.data % boundary
    result: Floats = raw[start : start + count * _DOUBLE].view(np.float64).reshape(shape)
    return result


def _contents(argument: Argument) -> str:
    shown = ", ".join(argument.labels[:12])
    return shown + (", …" if len(argument) > 12 else "") if shown else "nothing"
