"""Faults in programs: recording, rewriting, derivatives, evaluation."""

from mutation.fault import Fault

TAPE, SLOPES, BOUNDS = "program/tape.py", "program/derivatives.py", "program/intervals.py"
REWRITING, SCHEDULE = "program/rewriting.py", "program/schedule.py"

FAULTS = (
    Fault(
        TAPE,
        "return self.subtract(b, self.lhs[a])",
        "return self.subtract(self.lhs[a], b)",
        "−a + b",
        "test_tape.py::test_numbers_on_either_side",
    ),
    Fault(
        TAPE,
        "self.negate(self.add(self.lhs[a], b))",
        "self.add(self.lhs[a], b)",
        "−a − b",
        "test_tape.py::test_folding",
    ),
    Fault(
        TAPE,
        "self._intern(_SUB, self.rhs[a], self.lhs[a])",
        "self._intern(_SUB, self.lhs[a], self.rhs[a])",
        "−(a − b)",
        "test_tape.py::test_folding",
    ),
    Fault(
        TAPE,
        "if a > b and op in _COMMUTATIVE",
        "if a > b and op > 0",
        "a − b with b recorded first",
        "test_tape.py::test_recording_keeps_the_value",
    ),
    Fault(TAPE, "return value * sign", "return value", "|constant|", "test_tape.py"),
    Fault(
        SLOPES,
        "(b, -y * inverse)",
        "(b, y * inverse)",
        "derivatives of quotients",
        "test_derivatives.py::test_against_sympy",
    ),
    Fault(
        SLOPES, "return -x.sin()", "return x.sin()", "derivatives of cosines", "test_derivatives.py::test_against_sympy"
    ),
    Fault(
        SLOPES,
        "return 1 + y * y",
        "return 1 - y * y",
        "derivatives of tangents",
        "test_derivatives.py::test_against_sympy",
    ),
    Fault(
        SLOPES,
        "[(a, 2 * x)] if a == b",
        "[(a, x)] if a == b",
        "derivatives of squares",
        "test_derivatives.py::test_against_sympy",
    ),
    Fault(
        SLOPES,
        "Fraction(1, 2) / y",
        "Fraction(1, 2) / x",
        "derivatives of roots",
        "test_derivatives.py::test_against_sympy",
    ),
    Fault(
        BOUNDS,
        "a[0] - b[1], a[1] - b[0]",
        "a[0] - b[0], a[1] - b[1]",
        "bounds of differences",
        "test_intervals.py::test_enclosures_hold",
    ),
    Fault(
        BOUNDS,
        "low / (2 * np.pi) - 0.25, high / (2 * np.pi) - 0.25",
        "low / (2 * np.pi) + 0.25, high / (2 * np.pi) + 0.25",
        "extremes of sines",
        "test_intervals.py::test_waves_reach_their_extremes_between_the_ends",
    ),
    Fault(
        BOUNDS,
        "np.where((low <= 0) & (high >= 0), 0.0,",
        "np.where((low <= 0) & (high <= 0), 0.0,",
        "|x| across zero",
        "test_intervals.py::test_enclosures_hold",
    ),
    Fault(
        BOUNDS, "np.where(through, np.inf, high)", "high", "1/x across zero", "test_intervals.py::test_enclosures_hold"
    ),
    Fault(
        REWRITING,
        "(square - 1) / (square + 1)",
        "(square + 1) / (square - 1)",
        "tanh",
        "test_linear_model.py::test_friction",
    ),
    Fault(
        REWRITING,
        "copy.function(Op.SIGN, x) * x",
        "copy.function(Op.SIGN, x)",
        "|x| is its sign",
        "test_linear_model.py::test_friction",
    ),
    Fault(
        REWRITING,
        "1 / Fraction(width)",
        "Fraction(width)",
        "width within which dry friction turns",
        "test_state_limits.py::test_smoothed_torques_differ_near_standstill_only",
    ),
    Fault(
        "program/circular.py",
        "s * c_turn + c * s_turn",
        "s * c_turn - c * s_turn",
        "sines of turned angles",
        "test_sympy_bridge.py::test_there_and_back",
    ),
    Fault(
        "program/scalar.py",
        "return total if number >= 0 else 1 / total",
        "return total",
        "negative powers",
        "test_sympy_bridge.py::test_there_and_back",
    ),
    Fault(
        SCHEDULE,
        "a -= b",
        "a += b",
        "differences modulo p",
        "test_schedule.py::test_residues_are_those_of_the_exact_value",
    ),
    Fault(
        SCHEDULE,
        "-a % self.field.p",
        "a % self.field.p",
        "opposites modulo p",
        "test_schedule.py::test_residues_are_those_of_the_exact_value",
    ),
    Fault(
        "program/bounds.py",
        "max(a.degree + b.below, b.degree + a.below)",
        "max(a.degree, b.degree)",
        "degree that the certificate's bound rests on",
        "test_bounds.py",
    ),
    Fault(
        "program/bounds.py",
        "+ (power - b.power) * scale",
        "",
        "size of coefficients that the certificate's bound rests on",
        "test_bounds.py",
    ),
    Fault(
        "program/atoms.py",
        "laurent.append((name, -e))",
        "laurent.append((name, e))",
        "exp(x/c) is exp(c·x)",
        "test_linear_model.py::test_worked_examples",
    ),
)
