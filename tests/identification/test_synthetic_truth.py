"""Simulated robots, from their logs through the command line to numbers: all is compared with the truth."""

from __future__ import annotations

import csv
import ctypes
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.command_line import run
from support.generated_code import compiled
from support.simulated_models import Floats
from support.simulated_results import (
    FRESH,
    Result,
    assert_predicts,
    assert_same,
    params,
    result_of,
)
from support.simulated_robots import Motion, System
from support.simulated_systems import motion_of
from support.system_tools import tool


@pytest.fixture(params=params())
def result(request: pytest.FixtureRequest) -> Result:
    return result_of(request.param)


# -- the estimate ------------------------------------------------------------------------------------------------------


def test_estimates_are_the_truth_to_within_their_deviations(result: Result) -> None:
    estimate = result.document["estimate"]
    values = np.array([entry["value"] for entry in estimate["parameters"]])
    errors = (values - result.truth) / np.sqrt(np.diagonal(result.covariance))
    assert np.abs(errors).max() < 5
    assert np.mean(errors**2) < 2.5
    inside = [
        low <= truth <= high
        for (low, high), truth in zip(intervals(estimate), result.truth, strict=True)
    ]
    assert np.mean(inside) > 0.75


def intervals(estimate: dict[str, Any]) -> list[tuple[float, float]]:
    return [(entry["low"], entry["high"]) for entry in estimate["parameters"]]


def test_the_summary_says_that_all_is_well(result: Result) -> None:
    document = result.document
    assert document["conditioning"]["rank"] == result.base.rank
    assert document["feasibility"]["feasible"] is True
    scores = [
        score
        for v in document["validations"]
        if v["role"] == "validation"
        for score in v["scores"]
    ]
    assert len(scores) == len(result.system.noise)
    assert min(score["whole"]["r2"] for score in scores) > 0.98
    assert "stranger" not in {finding["kind"] for finding in document["findings"]}
    assert (result.folder / "report.html").stat().st_size > 10_000


def test_noise_is_found(result: Result) -> None:
    """The low-pass of both sides leaves of white noise its share of the band."""
    motion = motion_of(result.system)
    nyquist = 0.5 / (motion.time[1] - motion.time[0])
    share = np.sqrt(result.model.preparation.band / nyquist)
    noise = np.array(
        [
            result.document["estimate"]["noise"][o.name]
            for o in result.base.mechanism.outputs
        ]
    )
    ratio = noise / share / result.system.noise
    # the band leaves 40 to 130 independent rows of an output, which tell a deviation to 6 to 11 %
    assert (ratio > 0.85).all(), ratio
    assert (ratio < 1.3).all(), ratio
    # all outputs tell it to 3 to 8 %; what passes above the edge of the band adds 6 %
    assert 0.98 < np.sqrt(np.mean(ratio**2)) < 1.14, ratio


# -- predictions -------------------------------------------------------------------------------------------------------


def test_fresh_motions_are_predicted(result: Result) -> None:
    states = result.states(result.fresh)
    assert_predicts(result, result.base.predict(*states, result.model.values))
    assert_predicts(result, result.base.standard_regressor(*states) @ result.physical)


def test_predict_command(result: Result, tmp_path: Path) -> None:
    """``echelon predict`` gives the model's outputs at every row of a log; its scores are those of validation."""
    motion = motion_of(result.system, FRESH)
    log = result.system.log(
        motion, tmp_path / "fresh", result.base.mechanism, seed=None
    )
    done = run(
        "predict",
        str(result.folder / "model.json"),
        str(log),
        "-o",
        str(tmp_path / "out.csv"),
        "--json",
    )
    assert done.returncode == 0, done.stderr
    with (tmp_path / "out.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(motion.time)
    (samples,) = result.model.plan.samples(log, outputs=False)
    exact = result.base.predict(samples.q, samples.qd, samples.qdd, result.model.values)
    first = round((samples.start - float(rows[0]["time"])) * samples.rate)
    names = [f"{output.name}.predicted" for output in result.base.mechanism.outputs]
    table = np.array([[float(row[name] or "nan") for name in names] for row in rows])
    inside = np.isfinite(table[first:]).all(axis=1)[: len(samples)]
    told = json.loads(done.stdout)
    assert np.isnan(table).any(axis=1).sum() == told["near_ends"]
    assert told["near_ends"] < len(rows) / 10
    predicted = table[first : first + len(samples)][inside]
    for values, expected in zip(predicted.T, exact[inside].T, strict=True):
        assert_same(values, expected)
    scores = told["outputs"].values()
    assert min(score["whole"]["r2"] for score in scores) > 0.98


def test_compiled_code_is_the_model(result: Result, tmp_path: Path) -> None:
    library = tmp_path / "model.so"
    source = str(result.folder / "model.c")
    code = compiled(
        [tool("gcc"), "-O1", "-shared", "-fPIC", source, "-o", str(library), "-lm"],
        library,
    )
    motion = result.fresh
    expected = result.base.predict(*result.states(motion), result.model.values)
    assert_same(called(code, result.system, motion, expected.shape[1]), expected)


def called(code: ctypes.CDLL, system: System, motion: Motion, outputs: int) -> Floats:
    """Inverse dynamics of C at all states; with loops, from velocities and accelerations of independent coordinates."""
    found = np.full((len(motion.time), outputs), np.nan)
    moving = list(system.independent) or slice(None)
    for k, (q, qd, qdd) in enumerate(zip(motion.q, motion.qd, motion.qdd, strict=True)):
        code.model_inverse_dynamics(
            *map(_pointer, (q, qd[moving].copy(), qdd[moving].copy(), found[k]))
        )
    return found


def _pointer(values: Floats) -> ctypes.c_void_p:
    return values.ctypes.data_as(ctypes.c_void_p)
