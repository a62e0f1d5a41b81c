"""Generated source, compiled or loaded and called on batches of samples."""

from __future__ import annotations

import ctypes
import importlib.util
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra.program.function import Function
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from support.paths import TESTS
from support.system_tools import tool

Floats = npt.NDArray[Any]
Call = Callable[[Function, Mapping[str, Floats]], Floats]
"""Evaluates a function at samples: arguments (N, n), or (n,) where they are uniform."""

WARNINGS = [
    "-Wall",
    "-Wextra",
    "-Werror",
    "-pedantic",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
]


def reference(function: Function, values: Mapping[str, Floats]) -> Floats:
    """A function by NumPy, shape (N, ...)."""
    samples = len(values["q"])
    nodes = {}
    for argument in function.arguments:
        columns = np.broadcast_to(values[argument.name], (samples, len(argument)))
        nodes |= {node: columns[:, k] for k, node in enumerate(argument.nodes)}
    result = np.zeros((samples, *function.shape))
    if function.entries:
        rows = Schedule(function.program, list(function.outputs)).run(
            FloatArithmetic(), nodes, samples
        )
        for index, row in zip(function.entries, rows, strict=True):
            result[(slice(None), *index)] = row
    return result


def compiled(command: list[str], library: Path) -> ctypes.CDLL:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr, done.stderr
    return ctypes.CDLL(str(library))


def native(library: ctypes.CDLL, prefix: str, dtype: npt.DTypeLike) -> Call:
    """Calls functions of pointers, once for each sample."""

    def call(function: Function, values: Mapping[str, Floats]) -> Floats:
        samples = len(values["q"])
        entry = getattr(library, prefix + function.name)
        entry.restype = None
        result = np.full((samples, *function.shape), np.nan, dtype)
        for k in range(samples):
            rows = [
                row_of(values[a.name], a.uniform, k, dtype) for a in function.arguments
            ]
            entry(*(row.ctypes.data_as(ctypes.c_void_p) for row in [*rows, result[k]]))
        return result

    return call


def row_of(values: Floats, uniform: bool, k: int, dtype: npt.DTypeLike) -> Floats:
    return np.ascontiguousarray(values if uniform else values[k], dtype)


@dataclass(frozen=True)
class Build:
    """Where and how files are built.

    Attributes
    ----------
    folder : Path
    robot : str
    functions : tuple of Function
    precision : str
    flags : tuple of str
        More options of compilers of C and C++.
    """

    folder: Path
    robot: str
    functions: tuple[Function, ...]
    precision: str
    flags: tuple[str, ...] = ()

    @property
    def dtype(self) -> npt.DTypeLike:
        return np.float64 if self.precision == "double" else np.float32

    @property
    def real(self) -> str:
        return "double" if self.precision == "double" else "float"


def c(build: Build) -> Call:
    library, source = build.folder / "c.so", build.folder / f"{build.robot}.c"
    flags = ["-std=c99", *WARNINGS, "-O2", "-shared", "-fPIC", *build.flags]
    return native(
        compiled(
            [tool("gcc"), *flags, str(source), "-o", str(library), "-lm"], library
        ),
        f"{build.robot}_",
        build.dtype,
    )


def cpp(build: Build) -> Call:
    lines = [f'#include "{build.robot}.hpp"']
    for f in build.functions:
        given = ", ".join(f"const {build.real}* {a.name}" for a in f.arguments)
        arrays = ", ".join(
            f"*reinterpret_cast<const std::array<{build.real}, {len(a)}>*>({a.name})"
            for a in f.arguments
        )
        lines.append(f'extern "C" void run_{f.name}({given}, {build.real}* result) {{')
        lines.append(
            f"  const auto found = {build.robot}::{f.name}<{build.real}>({arrays});"
        )
        lines.append(
            "  for (std::size_t k = 0; k < found.size(); k++) { result[k] = found[k]; }\n}"
        )
    source, library = build.folder / "run.cpp", build.folder / "cpp.so"
    source.write_text("\n".join(lines) + "\n")
    flags = ["-std=c++17", *WARNINGS, "-O1", "-shared", "-fPIC", *build.flags]
    return native(
        compiled([tool("g++"), *flags, str(source), "-o", str(library)], library),
        "run_",
        build.dtype,
    )


