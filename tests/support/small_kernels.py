"""Small functions to compile, their values by NumPy, and the processors to compile for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from echelon.algebra.program.function import Argument, Function
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.algebra.program.tape import Program, Scalar
from echelon.compute.machine.target import host
from echelon.shared.errors import InputError

FloatArray = npt.NDArray[np.float64]
Outputs = Sequence[Scalar] | Mapping[tuple[int, ...], Scalar]


def available(lanes: int) -> bool:
    try:
        host(lanes)
    except InputError:
        return False
    return True


LANES = [lanes for lanes in (2, 4, 8) if available(lanes)]
"""Widths of vectors that this processor has."""


def function(
    record: Callable[..., Outputs],
    varying: Mapping[str, int],
    uniform: Mapping[str, int] | None = None,
    shape: tuple[int, ...] | None = None,
) -> Function:
    """A function whose result is what ``record`` makes of lists of scalars, one list for each argument.

    The result is a vector, or entries by index of an array of the given shape.
    """
    program = Program()
    arguments, given = [], []
    for name, size in {**varying, **(uniform or {})}.items():
        shared = name in (uniform or {})
        labels = tuple(f"{name}{k}" for k in range(size))
        scalars = [
            program.input(label, "symbol" if shared else "state") for label in labels
        ]
        nodes = tuple(scalar.node for scalar in scalars)
        arguments.append(Argument(name, nodes, labels, ("1",) * size, uniform=shared))
        given.append(scalars)
    made = record(*given)
    entries = (
        dict(made)
        if isinstance(made, Mapping)
        else {(k,): value for k, value in enumerate(made)}
    )
    axes = (len(entries),) if shape is None else shape
    names = tuple(tuple(map(str, range(size))) for size in axes)
    return Function(
        "tested",
        program,
        tuple(arguments),
        {i: value.node for i, value in entries.items()},
        names,
    )


def by_numpy(
    made: Function,
    values: Mapping[str, npt.ArrayLike],
    arithmetic: FloatArithmetic | None = None,
) -> FloatArray:
    """The function's values, shape (samples, ...).

    Those of uniform arguments have one axis, others the axis of samples before it.
    """
    arithmetic = arithmetic or FloatArithmetic()
    samples = max(
        (len(np.atleast_2d(values[a.name])) for a in made.arguments if not a.uniform),
        default=1,
    )
    leaves: dict[int, FloatArray] = {}
    for argument in made.arguments:
        columns = np.broadcast_to(
            np.asarray(values[argument.name], dtype=arithmetic.dtype),
            (samples, len(argument)),
        )
        leaves |= dict(zip(argument.nodes, columns.T, strict=True))
    schedule = Schedule(made.program, made.outputs)
    found = schedule.run(
        arithmetic, {node: leaves[node] for node in schedule.leaves}, samples
    )
    result = np.zeros((samples, *made.shape), dtype=arithmetic.dtype)
    for index, value in zip(made.entries, found, strict=True):
        result[(slice(None), *index)] = value
    return result


def same_bits(first: FloatArray, second: FloatArray) -> bool:
    """Whether two arrays are equal bit by bit; NaN equals NaN."""
    if first.shape != second.shape:
        return False
    bits = [np.where(np.isnan(a), np.nan, a).view(np.int64) for a in (first, second)]
    return bool(np.array_equal(*bits))


class Fences:
    """Arrays that start on a cache line, or some doubles after one, each between doubles that must not change."""

    _ROOM = 64
    _MARK = 1234.5

    def __init__(self) -> None:
        self._made: list[tuple[FloatArray, slice]] = []

    def array(self, shape: tuple[int, ...], offset: int = 0) -> FloatArray:
        size = math.prod(shape)
        around = np.full(size + 2 * self._ROOM + 16, self._MARK)
        start = self._ROOM + (-around.ctypes.data // 8) % 8 + offset
        within = slice(start, start + size)
        self._made.append((around, within))
        return around[within].reshape(shape)

    def aligned(
        self, shape: tuple[int, ...], *, zero: bool = False, boundary: int = 64
    ) -> FloatArray:
        """In place of :func:`echelon.compute.machine.kernel.aligned`; kernels only rely on whole cache lines."""
        assert boundary % 64 == 0
        found = self.array(shape)
        found[...] = 0 if zero else np.nan
        return found

    def check(self) -> None:
        for around, within in self._made:
            np.testing.assert_array_equal(around[: within.start], self._MARK)
            np.testing.assert_array_equal(around[within.stop :], self._MARK)
