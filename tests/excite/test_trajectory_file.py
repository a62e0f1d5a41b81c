"""Files of trajectories of every kind, and documents of coefficients: right, cut off, and wrong."""

from __future__ import annotations

import copy
import json
import sys
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from echelon.excite.files import samples as samples_module
from echelon.excite.files.samples import sampled
from echelon.excite.files.trajectory_file import (
    read_trajectory,
    text_of,
    trajectory_from_json,
    trajectory_schema,
    trajectory_to_json,
    write_trajectory,
)
from echelon.excite.problem.trajectory import (
    Basis,
    Combined,
    Fourier,
    Splines,
    Trajectory,
    resting_ends,
    uniform_splines,
)
from echelon.shared.errors import InputError, MissingExtraError
from support.trajectory_motions import NAMES, UNITS, motion, smooth, states

SAMPLED = [".csv", ".parquet", ".yaml"]


# -- samples -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", SAMPLED)
def test_samples_read_back_as_the_spline_through_them(
    tmp_path: Path, suffix: str
) -> None:
    """Also where the end is not a multiple of the step, and in another order."""
    there, path = smooth(2.0037), tmp_path / f"run{suffix}"
    write_trajectory(there, path, 250)
    found = read_trajectory(path, NAMES[::-1], UNITS[::-1])
    assert found.duration == pytest.approx(2.0037, abs=1e-9)
    t = np.linspace(0, found.duration, 501)
    mine, theirs = states(found, t), states(there, t)
    # times of messages are whole nanoseconds, which accelerations see divided by the step squared
    for order, tolerance in enumerate((1e-7, 1e-5, 2e-3)):
        np.testing.assert_allclose(
            mine[order][:, ::-1],
            theirs[order],
            rtol=0,
            atol=tolerance * np.abs(theirs[0]).max(),
        )


