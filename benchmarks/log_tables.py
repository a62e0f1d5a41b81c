"""Tables of how well identified models predict logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import echelon as ec
from tabular import table

SUMMARY = ("robot", "unseen data", "rms, % of range", "R²", "rms", "beside")
"""Columns of the summary: the first four for all readers, then robot, rms and what stands beside."""


def figures(numbers: Sequence[float], digits: int = 3) -> str:
    """Numbers of all outputs in one cell."""
    return " · ".join(f"{x:.{digits}g}" for x in numbers)


def quality(numbers: Sequence[float]) -> str:
    """R² of all outputs in one cell."""
    return " · ".join(f"{x:.4f}" for x in numbers)


def column(scores: Sequence[Any], name: str) -> list[float]:
    """One figure of all outputs."""
    return [getattr(score, name) for score in scores]


def overall(scores: Sequence[Any]) -> float:
    """Root mean square over the rows of all outputs, which must have one unit."""
    rows, rms = np.array(column(scores, "rows")), np.array(column(scores, "rms"))
    return float(np.sqrt(rows @ rms**2 / rows.sum()))


def summary(
    name: str, unseen: str, scores: Sequence[Any], beside: str, *, unit: str = ""
) -> list[str]:
    """A row of the summary."""
    unit = unit or scores[0].unit
    rms, percent = figures(column(scores, "rms")), figures(column(scores, "percent"), 2)
    return [
        name,
        unseen,
        percent,
        quality(column(scores, "r2")),
        f"{rms} {unit}",
        beside,
    ]


def summary_tables(rows: Sequence[Sequence[str]]) -> list[str]:
    """The summary as two tables: how well outputs are predicted, and beside what."""
    first = table(SUMMARY[:4], [row[:4] for row in rows])
    second = table((SUMMARY[0], *SUMMARY[4:]), [[row[0], *row[4:]] for row in rows])
    return [first, second]


def outputs_table(validations: Sequence[Any]) -> str:
    """Every output on fitted and on unseen data, with the prior model where there is one."""
    blocks = []
    prior = any(v.prior_scores for v in validations)
    head = [
        "output",
        "data",
        "rms",
        "% of range",
        "R²",
        "bias",
        *(["rms of prior"] if prior else []),
    ]
    for k, score in enumerate(validations[0].scores):
        for v in validations:
            s = v.scores[k]
            cells = [
                score.output,
                "fitted"
                if v.role == "identification"
                else f"unseen ({Path(v.source).stem})",
            ]
            bias = s.bias if abs(s.bias) > 1e-6 * s.rms else 0.0
            cells += [
                f"{s.rms:.4g} {s.unit}",
                f"{s.percent:.2f}",
                f"{s.r2:.5f}",
                f"{bias:.2g}",
            ]
            blocks.append(
                cells
                + (
                    [f"{v.prior_scores[k].rms:.4g}"]
                    if v.prior_scores
                    else [None]
                    if prior
                    else []
                )
            )
    return table(head, blocks)


def values(result: ec.Identification) -> dict[str, float]:
    """Estimated base parameters by the names of their representatives."""
    return dict(
        zip(result.estimate.parameters, result.estimate.values.tolist(), strict=True)
    )


def interval(result: ec.Identification, name: str) -> str:
    """A value with its confidence interval."""
    low, high = result.estimate.interval()[result.estimate.parameters.index(name)]
    return f"{values(result)[name]:.3f} ({low:.3f} … {high:.3f})"
