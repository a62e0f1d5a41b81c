"""What the library uses of CuPy, on the processor: for tests of everything but the device itself.

Arrays refuse what CuPy's refuse: implicit conversion to NumPy, and mixing with NumPy's arrays.  New arrays hold NaN and
stand between fences.  Kernels are compiled by g++ and called with arguments whose types are compared with those in the
text.
"""

from __future__ import annotations

import ctypes
import hashlib
import re
import subprocess
import tempfile
import weakref
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import numpy.typing as npt

HEADER = Path(__file__).with_name("cuda_on_cpu.hpp")
CODE = Path(__file__).parents[1] / ".pytest_cache" / "cuda"
"""Compiled kernels are kept here between runs."""
FENCE = 32
POST = 0x5A
SIGNATURE = re.compile(r'extern "C" __global__ void (\w+)\(([^)]*)\)')
TYPES = {"double": np.float64, "float": np.float32, "long long": np.int64}
SCALARS = {np.dtype(np.int64): ctypes.c_longlong}
OPTIONS = {"--std=c++14": "-std=c++14"}
DISPATCHED = (np.concatenate, np.argwhere)

backwards = False
"""Whether threads run in reverse order."""


class Usage:
    """Bytes of arrays that are alive, and the most there were."""

    now = most = 0

    @classmethod
    def change(cls, count: int) -> None:
        cls.now += count
        cls.most = max(cls.most, cls.now)


class ndarray:  # noqa: N801
    """An array on the device that is not there."""

    def __init__(self, values: npt.NDArray[Any], memory: npt.NDArray[np.uint8]) -> None:
        self._values, self._memory = values, memory

    @property
    def unwrapped(self) -> npt.NDArray[Any]:
        return self._values

    def check(self) -> None:
        ends = np.concatenate((self._memory[:FENCE], self._memory[-FENCE:]))
        assert (ends == POST).all(), "a kernel wrote beyond an array"

    def _view(self, values: npt.NDArray[Any]) -> ndarray:
        return ndarray(values, self._memory)

    shape = property(lambda self: self._values.shape)
    dtype = property(lambda self: self._values.dtype)
    ndim = property(lambda self: self._values.ndim)
    size = property(lambda self: self._values.size)
    flags = property(lambda self: SimpleNamespace(c_contiguous=self._values.flags.c_contiguous))
    T = property(lambda self: self._view(self._values.T))

    def reshape(self, *shape: int) -> ndarray:
        return self._view(self._values.reshape(*shape))

    def copy(self) -> ndarray:
        return owned(self._values)

    def all(self) -> ndarray:
        return owned(np.asarray(self._values.all()))

    def __getitem__(self, index: Any) -> ndarray:
        return self._view(np.asarray(self._values[index]))

    def __setitem__(self, index: Any, values: Any) -> None:
        assert isinstance(values, ndarray | float | int)
        self._values[index] = values.unwrapped if isinstance(values, ndarray) else values

    def __len__(self) -> int:
        return len(self._values)

    def __iter__(self) -> Iterator[ndarray]:
        return (self[k] for k in range(len(self)))

    def __bool__(self) -> bool:
        return bool(self._values)

    def __int__(self) -> int:
        return int(self._values)

    def __float__(self) -> float:
        return float(self._values)

    def __invert__(self) -> ndarray:
        return owned(~self._values)

    def __array__(self, *_: Any, **__: Any) -> Any:
        raise TypeError("Implicit conversion to a NumPy array is not allowed.")

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, **options: Any) -> ndarray:
        assert method == "__call__"
        return owned(ufunc(*map(unwrapped, inputs), **options))

    def __array_function__(self, function: Any, _: Any, args: Any, options: Mapping[str, Any]) -> ndarray:
        assert function in DISPATCHED
        return owned(function(*map(unwrapped, args), **options))


