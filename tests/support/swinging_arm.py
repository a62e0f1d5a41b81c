"""A URDF of two links that swing, and a log of it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import echelon as ec

Motion = dict[str, npt.NDArray[np.float64]]
ARM = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="0.15 0.01 0"/><mass value="2"/>
<inertia ixx="0.02" iyy="0.03" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="0.1 0 0.02"/><mass value="1"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder_joint" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="elbow_joint" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0.3 0 0"/>
<axis xyz="0 1 0"/></joint></robot>"""


def swinging(gravity: str = "file", wide: float = 1.0, fast: float = 1.0) -> Motion:
    """Time, positions, velocities and torques of the arm with its own inertias and some friction: 10 s at 300 Hz.

    Gravity may be another one than the file's, m/s² in the base frame, and swings be wider and faster by factors.
    """
    mechanism = ec.load_setup(ARM, gravity=gravity).mechanism
    base = ec.base_parameters(mechanism)
    t = np.arange(3000) / 300
    size = wide * np.array([[0.9, 0.4], [0.5, 0.7]])
    rate = fast * np.array([[2.1, 5.3], [3.4, 7.9]])
    phase = t[:, None, None] * rate
    q, qd, qdd = (
        (size * f).sum(axis=2)
        for f in (np.sin(phase), rate * np.cos(phase), -(rate**2) * np.sin(phase))
    )
    standard = [
        0.2 if value is None else value for value in mechanism.standard_values()
    ]
    noise = np.random.default_rng(1).normal(size=(2, *q.shape))
    tau = base.predict(q, qd, qdd, base.values(standard)) + 0.02 * noise[0]
    return {"t": t, "q": q + 1e-5 * noise[1], "qd": qd, "tau": tau}
