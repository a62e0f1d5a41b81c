"""Kinematics: where the frames of all bodies are in the base frame, and their derivatives by the positions."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, reduce

import numpy.typing as npt

from echelon.algebra import Function, Program, derivatives
from echelon.compute import Kernel
from echelon.dynamics.arguments import Arguments, geometry_values
from echelon.robot import (
    Mat,
    Mechanism,
    RecordedStep,
    Recorder,
    Vec,
    add,
    apply,
    forward,
    identity,
    product,
)
from echelon.shared import Floats

_ENTRIES = (
    12  # of a frame: its rotation's rows, each followed by a coordinate of its origin
)


class Kinematics:
    """Frames of the bodies of a mechanism, in machine code."""

    def __init__(
        self, mechanism: Mechanism, symbols: Mapping[str, float] | None = None
    ) -> None:
        self.mechanism = mechanism
        self._program = Program()
        self._nodes = [
            entry.node
            for rotation, shift in body_frames(Recorder(mechanism, self._program))
            for row, x in zip(rotation, shift, strict=True)
            for entry in (*row, x)
        ]
        self._arguments = Arguments(mechanism, self._program, {}).of(
            ("q", "symbols"), self._nodes
        )
        self._symbols = geometry_values(mechanism, self._arguments, symbols)

    def frames(self, q: npt.ArrayLike) -> Floats:
        """Frames of all bodies in the base frame, shape (N, bodies, 3, 4): axes as columns, and origin, m."""
        found = self._values({"q": q, **self._symbols})
        return found.reshape(len(found), -1, 3, 4)

    def slopes(self, q: npt.ArrayLike) -> Floats:
        """Derivatives of all frames by the positions, shape (N, bodies, 3, 4, positions)."""
        found = self._derivatives({"q": q, **self._symbols})
        return found.reshape(len(found), -1, 3, 4, len(self._arguments[0]))

    @cached_property
    def _values(self) -> Kernel:
        entries: dict[tuple[int, ...], int] = {
            (k,): node
            for k, node in enumerate(self._nodes)
            if node != self._program.zero.node
        }
        return Kernel(self._function("frames", entries, (self._labels,)))

    @cached_property
    def _derivatives(self) -> Kernel:
        found = derivatives(self._program, self._nodes, self._arguments[0].nodes)
        entries: dict[tuple[int, ...], int] = dict(found.items())
        return Kernel(
            self._function(
                "frame_slopes", entries, (self._labels, self._arguments[0].labels)
            )
        )

    @cached_property
    def _labels(self) -> tuple[str, ...]:
        return tuple(
            f"{body.name}[{k}]"
            for body in self.mechanism.bodies
            for k in range(_ENTRIES)
        )

    def _function(
        self,
        name: str,
        entries: Mapping[tuple[int, ...], int],
        axes: tuple[tuple[str, ...], ...],
    ) -> Function:
        return Function(name, self._program, self._arguments, entries, axes)


def body_frames(recorder: Recorder) -> list[tuple[Mat, Vec]]:
    """Record rotation and origin of every body's frame in the base frame."""
    base = identity(recorder.program), recorder.zeros
    frames = forward(
        recorder.mechanism,
        base,
        lambda frame, index: reduce(moved, recorder.steps(index), frame),
    )
    return [frames[index] for index in range(len(recorder.mechanism.bodies))]


def moved(frame: tuple[Mat, Vec], step: RecordedStep) -> tuple[Mat, Vec]:
    """A frame behind one more step."""
    rotation, shift = frame
    if step.shift is not None:
        shift = add(shift, apply(rotation, step.shift))
    return (
        rotation if step.rotation is None else product(rotation, step.rotation)
    ), shift
