"""Results of ``echelon identify`` for simulated robots, beside the truth."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest

from echelon.base.model import BaseModel
from echelon.identification.saved.identified import IdentifiedModel, load_identified
from support.command_line import run
from support.simulated_models import Floats
from support.simulated_robots import Motion, System
from support.simulated_systems import SYSTEMS, motion_of

FRESH = 12
"""Seed of a motion that nobody has seen."""
QUICK = ("arm",)
_FLAGS = {"keep_fixed_links": "--keep-fixed-links", "floating": "--floating"}
"""Flags of the command line by the options of :func:`echelon.load`."""


def params(*robots: str) -> list[Any]:
    """Systems by what they came as (all by default); those beyond the first one are slow."""
    names = [
        name for name, system in SYSTEMS.items() if not robots or system.robot in robots
    ]
    return [
        pytest.param(name, marks=() if name in QUICK else pytest.mark.slow)
        for name in names
    ]


@dataclass(frozen=True)
class Result:
    """A system, what ``echelon identify`` wrote about it, and the truth."""

    system: System
    folder: Path
    model: IdentifiedModel
    truth: Floats
    kept: object

    @property
    def base(self) -> BaseModel:
        return self.model.base

    @cached_property
    def document(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.text("model.json"))
        return found

    @cached_property
    def covariance(self) -> Floats:
        return np.array(self.document["estimate"]["covariance"])

    @cached_property
    def physical(self) -> Floats:
        """Standard parameters of the physically consistent fit."""
        return np.array(list(self.document["physical"]["standard"].values()))

    @cached_property
    def fresh(self) -> Motion:
        """Some states of a new motion, where all joints are fast enough to tell which way friction acts."""
        motion = motion_of(self.system, FRESH)
        fast = np.flatnonzero(
            (np.abs(motion.qd[:, -len(self.system.rates.T) :]) > 0.15).all(axis=1)
        )
        return motion.at(fast[:: len(fast) // 100])

    def text(self, name: str) -> str:
        return (self.folder / name).read_text()

    def states(self, motion: Motion) -> tuple[Floats, Floats, Floats]:
        """As the regressor takes them."""
        samples = self.system.samples(motion)
        return samples.q, samples.qd, samples.qdd

    def uncertainty(self, motion: Motion) -> Floats:
        """Root mean square, for each output, of the standard deviation of the predictions."""
        X = self.base.regressor(*self.states(motion))
        variance = np.einsum("ijk,kl,ijl->ij", X, self.covariance, X)
        found: Floats = np.sqrt(variance.mean(axis=0))
        return found

    def effects(self, motion: Motion) -> Floats:
        """Contribution of effects to the outputs, by the identified values."""
        values = [
            0.0 if c.body is not None else v
            for c, v in zip(self.base.mechanism.columns, self.physical, strict=True)
        ]
        found: Floats = self.base.standard_regressor(*self.states(motion)) @ np.array(
            values
        )
        return found


@cache
def result_of(name: str) -> Result:
    """A system after ``echelon identify`` on a noisy log; its files go when the process ends."""
    kept = TemporaryDirectory()
    return identified(SYSTEMS[name], Path(kept.name), kept)


def identified(system: System, folder: Path, kept: object = None) -> Result:
    """Result of the command line for a set-up file and a log."""
    (folder / "true").mkdir()
    base, values = system.truth(folder / "true")
    setup = system.write_setup(folder)
    log = system.log(motion_of(system), folder / "run", base.mechanism)
    options = [_FLAGS[name] for name in system.reading]
    done = run("identify", str(setup), str(log), "-o", str(folder / "result"), *options)
    assert done.returncode == 0, done.stderr
    model = load_identified(folder / "result" / "model.json")
    assert model.base.pivots == base.pivots
    return Result(system, folder / "result", model, base.values(values), kept)


def rms(values: Floats) -> Floats:
    found: Floats = np.sqrt(np.mean(values**2, axis=0))
    return found


def assert_predicts(result: Result, predicted: Floats, times: float = 4.0) -> None:
    """The exact outputs of a fresh motion, to within a few standard deviations of what noise does to predictions."""
    motion = result.fresh
    ratio = rms(predicted - motion.y) / result.uncertainty(motion)
    assert (ratio < times).all(), ratio
    assert (
        result.uncertainty(motion) < 0.05 * rms(motion.y - motion.y.mean(axis=0))
    ).all()


def assert_same(found: Floats, expected: Floats, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(
        found, expected, rtol=0, atol=tolerance * np.abs(expected).max()
    )