def unwrapped(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [unwrapped(item) for item in value]
    if isinstance(value, np.ndarray):
        raise TypeError("Unsupported type <class 'numpy.ndarray'>")
    return value.unwrapped if isinstance(value, ndarray) else value


def empty(shape: int | tuple[int, ...], dtype: npt.DTypeLike = np.float64) -> ndarray:
    kind = np.dtype(dtype)
    count = int(np.prod(shape)) * kind.itemsize
    memory = np.full(count + 2 * FENCE, POST, dtype=np.uint8)
    Usage.change(count)
    weakref.finalize(memory, Usage.change, -count)
    values = memory[FENCE : FENCE + count].view(kind).reshape(shape)
    values[...] = np.nan if kind.kind == "f" else -7
    return ndarray(values, memory)


def owned(values: npt.NDArray[Any]) -> ndarray:
    made = empty(values.shape, values.dtype)
    made.unwrapped[...] = values
    return made


def zeros(shape: int | tuple[int, ...], dtype: npt.DTypeLike = np.float64) -> ndarray:
    return owned(np.zeros(shape, dtype))


def asarray(values: Any, dtype: npt.DTypeLike = None) -> ndarray:
    return values if isinstance(values, ndarray) else owned(np.asarray(values, dtype))


def asnumpy(values: ndarray) -> npt.NDArray[Any]:
    return np.array(values.unwrapped)


def ascontiguousarray(values: ndarray, dtype: npt.DTypeLike = None) -> ndarray:
    array = unwrapped(values)
    fits = array.flags.c_contiguous and array.dtype == np.dtype(dtype or array.dtype)
    return values if fits else owned(np.ascontiguousarray(array, dtype))


def concatenate(arrays: Sequence[ndarray], axis: int = 0) -> ndarray:
    return owned(np.concatenate(unwrapped(arrays), axis))


def may_share_memory(a: ndarray, b: ndarray) -> bool:
    return bool(np.may_share_memory(unwrapped(a), unwrapped(b)))


class RawModule:
    """Kernels of a text, compiled when one of them is called."""

    def __init__(self, *, code: str, backend: str, options: tuple[str, ...]) -> None:
        assert backend == "nvrtc"
        assert code.isascii()
        assert "#include" not in code
        self.code, self.options = code, options

    def get_function(self, name: str) -> Kernel:
        return Kernel(self.code, self.options, name)


class Kernel:
    """One kernel."""

    def __init__(self, code: str, options: tuple[str, ...], name: str) -> None:
        self.code, self.options, self.name = code, options, name

    def __call__(self, grid: tuple[int, ...], block: tuple[int, ...], args: tuple[Any, ...]) -> None:
        assert all(0 < size < limit for size, limit in zip(grid, (2**31, 2**16, 2**16), strict=False))
        assert np.prod(block) <= 1024
        types = self._types()
        assert len(args) == len(types)
        call = getattr(library(self.code, self.options), f"launch_{self.name}")
        sizes = [(ctypes.c_uint * 3)(*size, *[1] * (3 - len(size))) for size in (grid, block)]
        passed = [self._passed(kind, value) for kind, value in zip(types, args, strict=True)]
        assert call(*sizes, int(backwards), *passed) == 0, "threads wait for others that never come"
        for value in args:
            if isinstance(value, ndarray):
                value.check()

    def _types(self) -> list[str]:
        parameters = dict(SIGNATURE.findall(self.code))[self.name].split(",")
        real = re.search(r"typedef (\w+) real;", self.code)
        words = [re.sub(r"\b(const|__restrict__)\b", "", p).replace("*", " * ").split()[:-1] for p in parameters]
        return [" ".join(word).replace("real", real[1] if real else "real") for word in words]

    @staticmethod
    def _passed(kind: str, value: Any) -> Any:
        wanted = np.dtype(TYPES[kind.removesuffix(" *")])
        assert value.dtype == wanted
        if not kind.endswith("*"):
            assert isinstance(value, np.generic)
            return SCALARS[wanted](value.item())
        assert isinstance(value, ndarray)
        assert value.flags.c_contiguous
        return value.unwrapped.ctypes.data_as(ctypes.c_void_p)


@cache
def library(code: str, options: tuple[str, ...]) -> ctypes.CDLL:
    CODE.mkdir(parents=True, exist_ok=True)
    lines = [f'#include "{HEADER}"', code]
    for name, parameters in SIGNATURE.findall(code):
        names = ", ".join(re.findall(r"(\w+)\s*(?:,|$)", parameters))
        lines.append(
            f'extern "C" int launch_{name}(\n'
            f"const unsigned* grid, const unsigned* threads, int backwards, {parameters})\n"
            f"{{ return emulation::launch(grid, threads, backwards, [&] {{ {name}({names}); }}); }}"
        )
    text = "\n".join(lines) + "\n"
    stem = hashlib.sha256((HEADER.read_text() + text + repr(options)).encode()).hexdigest()[:24]
    made = CODE / f"{stem}.so"
    if not made.exists():
        with tempfile.TemporaryDirectory(dir=CODE) as own:
            source, result = Path(own) / "kernel.cpp", Path(own) / "kernel.so"
            source.write_text(text)
            flags = [
                "-Wall",
                "-Wextra",
                "-Werror",
                "-O1",
                "-U_FORTIFY_SOURCE",
                "-shared",
                "-fPIC",
                *(OPTIONS[option] for option in options),
            ]
            command = ["g++", *flags, str(source), "-o", str(result)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            assert done.returncode == 0, done.stderr
            result.replace(made)
    return ctypes.CDLL(str(made))


def module(devices: int = 1, error: Exception | None = None) -> ModuleType:
    """A module that takes the place of CuPy.

    Parameters
    ----------
    devices : int
        How many it finds.
    error : Exception, optional
        Raised instead.
    """

    def count() -> int:
        if error is not None:
            raise error
        return devices

    made = ModuleType("cupy")
    offered = (ndarray, RawModule, empty, zeros, asarray, asnumpy, ascontiguousarray, concatenate, may_share_memory)
    vars(made).update({thing.__name__: thing for thing in offered})
    vars(made)["cuda"] = SimpleNamespace(runtime=SimpleNamespace(getDeviceCount=count))
    return made
