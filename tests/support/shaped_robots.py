"""Robots with shapes, and their motions, of the tests of clearances."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from echelon.algebra.exact.expressions import parse
from echelon.excite.problem.robot_shapes import entry_shapes
from echelon.excite.problem.shapes import Shape
from echelon.excite.problem.trajectory import (
    Basis,
    Fourier,
    Trajectory,
    uniform_splines,
)
from echelon.robot.joint import rotation, screw, translation
from echelon.robot.mechanism import Mechanism
from support.textbook_arms import body, place, tree

Floats = npt.NDArray[np.float64]

ARM = """<mujoco><compiler angle="radian"/><worldbody>
<geom name="floor" type="plane" size="1 1 1" pos="0 0 -0.4" euler="0.1 0 0"/>
<geom name="seen" type="sphere" size="0.5" contype="0" conaffinity="0"/>
<body name="a"><joint name="a" axis="0 0 1"/><geom name="ga" type="capsule" size="0.05" fromto="0 0 0 0.3 0 0"/>
<body name="b" pos="0.3 0 0.02"><joint name="b" axis="0 1 0"/><geom name="gb" type="box" size="0.1 0.04 0.03"
 pos="0.2 0 0" euler="0.2 0.1 0.3"/>
<body name="tool" pos="0.3 0 0" euler="0 0.4 0.3"><geom name="gt" type="cylinder" size="0.03 0.06" pos="0 0 0.02"/>
<body pos="0.1 0 0"><joint name="c" type="slide" axis="1 1 0"/><geom name="gc" type="ellipsoid" size="0.05 0.07 0.03"/>
<body name="d" pos="0.05 0 0.1"><joint name="d" axis="1 0 1" pos="0.02 0 0"/><geom name="gd" size="0.04"/>
<geom name="gm" type="mesh" mesh="m" pos="0.05 0 0.1"/></body></body></body></body></body>
</worldbody>
<asset><mesh name="m" vertex="0 0 0 0.1 0 0 0 0.2 0 0 0 0.15 0.1 0.2 0.1"/></asset>
<contact><exclude body1="a" body2="d"/></contact></mujoco>"""


def planar(links: int = 3) -> Mechanism:
    """Links of length 1 in a plane."""
    return tree(
        "planar",
        *(
            body(
                k,
                k - 1,
                "revolute",
                place("1 0 0" if k > 1 else "0 0 0"),
                rotation(f"q{k}"),
            )
            for k in range(1, links + 1)
        ),
    )


def spheres(mechanism: Mechanism, radius: float = 0.1) -> tuple[Shape, ...]:
    world = {"body": "world", "sphere": radius, "name": "stone"}
    return entry_shapes(
        mechanism,
        [world, *({"body": b.name, "sphere": radius} for b in mechanism.bodies)],
    )


def random_arm(seed: int) -> tuple[Mechanism, tuple[Shape, ...]]:
    """A branched tree of revolute, prismatic and screw joints, one of them coupled, with shapes and obstacles."""
    rng = np.random.default_rng(seed)
    bodies, entries = [], []
    for k in range(1, 6):
        xyz, rpy = (
            " ".join(f"{v:.3f}" for v in rng.uniform(-s, s, 3)) for s in (0.3, 0.0)
        )
        joint = [
            rotation(f"q{k}", int(rng.integers(3))),
            translation(f"q{k}", int(rng.integers(3))),
        ]
        joint += [screw(f"q{k}", parse("0.05"), int(rng.integers(3)))]
        kind = int(rng.choice(3, p=[0.6, 0.2, 0.2]))
        parent = k - 1 if k < 5 else 2
        bodies.append(
            body(
                k,
                parent,
                ("revolute", "prismatic", "screw")[kind],
                place(xyz, rpy),
                joint[kind],
            )
        )
        at = rng.uniform(-0.1, 0.1, 3).tolist()
        shape = [{"sphere": 0.08, "at": at}, {"box": [0.1, 0.2, 0.16], "at": at}]
        shape += [
            {"capsule": 0.05, "from": at, "to": [0.1, 0.1, 0.2]},
            {"cylinder": 0.05, "from": at, "to": [0, 0, 0.3]},
        ]
        entries.append({"body": f"link{k}", **shape[int(rng.integers(4))]})
    entries.append({"body": "world", "plane": [0, 0.2, 1], "through": [0, 0, -0.6]})
    entries.append(
        {"body": "world", "sphere": 0.2, "at": rng.uniform(-0.8, 0.8, 3).tolist()}
    )
    mechanism = tree(
        f"random{seed}", *bodies, couplings={"q3": {"q1": "-0.5", "q2": "0.3"}}
    )
    return mechanism, entry_shapes(mechanism, entries)


def motion(mechanism: Mechanism, seed: int, size: float = 1.0) -> Trajectory:
    rng, n = np.random.default_rng(seed), len(mechanism.positions)
    basis: Basis = Fourier(4.0, 4) if seed % 2 else uniform_splines(4.0, 12)
    return Trajectory(
        mechanism.positions,
        ("rad",) * n,
        basis,
        size * rng.normal(size=(basis.size, n)),
    )
