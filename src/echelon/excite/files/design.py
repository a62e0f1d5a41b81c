"""A designed trajectory as JSON: the motion, what it shows, every margin, and what it takes to design it again."""

from __future__ import annotations

from dataclasses import asdict
from math import isfinite
from typing import Any

from echelon.excite.files.coefficients import trajectory_to_json
from echelon.excite.margins import Margin
from echelon.excite.result import ExcitingTrajectory


def design_to_json(found: ExcitingTrajectory) -> dict[str, Any]:
    """Everything about a designed or judged trajectory, JSON-able; it reads back as its trajectory.

    Parameters
    ----------
    found : ExcitingTrajectory
    """
    shown = found.shown
    names = [expression.name for expression in found.base.expressions]
    std = {name: _number(value) for name, value in zip(names, shown.std, strict=True)}
    conditions = {"plain": _number(shown.condition), "scaled": _number(shown.scaled_condition)}
    return trajectory_to_json(
        found.trajectory,
        safe=found.safe,
        criterion=found.criterion,
        condition_numbers=conditions,
        log_det=_number(shown.log_det),
        standard_deviations=std,
        scaled_condition_over_time=[[t, _number(c)] for t, c in shown.over_time],
        held=dict(found.held),
        margins=[_margin(margin) for margin in found.margins],
        starts=[
            {**asdict(start), "value": _number(start.value), "history": list(start.history)} for start in found.starts
        ],
        findings=[str(finding) for finding in found.findings],
        settings=dict(found.settings),
    )


def _margin(margin: Margin) -> dict[str, Any]:
    numbers = {key: _number(value) for key, value in asdict(margin).items() if isinstance(value, float)}
    size = {"margin": _number(margin.margin), "kept": margin.kept, "active": margin.active}
    return {"label": margin.label, "unit": margin.unit, **numbers, **size}


def _number(value: float) -> float | None:
    """A number, or nothing where it is not finite, which JSON cannot say."""
    return float(value) if isfinite(value) else None
