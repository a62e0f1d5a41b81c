"""Summary: how well every output is predicted, on data the fit saw and on data it did not, beside the prior model."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite
from typing import Any

from echelon.identification.result import Identification
from echelon.identification.validation.validation import Score, Validation

_SAME = 0.01  # relative difference of rms below which two models count as equal
_WHITE = 0.01  # probability below which a residual is called coloured


@dataclass(frozen=True)
class Row:
    """One output."""

    score: Score
    prior: Score | None
    against: str  # ``"better"``, ``"worse"``, ``"equal"``, or empty without a prior
    remarks: tuple[str, ...]  # what a reader should notice

    @property
    def explained(self) -> float:
        """R² as the length of a bar, 0 to 100."""
        return 100 * min(max(self.score.r2, 0.0), 1.0) if isfinite(self.score.r2) else 0.0


def context(run: Identification) -> dict[str, Any]:
    """What the summary shows."""
    # unseen data say more, so they come first
    order = sorted(run.validations, key=lambda v: v.role != "validation")
    tables = [(v, _rows(v)) for v in order]
    return {
        "tables": [
            {"validation": v, "rows": rows, "prior": bool(v.prior_scores), "remarks": any(r.remarks for r in rows)}
            for v, rows in tables
        ],
        "unseen": any(v.role == "validation" for v in run.validations),
    }


def _rows(validation: Validation) -> list[Row]:
    prior = {score.output: score for score in validation.prior_scores}
    return [_row(score, prior.get(score.output)) for score in validation.scores]


def _row(score: Score, prior: Score | None) -> Row:
    remarks = []
    if score.r2 < 0:
        remarks.append("a constant would predict better")
    if score.whiteness < _WHITE:
        remarks.append("residual is not white")
    against = ""
    if prior is not None and isfinite(prior.rms) and isfinite(score.rms):
        gain = score.rms - prior.rms
        against = "equal" if abs(gain) <= _SAME * prior.rms else "better" if gain < 0 else "worse"
    return Row(score, prior, against, tuple(remarks))
