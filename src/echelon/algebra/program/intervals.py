"""Interval arithmetic on programs: bounds of every output while inputs stay in intervals.

What a function reaches between two samples follows from where its inputs are between them, without derivatives and
without trust in the samples.  Bounds are widened by a relative 1e-14 at every operation, which covers rounding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.algebra.program.operations import Op
from echelon.algebra.program.tape import Program
from echelon.shared import Floats, InputError

Interval = tuple[Floats, Floats]  # least and largest values, of one shape

_ROUNDING = 1e-14
_SLACK = 1e-12  # turns: places of extremes and poles are known up to rounding
_TURN = Op.INPUT, Op.COS, Op.SIN
_LARGEST = np.finfo(float).max
_MONOTONIC = {Op.EXP: np.exp, Op.TANH: np.tanh, Op.ATAN: np.arctan, Op.SIGN: np.sign}


def interval_values(
    program: Program, outputs: Sequence[int], inputs: Mapping[int, Interval]
) -> list[Interval]:
    """Bounds of outputs.

    >>> program = Program()
    >>> x = program.input("x")
    >>> ((low, high),) = interval_values(program, [(x * x - x).node], {x.node: (np.array(0.0), np.array(1.0))})
    >>> float(low.round(3)), float(high.round(3))
    (-1.0, 1.0)
    """
    found: dict[int, Interval] = {}
    with np.errstate(all="ignore"):  # where there is no value, bounds are infinite
        for node in program.needed(outputs, inputs):
            op = Op(program.ops[node])
            if node in inputs:
                found[node] = inputs[node]
            elif op is Op.INPUT:
                raise InputError(
                    f"the range of '{program.inputs[node].name}' is missing"
                )
            elif op is Op.CONSTANT:
                value = np.asarray(float(program.constants[node]))
                found[node] = _widened(value, value)
            elif (turn := _turn_of(program, op, node)) is not None:
                parts = [_signed(found[turn[kind][0]], turn[kind][1]) for kind in _TURN]
                found[node] = _turned(*parts)
            else:
                found[node] = _operation(program, op, node, found)
    return [found[node] for node in outputs]


def _turn_of(program: Program, op: Op, node: int) -> dict[Op, tuple[int, int]] | None:
    """Factors a and b of a node a·cos(x) ± b·sin(x), and the angle x under INPUT, as nodes with signs."""
    if op not in (Op.ADD, Op.SUB):
        return None
    for x, kind, a in _waves_of(program, program.lhs[node]):
        for y, other, b in _waves_of(program, program.rhs[node]):
            if x == y and kind is not other:
                return {
                    kind: (a, 1),
                    other: (b, 1 if op is Op.ADD else -1),
                    Op.INPUT: (x, 1),
                }
    return None


def _waves_of(program: Program, node: int) -> Iterator[tuple[int, Op, int]]:
    """Angle, function and other factor of a product with sines or cosines."""
    if program.ops[node] == Op.MUL:
        a, b = program.lhs[node], program.rhs[node]
        for wave, factor in ((a, b), (b, a)):
            if program.ops[wave] in (Op.SIN, Op.COS):
                yield program.lhs[wave], Op(program.ops[wave]), factor


def _turned(x: Interval, a: Interval, b: Interval) -> Interval:
    """Bounds of a·cos(x) + b·sin(x), a coordinate of a vector that turns.

    At every x they are reached at an end of a and of b, where the sum is one wave.
    """
    ends = [_one_wave(x, p, q) for p in a for q in b]
    low = np.minimum(
        np.minimum(ends[0][0], ends[1][0]), np.minimum(ends[2][0], ends[3][0])
    )
    high = np.maximum(
        np.maximum(ends[0][1], ends[1][1]), np.maximum(ends[2][1], ends[3][1])
    )
    return low, high


def _signed(a: Interval, sign: int) -> Interval:
    return a if sign > 0 else (-a[1], -a[0])


def _one_wave(x: Interval, a: Floats, b: Floats) -> Interval:
    """Bounds of a·cos(x) + b·sin(x) for numbers a and b."""
    size, start = np.hypot(a, b), np.arctan2(b, a)
    low, high = x[0] - start, x[1] - start
    wave = _wave(np.cos(low), np.cos(high), low / (2 * np.pi), high / (2 * np.pi))
    slack = np.minimum(_ROUNDING * (1 + np.abs(x[0]) + np.abs(x[1])), 2.0)
    known = np.isfinite(size)
    least, largest = size * (wave[0] - slack), size * (wave[1] + slack)
    return np.where(known, least, -np.inf), np.where(known, largest, np.inf)


def _operation(
    program: Program, op: Op, node: int, found: Mapping[int, Interval]
) -> Interval:
    a = found[program.lhs[node]]
    if op is Op.NEG:
        return -a[1], -a[0]
    if op in (Op.ADD, Op.SUB, Op.MUL, Op.DIV):
        b = found[program.rhs[node]]
        if op is Op.ADD:
            return _widened(a[0] + b[0], a[1] + b[1])
        if op is Op.SUB:
            return _widened(a[0] - b[1], a[1] - b[0])
        if op is Op.DIV:
            return _product(a, _inverse(b))
        return _square(a) if program.lhs[node] == program.rhs[node] else _product(a, b)
    return _function(op, a)


def _function(op: Op, a: Interval) -> Interval:
    low, high = a
    if op in _MONOTONIC:
        return _widened(_MONOTONIC[op](low), _MONOTONIC[op](high))
    if op is Op.ABS:
        least = np.where(
            (low <= 0) & (high >= 0), 0.0, np.minimum(np.abs(low), np.abs(high))
        )
        return least, np.maximum(np.abs(low), np.abs(high))
    if op is Op.COS:
        return _wave(np.cos(low), np.cos(high), low / (2 * np.pi), high / (2 * np.pi))
    if op is Op.SIN:
        return _wave(
            np.sin(low),
            np.sin(high),
            low / (2 * np.pi) - 0.25,
            high / (2 * np.pi) - 0.25,
        )
    function, bad = _PARTIAL[op](low, high)
    least, largest = _widened(function(low), function(high))
    return np.where(bad, -np.inf, least), np.where(bad, np.inf, largest)


_PARTIAL: Mapping[Op, Callable[[Floats, Floats], tuple[Any, npt.NDArray[np.bool_]]]] = {
    Op.LOG: lambda low, _: (np.log, low <= 0),
    Op.SQRT: lambda low, _: (np.sqrt, low < 0),
    Op.TAN: lambda low, high: (
        np.tan,
        ~(np.floor(low / np.pi - 0.5 - _SLACK) == np.floor(high / np.pi - 0.5 + _SLACK))
        | ~np.isfinite(high - low),
    ),
}
"""Functions without a value somewhere, and whether they may meet such a place."""


def _wave(first: Floats, last: Floats, start: Floats, end: Floats) -> Interval:
    """Bounds of a cosine, given at the ends, over some turns: 1 at every whole turn, −1 at every half."""
    top = ~(np.floor(end + _SLACK) < np.ceil(start - _SLACK))
    bottom = ~(np.floor(end - 0.5 + _SLACK) < np.ceil(start - 0.5 - _SLACK))
    least = np.minimum(first, last) - _ROUNDING
    largest = np.maximum(first, last) + _ROUNDING
    return np.where(bottom, -1.0, np.maximum(least, -1.0)), np.where(
        top, 1.0, np.minimum(largest, 1.0)
    )


def _product(a: Interval, b: Interval) -> Interval:
    ends = [a[0] * b[0], a[0] * b[1], a[1] * b[0], a[1] * b[1]]
    low = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
    if np.isnan(low).any():  # 0 · ∞: the other products say what is unbounded
        ends = [np.where(np.isnan(end), 0.0, end) for end in ends]
        low = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
    return _widened(
        low, np.maximum(np.maximum(ends[0], ends[1]), np.maximum(ends[2], ends[3]))
    )


def _square(a: Interval) -> Interval:
    low, high = _function(Op.ABS, a)
    return _widened(low * low, high * high)


def _inverse(b: Interval) -> Interval:
    through = (b[0] <= 0) & (b[1] >= 0)
    low, high = _widened(1 / b[1], 1 / b[0])
    return np.where(through, -np.inf, low), np.where(through, np.inf, high)


def _widened(low: Floats, high: Floats) -> Interval:
    # what overflows is only known to be beyond the largest number
    low, high = np.minimum(low, _LARGEST), np.maximum(high, -_LARGEST)
    return low - _ROUNDING * np.abs(low), high + _ROUNDING * np.abs(high)
