"""Generated CUDA kernels on a device: compiled by NVRTC, compared with machine code on the processor, and timed.

python benchmarks/gpu.py                  double and single precision, a hundred thousand samples
python benchmarks/gpu.py --samples 10000
python benchmarks/gpu.py --json

NVRTC and the driver are called directly, so that nothing needs to be installed for it: NVRTC is that of the system, of
CUDA_PATH, or of the package nvidia-cuda-nvrtc.  Where there is no device, kernels are compiled only; where there is no
NVRTC either, nothing is done.  Both are said, and are no failures; kernels that do not compile or are wrong are some.
"""

from __future__ import annotations

import argparse
import ctypes
import json
import os
import sys
from collections.abc import Iterator
from contextlib import suppress
from ctypes.util import find_library
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import echelon as ec
from echelon.algebra import Function
from echelon.codegen import generate
from echelon.compute import Kernel

ROBOTS = ("double_pendulum", "ur10", "panda", "tx40")
FUNCTIONS = ("regressor", "inverse_dynamics", "mass_matrix", "gravity")
TOLERANCE = {"double": 1e-11, "single": 2e-4}
"""Largest difference, relative to the largest value of an entry: hundreds of operations, each with one rounding."""
THREADS = 128  # of a block
REPEATS = 20
ARCHITECTURE = (
    "compute_75"  # where there is no device to ask: what CUDA 12 and 13 both know
)
CAPABILITY = (
    75,
    76,
)  # numbers of the attributes for the major and minor version of a device


class CudaError(Exception):
    """A call of the driver or of NVRTC failed."""


@dataclass(frozen=True)
class Run:
    """One kernel on the device."""

    robot: str
    function: str
    precision: str
    error: float  # relative
    microseconds: float  # of a launch
    per_second: float  # samples

    @property
    def right(self) -> bool:
        return self.error <= TOLERANCE[self.precision]


def library(names: list[str]) -> ctypes.CDLL | None:
    """The first library that loads."""
    for name in names:
        with suppress(OSError):
            # NVRTC looks for its own parts by their names, which are known once they are loaded
            for part in Path(name).parent.glob("libnvrtc-builtins.so*"):
                ctypes.CDLL(str(part))
            return ctypes.CDLL(name)
    return None


def nvrtc_names() -> Iterator[str]:
    """Where NVRTC may be."""
    folders = [Path(entry) / "nvidia" for entry in sys.path if entry]
    folders += [Path(os.environ[name]) for name in ("CUDA_PATH",) if name in os.environ]
    for folder in [*folders, Path("/usr/local/cuda")]:
        for pattern in ("**/libnvrtc.so*", "**/nvrtc64_*.dll"):
            yield from sorted(str(path) for path in folder.glob(pattern))
    yield from filter(None, [find_library("nvrtc")])


class Compiler:
    """NVRTC."""

    def __init__(self, nvrtc: ctypes.CDLL) -> None:
        self._nvrtc = nvrtc

    def ptx(self, source: str, architecture: str) -> bytes:
        """The kernels of a source in the device's assembly language."""
        program = ctypes.c_void_p()
        self._check("nvrtcCreateProgram", ctypes.byref(program), source.encode(), b"robot.cu", 0, None, None)  # fmt: skip
        option = ctypes.c_char_p(f"--gpu-architecture={architecture}".encode())
        failed = self._nvrtc.nvrtcCompileProgram(program, 1, ctypes.byref(option))
        if failed:
            raise CudaError(self._text("ProgramLog", program).decode())
        text = self._text("PTX", program)
        self._check("nvrtcDestroyProgram", ctypes.byref(program))
        return text

    def _text(self, what: str, program: ctypes.c_void_p) -> bytes:
        size = ctypes.c_size_t()
        self._check(f"nvrtcGet{what}Size", program, ctypes.byref(size))
        text = ctypes.create_string_buffer(size.value)
        self._check(f"nvrtcGet{what}", program, text)
        return text.value

    def _check(self, name: str, *arguments: Any) -> None:
        code = getattr(self._nvrtc, name)(*arguments)
        if code:
            raise CudaError(f"{name} failed with code {code}")


