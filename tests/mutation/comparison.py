"""Faults in comparisons of two robots: geometry, inertial values, outputs and their bounds."""

from mutation.fault import Fault

INERTIAS, OUTPUTS = "comparison/inertias.py", "comparison/outputs.py"
GEOMETRY, BOUNDS = "base/kinematic_match.py", "algebra/program/intervals.py"
TESTS = "comparison/test_compare.py"

FAULTS = (
    Fault(
        INERTIAS,
        "self.standard[start:start + PER_BODY] = ours - theirs",
        "self.standard[start:start + PER_BODY] = ours + theirs",
        "the difference of two bodies",
        f"{TESTS}::test_formats_say_one_thing",
    ),
    Fault(
        INERTIAS,
        "place = back @ np.linalg.inv(self.pairs.moves[i])",
        "place = back",
        "a base that stands elsewhere",
        f"{TESTS}::test_a_base_placed_otherwise_moves_no_joint",
    ),
    Fault(
        OUTPUTS,
        "Fraction(1, 2)",
        "Fraction(1, 8)",
        "bounds of products of velocities",
        f"{TESTS}::test_no_state_exceeds_the_bounds_and_examples_are_attained",
    ),
    Fault(
        OUTPUTS,
        "return sizes @ self.box.acceleration",
        "return sizes @ self.box.velocity",
        "bounds of the acceleration part",
        f"{TESTS}::test_no_state_exceeds_the_bounds_and_examples_are_attained",
    ),
    Fault(
        GEOMETRY,
        "np.cross(place[:3, 3], directions)",
        "np.cross(directions, place[:3, 3])",
        "screws in another base frame",
        f"{TESTS}::test_a_base_placed_otherwise_moves_no_joint",
    ),
    Fault(
        BOUNDS,
        "1 if op is Op.ADD else -1",
        "1",
        "differences of waves",
        "program/test_intervals.py::test_turning_vectors_have_exact_bounds",
    ),
)
