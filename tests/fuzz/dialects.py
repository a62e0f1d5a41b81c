"""What other programs write into robot files: loops and constraints of their own, loose XML, worlds, screws."""

from __future__ import annotations

from random import Random

_LINK = """<link name="{0}"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
</inertial></link>"""
_JOINT = """<joint name="{0}" type="continuous"><parent link="{1}"/><child link="{2}"/><origin xyz="{3}"/>
<axis xyz="0 0 1"/></joint>"""
_OPEN = "".join(
    (
        '<robot name="bar"{prefix}><link name="base"/>',
        *(_LINK.format(name) for name in ("crank", "coupler", "rocker")),
        _JOINT.format("j1", "base", "crank", "0 0 0"),
        _JOINT.format("j2", "crank", "coupler", "0 0.3 0"),
        _JOINT.format("j3", "base", "rocker", "0.7 0 0"),
        "{closing}</robot>",
    )
)
_CLOSINGS = (
    """<loop name="pin" type="revolute"><predecessor link="coupler"><origin xyz="0.6 0.2 0"/></predecessor>
<successor link="rocker"><origin xyz="-0.1 0.5 0"/></successor><axis xyz="0 0 1"/></loop>""",
    """<loop_joint name="pin" type="revolute"><link1 link="coupler" xyz="0.6 0.2 0"/>
<link2 link="rocker" xyz="-0.1 0.5 0"/></loop_joint>""",
    """<drake:ball_constraint>
<drake:ball_constraint_body_A name="coupler"/><drake:ball_constraint_body_B name="rocker"/>
<drake:ball_constraint_p_AP value="0.6 0.2 0"/><drake:ball_constraint_p_BQ value="-0.1 0.5 0"/>
</drake:ball_constraint>""",
    """<drake:joint name="pin" type="planar"><parent link="coupler"/><child link="rocker"/></drake:joint>""",
    """<gazebo><joint name="pin" type="revolute"><parent>coupler</parent><child>rocker</child>
<pose>-0.1 0.5 0 0 0 0</pose><axis><xyz>0 0 1</xyz></axis></joint></gazebo>""",
    """<transmission name="t"><joint name="j1"><mechanicalReduction>50</mechanicalReduction></joint></transmission>""",
    """<constraint type="loop"><predecessor link="coupler"/><successor link="rocker"/></constraint>""",
    "<!-- closed -- by hand --><!--- and so on --->",
    '<my:note text="1 -- 2"/>',
)
_PREFIXES = ("", "", ' xmlns:drake="http://drake.mit.edu"', ' drake:version="1"')

_MODEL = """<model name="{name}"><link name="base"/><link name="nut"><inertial><mass>2</mass></inertial></link>
<joint name="fix" type="fixed"><parent>world</parent><child>base</child></joint>
<joint name="j" type="{kind}"><parent>base</parent><child>nut</child>{more}<axis><xyz>0 0 1</xyz></axis>
</joint></model>"""
_KINDS = (
    ("screw", "<screw_thread_pitch>0.01</screw_thread_pitch>"),
    ("screw", "<thread_pitch>-600</thread_pitch>"),
    ("screw", ""),
    ("revolute", ""),
    ("prismatic", "<pose>0 0 0.1 0 0.3 0</pose>"),
    (
        "gearbox",
        "<gearbox_ratio>2</gearbox_ratio><gearbox_reference_body>base</gearbox_reference_body>",
    ),
    ("universal", "<axis2><xyz>1 0 0</xyz></axis2>"),
    ("ball", ""),
)
_MORE = (
    "",
    "",
    "<gripper name='g'><palm_link>nut</palm_link></gripper>",
    "<plugin name='p' filename='x'/>",
)


def urdf(rng: Random) -> str:
    """A four-bar whose loop stands in some dialect, or in several."""
    closing = "".join(rng.sample(_CLOSINGS, rng.choice((1, 1, 2))))
    return _OPEN.format(prefix=rng.choice(_PREFIXES), closing=closing)


def sdf(rng: Random) -> str:
    """A model, or a world of several, perhaps of one name."""
    models = []
    for name in rng.choice((("lift",), ("lift", "arm"), ("lift", "lift"), ())):
        kind, more = rng.choice(_KINDS)
        models.append(
            _MODEL.format(name=name, kind=kind, more=more).replace(
                "</model>", rng.choice(_MORE) + "</model>"
            )
        )
    inside = "".join(models)
    if rng.random() < 0.5:
        inside = f"<world name='w'><gravity>0 0 -9.8</gravity>{inside}</world>"
    return f"<sdf version='{rng.choice(('1.5', '1.7', '1.9', '1.11'))}'>{inside}</sdf>"
