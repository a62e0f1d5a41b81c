"""Coefficients of trajectories: a document says what the motion is, and comes back the same."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from echelon.errors import InputError
from echelon.excite.files.coefficients import text_of, trajectory_from_json, trajectory_schema, trajectory_to_json
from echelon.excite.files.trajectory_file import read_trajectory, write_trajectory
from echelon.excite.problem.trajectory import (
    Basis,
    Combined,
    Fourier,
    Splines,
    Trajectory,
    resting_ends,
    uniform_splines,
)
from support.trajectory_motions import NAMES, UNITS, motion, smooth, states

FAMILIES: dict[str, Basis] = {
    "fourier": Fourier(2.5, 3),
    "splines": Splines((0.0, 0.4, 1.5, 1.7, 2.5)),
    "septic": Splines((0.0, 1.0, 2.5), 7),
    "sum": Combined((Fourier(2.5, 2), uniform_splines(2.5, 4))),
    "nested": Combined((resting_ends(Fourier(2.5, 4)), Combined((Fourier(2.5, 1), uniform_splines(2.5, 1))))),
    "resting": resting_ends(resting_ends(uniform_splines(2.5, 9))),
}


@pytest.fixture(params=FAMILIES)
def trajectory(request: pytest.FixtureRequest) -> Trajectory:
    return motion(FAMILIES[request.param])


def by_formula(record: dict[str, Any], name: str, t: Any) -> Any:
    """What a motion's 'meaning' says, from the document alone."""
    if record["family"] == "sum":
        return sum(by_formula(part, name, t) for part in record["parts"])
    if record["family"] == "splines":
        return BSpline(np.array(record["knots"]), np.array(record["control_points"][name]), record["degree"])(t)
    own, duration = record["coefficients"][name], record["duration"]
    total = own["constant"]
    for k, (a, b) in enumerate(zip(own["sin"], own["cos"], strict=True), start=1):
        total = total + a * np.sin(2 * np.pi * k * t / duration) + b * np.cos(2 * np.pi * k * t / duration)
    return total


def test_a_document_says_what_the_motion_is(trajectory: Trajectory) -> None:
    document = json.loads(text_of(trajectory_to_json(trajectory)))
    t = np.linspace(0, 2.5, 101)
    for j, name in enumerate(NAMES):
        # cancelling parts of a recombined basis are large
        np.testing.assert_allclose(by_formula(document["motion"], name, t), trajectory(t)[:, j], rtol=0, atol=1e-9)


def test_a_document_reads_back(trajectory: Trajectory) -> None:
    document = json.loads(text_of(trajectory_to_json(trajectory)))
    jsonschema.validate(document, trajectory_schema())
    found = trajectory_from_json(document, "run.json")
    assert (found.coordinates, found.units, found.duration) == (NAMES, UNITS, 2.5)
    t = np.linspace(0, 2.5, 101)
    for mine, theirs in zip(states(found, t), states(trajectory, t), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max())
    assert trajectory_to_json(found) == document


def test_coefficients_read_back_in_the_order_asked_for(tmp_path: Path, trajectory: Trajectory) -> None:
    write_trajectory(trajectory, tmp_path / "run.json", 100)
    found = read_trajectory(tmp_path / "run.json", NAMES[::-1], UNITS[::-1])
    t = np.linspace(0, 2.5, 20)
    assert (found.coordinates, found.units) == (NAMES[::-1], UNITS[::-1])
    np.testing.assert_allclose(found(t), trajectory(t)[:, ::-1], rtol=0, atol=1e-9)


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(
    duration=st.floats(1e-6, 1e6),
    columns=st.integers(1, 3).flatmap(
        lambda h: st.lists(st.tuples(finite, finite), min_size=1 + 2 * h, max_size=1 + 2 * h)
    ),
)
def test_every_float_of_a_series_reads_back(duration: float, columns: list[tuple[float, float]]) -> None:
    basis = Fourier(duration, len(columns) // 2)
    there = Trajectory(NAMES, UNITS, basis, np.array(columns))
    found = trajectory_from_json(json.loads(text_of(trajectory_to_json(there))), "run.json")
    assert found.basis == basis
    assert found.coefficients.tobytes() == there.coefficients.tobytes()


@given(
    breaks=st.lists(st.floats(1e-9, 1e9), min_size=1, max_size=5, unique=True).map(sorted),
    degree=st.integers(5, 9),
    seed=st.integers(0, 2**32),
)
def test_every_float_of_a_spline_reads_back(breaks: list[float], degree: int, seed: int) -> None:
    there = motion(Splines((0.0, *breaks), degree), seed)
    found = trajectory_from_json(json.loads(text_of(trajectory_to_json(there))), "run.json")
    assert found.basis == there.basis
    assert found.coefficients.tobytes() == there.coefficients.tobytes()


def test_extra_data_travel_along() -> None:
    document = trajectory_to_json(smooth(), robot="panda", margins={"j1": 0.5})
    assert (document["robot"], document["margins"]) == ("panda", {"j1": 0.5})
    jsonschema.validate(document, trajectory_schema())
    assert trajectory_from_json(document, "run.json").coordinates == NAMES
    with pytest.raises(InputError, match="key 'units': is a key of the format itself"):
        trajectory_to_json(smooth(), units=["deg"])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_not_written(value: float) -> None:
    there = smooth()
    there.coefficients[2, 1] = value
    with pytest.raises(InputError, match="coordinate 'slider': a coefficient is not finite"):
        trajectory_to_json(there)


def test_a_family_that_the_format_does_not_know_is_refused() -> None:
    class Other(Fourier.__base__):  # type: ignore[misc, name-defined]
        duration, size, frequency, periodic = 1.0, 1, 1.0, False
        values = bounds = None

    with pytest.raises(InputError, match="no motions of the family Other; write samples instead"):
        trajectory_to_json(Trajectory(NAMES, UNITS, Other(), np.zeros((1, 2))))


def test_recombined_parts_are_written_by_name() -> None:
    """No matrix of the project's own appears in a file."""
    document = trajectory_to_json(motion(Combined((Fourier(1.0, 1),), np.array([[1.0], [2.0], [0.0]]))))
    own = document["motion"]["coefficients"]["j1"]
    assert (own["sin"], own["cos"]) == ([2 * own["constant"]], [0.0])
