"""CUDA text: a function's entries, and what brings them into rows or into triangles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from echelon.codegen.documentation import Subject
from echelon.codegen.generate import printed
from echelon.codegen.numbers import Precision
from echelon.codegen.targets.cuda import CUDA
from echelon.program.function import Function

KERNELS = Path(__file__).with_name("kernels")
ENTRIES = "echelon_entries_kernel"
"""Name of the kernel that computes entries."""
ROWS = "echelon_rows"
"""Name of the kernel that brings entries into rows."""
TRIANGLES = "echelon_triangles"
"""Name of the kernel that factors tall matrices."""


def entries_text(function: Function, precision: Precision, order: Sequence[int] | None = None) -> str:
    """Text of the kernel :data:`ENTRIES` that computes a function's entries, one after another for all samples.

    Its arguments are the number of samples, the function's arguments, and the result of shape (entries, samples).
    Arguments have shape (size, samples), or (size,) where they are uniform.

    Parameters
    ----------
    function : Function
    precision : Precision
    order : sequence of int, optional
        Numbers of the entries in the order that they shall have.
    """
    nodes = function.outputs if order is None else [function.outputs[k] for k in order]
    labels = tuple(f"entry {k}" for k in range(len(nodes)))
    entries: dict[tuple[int, ...], int] = {(k,): node for k, node in enumerate(nodes)}
    flat = replace(function, name="entries", entries=entries, axes=(labels,), units=())
    files = printed([flat], CUDA, precision, "echelon", Subject("at hand", (), {}))
    return "\n".join(files.values())


def rows_text(precision: Precision) -> str:
    """Text of the kernel :data:`ROWS`."""
    return f"typedef {CUDA.real[precision]} real;\n" + _kernel("rows.cu")


def triangles_text() -> str:
    """Text of the kernel :data:`TRIANGLES`."""
    return _kernel("triangles.cu")


def _kernel(file: str) -> str:
    return (KERNELS / file).read_text(encoding="ascii")