def test_samples_end_with_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal steps, but for a last one that is shorter; evaluated piece by piece or at once."""
    for duration, rate, last in (
        (2.0037, 250, 0.0037 % 0.004),
        (0.7, 30, 1 / 30),
        (2 * np.pi, 10, 2 * np.pi % 0.1),
    ):
        there = smooth(duration)
        found = sampled(there, rate)
        np.testing.assert_allclose(np.diff(found.t)[:-1], 1 / rate, rtol=1e-9)
        assert found.t[-1] == duration
        assert found.t[-1] - found.t[-2] == pytest.approx(last, abs=1e-9)
        monkeypatch.setattr(samples_module, "NUMBERS_AT_ONCE", 7 * there.basis.size)
        for whole, pieces in zip(
            found.states, sampled(there, rate).states, strict=True
        ):
            np.testing.assert_allclose(
                pieces, whole, rtol=0, atol=1e-12 * np.abs(whole).max()
            )
        np.testing.assert_array_equal(found.states[1], there(found.t, 1))
        monkeypatch.undo()


def test_rounded_times_of_messages_contradict_nothing(tmp_path: Path) -> None:
    """Fast samples of a slow motion: whole nanoseconds alone change its accelerations by 40 %."""
    basis = uniform_splines(0.5, 1)
    t = np.linspace(0, 0.5, 30)
    points = np.linalg.lstsq(
        basis.values(t), np.column_stack([t + 0.01 * t**2, t]), rcond=None
    )[0]
    there, path = Trajectory(NAMES, UNITS, basis, points), tmp_path / "run.yaml"
    write_trajectory(there, path, 3001)
    found = read_trajectory(path, NAMES, UNITS)
    np.testing.assert_allclose(found(t, 1), there(t, 1), atol=1e-4)


@pytest.mark.parametrize("suffix", SAMPLED)
def test_a_polynomial_of_degree_five_is_exact(tmp_path: Path, suffix: str) -> None:
    there = motion(uniform_splines(1.0, 1))
    write_trajectory(there, tmp_path / f"run{suffix}", 10)
    found = read_trajectory(tmp_path / f"run{suffix}", NAMES, UNITS)
    t = np.linspace(0, 1, 50)
    np.testing.assert_allclose(found(t, 2), there(t, 2), rtol=0, atol=1e-9)
    # the property on which limits are checked: bounds hold everywhere
    for order in range(4):
        assert np.all(
            np.abs(found(t, order)).max(axis=0)
            <= found.basis.bounds(found.coefficients, order) + 1e-9
        )


@pytest.mark.parametrize("suffix", SAMPLED)
def test_a_periodic_motion_can_be_repeated(tmp_path: Path, suffix: str) -> None:
    there, path = smooth(1.0), tmp_path / f"run{suffix}"
    write_trajectory(there, path, 200, repeats=3)
    found = read_trajectory(path, NAMES, UNITS)
    assert found.duration == pytest.approx(3)
    t = np.linspace(0, 1, 40)
    np.testing.assert_allclose(found(t + 2), there(t), rtol=0, atol=1e-6)


@pytest.mark.parametrize("suffix", [".json", *SAMPLED])
def test_one_that_is_not_periodic_cannot(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    with pytest.raises(
        InputError, match="repeats: a motion that is not periodic cannot be run 2 times"
    ):
        write_trajectory(motion(uniform_splines(2.0, 3)), path, 100, repeats=2)
    with pytest.raises(InputError, match="repeats: 0 is not a number of runs"):
        write_trajectory(smooth(), path, 100, repeats=0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("rate", "problem"),
    [
        (0, "rate: 0 Hz is not a sampling rate"),
        (-5.0, "not a sampling rate"),
        (float("nan"), "needs a number"),
        (2, "rate: 2 Hz gives 5 samples in 2 s; at least 6"),
        (1e9, r"rate: 1e\+09 Hz gives 2e\+09 samples; at most"),
    ],
)
def test_rates_that_are_wrong(rate: float, problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=problem):
        write_trajectory(smooth(), tmp_path / "run.csv", rate)


# -- files -------------------------------------------------------------------------------------------------------------


def test_suffixes_that_are_not_known(tmp_path: Path) -> None:
    for call in (
        lambda p: write_trajectory(smooth(), p, 100),
        lambda p: read_trajectory(p, NAMES, UNITS),
    ):
        with pytest.raises(
            InputError,
            match=r"'.xml' names no kind.*valid are .json, .csv, .parquet, .yaml",
        ):
            call(tmp_path / "run.xml")
    with pytest.raises(InputError, match="no such file"):
        read_trajectory(tmp_path / "run.csv", NAMES, UNITS)
    with pytest.raises(InputError, match="cannot be written"):
        write_trajectory(smooth(), tmp_path / "missing" / "run.csv", 100)


@pytest.mark.parametrize("suffix", [".json", *SAMPLED])
def test_equal_trajectories_give_equal_files_whole(tmp_path: Path, suffix: str) -> None:
    for name in ("one", "two"):
        write_trajectory(smooth(), tmp_path / f"{name}{suffix}", 100)
    assert (tmp_path / f"one{suffix}").read_bytes() == (
        tmp_path / f"two{suffix}"
    ).read_bytes()
    assert len(list(tmp_path.iterdir())) == 2  # nothing temporary is left


@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("suffix", [".json", ".parquet", ".yaml"])
def test_a_file_that_was_cut_off_is_one_clear_error(
    tmp_path: Path, suffix: str, share: float
) -> None:
    path = tmp_path / f"run{suffix}"
    write_trajectory(smooth(), path, 100)
    content = path.read_bytes()
    path.write_bytes(
        content[: max(1, int((len(content) - 1) * share))]
    )  # a last line break is no loss
    with pytest.raises(InputError) as caught:
        read_trajectory(path, NAMES, UNITS)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


def test_a_table_cut_off_inside_a_line_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    write_trajectory(smooth(), path, 100)
    content = path.read_text()
    path.write_text(content[: content.rindex(",") - 30])
    with pytest.raises(InputError, match=r"cells|line"):
        read_trajectory(path, NAMES, UNITS)


def test_packages_that_are_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingExtraError, match=r"echelon-robotics\[excite\]"):
        write_trajectory(smooth(), tmp_path / "run.parquet", 100)


FAMILIES: dict[str, Basis] = {
    "fourier": Fourier(2.5, 3),
    "splines": Splines((0.0, 0.4, 1.5, 1.7, 2.5)),
    "septic": Splines((0.0, 1.0, 2.5), 7),
    "sum": Combined((Fourier(2.5, 2), uniform_splines(2.5, 4))),
    "nested": Combined(
        (
            resting_ends(Fourier(2.5, 4)),
            Combined((Fourier(2.5, 1), uniform_splines(2.5, 1))),
        )
    ),
    "resting": resting_ends(resting_ends(uniform_splines(2.5, 9))),
}


@pytest.fixture(params=FAMILIES)
def trajectory(request: pytest.FixtureRequest) -> Trajectory:
    return motion(FAMILIES[request.param])


def by_formula(record: dict[str, Any], name: str, t: Any) -> Any:
    """Position of a joint at a time by the formula in a document's 'meaning', from the document alone."""
    if record["family"] == "sum":
        return sum(by_formula(part, name, t) for part in record["parts"])
    if record["family"] == "splines":
        return BSpline(
            np.array(record["knots"]),
            np.array(record["control_points"][name]),
            record["degree"],
        )(t)
    own, duration = record["coefficients"][name], record["duration"]
    total = own["constant"]
    for k, (a, b) in enumerate(zip(own["sin"], own["cos"], strict=True), start=1):
        total = (
            total
            + a * np.sin(2 * np.pi * k * t / duration)
            + b * np.cos(2 * np.pi * k * t / duration)
        )
    return total


