"""The minimal task of the docs on stock arms: limits by Pinocchio's dynamics and Coal's distances, at dense times."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

import echelon as ec
from echelon.excite.excite import ExcitingTrajectory
from support.resampled_motions import resampled
from support.robot_files import robot_file

TASK = """
echelon: 1
name: arm
robot: {file}
excitation:
  collisions:
    obstacles: [{{name: table, plane: [0, 0, 1]}}]
"""
DISTANCES = 250  # Hz
ROUNDING = 1e-6  # m: the tolerance of Coal's distances


def designed(folder: Path, name: str, **changes: Any) -> ExcitingTrajectory:
    (folder / "task.yaml").write_text(TASK.format(file=robot_file(name)))
    return ec.exciting_trajectory(ec.load_setup(folder / "task.yaml"), **changes)


def check_motion(found: ExcitingTrajectory, model: Any) -> None:
    """Positions, speeds and torques of all joints against the limits of the file."""
    q, qd, qdd = (resampled(found, order, 1000) for order in range(3))
    dense = resampled(found, 0, 10_000)
    assert np.all(
        (dense >= model.lowerPositionLimit) & (dense <= model.upperPositionLimit)
    )
    assert np.all(
        np.abs(resampled(found, 1, 10_000)).max(axis=0) <= model.velocityLimit
    )
    data = model.createData()
    tau = np.array(
        [pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)]
    )
    assert np.all(np.abs(tau).max(axis=0) <= 0.9 * model.effortLimit)


def hulls(file: Path, model: Any) -> dict[int, list[tuple[Any, Any]]]:
    """Convex shapes and their places, by the joint that carries them."""
    packages = [str(parent) for parent in file.parents]
    geometry = pin.buildGeomFromUrdf(
        model, str(file), pin.GeometryType.COLLISION, package_dirs=packages
    )
    found: dict[int, list[tuple[Any, Any]]] = {}
    for one in geometry.geometryObjects:
        shape = one.geometry
        if isinstance(shape, coal.BVHModelBase):
            shape.buildConvexHull(True, "Qt")
            shape = shape.convex
        found.setdefault(one.parentJoint, []).append((shape, one.placement))
    return found


def check_distances(found: ExcitingTrajectory, file: Path, model: Any) -> int:
    """Every pair that is limited keeps its clearance, and no bound is above what is measured; returns their number."""
    shapes, data = hulls(file, model), model.createData()
    table = [(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0), pin.SE3.Identity())]
    request = coal.DistanceRequest(True)
    margins = [
        margin for margin in found.margins if margin.label.startswith("distance of ")
    ]
    smallest = np.full(len(margins), np.inf)

    def parts(name: str) -> list[tuple[Any, Any]]:
        if name == "table":
            return table
        joint = (
            0 if name == "world" else model.frames[model.getFrameId(name)].parentJoint
        )
        place = pin.SE3.Identity() if joint == 0 else data.oMi[joint]
        return [(shape, place * own) for shape, own in shapes[joint]]

    for q in resampled(found, 0, DISTANCES):
        pin.forwardKinematics(model, data, q)
        for k, margin in enumerate(margins):
            first, second = (
                parts(name)
                for name in margin.label.removeprefix("distance of ").split(" and ")
            )
            for a, at_a in first:
                for b, at_b in second:
                    places = [
                        coal.Transform3s(at.rotation, at.translation)
                        for at in (at_a, at_b)
                    ]
                    distance = coal.distance(
                        a, places[0], b, places[1], request, coal.DistanceResult()
                    )
                    smallest[k] = min(smallest[k], distance)
    for margin, distance in zip(margins, smallest, strict=True):
        assert distance >= margin.low - ROUNDING, margin.label
        assert distance >= margin.least - ROUNDING, margin.label
    return len(margins)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur3_robot", "ur5_robot", "ur10_robot", "xarm7"])
def test_the_minimal_task_gives_a_motion_that_others_find_safe(
    tmp_path: Path, name: str
) -> None:
    found = designed(tmp_path, name)
    file = robot_file(name)
    model = pin.buildModelFromUrdf(str(file))
    assert found.safe
    check_motion(found, model)
    assert check_distances(found, file, model) >= 15
    assert found.chance is not None
    assert found.conditioning.scaled_condition < found.chance.scaled_condition
    assert max(found.conditioning.std) < found.chance.worst_std


def test_meshes_that_cannot_be_read_are_refused_with_the_ways_out_or_replaced(
    tmp_path: Path,
) -> None:
    with pytest.raises(
        ec.InputError, match=r"base\.dae.*\(and 10 more\).*unreadable: boxes .* or none"
    ):
        designed(tmp_path, "kinova")
    boxes = {
        "obstacles": [{"name": "table", "plane": [0, 0, 1]}],
        "unreadable": "boxes",
    }
    found = designed(tmp_path, "kinova", collisions=boxes, starts=1, budget=0.5)
    assert found.safe
    assert any(
        text.startswith("boxes of the inertias")
        for text in (finding.text for finding in found.findings)
    )
    assert any(margin.label.startswith("distance of ") for margin in found.margins)


@pytest.mark.slow
def test_a_robot_file_and_a_task_of_it_have_the_same_parameters(tmp_path: Path) -> None:
    few = {
        "starts": 1,
        "budget": 0.2,
        "move": ["elbow_joint"],
        "collisions": {"self": False},
    }
    bare = ec.exciting_trajectory(ec.load_setup(robot_file("ur5_robot")), **few)
    assert (
        designed(tmp_path, "ur5_robot", **few).base.expressions == bare.base.expressions
    )
