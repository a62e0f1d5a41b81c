"""NVIDIA's compilers accept the kernels: nvcc, and NVRTC, which CuPy uses."""

from __future__ import annotations

import ctypes
import importlib.util
import subprocess
from functools import cache
from pathlib import Path

import pytest

import echelon as ec
from echelon.codegen.numbers import Precision
from echelon.dynamics.functions import robot_function
from echelon.gpu.text import entries_text, rows_text, triangles_text
from echelon.observe.layout import layout_of, measured
from echelon.program.function import Function
from generated import tool

EXAMPLES = Path(__file__).parent.parent / "examples"
ARCHITECTURES = (75, 80, 86, 89, 90)
NVRTC = ("nvidia/cuda_nvrtc/lib", "nvidia/cu13/lib")
"""Where NVIDIA's packages keep the library."""


@cache
def texts() -> dict[str, str]:
    both = measured(function("tx40", "regressor"))
    found = {
        "triangles": triangles_text(),
        "tx40 observation": entries_text(both, Precision.DOUBLE, layout_of(both)[1].tolist()),
    }
    found |= {f"rows {precision}": rows_text(precision) for precision in Precision}
    for name in ("regressor", "inverse_dynamics"):
        made = function("panda", name)
        found |= {f"panda {name} {precision}": entries_text(made, precision) for precision in Precision}
    return found


def function(robot: str, name: str) -> Function:
    base = ec.base_parameters(ec.load(EXAMPLES / f"{robot}.yaml"))
    return robot_function(name, base.mechanism, base.matrix.pivots)


NAMES = [
    "triangles", "rows double", "rows single", "panda regressor double", "panda regressor single",
    "panda inverse_dynamics double", "panda inverse_dynamics single", "tx40 observation",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_nvcc(name: str, tmp_path: Path) -> None:
    source = tmp_path / "kernel.cu"
    source.write_text(texts()[name], encoding="ascii")
    flags = ["-std=c++14", "-Werror", "all-warnings", "-Xcompiler", "-Wall,-Wextra", "--threads", "2"]
    targets = [f"-gencode=arch=compute_{a},code=compute_{a}" for a in ARCHITECTURES]
    command = [tool("nvcc"), "-fatbin", *flags, *targets, str(source), "-o", str(tmp_path / "kernel.fatbin")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr


@pytest.mark.parametrize("name", NAMES)
def test_nvrtc(name: str) -> None:
    log = compiled(texts()[name], b"--std=c++14", b"--gpu-architecture=compute_75")
    assert not log.strip("\0\n "), log


def compiled(text: str, *options: bytes) -> str:
    """The log of NVRTC, which compiles without a device."""
    library = nvrtc()
    program = ctypes.c_void_p()
    assert library.nvrtcCreateProgram(ctypes.byref(program), text.encode("ascii"), b"kernel.cu", 0, None, None) == 0
    result = library.nvrtcCompileProgram(program, len(options), (ctypes.c_char_p * len(options))(*options))
    size = ctypes.c_size_t()
    library.nvrtcGetProgramLogSize(program, ctypes.byref(size))
    log = ctypes.create_string_buffer(size.value)
    library.nvrtcGetProgramLog(program, log)
    library.nvrtcDestroyProgram(ctypes.byref(program))
    assert result == 0, log.value.decode()
    return log.value.decode()


@cache
def nvrtc() -> ctypes.CDLL:
    """NVRTC, from NVIDIA's packages or the system, or skip."""
    found = importlib.util.find_spec("nvidia")
    for root in found.submodule_search_locations or () if found else ():
        for folder in NVRTC:
            for path in sorted(Path(root).parent.joinpath(folder).glob("libnvrtc.so.*")):
                if "alt" not in path.name:
                    return ctypes.CDLL(str(path))
    for name in ("libnvrtc.so.13", "libnvrtc.so.12", "libnvrtc.so"):
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    pytest.skip("NVRTC is not installed")
