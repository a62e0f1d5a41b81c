"""A first look at logs: what they can show of a robot, and what is missing, before anything is fitted."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from echelon.arrays import Floats
from echelon.base.derive import base_parameters
from echelon.base.model import BaseModel
from echelon.errors import InputError
from echelon.identification.conditioning import Conditioning, conditioning, without_rounding
from echelon.identification.estimators.least_squares import noise_estimate
from echelon.identification.rows.plan import Plan
from echelon.identification.rows.rows import ModelRows
from echelon.identification.survey import Survey, survey
from echelon.logs.recording import Samples
from echelon.setup.setup import Setup

SAMPLES = 20_000
"""Samples that are looked at, over all logs: enough to see which parameters a motion excites."""


@dataclass(frozen=True)
class Travel:
    """How far and how fast a coordinate moves."""

    coordinate: str
    low: float  # rad or m
    high: float
    speed: float  # largest, rad/s or m/s


@dataclass(frozen=True)
class FirstLook:
    """What logs can show."""

    base: BaseModel
    seconds: float  # of what was looked at
    survey: Survey
    travels: tuple[Travel, ...]
    conditioning: Conditioning

    @property
    def missing(self) -> tuple[str, ...]:
        """What other motions would have to bring, in sentences."""
        return tuple(direction.advice for direction in self.conditioning.weak)


def first_look(setup: Setup, paths: Sequence[Path]) -> FirstLook:
    """Look at the beginnings of logs."""
    base = base_parameters(setup.mechanism, seed=setup.seed)
    surveyed = survey(setup, base, paths)
    plan = Plan(base, setup.columns or surveyed.columns, surveyed.preparation)
    samples = list(_beginnings(plan, paths))
    if not samples:
        raise InputError("nothing of these logs is left after their preparation", source=", ".join(map(str, paths[:3])))
    observation = without_rounding(ModelRows.of(base, samples).observation(), base.units)
    seen = conditioning(observation, 1 / noise_estimate(observation), base)
    return FirstLook(base, sum(len(s) / s.rate for s in samples), surveyed, tuple(_travels(base, samples)), seen)


def _beginnings(plan: Plan, paths: Sequence[Path]) -> Iterator[Samples]:
    left = SAMPLES
    for path in paths:
        for samples in islice(plan.samples(path), 1 + left // 100):
            if left > 0:
                yield samples
            left -= len(samples)
        if left <= 0:
            return


def _travels(base: BaseModel, samples: Sequence[Samples]) -> Iterator[Travel]:
    of = base.mechanism
    q, qd = (np.concatenate([getattr(some, name) for some in samples]) for name in ("q", "qd"))
    names = of.positions if q.shape[1] == len(of.positions) else of.independent_velocities
    speeds: dict[str, Floats] = dict(
        zip(of.velocities if len(of.velocities) == qd.shape[1] else names, qd.T, strict=True)
    )
    for name, values in zip(names, q.T, strict=True):
        speed = float(np.abs(speeds[name]).max()) if name in speeds else float("nan")
        yield Travel(name, float(values.min()), float(values.max()), speed)
