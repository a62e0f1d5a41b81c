"""Faults in readers and writers of files."""

from mutation.fault import Fault

URDF, INERTIA, MJCF = (
    "formats/urdf/urdf_reader.py",
    "formats/literal.py",
    "formats/mjcf/mjcf_reader.py",
)
BUILD, JOINTS = "formats/builder.py", "formats/description/description_builder.py"

FAULTS = (
    Fault(
        URDF,
        "Triple = (1, 0, 0)",
        "Triple = (0, 0, 1)",
        "axes left out",
        "formats/test_urdf.py::test_default_axis_is_x",
    ),
    Fault(
        URDF,
        "'ixz', 'iyy'",
        "'iyy', 'ixz'",
        "products of inertia",
        "formats/test_urdf.py::test_fixed_links_are_lumped_or_kept",
    ),
    Fault(
        URDF,
        "'multiplier', '1'",
        "'multiplier', '-1'",
        "mimic without a multiplier",
        "formats/test_urdf.py",
    ),
    Fault(
        INERTIA,
        "cy * sp * sr - sy * cr",
        "cy * sp * sr + sy * cr",
        "rpy of inertials",
        "formats/test_mjcf.py::test_placements_reproduce_the_rotation",
    ),
    Fault(
        INERTIA,
        "- np.outer(p, h) - np.outer(h, p)",
        "- np.outer(p, h)",
        "inertia of merged links",
        "formats/test_urdf.py::test_fixed_links_are_lumped_or_kept",
    ),
    Fault(
        INERTIA,
        "turned + mass * (c @ c",
        "turned - mass * (c @ c",
        "parallel axes",
        "formats/test_urdf.py::test_fixed_links_are_lumped_or_kept",
    ),
    Fault(
        "robot/inertia.py",
        "2 * (x * y - w * z)",
        "2 * (x * y + w * z)",
        "quaternions",
        "formats/test_mjcf_dynamics.py::test_regressor_times_parameters_is_mujocos_inverse_dynamics",
    ),
    Fault(
        MJCF,
        "-self.reference[name])",
        "self.reference[name])",
        "reference positions",
        "formats/test_mjcf_dynamics.py::test_regressor_times_parameters_is_mujocos_inverse_dynamics",
    ),
    Fault(
        MJCF,
        "(-x, -y, -z))",
        "(x, y, z))",
        "anchors of joints",
        "formats/test_mjcf_dynamics.py::test_regressor_times_parameters_is_mujocos_inverse_dynamics",
    ),
    Fault(
        "formats/mjcf/mjcf_equality.py",
        "terms = {first: Spline((-_ONE,))}",
        "terms = {first: Spline((_ONE,))}",
        "direction of coupled joints",
        "formats/test_mjcf_dynamics.py::test_coupled_joints",
    ),
    Fault(
        "formats/literal.py",
        "offset, constant = (offset + value, Polynomial({}))",
        "offset, constant = (offset, Polynomial({}))",
        "offsets of mimics of mimics",
        "formats/test_urdf.py::test_mimics_follow_their_leader",
    ),
    Fault(
        "formats/builder.py",
        "numeric_placements(placements))",
        "numeric_placements(placements[:1]))",
        "inertials of links behind several fixed joints",
        "regressor/test_newton_euler.py::test_torques_equal_pinocchio",
    ),
    Fault(
        "formats/literal.py",
        "inner, constant = (dict(known[name].terms), known[name].offset)",
        "constant = known[name].offset",
        "couplings to coupled coordinates",
        "formats/test_description.py::test_examples",
    ),
    Fault(
        JOINTS,
        "(*motion, along_z @ along_x))",
        "(along_z @ along_x, *motion))",
        "standard DH read as modified",
        "formats/test_description_geometry.py::test_standard_rows_end_at_the_far_end",
    ),
    Fault(
        JOINTS,
        "enumerate((joint.axis, joint.axis2), 1)",
        "enumerate((joint.axis2, joint.axis), 1)",
        "axes of universal joints",
        "formats/test_description_geometry.py::test_joints_move_as_textbooks_say",
    ),
    Fault(
        "formats/literal.py",
        "Fraction(-981, 100)",
        "Fraction(-980, 100)",
        "gravity of URDF files",
        "regressor/test_newton_euler.py::test_torques_equal_pinocchio",
    ),
    Fault(
        "formats/writers/identified_values.py",
        "repr(float(value) + 0.0)",
        'f"{float(value):.6g}"',
        "digits of written files",
        "formats/test_write_robots.py::test_written_urdf_in_pinocchio_and_read_again",
    ),
    Fault(
        "formats/bodies.py",
        "difference > max(self._tolerance(",
        "difference > 0 * max(self._tolerance(",
        "relations between axes are not read",
        "formats/test_bodies.py::test_one_direction_in_several_spellings",
    ),
    Fault(
        "formats/bodies.py",
        "before @ turn(2, one) @ turn(0, twist) @ turn(2, two)",
        "before @ turn(2, two) @ turn(0, twist) @ turn(2, one)",
        "frames between related axes",
        "formats/test_bodies.py::test_the_geometry_stays_where_it_was",
    ),
)
