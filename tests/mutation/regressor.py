"""Faults in the dynamics."""

from mutation.fault import Fault

SPATIAL, ENERGY = "robot/steps.py", "dynamics/linear_forms.py"
POWER, PROBES, BALLS = (
    "dynamics/linear_forms.py",
    "robot/steps.py",
    "loops/closed_balls.py",
)
AXES, JOINTS = "robot/joint.py", "mechanism/test_joints.py"
FRAMES = "dynamics/frame_motion.py"
CLOSED = "regressor/test_closed_balls.py::test_states_are_closed"
TRUTHS = "regressor/test_loops_truths.py::test_four_bar regressor/test_loops_truths.py::test_parallelogram"

FAULTS = (
    Fault(
        BALLS,
        "(-opening[rows, :, pose])",
        "(opening[rows, :, pose])",
        "velocities of dependent coordinates",
        CLOSED,
    ),
    Fault(
        BALLS,
        "self.times(result) + bias",
        "self.times(result) - bias",
        "accelerations of dependent coordinates",
        CLOSED,
    ),
    Fault(
        SPATIAL,
        "a[2] * b[0] - a[0] * b[2]",
        "a[0] * b[2] - a[2] * b[0]",
        "cross products",
        JOINTS,
    ),
    Fault(
        "robot/joint.py",
        "((a, d, g), (b, e, h), (c, f, i))",
        "((a, b, c), (d, e, f), (g, h, i))",
        "no transpose",
        JOINTS,
    ),
    Fault(
        FRAMES,
        "add(add(coriolis, coriolis), ",
        "add(coriolis, ",
        "half of Coriolis's acceleration",
        JOINTS,
    ),
    Fault(
        FRAMES,
        "cross(before, turning)",
        "cross(turning, before)",
        "gyroscopic acceleration",
        JOINTS,
    ),
    Fault(POWER, "(-gx, -gy, -gz)", "(gx, gy, gz)", "gravity upside down", JOINTS),
    Fault(
        POWER,
        "cross(unit, at.linear)",
        "cross(at.linear, unit)",
        "moment of a first moment",
        JOINTS,
    ),
    Fault(
        POWER,
        "cross(at.angular, momentum)",
        "cross(momentum, at.angular)",
        "ω × I ω",
        JOINTS,
    ),
    Fault(
        ENERGY,
        "lift = lift - dot",
        "lift = lift + dot",
        "height of a shifted frame",
        "regressor/test_linear_forms.py",
    ),
    Fault(
        ENERGY,
        "half + rates.lift",
        "half - rates.lift",
        "potential energy of masses",
        "regressor/test_linear_forms.py",
    ),
    Fault(
        ENERGY,
        "vw[k] - rates.gravity[k]",
        "vw[k] + rates.gravity[k]",
        "energy of first moments",
        "regressor/test_linear_forms.py",
    ),
    Fault(
        ENERGY,
        "cross(rates.linear, rates.angular)",
        "cross(rates.angular, rates.linear)",
        "v × ω",
        "regressor/test_linear_forms.py",
    ),
    Fault(
        "robot/steps.py",
        "sum((c.rate[0] * r for c, r in known), zero)",
        "sum((c.rate[0] for c, r in known), zero)",
        "speeds of motors",
        "mechanism/test_effects.py::test_effects_in_the_drive_act_through_the_transmission",
    ),
    Fault(
        SPATIAL,
        "return self.drives",
        "return self.freedoms",
        "which sensors see friction",
        "mechanism/test_effects.py::test_effects_in_the_drive_act_through_the_transmission",
    ),
    Fault(
        SPATIAL,
        "increase(measured, output.reads or output.name,",
        "increase(measured, output.name,",
        "the zero of a sensor in the row of a spring",
        "regressor/test_sensor_effects.py::test_the_row_of_an_elastic_drive_has_the_zero_of_the_sensor_that_it_reads",
    ),
    Fault(
        POWER,
        "+ dot(twist[1], wrench[1])",
        "- dot(twist[1], wrench[1])",
        "power of forces",
        JOINTS,
    ),
    Fault(
        "dynamics/linear_forms.py",
        "in enumerate(kept)}",
        "in enumerate(sorted(kept))}",
        "order of chosen columns",
        "base/test_closed_form.py::test_textbook_set_term_by_term",
    ),
    Fault(
        PROBES,
        "and cut.on_parent == on_parent",
        "",
        "side of a cut on which a sensor sits",
        "base/test_sensors.py::test_force_and_torque_sensors_agree_with_mujoco",
    ),
    Fault(
        PROBES,
        "cut.frame.inverse()",
        "cut.frame",
        "frames of sensors",
        "base/test_sensors.py::test_force_and_torque_sensors_agree_with_mujoco",
    ),
    Fault("robot/steps.py", "(xy + wz,", "(xy - wz,", "rotation of a ball", JOINTS),
    Fault(
        "robot/steps.py",
        "position.sin() * motion.sign)",
        "position.sin())",
        "sense of a hinge",
        JOINTS,
    ),
)