def cuda(build: Build) -> Call:
    """The kernels on the processor, one thread after the other, with more threads than samples."""
    lines = [
        f'#include "{TESTS.joinpath("support", "cuda_on_cpu.hpp")}"',
        f'#include "{build.robot}.cu"',
    ]
    for f in build.functions:
        given = ", ".join(f"const {build.real}* {a.name}" for a in f.arguments)
        passed = ", ".join(["count", *(a.name for a in f.arguments), "result"])
        lines.append(
            f'extern "C" void run_{f.name}(long long count, {given}, {build.real}* result) {{'
        )
        lines.append("  const unsigned blocks = (unsigned)count/32 + 2;")
        lines.append(
            f"  launch(blocks, 32, [&] {{ {build.robot}_{f.name}_kernel({passed}); }});\n}}"
        )
    source, library = build.folder / "run_cuda.cpp", build.folder / "cuda.so"
    source.write_text("\n".join(lines) + "\n")
    flags = ["-std=c++14", "-Wall", "-Wextra", "-Werror", "-O1", "-shared", "-fPIC"]
    loaded = compiled([tool("g++"), *flags, str(source), "-o", str(library)], library)

    def call(function: Function, values: Mapping[str, Floats]) -> Floats:
        samples = len(values["q"])
        columns = [
            np.ascontiguousarray(values[a.name].T, build.dtype)
            for a in function.arguments
        ]
        size = int(np.prod(function.shape))
        guarded = np.full(
            (size + 2, samples), np.nan, build.dtype
        )  # nothing is written before or behind the result
        pointers = (
            array.ctypes.data_as(ctypes.c_void_p) for array in [*columns, guarded[1:]]
        )
        getattr(loaded, f"run_{function.name}")(ctypes.c_longlong(samples), *pointers)
        assert np.isnan(guarded[[0, -1]]).all()
        return guarded[1:-1].T.reshape(samples, *function.shape)

    return call


def rust(build: Build) -> Call:
    real = "f64" if build.precision == "double" else "f32"
    lines = [
        "#![deny(warnings)]",
        "#![allow(clippy::missing_safety_doc)]",
        f"pub mod {build.robot};",
    ]
    for f in build.functions:
        shape = real
        for size in reversed(f.shape):
            shape = f"[{shape}; {size}]"
        given = ", ".join(f"{a.name}: *const [{real}; {len(a)}]" for a in f.arguments)
        passed = ", ".join(f"&*{a.name}" for a in f.arguments)
        lines.append(
            f'#[no_mangle]\npub unsafe extern "C" fn run_{f.name}({given}, result: *mut {shape}) {{'
        )
        lines.append(f"    {build.robot}::{f.name}({passed}, &mut *result);\n}}")
    source, library = build.folder / "lib.rs", build.folder / "rust.so"
    source.write_text("\n".join(lines) + "\n")
    command = [
        tool("rustc"),
        "--crate-type",
        "cdylib",
        "--edition",
        "2021",
        "-O",
        str(source),
        "-o",
        str(library),
    ]
    return native(compiled(command, library), "run_", build.dtype)


def module(path: Path) -> ModuleType:
    specification = importlib.util.spec_from_file_location(path.stem, path)
    assert specification is not None
    assert specification.loader is not None
    made = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(made)
    return made


def python(build: Build) -> Call:
    loaded = module(build.folder / f"{build.robot}.py")

    def call(function: Function, values: Mapping[str, Floats]) -> Floats:
        result: Floats = getattr(loaded, function.name)(
            *(values[a.name] for a in function.arguments)
        )
        assert result.dtype == build.dtype
        return result

    return call


def jax(build: Build) -> Call:
    import jax as library

    library.config.update("jax_enable_x64", build.precision == "double")
    loaded = module(build.folder / f"{build.robot}_jax.py")

    def call(function: Function, values: Mapping[str, Floats]) -> Floats:
        axes = tuple(None if a.uniform else 0 for a in function.arguments)
        batch = library.jit(library.vmap(getattr(loaded, function.name), in_axes=axes))
        result = np.asarray(
            batch(
                *(np.asarray(values[a.name], build.dtype) for a in function.arguments)
            )
        )
        assert result.dtype == build.dtype
        return result

    return call


def casadi(build: Build) -> Call:
    loaded = module(build.folder / f"{build.robot}_casadi.py")

    def call(function: Function, values: Mapping[str, Floats]) -> Floats:
        made = getattr(loaded, function.name)()
        rows = []
        for k in range(len(values["q"])):
            given = [
                row_of(values[a.name], a.uniform, k, np.float64)
                for a in function.arguments
            ]
            rows.append(np.asarray(made(*given)).reshape(function.shape))
        return np.array(rows)

    return call


def matlab(build: Build) -> Call:
    octave = tool("octave-cli")

    def call(function: Function, values: Mapping[str, Floats]) -> Floats:
        lines = ["1;"]
        for k in range(len(values["q"])):
            rows = [
                row_of(values[a.name], a.uniform, k, np.float64)
                for a in function.arguments
            ]
            given = ", ".join(
                "[" + "; ".join(map(repr, map(float, row))) + "]" for row in rows
            )
            lines.append(
                f"r = double({build.robot}_{function.name}({given}))'; printf('%.17g\\n', r(:));"
            )
        (build.folder / "call_generated.m").write_text("\n".join(lines) + "\n")
        command = [octave, "--no-gui", "--norc", "call_generated.m"]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, cwd=build.folder
        )
        assert done.returncode == 0, done.stderr
        return np.array(done.stdout.split(), float).reshape(
            len(values["q"]), *function.shape
        )

    return call


RUNNERS: Mapping[str, Callable[[Build], Call]] = {
    "c": c,
    "cpp": cpp,
    "cuda": cuda,
    "python": python,
    "jax": jax,
    "casadi": casadi,
    "matlab": matlab,
    "rust": rust,
}
"""Targets that run here, where their tools are installed."""
