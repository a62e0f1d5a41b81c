"""The page about a calibration: how far off the robot was, and is; what was found, and what did not show."""

from __future__ import annotations

from math import degrees

import numpy as np

from echelon.calibration import Calibration
from echelon.report.page import Context, html_page, significant
from echelon.shared import Floats, one_line, public

TITLES = {
    "residuals": "Residuals before and after",
    "combinations": "Combinations of errors",
}
"""Sections below the header, in order."""
WIDTH, HEIGHT = 720.0, 220.0
"""Size of a picture, pixels."""


@public
def calibration_html(found: Calibration) -> str:
    """A page about a calibration, as one HTML file that loads nothing from anywhere.

    Parameters
    ----------
    found : Calibration

    Returns
    -------
    str
        To be written as UTF-8.

    Raises
    ------
    MissingExtraError
        If plotly is not installed.
    """
    contexts = {
        "header": _header(found),
        "residuals": {
            "pictures": [_picture(*item) for item in found.residuals.items()]
        },
        "combinations": _combinations(found),
    }
    return html_page(
        f"Calibration of {one_line(found.robot.mechanism.name)}",
        "calibration_",
        TITLES,
        contexts,
        {},
        styles=[],
        scripts=[],
        without_script="Sorting needs JavaScript, which is switched off.",
    )


def _header(found: Calibration) -> Context:
    scores = []
    for score in found.scores:
        unit, factor = ("mm", 1e3) if score.unit == "m" else ("°", degrees(1))
        values = (score.before, score.after, score.median)
        shown = [significant(value * factor, 3) for value in values]
        scores.append(
            {"name": score.name, "rows": score.rows, "unit": unit, "values": shown}
        )
    return {
        "robot": found.robot.mechanism.name,
        "scores": scores,
        "better": all(score.after <= score.before for score in found.scores),
        "outliers": found.outliers,
        "left_out": found.left_out,
        "hidden": found.hidden,
        "redundant": found.redundant,
        "rank": found.base.rank,
        "errors": len(found.base.parameters),
    }


def _picture(name: str, sizes: tuple[Floats, Floats]) -> Context:
    """Sizes of residuals against rows, as circles; before and after on one scale."""
    unit, factor = ("°", degrees(1)) if name.endswith("(rad)") else ("mm", 1e3)
    most = max(float(np.max(sizes, initial=0.0)), 1e-12)
    many = max(len(sizes[0]) - 1, 1)
    points = [
        [
            (WIDTH * k / many, HEIGHT * (1 - value / most))
            for k, value in enumerate(size.tolist())
        ]
        for size in sizes
    ]
    title = name.rpartition(" (")[0]
    return {
        "title": title,
        "unit": unit,
        "most": significant(most * factor, 3),
        "before": points[0],
        "after": points[1],
        "width": WIDTH,
        "height": HEIGHT,
    }


def _combinations(found: Calibration) -> Context:
    base = found.base
    rows = [
        {
            "form": str(base.readable[k]),
            "unit": unit,
            "value": value,
            "std": deviation,
            "hidden": pivot in found.hidden,
        }
        for k, (pivot, unit, value, deviation) in enumerate(
            zip(
                base.pivots,
                base.units,
                found.values.tolist(),
                found.deviations.tolist(),
                strict=True,
            )
        )
    ]
    return {
        "rows": rows,
        "unseen": found.unidentifiable,
        "certificate": str(base.certificate),
    }
