"""The device through CuPy, which is imported only when a device is asked for."""

from __future__ import annotations

from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.arrays import Floats
from echelon.errors import InputError, MissingExtraError
from echelon.machine.batch import real_array

Array = Any
"""An array on the device; CuPy has no types."""

_OPTIONS = ("--std=c++14",)


class Device:
    """The current device of CuPy.

    Raises
    ------
    MissingExtraError
        If CuPy is not installed.
    InputError
        If there is no device that it can use.
    """

    def __init__(self) -> None:
        self.cupy = _cupy()

    def holds(self, values: object) -> bool:
        """Whether values are an array on a device."""
        return isinstance(values, self.cupy.ndarray)

    def sent(self, values: Array | npt.NDArray[Any]) -> Array:
        """An array on the device; one that is there already stays where it is."""
        return values if self.holds(values) else self.cupy.asarray(np.ascontiguousarray(values))

    def contiguous(self, array: Array, dtype: npt.DTypeLike) -> Array:
        """An array on the device in C order, the same one if it fits."""
        return self.cupy.ascontiguousarray(array, dtype)

    def fetched(self, values: Any) -> Any:
        """Arrays on the device as NumPy arrays, everything else as it is."""
        return self.cupy.asnumpy(values) if self.holds(values) else values

    def real(self, name: str, values: Any) -> Array | Floats:
        """An array of real numbers, where it is; what is no array becomes one of NumPy.

        Raises
        ------
        InputError
            If it does not hold real numbers.
        """
        if not self.holds(values):
            return real_array(name, values)
        if values.dtype.kind not in "fiu":
            raise InputError(f"{name} holds {values.dtype} values; expected real numbers")
        return values

    def empty(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Array:
        """A new array."""
        return self.cupy.empty(shape, dtype)

    def zeros(self, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Array:
        """A new array of zeros."""
        return self.cupy.zeros(shape, dtype)

    def result(self, shape: tuple[int, ...], dtype: npt.DTypeLike, out: Array | None, given: tuple[Any, ...]) -> Array:
        """The array to write a result to: a new one, or the caller's after a check.

        Parameters
        ----------
        shape : tuple of int
        dtype : dtype
        out : array, optional
        given : tuple of array
            What is read meanwhile.

        Raises
        ------
        InputError
            If the caller's array is not on the device, does not fit, or overlaps an input.
        """
        if out is None:
            return self.empty(shape, dtype)
        if not self.holds(out):
            raise InputError(f"out is a {type(out).__name__}; expected a CuPy array")
        if out.shape != shape or out.dtype != dtype or not out.flags.c_contiguous:
            given_type, expected_type = out.dtype, np.dtype(dtype)
            raise InputError(
                f"out has shape {out.shape} and type {given_type}; expected {shape}, {expected_type}, C-contiguous"
            )
        if any(self.holds(array) and self.cupy.may_share_memory(out, array) for array in given):
            raise InputError("out overlaps an input, which would change while it is read")
        return out

    def kernel(self, text: str, name: str) -> Any:
        """A kernel of a CUDA source, compiled by NVRTC when it is first called; CuPy keeps the code on disk.

        Parameters
        ----------
        text : str
        name : str
            Of a function with ``extern "C" __global__``.

        Returns
        -------
        callable
            Of the grid, the block of threads, and the arguments.
        """
        return self.cupy.RawModule(code=text, backend="nvrtc", options=_OPTIONS).get_function(name)


def _cupy() -> ModuleType:
    try:
        module = import_module("cupy")
    except ImportError:
        raise MissingExtraError("cupy", "cuda") from None
    try:
        count = module.cuda.runtime.getDeviceCount()
    except RuntimeError as error:
        raise InputError(f"no GPU can be used: {error}") from None
    if not count:
        raise InputError("no GPU can be used: CUDA finds no device")
    return module
