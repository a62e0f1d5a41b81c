"""FIGAROH's calibration of an arm by poses of its flange; run by the interpreter of FIGAROH's own environment.

Reads a JSON document: placements of the joints, each 4 × 4, positions and poses of the rows of the fit and of those
held out.  Prints seconds, numbers of parameters, and root mean squares of held-out rows before and after.
"""

from __future__ import annotations

import contextlib
import csv
import io
import json
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import yaml
from figaroh.calibration.base_calibration import BaseCalibration
from figaroh.calibration.calibration_tools import calc_updated_fkm

WEIGHT = 0.3  # m: lever that weighs angles beside lengths, as in the reference


class PoseCalibration(BaseCalibration):
    """Residuals of poses, with angles weighed by a lever."""

    def cost_function(self, var):
        """Weighted residuals at some values of the parameters."""
        seen = calc_updated_fkm(
            self.model, self.data, var, self.q_measured, self.calib_config
        )
        left = self._compute_logmap_residuals(self.PEE_measured, seen)
        return self.apply_measurement_weighting(
            left, pos_weight=1.0, orient_weight=WEIGHT
        )


def arm(placements):
    """A chain of revolute joints about z."""
    model = pin.Model()
    for k, placement in enumerate(placements):
        model.addJoint(k, pin.JointModelRZ(), pin.SE3(np.array(placement)), f"q{k + 1}")
    last = len(placements)
    model.addFrame(
        pin.Frame("flange", last, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME)
    )
    return SimpleNamespace(
        model=model, data=model.createData(), q0=pin.neutral(model), name="arm"
    )


def write(path, q, poses):
    """A table in FIGAROH's form: x y z, roll pitch yaw, joints."""
    names = ["x1", "y1", "z1", "phix1", "phiy1", "phiz1"]
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(names + [f"q{k + 1}" for k in range(len(q[0]))])
        for one, pose in zip(q, np.array(poses), strict=True):
            angles = pin.rpy.matrixToRpy(pose[:3, :3])
            table.writerow([*pose[:3, 3], *angles, *one])


def settings(folder, count, method):
    """A configuration file: all parameters, chosen and estimated by one of FIGAROH's methods."""
    task = {
        "type": "kinematic_calibration",
        "kinematics": {"base_frame": "universe", "tool_frame": "flange"},
        "joints": {"active_joints": []},
        "measurements": {
            "markers": [{"measurable_dof": [True] * 6}],
            "poses": {"base_pose": None, "tool_pose": None},
        },
        "parameters": {
            "calibration_level": "full_params",
            "estimation": {"method": method},
        },
        "data": {"source_file": f"{folder}/fit.csv", "number_of_samples": count},
    }
    path = Path(folder) / "settings.yaml"
    robot = {"name": "arm"}
    path.write_text(yaml.safe_dump({"robot": robot, "tasks": {"calibration": task}}))
    return str(path)


def left(found, values, q, poses):
    """Root mean squares of what is left of positions, m, and rotations, rad."""
    config = {**found.calib_config, "NbSample": len(q)}
    seen = calc_updated_fkm(
        found.model, found.data, np.asarray(values), np.array(q), config
    )
    rows = np.asarray(seen).reshape(6, len(q)).T
    shifts, turns = [], []
    for one, pose in zip(rows, np.array(poses), strict=True):
        shifts.append(np.linalg.norm(one[:3] - pose[:3, 3]))
        turned = pin.rpy.rpyToMatrix(*one[3:]).T @ pose[:3, :3]
        turns.append(np.linalg.norm(pin.log3(turned)))
    return [float(np.sqrt(np.mean(np.square(some)))) for some in (shifts, turns)]


def main():
    """Calibrate once."""
    told = json.loads(Path(sys.argv[1]).read_text())
    with (
        tempfile.TemporaryDirectory() as folder,
        contextlib.redirect_stdout(io.StringIO()),
    ):
        write(f"{folder}/fit.csv", told["q"], told["poses"])
        started = perf_counter()
        found = PoseCalibration(
            arm(told["placements"]),
            settings(folder, len(told["q"]), told["method"]),
        )
        found.calib_config |= {"known_baseframe": False, "known_tipframe": False}
        found.initialize()
        found.solve(max_iterations=1, enable_logging=False)
        seconds = perf_counter() - started
        names = found.calib_config["param_name"]
        values = found.LM_result.x
        after = left(found, values, told["q_held"], told["poses_held"])
    print(json.dumps({"seconds": seconds, "parameters": len(names), "after": after}))


if __name__ == "__main__":
    main()
