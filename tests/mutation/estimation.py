"""Faults in identification, exciting trajectories, and what is said, shown and saved of results."""

from mutation.fault import Fault

ESTIMATORS, ROBUST = "identification/test_estimators.py", "identification/test_estimators_robust.py"
PRIOR, VALIDATION = "identification/test_estimators_prior.py", "identification/test_validation.py"
FIT, PSEUDO = "identification/test_physics_fit.py", "identification/test_physics_pseudo_inertia.py"
GAINS, WEIGHT = "identification/test_gains.py", "identification/test_physics_weight.py"
CRITERIA, GRADIENTS = "excite/test_criteria.py", "excite/test_excite_gradients.py"
FAMILIES, MARGINS = "excite/test_families.py", "excite/test_margins.py"
EFFORTS, AUDIT = "excite/test_effort_model.py", "claims/test_audit.py claims/test_audit_reading.py"

FAULTS = (
    Fault(
        "identification/estimators/least_squares.py",
        "solution.triangle.residual**2 / solution.degrees",
        "solution.triangle.residual**2 / solution.triangle.rows",
        "noise of ordinary least squares",
        ESTIMATORS,
    ),
    Fault(
        "identification/estimators/least_squares.py",
        "residual**2 / degrees if relative",
        "residual**2 if relative",
        "common factor of noise",
        ESTIMATORS,
    ),
    Fault(
        "identification/estimators/huber.py", "- clip * sqrt(2 / pi)", "+ clip * sqrt(2 / pi)", "Huber's noise", ROBUST
    ),
    Fault(
        "identification/estimators/huber.py",
        "* (1.0 - share)",
        "* share",
        "Huber's correction",
        f"{ROBUST} identification/test_estimators_coverage.py",
    ),
    Fault(
        "identification/estimators/ridge.py",
        "self.rows * np.log(2 * np.pi * variance)",
        "np.log(2 * np.pi * variance)",
        "evidence",
        PRIOR,
    ),
    Fault("identification/estimators/ridge.py", "misfit / free", "misfit / self.rows", "noise beside a prior", PRIOR),
    Fault(
        "identification/estimators/covariance.py",
        "np.sqrt((count - 1) / count)",
        "np.sqrt(1 / count)",
        "jackknife",
        "identification/test_estimators_batches.py",
    ),
    Fault(
        "identification/physics/pseudo_inertia.py",
        "eigenvalues - np.log(eigenvalues) - 1",
        "eigenvalues - np.log(eigenvalues)",
        "divergence of equal bodies",
        PSEUDO,
    ),
    Fault(
        "identification/physics/interior.py",
        "corrected[column] = -value / row[column]",
        "corrected[column] = value / row[column]",
        "stated equalities",
        "identification/test_physics_bounds.py",
    ),
    Fault(
        "identification/physics/fit.py",
        "chosen = max(k for k",
        "chosen = min(k for k",
        "choice of the prior's weight",
        WEIGHT,
    ),
    Fault("identification/physics/fit.py", "+ r * variance", "+ variance", "misfit that a prior may add", WEIGHT),
    Fault(
        "identification/validation.py",
        "mine * self.bias + its * other.bias",
        "self.bias + other.bias",
        "bias of predictions",
        VALIDATION,
    ),
    Fault(
        "identification/validation.py",
        "+ mine * its * apart",
        "+ mine * apart",
        "spread over blocks",
        VALIDATION,
    ),
    Fault(
        "identification/correlation.py",
        "1 + 2 * np.cumsum(known)",
        "1 + np.cumsum(known)",
        "autocorrelation times",
        VALIDATION,
    ),
    Fault(
        "identification/conditioning.py",
        "relative[k] < WEAK or noisy[k]",
        "relative[k] < WEAK",
        "directions that noise hides",
        "identification/test_excitation.py",
    ),
    Fault(
        "identification/current_fit.py",
        "np.sqrt(max(part.rows - leverage, 1.0))",
        "max(part.rows - leverage, 1.0)",
        "noise of currents",
        GAINS,
    ),
    Fault("identification/gains.py", "if low < 0 < high)", "if low < 0 and high < 0)", "gains that are unclear", GAINS),
    Fault("excite/problem/information.py", "* (2 * weight)", "* weight", "derivative of the information", GRADIENTS),
    Fault(
        "excite/problem/information.py",
        "(vectors / values**2) @ vectors.T / trace",
        "(vectors / values) @ vectors.T / trace",
        "derivative of A-optimality",
        f"{CRITERIA} {GRADIENTS}",
    ),
    Fault(
        "excite/problem/trajectory.py", "order * np.pi / 2", "order * np.pi", "derivatives of Fourier series", FAMILIES
    ),
    Fault(
        "excite/problem/trajectory.py",
        "basis.values(ends, 1), basis.values(ends, 2)",
        "basis.values(ends, 1)",
        "acceleration at the ends",
        FAMILIES,
    ),
    Fault(
        "excite/problem/trajectory.py",
        "np.linalg.norm(pairs, axis=1)",
        "np.abs(pairs).max(axis=1)",
        "bounds of Fourier series",
        FAMILIES,
    ),
    Fault("excite/verify/margins.py", "h**2 / 2 *", "h**2 / 9 *", "Taylor's remainder", MARGINS),
    Fault(
        "excite/verify/margins.py",
        "(trajectory.duration / count) ** 2 / 8",
        "(trajectory.duration / count) ** 2 / 80",
        "between samples",
        MARGINS,
    ),
    Fault(
        "excite/problem/effort_limits.py",
        "mean - wide - most]",
        "mean - wide - least]",
        "lower ends of uncertain efforts",
        EFFORTS,
    ),
    Fault(
        "excite/problem/effort_limits.py",
        "* (1 - margin)",
        "* (1 + margin)",
        "what is kept free of efforts",
        f"{EFFORTS} excite/test_state_limits.py",
    ),
    Fault(
        "excite/problem/shapes.py",
        "size[0] + size[1] * np.abs(n[:, 2])",
        "size[0] + size[1] * n[:, 2]",
        "lower half of a capsule",
        "excite/test_collisions_room.py excite/test_collisions_certificate.py excite/test_collisions_distances.py",
    ),
    Fault("claims/compare.py", "max(_NOISE, 4 * tolerance)", "1.0", "rows that are independent", AUDIT),
    Fault(
        "claims/naming.py",
        "signed = value if sign > 0 else -value",
        "signed = value",
        "differences in claims",
        AUDIT,
    ),
    Fault(
        "claims/naming.py",
        "for _ in range(int(number))",
        "for _ in range(int(number) - 1)",
        "powers in claims",
        AUDIT,
    ),
    Fault(
        "claims/audit.py",
        "= -self.b[:, column]",
        "= self.b[:, column]",
        "witnesses",
        f"{AUDIT} claims/test_structure_claims.py",
    ),
    Fault(
        "results/saved.py",
        "if not all(row.values()):",
        "if not any(row.values()):",
        "coefficients of zero",
        "results/test_forgeries.py results/test_serialize.py",
    ),
    Fault("results/saved.py", "rel_tol=1e-9", "rel_tol=1e-1", "forged values", "results/test_forgeries.py"),
    Fault("results/saved.py", "or not same_text", "", "forged expressions", "results/test_forgeries.py"),
    Fault(
        "results/identified.py",
        "list(record.values) != list(base.pivots)",
        "len(record.values) != len(base.pivots)",
        "values of other parameters",
        "exact/test_hostile_numbers.py",
    ),
    Fault(
        "report/digits.py",
        "place = 1 - _exponent(std, 2)",
        "place = 0 - _exponent(std, 2)",
        "digits beside an uncertainty",
        "report/test_report_figures.py",
    ),
    Fault(
        "report/drawing.py",
        "min(1 + 3 * seen // carried, 3)",
        "min(3 * seen // carried, 3)",
        "thirds",
        "report/test_report_figures.py",
    ),
    Fault(
        "cli/checks.py",
        "VALID if found.equal else REFUTED",
        "VALID",
        "exit code of an audit",
        "claims/test_audit_reading.py",
    ),
    Fault(
        "cli/generate.py",
        "if len(found) < len(pairs):",
        "if len(found) > len(pairs):",
        "names that occur twice",
        "codegen/test_codegen_text.py",
    ),
    Fault(
        "cli/derive.py",
        "if found.literal_rank != rank",
        "if found.literal_rank == rank",
        "the literal rank",
        "base/test_numeric_comparison.py",
    ),
    Fault(
        "cli/process.py",
        "SystemExit(_SIGNALLED + number)",
        "SystemExit(number)",
        "exit code of an interruption",
        "cli/test_faults.py",
    ),
)
