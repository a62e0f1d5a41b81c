"""Links: a drawing of the robot that says how much the sensors can see of every body."""

from __future__ import annotations

from typing import Any

from echelon.conventions import PARAMETERS
from echelon.identification.result import Identification
from echelon.report.pose import drawable_pose
from echelon.report.seen import CLASSES, seen_bodies
from echelon.report.skeleton import drawing


def context(run: Identification) -> dict[str, Any]:
    """What the section on links shows."""
    mechanism = run.base.mechanism
    bodies = seen_bodies(run.base)
    pose = drawable_pose(mechanism)
    classes = list(run.base.classification.values())
    return {
        "bodies": bodies,
        "columns": PARAMETERS,
        "drawing": None if pose is None else drawing(mechanism, pose, bodies),
        "bent": pose is not None and pose.bent,
        "loops": bool(mechanism.closures),
        "counts": {name: classes.count(kind) for kind, name in CLASSES.items()},
    }
