"""Velocities and accelerations of frames, recorded step by step from the ground."""

from __future__ import annotations

from dataclasses import dataclass

from echelon.robot import (
    RecordedStep,
    Vec,
    VirtualMotion,
    add,
    cross,
    into_frame,
    scale,
)

Twist = tuple[Vec, Vec]
"""Angular velocity and linear velocity of the frame's origin, in the frame's axes."""


def moved(motion: VirtualMotion, twist: Twist, step: RecordedStep) -> Twist:
    """Virtual twist behind a step."""
    angular, linear = twist
    if step.shift is not None:
        linear = add(linear, cross(angular, step.shift))
    angular, linear = into_frame(step, angular), into_frame(step, linear)
    for freedom in step.freedoms:
        if freedom.name in motion.freedoms:
            angular = add(
                angular, scale(freedom.angular, motion.freedoms[freedom.name])
            )
            linear = add(linear, scale(freedom.linear, motion.freedoms[freedom.name]))
    return angular, linear


@dataclass(frozen=True)
class Accelerations:
    """Angular velocity, angular acceleration, and linear acceleration of the origin."""

    angular: Vec
    angular_rate: Vec
    linear: Vec  # minus gravity, where the ground has that acceleration


def accelerated(now: Accelerations, step: RecordedStep) -> Accelerations:
    """Accelerations behind a step."""
    linear = now.linear
    if step.shift is not None:
        swing = add(
            cross(now.angular_rate, step.shift),
            cross(now.angular, cross(now.angular, step.shift)),
        )
        linear = add(linear, swing)
    before = into_frame(step, now.angular)
    angular = before
    angular_rate = into_frame(step, now.angular_rate)
    linear = into_frame(step, linear)
    for freedom in step.freedoms:
        turning = scale(freedom.angular, freedom.rate)
        sliding = scale(freedom.linear, freedom.rate)
        angular = add(angular, turning)
        angular_rate = add(
            angular_rate,
            add(cross(before, turning), scale(freedom.angular, freedom.acceleration)),
        )
        coriolis = cross(before, sliding)
        linear = add(
            linear,
            add(add(coriolis, coriolis), scale(freedom.linear, freedom.acceleration)),
        )
    return Accelerations(angular, angular_rate, linear)
