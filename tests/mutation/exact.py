"""Faults in the algebra."""

from mutation.fault import Fault

FIELD, NUMBERS, SERIES = "exact/field.py", "exact/polynomial.py", "exact/series.py"
RATIONAL, EXPRESSIONS = "exact/rational.py", "exact/expressions.py"
LOOPS = "regressor/test_loops_truths.py::test_four_bar regressor/test_loops_truths.py::test_gough_stewart"

FAULTS = (
    Fault(
        FIELD,
        "(23 - candidate) % 24",
        "(17 - candidate) % 24",
        "primes without √3",
        "exact/test_field.py::test_random_primes",
    ),
    Fault(
        FIELD, "pow(3, power, p))", "pow(2, power, p))", "√3 is √2", "exact/test_field.py::test_roots_and_conjugates"
    ),
    Fault(
        FIELD,
        "(1, self.root2, self.root3,",
        "(1, self.root3, self.root2,",
        "√2 is √3",
        "exact/test_field.py::test_embedding_is_a_homomorphism",
    ),
    Fault(
        FIELD,
        "inverse[:half] * right",
        "inverse[:half] * left",
        "inverses of large arrays",
        "exact/test_field.py::test_inverses_of_arrays",
    ),
    Fault(
        FIELD,
        "cosine, sine = (1 - square) * scale",
        "cosine, sine = (1 + square) * scale",
        "circle points",
        "exact/test_field.py::test_circle_is_the_half_angle_formula",
    ),
    Fault(
        FIELD,
        "np.concatenate([((1 - square)",
        "np.concatenate([((1 + square)",
        "sphere points",
        "exact/test_field.py::test_sphere",
    ),
    Fault(
        FIELD,
        "s if count >= 0 else -s % self.p",
        "s",
        "negative multiples of angles",
        "exact/test_field.py::test_multiple_angles_are_chebyshev_polynomials",
    ),
    Fault(
        FIELD,
        "% p - a[1] * b[1]",
        "% p + a[1] * b[1]",
        "cosine of a sum",
        "exact/test_field.py::test_multiple_angles_are_chebyshev_polynomials",
    ),
    Fault(
        NUMBERS,
        "((1, 1), (2, 0), (1, 3), (2, 2))",
        "((1, 1), (2, 0), (1, 3), (3, 2))",
        "√2·√6",
        "exact/test_numbers.py::test_field_axioms",
    ),
    Fault(
        NUMBERS,
        "surd(0, -quarter, 0, quarter)",
        "surd(0, quarter, 0, -quarter)",
        "cos 75°",
        "exact/test_numbers.py::test_turns_of_15_degrees",
    ),
    Fault(
        NUMBERS,
        "cosine_of_turn(k - 6)",
        "cosine_of_turn(k + 6)",
        "sines change sign",
        "exact/test_numbers.py::test_turns_of_15_degrees",
    ),
    Fault(
        NUMBERS,
        "surd(a, -b, -c, d))",
        "surd(a, -b, -c, -d))",
        "inverse of a surd",
        "exact/test_numbers.py::test_field_axioms",
    ),
    Fault(
        "exact/polynomial.py",
        "rest.get(partner, 0) + 2",
        "rest.get(partner, 0) + 1",
        "sin² = 1 − cos",
        "exact/test_polynomial.py::test_evaluation_on_the_circle_is_a_homomorphism",
    ),
    Fault(
        "exact/polynomial.py",
        "(m, -f) for m, f",
        "(m, f) for m, f",
        "sin² = 1 + cos²",
        "exact/test_polynomial.py::test_evaluation_on_the_circle_is_a_homomorphism",
    ),
    Fault(
        RATIONAL,
        "+ other.numerator * self.denominator",
        "+ other.numerator * other.denominator",
        "sums of quotients",
        "exact/test_rational.py::test_field_axioms",
    ),
    Fault(
        "exact/ring.py",
        "a * a - b * b * square",
        "a * a + b * b * square",
        "denominators with roots and sines",
        "exact/test_rational.py::test_a_quotient_that_is_a_polynomial_becomes_one",
    ),
    Fault(
        "exact/ring.py",
        "scale = inverse(lead)",
        "scale = lead",
        "normalised denominators",
        "exact/test_rational.py::test_lowest_terms_agree_with_sympy",
    ),
    Fault(
        "exact/field.py",
        "= field.p - value",
        "= value",
        "signs of null vectors",
        "exact/test_field.py::test_null_vectors",
    ),
    Fault(
        "exact/field.py",
        "if table[:, unknowns:, unknowns:].any():",
        "if table[:, unknowns:, :unknowns].any():",
        "surplus equations are not looked at",
        "exact/test_field.py::test_one_bad_system_spoils_the_batch",
    ),
    Fault(SERIES, "error[..., 0] -= 2", "error[..., 0] -= 1", "1/series", LOOPS),
    Fault(SERIES, "np.arange(1, a.shape[-1])", "np.arange(0, a.shape[-1] - 1)", "d/dt of series", LOOPS),
    Fault(SERIES, "error[..., k, k, 0] += 2", "error[..., k, k, 0] += 1", "inverse matrices of series", LOOPS),
    Fault(
        SERIES, "(high * 65536 + middle) % p", "(high * 65536 - middle) % p", "products of matrices of series", LOOPS
    ),
    Fault(
        "exact/interpolation.py",
        "(residue - value) * pow",
        "(value - residue) * pow",
        "Chinese remainders",
        "exact/test_interpolation.py::test_chinese_remainders_agree_with_sympy",
    ),
    Fault(
        "exact/interpolation.py",
        "height << _MARGIN_BITS > modulus",
        "height > modulus",
        "any fraction is believed",
        "exact/test_interpolation.py::test_noise_is_hardly_ever_believed",
    ),
    Fault(
        EXPRESSIONS,
        "return -self.read(operand)",
        "return self.read(operand)",
        "unary minus",
        "exact/test_expressions.py::test_meaning",
    ),
    Fault(
        EXPRESSIONS,
        "<= _PIECE or depth or character",
        "<= _PIECE or character",
        "long sums are cut inside brackets",
        "exact/test_expressions.py::test_a_long_sum_is_the_sum_of_its_terms",
    ),
    Fault(
        EXPRESSIONS,
        "turns = coefficient",
        "turns = -coefficient",
        "angles in π turn back",
        "exact/test_expressions.py::test_meaning",
    ),
    Fault(
        "exact/ring.py",
        "total *= scale**exponent",
        "total *= scale",
        "constants of repeated factors",
        "exact/test_rational.py",
    ),
    Fault(
        "program/zero_dimensional.py",
        "self._zeros.append(node)",
        "pass",
        "samples at which other numbers vanish",
        "program/test_zero_dimensional.py::test_special_samples_are_solved_by_themselves",
    ),
    Fault(
        "program/zero_dimensional.py",
        "(self._numbers.minus_one, known)",
        "(self._numbers.one, known)",
        "normal forms",
        "program/test_zero_dimensional.py::test_planted_solutions_are_found_and_all_are_solutions",
    ),
)
