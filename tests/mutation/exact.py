"""Faults in the algebra."""

from mutation.fault import Fault

FIELD, NUMBERS, SERIES = "exact/field.py", "exact/numbers.py", "exact/series.py"
RATIONAL, EXPRESSIONS = "exact/rational.py", "exact/expressions.py"
LOOPS = "test_loops_truths.py::test_four_bar test_loops_truths.py::test_gough_stewart"

FAULTS = (
    Fault(FIELD, "(23 - candidate) % 24", "(17 - candidate) % 24", "primes without √3", "test_field.py"),
    Fault(FIELD, "pow(3, power, p))", "pow(2, power, p))", "√3 is √2", "test_field.py"),
    Fault(FIELD, "(1, self.root2, self.root3,", "(1, self.root3, self.root2,", "√2 is √3", "test_field.py"),
    Fault(FIELD, "bin(self.p - 2)", "bin(self.p - 3)", "inverses of large arrays", "test_field.py"),
    Fault(FIELD, "return (1 - square) * scale", "return (1 + square) * scale", "circle points", "test_field.py"),
    Fault(FIELD, "np.concatenate([((1 - square)", "np.concatenate([((1 + square)", "sphere points", "test_field.py"),
    Fault(FIELD, "s if count >= 0 else -s % self.p", "s", "negative multiples of angles", "test_field.py"),
    Fault(FIELD, "% p - a[1] * b[1]", "% p + a[1] * b[1]", "cosine of a sum", "test_field.py"),
    Fault(NUMBERS, "((1, 1), (2, 0), (1, 3), (2, 2))", "((1, 1), (2, 0), (1, 3), (3, 2))", "√2·√6", "test_numbers.py"),
    Fault(NUMBERS, "surd(0, -quarter, 0, quarter)", "surd(0, quarter, 0, -quarter)", "cos 75°", "test_numbers.py"),
    Fault(NUMBERS, "cosine_of_turn(k - 6)", "cosine_of_turn(k + 6)", "sines change sign", "test_numbers.py"),
    Fault(NUMBERS, "surd(a, -b, -c, d))", "surd(a, -b, -c, -d))", "inverse of a surd", "test_numbers.py"),
    Fault(
        "exact/polynomial.py",
        "rest.get(partner, 0) + 2",
        "rest.get(partner, 0) + 1",
        "sin² = 1 − cos",
        "test_polynomial.py::test_evaluation_on_the_circle_is_a_homomorphism",
    ),
    Fault(
        "exact/polynomial.py",
        "(m, -f) for m, f",
        "(m, f) for m, f",
        "sin² = 1 + cos²",
        "test_polynomial.py::test_evaluation_on_the_circle_is_a_homomorphism",
    ),
    Fault(
        RATIONAL,
        "+ other.numerator * self.denominator",
        "+ other.numerator * other.denominator",
        "sums of quotients",
        "test_rational.py",
    ),
    Fault(
        RATIONAL,
        "a * a - b * b * square",
        "a * a + b * b * square",
        "denominators with roots and sines",
        "test_rational.py::test_a_quotient_that_is_a_polynomial_becomes_one",
    ),
    Fault(
        RATIONAL,
        "scale = inverse(lead)",
        "scale = lead",
        "normalised denominators",
        "test_rational.py::test_lowest_terms_agree_with_sympy",
    ),
    Fault(
        "exact/elimination.py",
        "= -int(reduced[row, free])",
        "= int(reduced[row, free])",
        "signs of null vectors",
        "test_elimination.py test_linear_model.py",
    ),
    Fault(
        "exact/elimination.py",
        "if table[:, unknowns:, unknowns:].any():",
        "if table[:, unknowns:, :unknowns].any():",
        "surplus equations are not looked at",
        "test_elimination.py",
    ),
    Fault(SERIES, "error[..., 0] -= 2", "error[..., 0] -= 1", "1/series", LOOPS),
    Fault(SERIES, "np.arange(1, a.shape[-1])", "np.arange(0, a.shape[-1] - 1)", "d/dt of series", LOOPS),
    Fault(SERIES, "error[..., k, k, 0] += 2", "error[..., k, k, 0] += 1", "inverse matrices of series", LOOPS),
    Fault(
        SERIES, "(high * 65536 + middle) % p", "(high * 65536 - middle) % p", "products of matrices of series", LOOPS
    ),
    Fault(
        "exact/reconstruction.py",
        "(residue - value) * pow",
        "(value - residue) * pow",
        "Chinese remainders",
        "test_reconstruction.py",
    ),
    Fault(
        "exact/reconstruction.py",
        "height << _MARGIN_BITS > modulus",
        "height > modulus",
        "any fraction is believed",
        "test_reconstruction.py",
    ),
    Fault(EXPRESSIONS, "return -self.read(operand)", "return self.read(operand)", "unary minus", "test_expressions.py"),
    Fault(
        EXPRESSIONS,
        "<= _PIECE or depth or character",
        "<= _PIECE or character",
        "long sums are cut inside brackets",
        "test_expressions.py",
    ),
    Fault(EXPRESSIONS, "turns = coefficient", "turns = -coefficient", "angles in π turn back", "test_expressions.py"),
    Fault(
        "exact/factors.py",
        "total *= scale**exponent",
        "total *= scale",
        "constants of repeated factors",
        "test_factors.py",
    ),
    Fault(
        "exact/straight_line.py",
        "return ONE + MINUS_ONE - number",
        "return number",
        "−1/1",
        "test_straight_line.py test_zero_dimensional.py",
    ),
    Fault(
        "exact/normal_forms.py",
        "(self.table[touched] + change)",
        "(self.table[touched] - change)",
        "normal forms",
        "test_zero_dimensional.py",
    ),
)
