"""Faults in the description of mechanisms."""

from mutation.fault import Fault

JOINT, SUBSTITUTE = "robot/joint.py", "robot/substitute.py"
JOINTS = "mechanism/test_joints.py formats/test_description_geometry.py"

FAULTS = (
    Fault(
        JOINT,
        "Placement(back, (-x, -y, -z))",
        "Placement(back, (x, y, z))",
        "inverse placements",
        "mechanism/test_joints.py::test_a_placement_and_its_inverse",
    ),
    Fault(JOINT, "= (c, -s, s, c)", "= (c, s, -s, c)", "sense of turns", JOINTS),
    Fault(
        JOINT,
        "multiply(self.rotation, other.rotation)",
        "multiply(other.rotation, self.rotation)",
        "order of turns",
        JOINTS,
    ),
    Fault(
        JOINT,
        "merged.pop() @ step",
        "step @ merged.pop()",
        "order of fixed frames",
        JOINTS,
    ),
    Fault(
        JOINT, ".angle', normal)", ".angle', first)", "axis of a planar joint", JOINTS
    ),
    Fault(
        JOINT,
        "Motion(MotionKind.SCREW, name, axis, sign, pitch)",
        "Motion(MotionKind.SCREW, name, axis, 1, pitch)",
        "screws along negative axes",
        JOINTS,
    ),
    Fault(
        "algebra/exact/rational.py",
        "a - factor * b for",
        "a + factor * b for",
        "inverse of a transmission",
        "base/test_sensors.py::test_torques_follow_the_transmission",
    ),
    Fault(
        "robot/motor_side.py",
        "np.linalg.solve(matrix,",
        "np.linalg.solve(matrix.T,",
        "positions on the motor's side",
        "mechanism/test_motor_side.py",
    ),
    Fault(
        SUBSTITUTE,
        "return tuple((_mapped(part, put) for part in value))",
        "return value",
        "nested expressions at values of symbols",
        "mechanism/test_substitute.py",
    ),
    Fault(
        SUBSTITUTE,
        "'couplings', 'closures', ",
        "'couplings', ",
        "closures at values of symbols",
        "mechanism/test_substitute.py",
    ),
    Fault(
        "robot/locking.py",
        "moved_by(motion, as_polynomial(cosine), as_polynomial(sine)",
        "moved_by(motion, as_polynomial(cosine), as_polynomial(-sine)",
        "sense of held angles",
        "mechanism/test_lock_joints.py::test_remaining_joints_are_those_of_the_reduced_model",
    ),
    Fault(
        "robot/stated.py",
        "return Fraction(gcd(*(int(v * denominator) for v in present)), denominator)",
        "return Fraction(1, 10)",
        "the unit of decimal angles",
        "base/test_stated_values.py::test_all_decimals_are_multiples_of_one_unit",
    ),
)
