"""Physics: whether a robot with these base parameters can exist, and which one was chosen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from echelon.conventions import PARAMETERS, PER_BODY
from echelon.identification.physics.result import Feasibility, PhysicalFit
from echelon.identification.result import Identification
from echelon.inertia.convert import convert
from echelon.mechanism.mechanism import Body, Mechanism
from echelon.report.closed_forms import ClosedForms
from echelon.report.environment import trusted

_SHOWN = 8  # base parameters that move most
_ROUNDING = 1e-12  # of the largest moment of inertia


@dataclass(frozen=True)
class BodyRow:
    """Standard parameters of a body, and what the robot's file says."""

    name: str
    label: str
    margin: float | None  # smallest eigenvalue of its pseudo-inertia, relative to its scale
    # mass, centre of mass and six moments about it; None where it carries no mass, or the file is silent
    fitted: tuple[float, ...] | None
    stated: tuple[float, ...] | None
    # shape (str, float): the parameters as they are, for a body that does not carry all ten
    carried: tuple[tuple[str, float], ...]


def context(run: Identification) -> dict[str, Any]:
    """What the section on physics shows."""
    found: dict[str, Any] = {
        "feasibility": run.feasibility,
        "physical": run.physical,
        "moved": [] if run.feasibility is None else _moved(run, run.feasibility),
        "bodies": [],
        "effects": [],
        "excess": None,
        "used": run.chosen == "physical",
    }
    if run.physical is not None:
        found["bodies"] = _bodies(run.base.mechanism, run.physical)
        found["effects"] = _effects(run, run.physical)
        least = run.physical.least_misfit
        found["excess"] = 100 * (run.physical.misfit / least - 1) if least > 0 else None
    return found


def _moved(run: Identification, feasibility: Feasibility) -> list[dict[str, Any]]:
    """Base parameters by which the nearest physical robot differs most, in standard deviations."""
    if feasibility.nearest is None:
        return []
    with np.errstate(divide="ignore", invalid="ignore"):
        shift = (feasibility.nearest - run.estimate.values) / run.estimate.std
    order = [k for k in np.argsort(-np.abs(shift), kind="stable") if np.isfinite(shift[k]) and shift[k] != 0]
    forms = ClosedForms(run.base)
    return [
        {
            "name": trusted(forms.name(run.base.pivots[k])),
            "value": float(run.estimate.values[k]),
            "nearest": float(feasibility.nearest[k]),
            "shift": float(shift[k]),
            "unit": run.base.units[k],
        }
        for k in order[:_SHOWN]
    ]


def _bodies(mechanism: Mechanism, physical: PhysicalFit) -> list[BodyRow]:
    values = dict(zip(physical.parameters, physical.standard.tolist(), strict=True))
    rows = []
    for index in mechanism.carriers:
        body, first = mechanism.bodies[index], mechanism.first_column[index]
        names = mechanism.parameters[first : first + len(body.carried)]
        own = {k: values[name] for k, name in zip(body.carried, names, strict=True) if name in values}
        whole = len(own) == PER_BODY
        rows.append(
            BodyRow(
                mechanism.carrier_name(index),
                body.label,
                physical.margins.get(body.name, physical.margins.get(body.label)),
                _about_centre([own[k] for k in range(PER_BODY)]) if whole else None,
                _stated(body),
                () if whole else tuple((PARAMETERS[k], value) for k, value in own.items()),
            )
        )
    return rows


def _stated(body: Body) -> tuple[float, ...] | None:
    return None if body.inertial is None else _about_centre(list(body.inertial))


def _about_centre(standard: list[float]) -> tuple[float, ...] | None:
    """Mass, centre and moments about it; None without mass."""
    if not standard[-1] > 0:
        return None
    central = convert(standard, "echelon", "urdf")
    # products of inertia that only rounding has left
    central[4:][np.abs(central[4:]) < _ROUNDING * np.abs(central[4:]).max()] = 0.0
    return tuple(central.tolist())


def _effects(run: Identification, physical: PhysicalFit) -> list[dict[str, Any]]:
    values = dict(zip(physical.parameters, physical.standard.tolist(), strict=True))
    forms = ClosedForms(run.base)
    return [
        {
            "name": trusted(forms.name(effect.parameter)),
            "value": values[effect.parameter],
            "stated": effect.value,
            "unit": effect.unit,
        }
        for effect in run.base.mechanism.effects
        if effect.parameter in values
    ]
