"""FIGAROH's own search for an exciting trajectory: run by the interpreter of the environment that holds FIGAROH.

python -I probes/figaroh_trajectory.py URDF REACH SEED

Settings are those that FIGAROH has where its configuration says nothing: five waypoints two seconds apart, at rest in
each of them, 100 samples per second, at most 200 iterations of IPOPT with finite differences.  Only its margin, 5 % at
each end of every limit, is taken away.  Positions end at ±REACH, speeds are those of the URDF, and torques are free,
as for Echelon.  Without friction, rotors and offsets, which its configuration would add, and without collisions: the
model is read without shapes.

Prints one line of JSON: seconds, status of IPOPT, iterations, the columns of Pinocchio's regressor that it chose, and
the samples of its motion (none if it found no feasible one).
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
import pinocchio as pin
from figaroh.optimal.base_optimal_trajectory import (
    BaseOptimalTrajectory,
    BaseTrajectoryIPOPTProblem,
)
from pinocchio.robot_wrapper import RobotWrapper

STATUS = {0: "converged", 1: "acceptable", -1: "iteration limit"}
COMPONENTS = {"friction": False, "actuator_inertia": False, "joint_offset": False}


class _Problem(BaseTrajectoryIPOPTProblem):  # type: ignore[misc, unused-ignore]
    """Keeps what the solver says, which FIGAROH drops where it fails."""

    def solve_with_waypoints(self, wps: Any) -> Any:
        answer = super().solve_with_waypoints(wps)
        self.opt_traj.said = answer[1]
        return answer


class _Search(BaseOptimalTrajectory):  # type: ignore[misc, unused-ignore]
    """The class to derive from, as its documentation asks."""

    said: dict[str, Any]

    def create_ipopt_problem(self, *arguments: Any) -> _Problem:
        return _Problem(self, *arguments)


def limited(urdf: str, reach: float) -> RobotWrapper:
    """The robot with its limits."""
    model = pin.buildModelFromUrdf(urdf)
    model.lowerPositionLimit[:], model.upperPositionLimit[:] = -reach, reach
    model.effortLimit[:] = 1e9
    return RobotWrapper(model)


def search(robot: RobotWrapper, folder: Path) -> _Search:
    """FIGAROH's object, with its base parameters."""
    joints = list(robot.model.names)[1:]
    tasks = {
        "identification": {"problem": {"model_components": COMPONENTS}},
        "optimal_trajectory": {"problem": {"soft_lim": 0.0}},
    }
    settings = folder / "figaroh.yaml"
    properties = {"joints": {"active_joints": joints}}
    settings.write_text(
        json.dumps(
            {"robot": {"name": "robot", "properties": properties}, "tasks": tasks}
        )
    )
    made = _Search(robot, joints, str(settings))
    made.identif_config["act_idxv"] = list(
        range(robot.model.nv)
    )  # its examples set it in this way, too
    made.initialize()
    return made


def columns(made: _Search, count: int) -> list[int]:
    """Where the base columns stand among all."""
    return [
        int(column) for column in np.delete(np.arange(count), made.idx_e)[made.idx_b]
    ]


def measured(urdf: str, reach: float, seed: int) -> dict[str, Any]:
    """One search."""
    robot = limited(urdf, reach)
    np.random.seed(seed)  # the generator that FIGAROH draws from
    with TemporaryDirectory() as folder:
        begun = perf_counter()
        made = search(robot, Path(folder))
        found = made.solve(stack_reps=1)
        seconds = perf_counter() - begun
    states = [
        [np.asarray(part).tolist() for part in found[key]]
        for key in ("P_F", "V_F", "A_F")
    ]
    code = int(made.said["status"])
    counted = made.said["iteration_data"][
        "iterations"
    ]  # from 0 on, and again where it restores feasibility
    return {
        "seconds": seconds,
        "status": STATUS.get(code, f"IPOPT's code {code}"),
        "iterations": counted[-1],
        "columns": columns(made, 10 * robot.model.nv),
        "states": [part[0] for part in states] if states[0] else None,
    }


def main() -> None:
    line = os.dup(1)
    os.dup2(2, 1)  # IPOPT writes to the standard output
    answer = measured(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]))
    with os.fdopen(line, "w") as output:
        output.write(json.dumps(answer) + "\n")


if __name__ == "__main__":
    main()