class Device:
    """The first device, by the driver's interface."""

    def __init__(self, driver: ctypes.CDLL) -> None:
        self._driver = driver
        self._call("cuInit", 0)
        device, context = ctypes.c_int(), ctypes.c_void_p()
        self._call("cuDeviceGet", ctypes.byref(device), 0)
        name = ctypes.create_string_buffer(100)
        self._call("cuDeviceGetName", name, len(name), device)
        version = []
        for attribute in CAPABILITY:
            value = ctypes.c_int()
            self._call("cuDeviceGetAttribute", ctypes.byref(value), attribute, device)
            version.append(value.value)
        self.name, self.architecture = (
            name.value.decode(),
            "compute_{}{}".format(*version),
        )
        self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), device)
        self._call("cuCtxSetCurrent", context)

    def load(self, ptx: bytes) -> ctypes.c_void_p:
        """A module of kernels."""
        module = ctypes.c_void_p()
        self._call("cuModuleLoadData", ctypes.byref(module), ptx)
        return module

    def run(
        self,
        module: ctypes.c_void_p,
        name: str,
        arrays: list[np.ndarray],
        result: np.ndarray,
    ) -> float:
        """Fill the result by a kernel of ``count`` samples; seconds of a launch."""
        kernel = ctypes.c_void_p()
        self._call("cuModuleGetFunction", ctypes.byref(kernel), module, name.encode())
        places = [self._copied(array) for array in [*arrays, result]]
        count = ctypes.c_longlong(result.shape[1])
        pointers = [
            ctypes.cast(ctypes.byref(x), ctypes.c_void_p) for x in [count, *places]
        ]
        packed = (ctypes.c_void_p * len(pointers))(*pointers)
        blocks = -(-result.shape[1] // THREADS)
        seconds = 0.0
        for launches in (1, REPEATS):  # the first one is slower
            started = perf_counter()
            for _ in range(launches):
                self._call("cuLaunchKernel", kernel, blocks, 1, 1, THREADS, 1, 1, 0, None, packed, None)  # fmt: skip
            self._call("cuCtxSynchronize")
            seconds = (perf_counter() - started) / launches
        back = ctypes.c_void_p(result.ctypes.data)
        self._call("cuMemcpyDtoH_v2", back, places[-1], ctypes.c_size_t(result.nbytes))
        for place in places:
            self._call("cuMemFree_v2", place)
        return seconds

    def _copied(self, array: np.ndarray) -> ctypes.c_uint64:
        """An array's copy on the device."""
        place, size = ctypes.c_uint64(), ctypes.c_size_t(max(array.nbytes, 1))
        self._call("cuMemAlloc_v2", ctypes.byref(place), size)
        source = ctypes.c_void_p(array.ctypes.data)
        self._call("cuMemcpyHtoD_v2", place, source, ctypes.c_size_t(array.nbytes))
        return place

    def _call(self, name: str, *arguments: Any) -> None:
        code = getattr(self._driver, name)(*arguments)
        if code:
            raise CudaError(f"{name} failed with code {code}")


def device() -> Device | str:
    """The device, or why there is none."""
    driver = library(["libcuda.so.1", "nvcuda.dll"])
    if driver is None:
        return "no CUDA driver"
    try:
        return Device(driver)
    except CudaError as error:
        return f"no CUDA device ({error})"


def values_of(function: Function, samples: int, kind: type) -> dict[str, np.ndarray]:
    """Random values of a function's arguments, exact in the precision of the device."""
    rng = np.random.default_rng(0)
    found = {}
    for argument in function.arguments:
        shape = (len(argument),) if argument.uniform else (samples, len(argument))
        found[argument.name] = rng.uniform(-2, 2, shape).astype(kind)
    return found


def compared(
    gpu: Device,
    module: ctypes.c_void_p,
    robot: str,
    function: Function,
    precision: str,
    samples: int,
) -> Run:
    """A kernel beside machine code."""
    kind = np.float64 if precision == "double" else np.float32
    values = values_of(function, samples, kind)
    wanted = Kernel(function)({name: v.astype(float) for name, v in values.items()})
    wanted = wanted.reshape(samples, -1).T
    arrays = [np.ascontiguousarray(values[a.name].T) for a in function.arguments]
    result = np.full(wanted.shape, np.nan, kind)
    seconds = gpu.run(module, f"{robot}_{function.name}_kernel", arrays, result)
    scale = np.maximum(np.abs(wanted).max(axis=1, keepdims=True), 1.0)
    # nan, where a kernel wrote nothing, is no agreement
    error = float(np.max(np.abs(result - wanted) / scale))
    return Run(robot, function.name, precision, error, 1e6 * seconds, samples / seconds)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    nvrtc, gpu = library(list(nvrtc_names())), device()
    report: dict[str, Any] = {"device": gpu if isinstance(gpu, str) else gpu.name}
    if nvrtc is None:
        said = (
            f"{report['device']}; no NVRTC to compile with: nothing was compiled or run"
        )
        print(json.dumps({**report, "nvrtc": False}) if options.json else said)
        return 0
    compiler, runs, sizes = Compiler(nvrtc), [], {}
    architecture = ARCHITECTURE if isinstance(gpu, str) else gpu.architecture
    root = Path(__file__).resolve().parent.parent / "examples"
    for robot in ROBOTS:
        base = ec.base_parameters(ec.load(root / f"{robot}.yaml"))
        for precision in TOLERANCE:
            source = generate(base, "cuda", FUNCTIONS, name=robot, precision=precision)
            ptx = compiler.ptx(source[f"{robot}.cu"], architecture)
            sizes[f"{robot}, {precision}"] = len(ptx)
            if isinstance(gpu, str):
                continue
            module = gpu.load(ptx)
            runs += [
                compared(gpu, module, robot, f, precision, options.samples)
                for f in source.functions
            ]
    report |= {"architecture": architecture, "compiled": sizes}
    report |= {"runs": [{**asdict(run), "right": run.right} for run in runs]}
    if options.json:
        print(json.dumps(report))
    else:
        print(f"{report['device']}; {len(sizes)} sources compiled for {architecture}")
        if not runs:
            print("no kernel was run: the numbers are not compared here")
        for run in runs:
            print(
                f"{run.robot:>16} {run.function:<17} {run.precision}: {run.microseconds:9.1f} µs, "
                f"{run.per_second:9.3g} samples/s, error {run.error:.1e}{'' if run.right else '  WRONG'}"
            )
    return int(not all(run.right for run in runs))


if __name__ == "__main__":
    sys.exit(main())
