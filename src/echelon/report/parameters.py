"""Sections about parameters: their values and how far these can be trusted, conditioning, physical consistency."""

from __future__ import annotations

from contextlib import suppress
from math import ceil, floor, log10
from typing import Any

import numpy as np

from echelon.conventions import PARAMETERS, PER_BODY
from echelon.errors import InputError
from echelon.identification.physics.feasibility import Feasibility
from echelon.identification.physics.fit import PhysicalFit
from echelon.identification.result import Identification
from echelon.inertia import convert
from echelon.mechanism.mechanism import Mechanism
from echelon.report.page import ClosedForms, Context, to_place, with_uncertainty

_LEVEL = 0.95
_VAGUE = 30.0  # per cent of its value beyond which a deviation is remarked
_WIDTH, _HEIGHT, _LEFT, _BOTTOM, _TOP = 900.0, 220.0, 64.0, 34.0, 12.0  # of the plot of singular values, px
_WIDEST = 36.0  # of a bar, px
_DECADES = 16  # that are drawn at most; smaller singular values stand at the bottom
_MOST_MOVED = 8  # base parameters that move most and are listed
_ROUNDING = 1e-12  # of the largest moment of inertia


def parameters(run: Identification) -> Context:
    """Every base parameter in closed form, its value and its uncertainty; numbers have a text and a key to sort by."""
    others = _other_values(run)
    rows = [_row(run, k, form, [values for _, values in others]) for k, form in enumerate(ClosedForms(run.base).all())]
    return {
        "rows": rows,
        "others": [name for name, _ in others],
        "level": f"{100 * _LEVEL:g}",
        "essential": None if run.essential is None else sum(row["essential"] for row in rows),
        "predict_with": run.predict_with,
        "method": run.estimate.method,
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


def _row(run: Identification, k: int, form: Any, others: list[Any]) -> Context:
    estimate = run.estimate
    value, std, relative = float(estimate.values[k]), float(estimate.std[k]), float(estimate.relative_std[k])
    low, high = (float(end) for end in estimate.interval(_LEVEL)[k])
    text, deviation = with_uncertainty(value, std)
    with np.errstate(divide="ignore", invalid="ignore"):
        apart = [float(np.divide(abs(float(values[k]) - value), std)) for values in others]
    return {
        "form": form,
        "unit": estimate.units[k],
        "value": {"text": text, "key": value},
        "std": {"text": deviation, "key": std},
        "low": to_place(low, std),
        "high": to_place(high, std),
        "relative": relative,
        "independent_share": float(run.conditioning.independent_share[k]),
        "essential": None if run.essential is None else bool(run.essential.values[k] != 0),
        "others": [{"text": to_place(float(values[k]), std), "key": float(values[k])} for values in others],
        "deviations": apart,  # of the others, in standard deviations
        "vague": not relative <= _VAGUE,
    }


def conditioning(run: Identification) -> Context:
    """Combinations of parameters that the data show well, and those that they hardly show."""
    forms = ClosedForms(run.base)
    weak = [
        {
            "value": direction.singular_value,
            "terms": [(weight, forms.name(name)) for name, weight in direction.weights],
            "advice": direction.advice,
        }
        for direction in run.conditioning.weak
    ]
    return {"conditioning": run.conditioning, "total": run.base.rank, "weak": weak, "plot": _plot(run)}


def _plot(run: Identification) -> Context | None:
    """Bars of the singular values on a logarithmic scale; None if there are none."""
    values = np.asarray(run.conditioning.singular_values, dtype=float)
    positive = values[np.isfinite(values) & (values > 0)]
    if not len(positive):
        return None
    high = ceil(log10(positive.max()) - 1e-9)
    low = max(min(floor(log10(positive.min())), high - 1), high - _DECADES)
    room, right = _HEIGHT - _TOP - _BOTTOM, _WIDTH - 8
    step = (right - _LEFT) / len(values)

    def height(value: float) -> float:
        return room * min(max((log10(value) - low) / (high - low), 0.01), 1.0) if value > 0 else 0.0

    rank = run.conditioning.rank
    bars = [
        {"x": _LEFT + step * k, "y": _TOP + room - height(v), "height": height(v), "value": v, "seen": k < rank}
        for k, v in enumerate(values.tolist())
    ]
    every = max(1, ceil((high - low) / 6))
    ticks = [{"y": _TOP + room * (high - k) / (high - low), "exponent": k} for k in range(high, low - 1, -every)]
    return {
        "width": _WIDTH,
        "height": _HEIGHT,
        "left": _LEFT,
        "right": right,
        "floor": _TOP + room,
        "bar": min(max(0.7 * step, 0.5), _WIDEST),
        "bars": bars,
        "ticks": ticks,
        "count": len(values),
    }


def physics(run: Identification) -> Context:
    """Whether a robot with these base parameters can exist, and which one was chosen."""
    feasibility, fit = run.feasibility, run.physical
    least = 0.0 if fit is None else fit.unconstrained_misfit
    return {
        "feasibility": feasibility,
        "physical": fit,
        "moved": [] if feasibility is None else _moved(run, feasibility),
        "bodies": [] if fit is None else _bodies(run.base.mechanism, fit),
        "effects": [] if fit is None else _effects(run, fit),
        "excess": 100 * (fit.misfit / least - 1) if fit is not None and least > 0 else None,
        "used": run.predict_with == "physical",
    }


def _moved(run: Identification, feasibility: Feasibility) -> list[Context]:
    """Base parameters by which the nearest physical robot differs most, in standard deviations."""
    if feasibility.nearest is None:
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = (feasibility.nearest - run.estimate.values) / run.estimate.std
    order = [k for k in np.argsort(-np.abs(shift), kind="stable") if np.isfinite(shift[k]) and shift[k] != 0]
    forms = ClosedForms(run.base)
    return [
        {
            "name": forms.name(run.base.pivots[k]),
            "value": float(run.estimate.values[k]),
            "nearest": float(feasibility.nearest[k]),
            "shift": float(shift[k]),
            "unit": run.base.units[k],
        }
        for k in order[:_MOST_MOVED]
    ]


def _bodies(mechanism: Mechanism, fit: PhysicalFit) -> list[Context]:
    values = dict(zip(fit.parameters, fit.standard.tolist(), strict=True))
    rows = []
    for index in mechanism.carriers:
        body, first = mechanism.bodies[index], mechanism.first_column[index]
        names = mechanism.parameters[first : first + len(body.carried)]
        own = {k: values[name] for k, name in zip(body.carried, names, strict=True) if name in values}
        whole = len(own) == PER_BODY
        rows.append(
            {
                "name": mechanism.carrier_name(index),
                "label": body.label,
                # smallest eigenvalue of its pseudo-inertia, relative to its scale
                "margin": fit.margins.get(body.name, fit.margins.get(body.label)),
                "fitted": _about_centre([own[k] for k in range(PER_BODY)]) if whole else None,
                "stated": None if body.inertial is None else _about_centre(list(body.inertial)),
                "carried": [] if whole else [(PARAMETERS[k], value) for k, value in own.items()],
            }
        )
    return rows


def _about_centre(standard: list[float]) -> list[float] | None:
    """Mass, centre of mass and six moments about it; None without mass."""
    if not standard[-1] > 0:
        return None
    central = convert(standard, "echelon", "urdf")
    # products of inertia that only rounding has left
    central[4:][np.abs(central[4:]) < _ROUNDING * np.abs(central[4:]).max()] = 0.0
    found: list[float] = central.tolist()
    return found


def _effects(run: Identification, fit: PhysicalFit) -> list[Context]:
    values = dict(zip(fit.parameters, fit.standard.tolist(), strict=True))
    forms = ClosedForms(run.base)
    return [
        {
            "name": forms.name(effect.parameter),
            "value": values[effect.parameter],
            "stated": effect.value,
            "unit": effect.unit,
        }
        for effect in run.base.mechanism.effects
        if effect.parameter in values
    ]
