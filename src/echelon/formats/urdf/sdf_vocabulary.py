"""The names that stand in SDF files, by the specification, and what programs add to them."""

from __future__ import annotations

from echelon.formats.vocabulary import Element, Otherwise

_TEXT = Element()
_POSE = Element(attributes="relative_to degrees rotation_format")

_INERTIAL = Element(
    {
        "pose": _POSE,
        "mass": _TEXT,
        "inertia": Element(
            dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), _TEXT)
        ),
        # noted by the reader; densities matter to inertias that are left to collisions only
        "fluid_added_mass": Element(otherwise=Otherwise.QUIET),
        "density": _TEXT,
        "auto_inertia_params": Element(otherwise=Otherwise.QUIET),
    },
    "auto",
    single="pose mass inertia",
)

_LINK = Element(
    {"pose": _POSE, "inertial": _INERTIAL, "gravity": _TEXT},
    "name",
    harmless="visual collision sensor light projector audio_sink audio_source battery particle_emitter self_collide",
    listed="velocity_decay kinematic enable_wind must_be_base_link plugin frame wheel_slip",
    single="pose inertial gravity",
)

_AXIS = Element(
    {
        "xyz": Element(attributes="expressed_in"),
        "mimic": Element(
            dict.fromkeys(("multiplier", "offset", "reference"), _TEXT), "joint axis"
        ),
        "use_parent_model_frame": _TEXT,
        "limit": Element(otherwise=Otherwise.QUIET),
        "dynamics": Element(
            dict.fromkeys(("damping", "friction"), _TEXT),
            listed="spring_reference spring_stiffness",
            otherwise=Otherwise.LISTED,
        ),
        "initial_position": _TEXT,
    },
    single="xyz mimic limit dynamics",
)

_JOINT = Element(
    {
        "parent": _TEXT,
        "child": _TEXT,
        "pose": _POSE,
        "axis": _AXIS,
        "axis2": _AXIS,
        # of screws
        "thread_pitch": _TEXT,
        "screw_thread_pitch": _TEXT,
        # of gearboxes, which the reader refuses
        "gearbox_ratio": _TEXT,
        "gearbox_reference_body": _TEXT,
    },
    "name type",
    harmless="sensor",
    listed="physics plugin drake:controller_gains",
    single="parent child pose axis axis2 thread_pitch screw_thread_pitch",
)

MODEL_NAMES = Element(
    {
        "link": _LINK,
        "joint": _JOINT,
        "frame": Element({"pose": _POSE}, "name attached_to", single="pose"),
        "pose": _POSE,
        # the reader takes or refuses models within the model itself
        "model": Element(otherwise=Otherwise.QUIET),
        "include": Element(otherwise=Otherwise.QUIET),
    },
    "name canonical_link placement_frame",
    # grippers are settings of checks whether something is grasped
    harmless="static self_collide allow_auto_disable enable_wind gripper drake:collision_filter_group @version",
    listed="plugin joint_state link_state",
    single="pose",
    advice={
        "": ".  Joints that close loops, or connect a link with several others, are <joint> elements"
    },
)
"""The vocabulary of a <model> that moves."""

_WORLD = Element(
    {"gravity": _TEXT, "model": Element(otherwise=Otherwise.QUIET)},
    "name",
    harmless="light scene physics gui plugin audio magnetic_field atmosphere spherical_coordinates state road include",
    listed="wind actor population frame",
    advice={"": ".  Keep what belongs to the robot in its <model>"},
)

SDF = Element(
    {"world": _WORLD, "model": Element(otherwise=Otherwise.QUIET)},
    "version",
    harmless="light",
    listed="actor",
)
"""The vocabulary of <sdf>, without what stands in models."""
