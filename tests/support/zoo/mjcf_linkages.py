"""Linkages as MJCF files, closed by connects and welds."""

from __future__ import annotations

from support.zoo.case import Case
from support.zoo.mjcf_text import INERTIA, mjcf

BARS = """<body name="a"><joint name="a" axis="0 1 0"/>INERTIA
  <body name="b" pos="0.3 0 0.1"><joint name="b" axis="0 1 0"/>INERTIA</body></body>
<body name="c" pos="0.5 0 0"><joint name="c" axis="0 1 0"/>INERTIA</body>"""
RACK = '<body name="rack" pos="0 1 0"><joint name="rack" type="slide" axis="1 0 0"/>INERTIA</body>'
TENDON = '<tendon><fixed name="t"><joint joint="rack" coef="1"/><joint joint="a" coef="-0.1"/></fixed></tendon>'
PIN = '<connect body1="b" body2="c" anchor="0.2 0 0.15"/>'


def delta() -> str:
    """A Delta robot whose parallelograms are rods with pins; they hang straight down, so its arms are stuck."""
    arms, ends, pins = "", "", ""
    for k in range(3):
        rods, sites = "", ""
        for s, y in ((f"r{k}", 0.05), (f"l{k}", -0.05)):
            inner = f'<joint name="{s}" axis="1 0 0"/>INERTIA<site name="{s}" pos="0 0 -0.4"/>'
            rods += f'<body name="{s}" pos="0 {y} 0">{inner}</body>'
            sites += f'<site name="{s}end" pos="0.32 {y} 0"/>'
            pins += f'<connect site1="{s}" site2="{s}end"/>'
        bar = f'<body name="bar{k}" pos="0.2 0 0"><joint name="bar{k}" axis="0 1 0"/>INERTIA{rods}</body>'
        arm = f'<body name="arm{k}" pos="0.12 0 0"><joint name="arm{k}" axis="0 1 0"/>INERTIA{bar}</body>'
        arms += f'<body euler="0 0 {120 * k}">{arm}</body>'
        ends += f'<body euler="0 0 {120 * k}">{sites}</body>'
    return mjcf(
        f'{arms}<body name="top" pos="0 0 -0.4"><freejoint/>INERTIA{ends}</body>',
        pins,
        "arm0 arm1 arm2",
    )


def welded_chain() -> str:
    """Eight revolute joints with three oblique angles between two and the next."""
    axes = ("0 0 1", "0 1 0", "1 0 0", "0 0 1", "0 1 0", "1 0 0", "0 0 1", "0 1 0")
    bodies = "".join(
        f'<body name="l{k}" pos="0.1 {k / 20} 0.2" euler="{7 * k} {3 * k} 0"><joint name="l{k}" axis="{axis}"/>INERTIA'
        for k, axis in enumerate(axes)
    )
    return mjcf(bodies + "</body>" * len(axes), '<weld body1="l7"/>')


MJCF_LINKAGES = {
    "rod, connects at both ends": Case(
        3,
        17,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="thigh" pos="0 0 1"><joint name="hip" axis="0 1 0"/>
  INERTIA
  <body name="shank" pos="0 0 -0.4"><joint name="knee" axis="0 1 0"/>
    INERTIA
    <body name="foot" pos="0 0 -0.42"><joint name="ankle" axis="0 1 0"/>
      INERTIA</body></body></body>
<body name="rod" pos="0.05 0.02 0.9"><freejoint name="rod"/>
  INERTIA</body></worldbody><equality>
  <connect body1="rod" body2="thigh" anchor="0 0 0"/><connect body1="rod" body2="foot" anchor="0.03 0 -0.7"/>
  </equality><actuator><motor joint="hip"/><motor joint="knee"/></actuator></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "rod, welds": Case(
        1,
        8,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="a"><joint name="a" axis="0 1 0"/>
  INERTIA<body name="b" pos="0.3 0 0">
  <joint name="b" axis="0 1 0"/>INERTIA
<body name="c" pos="0.1 0 -0.35"><joint name="c" axis="0 1 0"/>
  INERTIA</body></body></body>
<body name="d" pos="0.1 0 -0.4"><joint name="d" axis="0 1 0"/>
  INERTIA</body></worldbody><equality>
  <weld body1="c" body2="d"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "four bar connect to world": Case(
        1,
        8,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="a"><joint name="a" axis="0 1 0"/>
  INERTIA<body name="b" pos="0.3 0 0.1">
  <joint name="b" axis="0 1 0"/>INERTIA
<body name="c" pos="0.1 0 -0.35"><joint name="c" axis="0 1 0"/>
  INERTIA</body></body></body></worldbody>
  <equality><connect body1="c" anchor="0.2 0 0.05"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "sarrus mjcf": Case(
        1,
        5,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="a1" pos="0.3 0 0"><joint name="a1" axis="0 1 0"/>
  INERTIA<body name="a2" pos="0.2 0 0.3">
  <joint name="a2" axis="0 1 0"/>INERTIA
<body name="top" pos="-0.2 0 0.3"><joint name="top" axis="0 1 0"/>
  INERTIA</body></body></body>
<body name="b1" pos="0 0.3 0"><joint name="b1" axis="1 0 0"/>
  INERTIA<body name="b2" pos="0 0.2 0.3">
  <joint name="b2" axis="1 0 0"/>INERTIA
  </body></body></worldbody><equality><connect body1="b2" body2="top" anchor="0.05 -0.2 0.3"/>
  <connect body1="b2" body2="top" anchor="-0.05 -0.2 0.3"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "door hung by two connects": Case(
        1,
        1,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
  <body name="door" pos="0.1 0.2 1"><freejoint name="door"/>
  INERTIA</body></worldbody><equality>
  <connect body1="door" anchor="0 0 0.5"/><connect body1="door" anchor="0 0 -0.5"/></equality></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "scissors mjcf": Case(
        1,
        5,
        """
<mujoco model="m"><compiler angle="degree"/><option gravity="0 0 -9.81"/><worldbody>
<body name="s1"><joint name="s1" axis="0 1 0"/>
  INERTIA</body>
<body name="foot" pos="0.4 0 0"><joint name="slide" type="slide" axis="1 0 0"/>
  INERTIA
 <body name="s2"><joint name="s2" axis="0 1 0"/>
   INERTIA</body></body>
<body name="top" pos="0 0 0.3"><joint name="up" type="slide" axis="0 0 1"/>
  INERTIA
 <body name="wheel" pos="0.4 0 0"><joint name="w" type="slide" axis="1 0 0"/>
   INERTIA</body></body></worldbody><equality>
   <connect body1="s1" body2="s2" anchor="0.2 0 0.15"/><connect body1="s1" body2="wheel" anchor="0.4 0 0.3"/>
   <connect body1="s2" body2="top" anchor="-0.4 0 0.3"/></equality><actuator><motor joint="up"/></actuator></mujoco>
""".replace("INERTIA", INERTIA),
    ),
    "four bar that moves a rack by a joint equality": Case(
        1,
        8,
        mjcf(
            BARS + RACK, PIN + '<joint joint1="a" joint2="rack" polycoef="0 10 0 0 0"/>'
        ),
    ),
    "four bar that moves a rack by a tendon": Case(
        1,
        8,
        mjcf(BARS + RACK, PIN + '<tendon tendon1="t"/>').replace(
            "<equality>", f"{TENDON}<equality>"
        ),
    ),
    "delta connect mjcf": Case(3, 37, delta(), slow=True),
    "chain with many angles, welded to the world mjcf": Case(
        2, 36, welded_chain(), slow=True
    ),
}