def test_a_document_says_what_the_motion_is(trajectory: Trajectory) -> None:
    document = json.loads(text_of(trajectory_to_json(trajectory)))
    t = np.linspace(0, 2.5, 101)
    for j, name in enumerate(NAMES):
        # cancelling parts of a recombined basis are large
        np.testing.assert_allclose(
            by_formula(document["motion"], name, t),
            trajectory(t)[:, j],
            rtol=0,
            atol=1e-9,
        )


def test_a_document_reads_back(trajectory: Trajectory) -> None:
    document = json.loads(text_of(trajectory_to_json(trajectory)))
    jsonschema.Draft202012Validator(trajectory_schema()).validate(document)
    found = trajectory_from_json(document, "run.json")
    assert (found.coordinates, found.units, found.duration) == (NAMES, UNITS, 2.5)
    t = np.linspace(0, 2.5, 101)
    for mine, theirs in zip(states(found, t), states(trajectory, t), strict=True):
        np.testing.assert_allclose(
            mine, theirs, rtol=0, atol=1e-9 * np.abs(theirs).max()
        )
    assert trajectory_to_json(found) == document


def test_coefficients_read_back_in_the_order_asked_for(
    tmp_path: Path, trajectory: Trajectory
) -> None:
    write_trajectory(trajectory, tmp_path / "run.json", 100)
    found = read_trajectory(tmp_path / "run.json", NAMES[::-1], UNITS[::-1])
    t = np.linspace(0, 2.5, 20)
    assert (found.coordinates, found.units) == (NAMES[::-1], UNITS[::-1])
    np.testing.assert_allclose(found(t), trajectory(t)[:, ::-1], rtol=0, atol=1e-9)


finite = st.floats(allow_nan=False, allow_infinity=False)


