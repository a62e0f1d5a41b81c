"""Legs with rods that close loops, and a biped on two of them, as MJCF files."""

from __future__ import annotations

from support.zoo.case import Case
from support.zoo.mjcf_text import mjcf


def leg(side: str, y: float) -> str:
    """A biped's leg of the kind of Cassie's: one rod closes a loop over knee and heel, one moves the foot.

    The ends of the rods are to be held together by :func:`leg_loops`.
    """
    return f"""
<body name="roll-{side}" pos="0.021 {y} 0"><joint name="roll-{side}" axis="1 0 0"/>INERTIA
 <body name="yaw-{side}" pos="-0.07 0 0"><joint name="yaw-{side}" axis="0 0 1"/>INERTIA
  <body name="pitch-{side}" pos="0 0 -0.09"><joint name="pitch-{side}" axis="0 1 0"/>INERTIA
   <body name="achilles-{side}" pos="0.02 0.04 0.03"><joint name="achilles-{side}" type="ball"/>INERTIA</body>
   <body name="knee-{side}" pos="0.12 0 -0.02"><joint name="knee-{side}" axis="0 1 0"/>INERTIA
    <body name="shin-{side}" pos="0.0607 0 -0.0474"><joint name="shin-{side}" axis="0 1 0"/>INERTIA
     <body name="tarsus-{side}" pos="0.4348 0 -0.02"><joint name="tarsus-{side}" axis="0 1 0"/>INERTIA
      <body name="heel-{side}" pos="-0.01269 0 -0.03059"><joint name="heel-{side}" axis="0 1 0"/>INERTIA</body>
      <body name="crank-{side}" pos="0.058 0 -0.034"><joint name="crank-{side}" axis="0 1 0"/>INERTIA
       <body name="rod-{side}" pos="0.055 0 0"><joint name="rod-{side}" axis="0 1 0"/>INERTIA</body></body>
      <body name="foot-{side}" pos="0.408 0 -0.04"><joint name="foot-{side}" axis="0 1 0"/>INERTIA</body>
     </body></body></body></body></body></body>"""


def leg_loops(side: str) -> str:
    return f"""<connect body1="achilles-{side}" body2="heel-{side}" anchor="0.5012 0 -0.1"/>
      <connect body1="rod-{side}" body2="foot-{side}" anchor="0.35 0 0.02"/>"""


def biped(base: str) -> str:
    """A pelvis with two such legs."""
    pelvis = f'<body name="pelvis" pos="0 0 1">{base}INERTIA{leg("left", 0.135)}{leg("right", -0.135)}</body>'
    motors = " ".join(
        f"{joint}-{s}"
        for s in ("left", "right")
        for joint in ("roll", "yaw", "pitch", "knee", "crank")
    )
    return mjcf(pelvis, leg_loops("left") + leg_loops("right"), motors)


LEGS = {
    "leg mjcf": Case(8, 71, mjcf(leg("left", 0.135), leg_loops("left"))),
    "biped mjcf": Case(22, 160, biped('<freejoint name="pelvis"/>'), slow=True),
    "biped on a stand mjcf": Case(16, 142, biped("")),
}
