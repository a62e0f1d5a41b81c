"""Seconds that the first regressor of a robot takes: recorded, compiled or loaded, and evaluated at a few states.

python -m probes.first_use panda|talos [--running]
"""

from __future__ import annotations

import json
import sys
from time import perf_counter

import numpy as np

import echelon as ec
from robots import find_urdf, panda

STATES = 8


def main() -> None:
    name = sys.argv[1]
    if "--running" in sys.argv:  # another robot has started the compiler before
        _use(ec.base_parameters(ec.load(find_urdf("so100.urdf"))))
    arm = name == "panda"
    mechanism = (
        panda().exact()
        if arm
        else ec.load(find_urdf("talos_reduced.urdf"), floating=True)
    )
    base = ec.base_parameters(mechanism)
    start = perf_counter()
    _use(base)
    print(json.dumps({"seconds": perf_counter() - start}))


def _use(base: ec.BaseModel) -> None:
    rng = np.random.default_rng(1)
    q = rng.uniform(-1, 1, (STATES, len(base.mechanism.positions)))
    for motion in base.mechanism.motions:
        if len(motion.positions) > 1:  # a unit quaternion
            first = base.mechanism.positions.index(motion.positions[0])
            q[:, first : first + 4] /= np.linalg.norm(
                q[:, first : first + 4], axis=1, keepdims=True
            )
    qd, qdd = rng.uniform(-1, 1, (2, STATES, len(base.mechanism.velocities)))
    base.regressor(q, qd, qdd)


if __name__ == "__main__":
    main()
