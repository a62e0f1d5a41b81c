"""Physical consistency: pseudo-inertias, semidefinite fits, exact feasibility."""
