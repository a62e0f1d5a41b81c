"""The names that stand in URDF files: those of the format, of its dialects with loops, and what vendors add to them."""

from __future__ import annotations

from echelon.formats.vocabulary import Element, Otherwise

LOOP_BESIDE = (
    "a YAML file beside it:  robot: {{file: {file}}}  and  loops: [{{joint: revolute, connects: [LINK_A, LINK_B], "
    "at: {{xyz: [0, 0, 0]}}, on_second: {{xyz: [0, 0, 0]}}, axis: z}}]"
)
"""Where a loop is stated, with the name of the URDF file to be filled in."""

_LOOP = f".  If it closes a loop, state that in {LOOP_BESIDE}"
_JOINT = (
    ".  State it as a <joint> of a type that URDF has, and its true type in a YAML file beside it: "
    "robot: {{file: {file}, joints: {{NAME: {{type: spherical}}}}}}"
)
_COUPLING = ".  Joints that follow others are stated with <mimic joint='LEADER' multiplier='RATIO'/>"
_XACRO = ".  It is xacro, whose namespace is missing: xmlns:xacro='http://www.ros.org/wiki/xacro'"

_ORIGIN = Element(attributes="xyz rpy")
_AXIS = Element(attributes="xyz", listed="@rpy")
_LINK_NAME = Element(attributes="link")
_END = Element({"origin": _ORIGIN}, "link", single="origin")
_VALUE = Element(attributes="value")
_NAME = Element(attributes="name")

_INERTIAL = Element(
    {
        "origin": _ORIGIN,
        "mass": Element(attributes="value", listed="@unit @units"),
        "inertia": Element(attributes="ixx ixy ixz iyy iyz izz", listed="@unit @units"),
    },
    single="origin mass inertia",
)

_LINK = Element(
    {"inertial": _INERTIAL},
    "name",
    harmless="visual collision",
    listed=(
        "contact contact_coefficients collision_checking self_collision_checking self_filter self_collide selfCollide "
        "surface origin gravity turnGravityOff kinematic velocity_decay enable_wind must_be_base_link sensor material "
        "color texture light projector battery audio_source audio_sink description comment drake:proximity_properties "
        "@type @class @concave @id @description"
    ),
    single="inertial",
)

_JOINT_ELEMENT = Element(
    {
        "parent": _LINK_NAME,
        "child": _LINK_NAME,
        "origin": _ORIGIN,
        "axis": _AXIS,
        "mimic": Element(attributes="joint multiplier offset"),
        "limit": Element(
            attributes="lower upper effort velocity acceleration deceleration jerk",
            harmless="@drake:acceleration",
            otherwise=Otherwise.LISTED,
        ),
        "dynamics": Element(
            attributes="damping friction armature", otherwise=Otherwise.LISTED
        ),
    },
    "name type independent",
    harmless="calibration safety_controller",
    listed=(
        "hardwareInterface hardware_interface sensor actuator motor drive isaac_drive_api physics spring_stiffness "
        "spring_reference stiffness damping friction provideFeedback disable_collisions home description comment "
        "gazebo joint_properties compliance feedback @id @class @description @actuated "
        "@dont_collapse @disableFixedJointLumping @preserveFixedJoint"
    ),
    single="parent child origin axis mimic limit dynamics",
    advice={
        "": ".  The elements of a joint are <parent>, <child>, <origin>, <axis>, <mimic>, <limit> and <dynamics>"
    },
)

_ACTUATOR = Element(
    listed="rotor_inertia motor_inertia drake:rotor_inertia drake:gear_ratio",
    otherwise=Otherwise.QUIET,
)
_PLUGIN = Element(listed="mimicJoint mimic_joint", otherwise=Otherwise.QUIET)

_GAZEBO_JOINT = Element(
    {
        "parent": Element(),
        "child": Element(),
        "pose": Element(attributes="relative_to"),
        "axis": Element(
            {"xyz": Element(advice={"": _LOOP})},
            harmless="limit dynamics",
            advice={"": _LOOP},
        ),
    },
    "name type",
    harmless="physics sensor",
    single="parent child pose axis",
    advice={"": _LOOP},
)

_GAZEBO = Element(
    {"joint": _GAZEBO_JOINT, "plugin": _PLUGIN},
    "reference",
    harmless=(
        "material sensor visual collision mu mu1 mu2 fdir1 kp kd minDepth min_depth maxVel maxContacts max_contacts "
        "selfCollide self_collide laserRetro genTexCoord transparency provideFeedback implicitSpringDamper stopKp "
        "stopKd stopCfm stopErp fudgeFactor cfmDamping initial_joint_position canonicalBody enable_wind "
        "preserveFixedJoint disableFixedJointLumping"
    ),
    otherwise=Otherwise.LISTED,
)

URDF = Element(
    {
        "link": _LINK,
        "joint": _JOINT_ELEMENT,
        "gravity": Element(attributes="xyz"),
        "loop": Element(
            {"predecessor": _END, "successor": _END, "axis": _AXIS},
            "name type",
            harmless="limit dynamics",
            single="predecessor successor axis",
            advice={"": _LOOP},
        ),
        "coupling": Element(
            {"predecessor": _LINK_NAME, "successor": _LINK_NAME, "ratio": _VALUE},
            "name",
            single="predecessor successor ratio",
            advice={"": _COUPLING},
        ),
        "loop_joint": Element(
            {
                "link1": Element(attributes="link xyz rpy"),
                "link2": Element(attributes="link xyz rpy"),
            },
            "name type",
            single="link1 link2",
            advice={"": _LOOP},
        ),
        "drake:ball_constraint": Element(
            {
                "drake:ball_constraint_body_A": _NAME,
                "drake:ball_constraint_body_B": _NAME,
                "drake:ball_constraint_p_AP": _VALUE,
                "drake:ball_constraint_p_BQ": _VALUE,
            },
            single=(
                "drake:ball_constraint_body_A drake:ball_constraint_body_B drake:ball_constraint_p_AP "
                "drake:ball_constraint_p_BQ"
            ),
            advice={"": _LOOP},
        ),
        "gazebo": _GAZEBO,
        "transmission": Element({"actuator": _ACTUATOR}, otherwise=Otherwise.QUIET),
    },
    "name",
    harmless="material sensor ros2_control frame fixed_frame drake:collision_filter_group @version",
    listed=(
        "origin static mujoco capability group group_state chain end_effector virtual_joint passive_joint "
        "disable_collisions disable_default_collisions collision_checking self_collision_checking self_filter "
        "safety_controller calibration sensors color texture contact camera light controller hardware actuator "
        "joint_limits joint_properties webots param parameters rosparam yarp author maintainer license description "
        "comment documentation metadata info website url version @author @date @license @description @file @id"
    ),
    advice={
        "": _LOOP,
        "drake:joint": _JOINT,
        "joint_constraint": _COUPLING,
        "xacro:include": _XACRO,
        "xacro:property": _XACRO,
        "xacro:macro": _XACRO,
        "xacro:arg": _XACRO,
    },
)
"""The vocabulary of <robot>."""
