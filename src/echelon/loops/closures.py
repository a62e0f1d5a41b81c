"""Closure equations of a mechanism with loops, and their Jacobian.

A closure holds components of p and R, the origin and the axes of its second frame seen from the first, at fixed values.
The rate of such a component is the power of a unit wrench on the second body and of its opposite on the first: a unit
force along an axis at the frame's origin for p, a moment b × a for the product a · b of two axes.  So the Jacobian's
entries are generalised forces, and sensors, which are freedoms that never move, get theirs the same way.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from echelon.algebra import Program, Scalar
from echelon.robot import (
    Closure,
    Mat,
    Mechanism,
    Placement,
    Probes,
    RecordedStep,
    Recorder,
    Vec,
    add,
    apply,
    cross,
    dot,
    ends_of,
    identity,
    into_frame,
    product,
    transpose,
)

Wrench = tuple[Vec, Vec]
"""Moment and force."""


@dataclass(frozen=True)
class ClosureEquations:
    """Recorded closure equations."""

    program: Program
    equations: tuple[int, ...]  # nodes that vanish where the loops are closed
    # for an equation and a freedom (a velocity coordinate of the tree, or a sensor), the node of its derivative
    jacobian: Mapping[tuple[int, str], int]
    owners: tuple[str, ...]  # name of the closure of every equation
    is_length: tuple[
        bool, ...
    ]  # whether an equation is about a length, not about a direction
    # on the second body, what each equation stands for, about the first frame's origin, in its axes
    wrenches: tuple[Wrench, ...]


def record_closures(
    mechanism: Mechanism, recorder: Recorder, probes: Probes | None = None
) -> ClosureEquations:
    """Record the closure equations on a recorder's program."""
    equations: list[int] = []
    owners: list[str] = []
    is_length: list[bool] = []
    wrenches: list[Wrench] = []
    sums: dict[tuple[int, str], Scalar] = {}
    for closure in mechanism.closures:
        loop = _Loop(mechanism, recorder, probes, closure)
        is_length += [True] * len(closure.kind.positions) + [False] * len(
            closure.kind.directions
        )
        for value, (on_first, on_second) in loop.conditions():
            efforts = loop.efforts(on_first, on_second)
            for name, effort in _independent(recorder, efforts):
                key = (len(equations), name)
                sums[key] = sums[key] + effort if key in sums else effort
            equations.append(value.node)
            owners.append(closure.name)
            wrenches.append((_negative(on_first[0]), _negative(on_first[1])))
    jacobian = {key: value.node for key, value in sums.items() if not value.is_zero}
    return ClosureEquations(
        recorder.program,
        tuple(equations),
        jacobian,
        tuple(owners),
        tuple(is_length),
        tuple(wrenches),
    )


def _independent(
    recorder: Recorder, efforts: list[tuple[str, Scalar]]
) -> Iterator[tuple[str, Scalar]]:
    """Efforts at coordinates that no coupling makes dependent."""
    for name, effort in efforts:
        if name in recorder.slopes:
            for leader, slope in recorder.slopes[name].items():
                yield leader, effort * slope
        else:
            yield name, effort


class _Loop:
    """The two chains from the nearest common body to the frames that a closure holds together."""

    def __init__(
        self,
        mechanism: Mechanism,
        recorder: Recorder,
        probes: Probes | None,
        closure: Closure,
    ) -> None:
        self.recorder, self.closure = recorder, closure
        first, second = ends_of(mechanism, closure)
        self.first = _chain(recorder, probes, first[::-1], closure.first_frame)
        self.second = _chain(recorder, probes, second[::-1], closure.second_frame)

    def conditions(self) -> Iterator[tuple[Scalar, tuple[Wrench, Wrench]]]:
        """Every equation with its unit wrench: on the first body, and on the second, each in the axes of its frame."""
        zeros, units = self.recorder.zeros, identity(self.recorder.program)
        axes, origin = self._frame(self.first)
        other_axes, other_origin = self._frame(self.second)
        difference = add(other_origin, _negative(origin))
        positions = self.closure.kind.positions
        seen = _back(self.first, other_origin)
        for k in positions:
            direction, lever, value = units[k], zeros, difference[k]
            if len(positions) < len(
                units
            ):  # otherwise the axes of the common body serve, with fewer terms
                direction, value = apply(axes, units[k]), seen[k]
                lever = apply(transpose(axes), cross(difference, direction))
            on_first = (_negative(lever), _negative(apply(transpose(axes), direction)))
            on_second = (zeros, apply(transpose(other_axes), direction))
            yield value, (on_first, on_second)
        for i, j, target in self.closure.kind.directions:
            a, b = apply(axes, units[i]), apply(other_axes, units[j])
            moment = cross(b, a)
            on_first = (_negative(apply(transpose(axes), moment)), zeros)
            on_second = (apply(transpose(other_axes), moment), zeros)
            yield (
                dot(a, b) - self.recorder.program.constant(target),
                (on_first, on_second),
            )

    def efforts(self, on_first: Wrench, on_second: Wrench) -> list[tuple[str, Scalar]]:
        """The effort that wrenches need at each freedom."""
        return [
            *_carried_back(self.first, on_first),
            *_carried_back(self.second, on_second),
        ]

    def _frame(self, chain: list[RecordedStep]) -> tuple[Mat, Vec]:
        """Axes and origin at the end of a chain, in the frame where it begins."""
        axes, origin = identity(self.recorder.program), self.recorder.zeros
        for step in reversed(chain):
            if step.rotation is not None:
                axes = product(step.rotation, axes)
                origin = apply(step.rotation, origin)
            if step.shift is not None:
                origin = add(step.shift, origin)
        return axes, origin


def _chain(
    recorder: Recorder, probes: Probes | None, bodies: list[int], *frames: Placement
) -> list[RecordedStep]:
    steps: list[RecordedStep] = []
    for body in bodies:
        before, after = (
            (probes.steps(body, True), probes.steps(body, False))
            if probes
            else ([], [])
        )
        steps += [*before, *recorder.steps(body), *after]
    return [*steps, *(recorder.placement(frame) for frame in frames)]


def _back(chain: list[RecordedStep], point: Vec) -> Vec:
    """A point's coordinates at the end of a chain, from those where it begins; linear in every step."""
    for step in chain:
        if step.shift is not None:
            point = add(point, _negative(step.shift))
        point = into_frame(step, point)
    return point


def _carried_back(
    chain: list[RecordedStep], wrench: Wrench
) -> Iterator[tuple[str, Scalar]]:
    """Generalised force at every freedom of a chain whose end carries a wrench."""
    moment, force = wrench
    for step in reversed(chain):
        for freedom in step.freedoms:
            yield (
                freedom.name,
                dot(freedom.angular, moment) + dot(freedom.linear, force),
            )
        if step.rotation is not None:
            moment, force = apply(step.rotation, moment), apply(step.rotation, force)
        if step.shift is not None:
            moment = add(moment, cross(step.shift, force))


def _negative(v: Vec) -> Vec:
    return (-v[0], -v[1], -v[2])
