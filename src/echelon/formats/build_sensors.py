"""The sensors of a literal tree as measured outputs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from functools import reduce
from operator import matmul

from echelon.exact.polynomial import Polynomial
from echelon.formats.intent import Intent, symbol_stem
from echelon.formats.literal import LiteralPlacement, LiteralSensor, LiteralWrench
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.output import Cut, JointForce, Output, plain
from echelon.mechanism.placement import Placement


def build_outputs(
    sensors: Collection[LiteralSensor],
    motions: Mapping[str, Motion],
    host: Callable[[int], tuple[int, tuple[LiteralPlacement, ...]]],
    intent: Intent,
    notes: list[str],
) -> Iterator[Output]:
    """Outputs of sensors."""
    for sensor in sensors:
        if isinstance(sensor, LiteralWrench):
            body, offset = host(sensor.link)
            placements = (intent.placement(p, symbol_stem(sensor.name)) for p in (*offset, *sensor.placements))
            frame = reduce(matmul, placements, Placement())
            letter, unit = ("t", "N·m") if sensor.angular else ("f", "N")
            for axis, word in enumerate("xyz"):
                cut = Cut(body, frame, on_parent=False, axis=axis, angular=sensor.angular)
                yield plain(f"{sensor.name}.{letter}{word}", unit, cut)
        elif sensor.joint in motions:
            unit = "N" if motions[sensor.joint].kind is MotionKind.TRANSLATION else "N·m"
            yield Output(sensor.name, unit, ((JointForce(sensor.joint), Polynomial.constant(sensor.weight)),))
        else:
            notes.append(f"{sensor.element} is left out: joint '{sensor.joint}' does not move freely")
