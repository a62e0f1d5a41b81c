"""Texts of MJCF files."""

from __future__ import annotations

INERTIA = '<inertial pos="0.05 -0.02 0.11" mass="1.3" diaginertia="0.021 0.017 0.012"/>'


def mjcf(world: str, equality: str, motors: str = "") -> str:
    """An MJCF file; all bodies have some inertia, motors are on the named joints."""
    actuator = "".join(f'<motor joint="{name}"/>' for name in motors.split())
    return f"""<mujoco><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>{world}</worldbody>
<equality>{equality}</equality><actuator>{actuator}</actuator></mujoco>""".replace(
        "INERTIA", INERTIA
    )
