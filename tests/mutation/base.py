"""Faults in base parameters and their certificate."""

from mutation.fault import Fault

CERTIFICATE, PRIMES, BALLS = (
    "base/certificate.py",
    "base/prime_checks.py",
    "base/ball_checks.py",
)
ORDER = "base/matrix.py"
CLAIMS = "claims/test_false_claims.py"

FAULTS = (
    Fault(
        "base/elimination.py",
        "return all((vanishes(x, bits) for x in left.flat))",
        "return True",
        "what holds at few poses is taken to hold at all",
        "base/test_real_states.py::test_relations_hold_in_other_rows",
    ),
    Fault(
        PRIMES,
        "if (actual.get(column, 0) - claimed.get(column, 0)) % p:",
        "if column in actual and (actual[column] - claimed.get(column, 0)) % p:",
        "a false claim about an invisible parameter",
        CLAIMS,
    ),
    Fault(
        PRIMES, "0, :self.sampler.regions]", "0, :1]", "one region is looked at", CLAIMS
    ),
    Fault(
        CERTIFICATE,
        "if minor.rank < self.matrix.rank:",
        "if minor.rank < 0:",
        "dependent parameters pass as base parameters",
        "base/test_certificate.py",
    ),
    Fault(
        CERTIFICATE,
        "if missed or minor is None:",
        "if minor is None:",
        "a column that no check reaches",
        "base/test_certificate.py::test_a_column_that_no_check_reaches_is_an_error",
    ),
    Fault(
        CERTIFICATE,
        "if stated.fractions_of_pi:",
        "if False:",
        "sums of fractions of pi",
        "base/test_stated_values.py::test_sums_of_fractions_of_pi_are_not_passed_over",
    ),
    Fault(
        BALLS,
        "if False in zero:",
        "if not zero:",
        "what is left of a column in ball arithmetic",
        "results/test_false_sets.py",
    ),
    Fault(
        BALLS,
        "return bool(difference < LARGEST_RELATIVE_ERROR * abs(found)) and (not difference > numbers.radius)",
        "return True",
        "rounded coefficients are the solved ones",
        "base/test_budget.py",
    ),
    Fault(
        PRIMES,
        "if rank(table, field) > matrix.rank:",
        "if rank(table, field) < 0:",
        "columns of numbers that are independent",
        "results/test_false_sets.py",
    ),
    Fault(
        CERTIFICATE,
        "if column != pivot and column in pivots:",
        "if column in () and column in pivots:",
        "a representative in another's row",
        "base/test_certificate.py",
    ),
    Fault(
        "algebra/exact/field.py",
        "total[pivot] + addend if pivot in total else addend",
        "addend",
        "sums in X̄ B",
        "base/test_certificate.py::test_right_sets_pass",
    ),
    Fault(
        ORDER,
        "inf if (body",
        "-inf if (body",
        "parameters of effects come first",
        "base/test_order.py",
    ),
    Fault(
        ORDER,
        "else -(factor * value)",
        "else factor * value",
        "exchange of pivots",
        "base/test_order.py",
    ),
    Fault(
        "base/matrix.py",
        "len(row) == 1",
        "len(row) <= 2",
        "identifiable alone",
        "base/test_base_model.py base/test_display.py",
    ),
    Fault(
        "base/lift.py",
        "prior + root @ correction",
        "prior + correction",
        "lift in another metric",
        "base/test_lift.py",
    ),
    Fault(
        "base/lift.py",
        "base_values - b @ prior",
        "base_values",
        "lift with a prior",
        "base/test_lift.py",
    ),
    Fault(
        "algebra/exact/polynomial.py",
        "[0 if generator.startswith('cos(') else 1]",
        "[1 if generator.startswith('cos(') else 0]",
        "cosines and sines of B",
        "exact/test_polynomial.py",
    ),
    Fault(
        "base/expression.py",
        "top = -top if sign < 0 else top",
        "top = top",
        "signs in printed forms",
        "base/test_display.py base/test_base_model.py",
    ),
    Fault(
        "base/derive.py",
        ".rank == structure.rank",
        ".rank >= 0",
        "general answers for special values",
        "base/test_stated_values.py::test_the_stated_zero_decides_and_is_named",
    ),
    Fault(
        "base/stated_values.py",
        "if self._enough(SymbolRelations(frozenset(fixed))):",
        "if not names:",
        "values that do not matter are fixed",
        "base/test_stated_values.py::test_the_stated_zero_decides_and_is_named",
    ),
)
