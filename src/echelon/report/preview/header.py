"""Header: may this run?  The verdict on the limits, what else is wrong, and how well the parameters will be seen."""

from __future__ import annotations

from math import isfinite
from typing import Any

from echelon.excite.exciting_trajectory import ExcitingTrajectory
from echelon.excite.verify.margins import Margin
from echelon.logs.finding import Severity
from echelon.report.digits import significant

CRITERIA = {
    "d_optimal": "smallest confidence ellipsoid (D-optimal)",
    "a_optimal": "smallest sum of variances (A-optimal)",
    "condition": "smallest condition number",
}
"""The criteria in words."""


def context(found: ExcitingTrajectory) -> dict[str, Any]:
    """What the header shows."""
    shown, mechanism = found.conditioning, found.base.mechanism
    findings = sorted(found.findings, key=lambda finding: finding.severity is not Severity.WARNING)
    return {
        "robot": mechanism.name,
        "verdict": verdict(found.margins),
        "safe": found.safe and bool(found.margins),
        "broken": [margin for margin in found.margins if not margin.kept],
        "active": found.active,
        "limits": len(found.margins),
        "blind": not isfinite(shown.condition),
        "findings": findings,
        "warnings": sum(1 for finding in findings if finding.severity is Severity.WARNING),
        "criterion": CRITERIA.get(found.criterion, found.criterion),
        "held": [(name, significant(position)) for name, position in found.held.items()],
        "moving": found.trajectory.coordinates,
        "facts": [
            ("duration", significant(found.trajectory.duration), "s"),
            ("condition number", significant(shown.condition), ""),
            ("condition number, columns of norm 1", significant(shown.scaled_condition), ""),
            ("log det of the information", significant(shown.log_det), ""),
            ("base parameters", str(found.base.rank), ""),
        ],
    }


def verdict(margins: tuple[Margin, ...]) -> str:
    """Whether limits are kept, in words.

    >>> verdict((Margin("velocity of j1", "rad/s", -2.0, 2.0, -1.0, 1.5),))
    'Every limit is kept at every time.'
    >>> verdict((Margin("velocity of j1", "rad/s", -2.0, 2.0, -1.0, 2.5),))
    'Do not run this: 1 of 1 limits is broken.'
    """
    broken = sum(1 for margin in margins if not margin.kept)
    if not margins:
        return "No limit was checked."
    if not broken:
        return "Every limit is kept at every time."
    return f"Do not run this: {broken} of {len(margins)} limits {'is' if broken == 1 else 'are'} broken."
