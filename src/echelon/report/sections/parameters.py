"""Parameters: every base parameter in closed form, its value, and how far it can be trusted."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from echelon.errors import InputError
from echelon.identification.result import Identification
from echelon.report.closed_forms import ClosedForm, ClosedForms
from echelon.report.digits import to_place, with_uncertainty
from echelon.report.environment import trusted

_LEVEL = 0.95
_VAGUE = 30.0  # per cent of its value beyond which a deviation is remarked


@dataclass(frozen=True)
class Cell:
    """A number in the table: what is shown, and what is sorted by."""

    text: str
    key: float


@dataclass(frozen=True)
class Row:
    """One base parameter."""

    form: ClosedForm
    unit: str
    value: Cell
    std: Cell
    low: str  # ends of the interval
    high: str
    relative: Cell
    visibility: Cell
    essential: bool | None
    others: tuple[Cell, ...]  # values of other models, in the order of the context's ``others``
    deviations: tuple[float, ...]  # how far these are from the value, in standard deviations
    vague: bool  # whether the deviation is large against the value


def context(run: Identification) -> dict[str, Any]:
    """What the table of parameters shows."""
    others = _other_values(run)
    rows = _rows(run, [values for _, values in others])
    return {
        "rows": rows,
        "others": [name for name, _ in others],
        "level": f"{100 * _LEVEL:g}",
        "essential": None if run.essential is None else sum(bool(row.essential) for row in rows),
        "chosen": run.chosen,
        "method": run.estimate.method,
        "html": lambda form: trusted(form.html),
        "start": lambda form: trusted(form.start),
    }


def _other_values(run: Identification) -> list[tuple[str, Any]]:
    """Base parameters of other models that a reader may want to compare with."""
    found: list[tuple[str, Any]] = []
    if run.essential is not None:
        found.append(("essential only", run.essential.values))
    if run.physical is not None:
        found.append(("physical fit", run.physical.base))
    with suppress(InputError):  # the file states no inertia, or a length has no value
        found.append(("robot file", run.base.values()))
    return found


def _rows(run: Identification, others: list[Any]) -> list[Row]:
    estimate = run.estimate
    intervals = estimate.interval(_LEVEL)
    essential = None if run.essential is None else run.essential.values != 0
    rows = []
    for k, form in enumerate(ClosedForms(run.base).all()):
        value, std = float(estimate.values[k]), float(estimate.std[k])
        relative = float(estimate.relative_std[k])
        shown, deviation = with_uncertainty(value, std)
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = tuple(float(np.divide(abs(float(values[k]) - value), std)) for values in others)
        rows.append(
            Row(
                form,
                estimate.units[k],
                Cell(shown, value),
                Cell(deviation, std),
                to_place(float(intervals[k, 0]), std),
                to_place(float(intervals[k, 1]), std),
                Cell("", relative),
                Cell("", float(run.excitation.visibility[k])),
                None if essential is None else bool(essential[k]),
                tuple(Cell(to_place(float(values[k]), std), float(values[k])) for values in others),
                apart,
                not relative <= _VAGUE,
            )
        )
    return rows
