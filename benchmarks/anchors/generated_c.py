"""Generated C, compiled as a user would, and called one state after another from a loop in C."""

from __future__ import annotations

import ctypes
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from anchors.build import BUILT, library

Floats = npt.NDArray[np.float64]

FLAGS = ("-std=gnu99", "-O3", "-march=native", "-ffp-contract=fast")
_STATE = ("q", "qd", "qdd", "qdr", "qddr", "y")
_ARGUMENT = re.compile(r"const double (\w+)\[(\d+)\]")

# The loop is in a file of its own, so that the function is called and not dissolved in it.
_LOOP = """\
#include <time.h>
#include "{header}"

double time_calls(long count, long rounds, const double *const *given, double *result)
{{
    struct timespec start, end;
    clock_gettime(CLOCK_MONOTONIC, &start);
    for (long round = 0; round < rounds; round++)
        for (long i = 0; i < count; i++)
            {function}({arguments}, result + i * {size});
    clock_gettime(CLOCK_MONOTONIC, &end);
    return (double)(end.tv_sec - start.tv_sec) + 1e-9 * (double)(end.tv_nsec - start.tv_nsec);
}}
"""


@dataclass(frozen=True)
class CompiledC:
    """One function of generated C.

    Attributes
    ----------
    arguments : tuple of (str, int)
        Name and length of every argument; the state (q, qd, …) changes from call to call.
    size : int
        Length of the result.
    """

    arguments: tuple[tuple[str, int], ...]
    size: int
    loaded: ctypes.CDLL

    def calls(
        self, given: Mapping[str, Floats], result: Floats, rounds: int = 1
    ) -> float:
        """Seconds for single calls, once per state and round."""
        arrays = [np.ascontiguousarray(given[name]) for name, _ in self.arguments]
        pointers = (ctypes.c_void_p * len(arrays))(
            *(array.ctypes.data for array in arrays)
        )
        count = ctypes.c_long(len(result))
        self.loaded.time_calls.restype = ctypes.c_double
        return float(
            self.loaded.time_calls(
                count,
                ctypes.c_long(rounds),
                pointers,
                ctypes.c_void_p(result.ctypes.data),
            )
        )


def compiled(files: Mapping[str, str], function: str) -> CompiledC:
    """Compile a header and a source.

    Parameters
    ----------
    files : mapping of str to str
        Texts by the names of the files.
    function : str
        Its name without the robot's, ``"inverse_dynamics"``.

    Raises
    ------
    UnavailableError
        If there is no compiler.
    """
    folder = BUILT / "generated"
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name).write_text(text, encoding="utf-8")
    header = next(name for name in files if name.endswith(".h"))
    declared = re.search(rf"void (\w+_{function})\((.*?)\);", files[header], re.DOTALL)
    if declared is None:
        raise ValueError(f"{header} declares no {function}")
    arguments = tuple(
        (name, int(size)) for name, size in _ARGUMENT.findall(declared[2])
    )
    size = int(declared[2].rsplit("[", 1)[1].strip("] ").removeprefix("restrict"))
    loop = folder / f"{Path(header).stem}_{function}_loop.c"
    loop.write_text(_loop(header, declared[1], arguments, size), encoding="utf-8")
    sources = [loop, *(folder / name for name in files if name.endswith(".c"))]
    return CompiledC(arguments, size, library(sources, (*FLAGS, f"-I{folder}"), "c"))


def _loop(
    header: str, function: str, arguments: tuple[tuple[str, int], ...], size: int
) -> str:
    passed = [
        f"given[{k}]" + (f" + i * {n}" if name in _STATE else "")
        for k, (name, n) in enumerate(arguments)
    ]
    return _LOOP.format(
        header=header, function=function, arguments=", ".join(passed), size=size
    )
