"""Base models that several tests look at, derived once in each process; they are frozen."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import echelon as ec
from echelon.robot.mechanism import Mechanism
from support.paths import EXAMPLES


@cache
def base_of(robot: str | Callable[[], Mechanism], **options: Any) -> ec.BaseModel:
    """Base parameters of an example, by its path below ``examples`` without ``.yaml``, or of what a function builds."""
    if isinstance(robot, str):
        mechanism = ec.load(EXAMPLES / f"{robot}.yaml")
    else:
        mechanism = robot()
    return ec.base_parameters(mechanism, **options)