@given(
    duration=st.floats(1e-6, 1e6),
    columns=st.integers(1, 3).flatmap(
        lambda h: st.lists(
            st.tuples(finite, finite), min_size=1 + 2 * h, max_size=1 + 2 * h
        )
    ),
)
def test_every_float_of_a_series_reads_back(
    duration: float, columns: list[tuple[float, float]]
) -> None:
    basis = Fourier(duration, len(columns) // 2)
    there = Trajectory(NAMES, UNITS, basis, np.array(columns))
    found = trajectory_from_json(
        json.loads(text_of(trajectory_to_json(there))), "run.json"
    )
    assert found.basis == basis
    assert found.coefficients.tobytes() == there.coefficients.tobytes()


@given(
    breaks=st.lists(st.floats(1e-9, 1e9), min_size=1, max_size=5, unique=True).map(
        sorted
    ),
    degree=st.integers(5, 9),
    seed=st.integers(0, 2**32),
)
def test_every_float_of_a_spline_reads_back(
    breaks: list[float], degree: int, seed: int
) -> None:
    there = motion(Splines((0.0, *breaks), degree), seed)
    found = trajectory_from_json(
        json.loads(text_of(trajectory_to_json(there))), "run.json"
    )
    assert found.basis == there.basis
    assert found.coefficients.tobytes() == there.coefficients.tobytes()


def test_extra_data_travel_along() -> None:
    document = trajectory_to_json(smooth(), robot="panda", margins={"j1": 0.5})
    assert (document["robot"], document["margins"]) == ("panda", {"j1": 0.5})
    jsonschema.Draft202012Validator(trajectory_schema()).validate(document)
    assert trajectory_from_json(document, "run.json").coordinates == NAMES
    with pytest.raises(InputError, match="key 'units': is a key of the format itself"):
        trajectory_to_json(smooth(), units=["deg"])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_not_written(value: float) -> None:
    there = smooth()
    there.coefficients[2, 1] = value
    with pytest.raises(
        InputError, match="coordinate 'slider': a coefficient is not finite"
    ):
        trajectory_to_json(there)


def test_a_family_that_the_format_does_not_know_is_refused() -> None:
    class Other(Fourier.__base__):  # type: ignore[misc, name-defined]
        duration, size, frequency, periodic = 1.0, 1, 1.0, False
        values = bounds = None

    with pytest.raises(
        InputError, match="no motions of the family Other; write samples instead"
    ):
        trajectory_to_json(Trajectory(NAMES, UNITS, Other(), np.zeros((1, 2))))


def test_recombined_parts_are_written_by_name() -> None:
    """No matrix of the project's own appears in a file."""
    document = trajectory_to_json(
        motion(Combined((Fourier(1.0, 1),), np.array([[1.0], [2.0], [0.0]])))
    )
    own = document["motion"]["coefficients"]["j1"]
    assert (own["sin"], own["cos"]) == ([2 * own["constant"]], [0.0])


def spline_document() -> dict[str, Any]:
    return trajectory_to_json(motion(uniform_splines(2.0, 3)))


def changed(
    document: dict[str, Any], *path: Any, value: Any = None, drop: bool = False
) -> dict[str, Any]:
    copied = copy.deepcopy(document)
    inner: Any = copied
    for key in path[:-1]:
        inner = inner[key]
    if drop:
        del inner[path[-1]]
    else:
        inner[path[-1]] = value
    return copied


FOURIER, SPLINE = trajectory_to_json(smooth()), spline_document()
SERIES, POINTS = (
    FOURIER["motion"]["coefficients"]["j1"],
    SPLINE["motion"]["control_points"]["j1"],
)
KNOTS = SPLINE["motion"]["knots"]
UNLIKE = {
    "family": "sum",
    "parts": [FOURIER["motion"], trajectory_to_json(smooth(3.0))["motion"]],
}


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ([], 'run.json: is not a trajectory: .*begins with "echelon_trajectory": 1'),
        ({"coordinates": []}, "run.json: is not a trajectory"),
        (changed(FOURIER, "echelon_trajectory", value=2), "echelon_trajectory: not a trajectory of this format: needs 1, found 2"),
        (changed(FOURIER, "echelon_trajectory", value="1"), "echelon_trajectory: .* needs 1, found '1'"),
        (changed(FOURIER, "units", drop=True), "units: .* missing"),
        (changed(FOURIER, "units", value=["rad"]), "units: has 1 entries for 2 coordinates"),
        (changed(FOURIER, "units", 0, value="deg"), "units.0: .*'deg' is not valid .valid: rad, m."),
        (changed(FOURIER, "coordinates", value=["j1", "j1"]), "coordinates: 'j1' occurs twice"),
        (changed(FOURIER, "coordinates", value=[]), "coordinates: .* at least 1"),
        (changed(FOURIER, "coordinates", value=["j1"]), "units: has 2 entries for 1 coordinates"),
        (
            changed(FOURIER, "motion", "coefficients", "j2", value=SERIES),
            "motion.coefficients: there is no coordinate for 'j2'; valid are 'j1', 'slider'",
        ),
        (changed(FOURIER, "coordinates", value=["j1", "j2"]), "motion.coefficients: the coordinate 'j2' is missing"),
        (changed(FOURIER, "motion", "family", value="forier"), "motion: .*'forier'.*'fourier'.*fourier, splines, sum"),
        (changed(FOURIER, "motion", "family", drop=True), "motion: .*'family'"),
        (changed(FOURIER, "motion", value=3), "motion: .* needs a mapping"),
        (changed(FOURIER, "motion", "period", value=3), "motion.period: .* unknown key"),
        (changed(FOURIER, "motion", "duration", value=0), "duration: .* greater than or equal to"),
        (changed(FOURIER, "motion", "duration", value=float("inf")), "duration: .* needs a finite number"),
        (changed(FOURIER, "motion", "duration", value="2"), "duration: .* needs a number"),
        (changed(FOURIER, "motion", "harmonics", value=0), "harmonics: .* greater than or equal to 1"),
        (changed(FOURIER, "motion", "harmonics", value=3), "coefficients.j1.sin: has 2 entries; needs 3"),
        (changed(FOURIER, "motion", "harmonics", value=2.5), "harmonics: .* needs a whole number"),
        (changed(FOURIER, "motion", "coefficients", "j1", "cos", value=[1.0]), "j1.cos: has 1 entries; needs 2"),
        (changed(FOURIER, "motion", "coefficients", "j1", "cos", 1, value=float("nan")), "cos.1: .* needs a finite"),
        (changed(FOURIER, "motion", "coefficients", "j1", "constant", value=10**400), "j1.constant: .* needs a finite"),
        (changed(FOURIER, "motion", "coefficients", "j1", "sin", drop=True), "j1.sin: .* missing"),
        (changed(SPLINE, "motion", "degree", value=0), "degree: .* greater than or equal to 5"),
        (changed(SPLINE, "motion", "degree", value=4), "degree: .* greater than or equal to 5"),
        (changed(SPLINE, "motion", "degree", value=10**9), "motion.knots: of degree 1000000000 begin"),
        (changed(SPLINE, "motion", "knots", value=KNOTS[:-1]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", value=[]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", value=[k + 1 for k in KNOTS]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", 7, value=KNOTS[6]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "control_points", "j1", value=POINTS[1:]), "j1: has 7 entries; 14 knots .* need 8"),
        (changed(SPLINE, "motion", "control_points", "j1", 0, value=None), "j1.0: .* needs a number"),
        (changed(SPLINE, "motion", "control_points", "j1", drop=True), "points: the coordinate 'j1' is missing"),
        (changed(FOURIER, "motion", value=UNLIKE), r"motion.parts\[1\]: lasts 3.0 s, the first part 2.0 s"),
        (changed(FOURIER, "motion", value=UNLIKE | {"parts": []}), "parts: .* at least 1"),
        (
            changed(changed(FOURIER, "motion", value=UNLIKE), "motion", "parts", 0, "coefficients", "j1", drop=True),
            r"motion.parts\[0\].coefficients: the coordinate 'j1' is missing",
        ),
    ],
)  # fmt: skip
def test_documents_that_are_wrong(document: Any, problem: str) -> None:
    with pytest.raises(InputError, match=problem) as caught:
        trajectory_from_json(document, "run.json")
    assert str(caught.value).startswith("run.json: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (b"{", r"not well-formed JSON: .* \(line 1\)"),
        (b"\xff\xfe", "not UTF-8 text"),
        (b"[" * 200_000, "nested too deeply|not well-formed"),
        (
            b'{"echelon_trajectory": 1, "echelon_trajectory": 1}',
            "the key 'echelon_trajectory' occurs twice",
        ),
        (b'{"echelon_trajectory": ' + b"1" * 5000 + b"}", "not readable as JSON"),
        (b"", "is empty"),
    ],
)
def test_files_that_are_no_documents(text: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_bytes(text)
    with pytest.raises(InputError, match=problem):
        read_trajectory(path, NAMES, UNITS)


def test_coordinates_of_documents_are_compared(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    write_trajectory(smooth(), path, 100)
    for names, units, problem in (
        (
            ["j1", "j2"],
            UNITS,
            "coordinates: the coordinate 'j2' is missing; there are 'j1', 'slider'",
        ),
        (
            ["slider"],
            ["m"],
            "coordinates: there is no coordinate for 'j1'; valid are 'slider'",
        ),
        (NAMES, ["rad", "rad"], "units: 'slider' is in m; needs rad"),
    ):
        with pytest.raises(InputError, match=problem):
            read_trajectory(path, names, units)
