"""Header: which robot, which logs, the verdict, and what is wrong, first things first."""

from __future__ import annotations

from typing import Any

from echelon.identification.result import Identification
from echelon.logs.finding import Severity

_CHOSEN = {
    "estimate": "the estimate of all base parameters",
    "essential": "the essential base parameters only",
    "physical": "the physically consistent fit",
}


def context(run: Identification) -> dict[str, Any]:
    """What the header shows."""
    findings = sorted(run.findings, key=lambda finding: finding.severity is not Severity.WARNING)
    warnings = sum(1 for finding in findings if finding.severity is Severity.WARNING)
    mechanism = run.base.mechanism
    unseen = [v.source for v in run.validations if v.role == "validation"]
    return {
        "robot": mechanism.name,
        "verdict": run.verdict,
        "logs": run.logs,
        "validated": unseen,
        "findings": findings,
        "warnings": warnings,
        "chosen": _CHOSEN.get(run.chosen, run.chosen),
        "method": run.estimate.method,
        "facts": [
            ("base parameters", run.base.rank),
            ("standard parameters", len(run.base.parameters)),
            ("outputs", len(mechanism.outputs)),
            ("rows", sum(run.estimate.rows)),
        ],
    }
