"""Files of trajectories: what is written means the same to other programs and comes back the same."""

from __future__ import annotations

import copy
import csv
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from scipy.interpolate import BSpline

from echelon.errors import InputError, MissingExtraError
from echelon.excite.families.basis import Basis, Recombined, resting_ends
from echelon.excite.families.bsplines import Splines, uniform_splines
from echelon.excite.families.fourier import Fourier
from echelon.excite.families.sums import Sum
from echelon.excite.files import samples as samples_module
from echelon.excite.files.coefficients import text_of, trajectory_from_json, trajectory_to_json
from echelon.excite.files.joint_trajectory import yaml_text
from echelon.excite.files.reading import read_trajectory
from echelon.excite.files.samples import sampled
from echelon.excite.files.schema import trajectory_schema
from echelon.excite.files.writing import write_trajectory
from echelon.excite.trajectory import Trajectory

NAMES, UNITS = ("j1", "slider"), ("rad", "m")
KIND = "trajectory_msgs/msg/JointTrajectory"
STORE = get_typestore(Stores.ROS2_HUMBLE)
SAMPLED = [".csv", ".parquet", ".yaml", ".mcap"]
FAMILIES: dict[str, Basis] = {
    "fourier": Fourier(2.5, 3),
    "splines": Splines((0.0, 0.4, 1.5, 1.7, 2.5)),
    "septic": Splines((0.0, 1.0, 2.5), 7),
    "sum": Sum((Fourier(2.5, 2), uniform_splines(2.5, 4))),
    "nested": Sum((resting_ends(Fourier(2.5, 4)), Sum((Fourier(2.5, 1), uniform_splines(2.5, 1))))),
    "resting": resting_ends(resting_ends(uniform_splines(2.5, 9))),
}


def motion(basis: Basis, seed: int = 0) -> Trajectory:
    coefficients = np.random.default_rng(seed).normal(size=(basis.size, 2))
    return Trajectory(NAMES, UNITS, basis, coefficients)


def smooth(duration: float = 2.0, harmonics: int = 2) -> Trajectory:
    return motion(Fourier(duration, harmonics), 3)


@pytest.fixture(params=FAMILIES)
def trajectory(request: pytest.FixtureRequest) -> Trajectory:
    return motion(FAMILIES[request.param])


def states(found: Trajectory, t: Any) -> list[Any]:
    return [found(t, order) for order in range(4)]


# -- coefficients ------------------------------------------------------------------------------------------------------


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


Change = Callable[[dict[str, Any]], Any]


def spline_document() -> dict[str, Any]:
    return trajectory_to_json(motion(uniform_splines(2.0, 3)))


def changed(document: dict[str, Any], *path: Any, value: Any = None, drop: bool = False) -> dict[str, Any]:
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
SERIES, POINTS = FOURIER["motion"]["coefficients"]["j1"], SPLINE["motion"]["control_points"]["j1"]
KNOTS = SPLINE["motion"]["knots"]
UNLIKE = {"family": "sum", "parts": [FOURIER["motion"], trajectory_to_json(smooth(3.0))["motion"]]}


@pytest.mark.parametrize(
    ("document", "problem"),
    [
        ([], 'run.json: is no trajectory: .*begins with "echelon_trajectory": 1'),
        ({"coordinates": []}, "run.json: is no trajectory"),
        (changed(FOURIER, "echelon_trajectory", value=2), "echelon_trajectory: version 2 of the format is not known"),
        (changed(FOURIER, "echelon_trajectory", value="1"), "version '1' of the format is not known; valid is 1"),
        (changed(FOURIER, "echelon_trajectory", value=True), "version True of the format"),
        (changed(FOURIER, "units", drop=True), "run.json: the key 'units' is missing"),
        (changed(FOURIER, "units", value=["rad"]), "units: has 1 entries for 2 coordinates"),
        (changed(FOURIER, "units", 0, value="deg"), r"units\[0\]: should be 'rad' or 'm'"),
        (changed(FOURIER, "coordinates", value=["j1", "j1"]), "coordinates: 'j1' occurs twice"),
        (changed(FOURIER, "coordinates", value=[]), "coordinates: List should have at least 1 item"),
        (changed(FOURIER, "coordinates", value=["j1"]), "units: has 2 entries for 1 coordinates"),
        (
            changed(FOURIER, "motion", "coefficients", "j2", value=SERIES),
            r"motion.coefficients: 'j2' is none of the document's coordinates \['j1', 'slider'\]",
        ),
        (changed(FOURIER, "coordinates", value=["j1", "j2"]), "motion.coefficients: the coordinate 'j2' is missing"),
        (changed(FOURIER, "motion", "family", value="forier"), "motion: the family 'forier' is not known; did you"),
        (changed(FOURIER, "motion", "family", drop=True), "motion: the key 'family' is missing"),
        (changed(FOURIER, "motion", value=3), "motion: should be a valid dictionary"),
        (changed(FOURIER, "motion", "period", value=3), "motion.period: is no key of the format"),
        (changed(FOURIER, "motion", "duration", value=0), "motion.duration: should be greater than 0"),
        (changed(FOURIER, "motion", "duration", value=float("inf")), "motion.duration: should be a finite number"),
        (changed(FOURIER, "motion", "duration", value="2"), "motion.duration: should be a valid number"),
        (changed(FOURIER, "motion", "harmonics", value=0), "motion.harmonics: should be greater than or equal to 1"),
        (changed(FOURIER, "motion", "harmonics", value=3), "coefficients.j1.sin: has 2 entries; needs 3"),
        (changed(FOURIER, "motion", "harmonics", value=2.5), "motion.harmonics: should be a valid integer"),
        (changed(FOURIER, "motion", "coefficients", "j1", "cos", value=[1.0]), "j1.cos: has 1 entries; needs 2"),
        (changed(FOURIER, "motion", "coefficients", "j1", "cos", 1, value=float("nan")), r"cos\[1\]: should be a fin"),
        (changed(FOURIER, "motion", "coefficients", "j1", "constant", value=10**400), "j1.constant: should be a"),
        (changed(FOURIER, "motion", "coefficients", "j1", "sin", drop=True), "j1: the key 'sin' is missing"),
        (changed(SPLINE, "motion", "degree", value=0), "motion.degree: should be greater than or equal to 5"),
        (changed(SPLINE, "motion", "degree", value=4), "motion.degree: should be greater than or equal to 5"),
        (changed(SPLINE, "motion", "degree", value=10**9), "motion.knots: of degree 1000000000 begin"),
        (changed(SPLINE, "motion", "knots", value=KNOTS[:-1]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", value=[]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", value=[k + 1 for k in KNOTS]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "knots", 7, value=KNOTS[6]), "motion.knots: of degree 5 begin"),
        (changed(SPLINE, "motion", "control_points", "j1", value=POINTS[1:]), "j1: has 7 entries; 14 knots .* need 8"),
        (changed(SPLINE, "motion", "control_points", "j1", 0, value=None), r"j1\[0\]: should be a valid number"),
        (changed(SPLINE, "motion", "control_points", "j1", drop=True), "points: the coordinate 'j1' is missing"),
        (changed(FOURIER, "motion", value=UNLIKE), r"motion.parts\[1\]: lasts 3.0 s, the first part 2.0 s"),
        (changed(FOURIER, "motion", value=UNLIKE | {"parts": []}), "motion.parts: List should have at least 1"),
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
        (b'{"echelon_trajectory": 1, "echelon_trajectory": 1}', "the key 'echelon_trajectory' occurs twice"),
        (b'{"echelon_trajectory": ' + b"1" * 5000 + b"}", "not readable as JSON"),
        (b"", "is empty"),
    ],
)
def test_files_that_are_no_documents(text: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    path.write_bytes(text)
    with pytest.raises(InputError, match=problem):
        read_trajectory(path, NAMES, UNITS)


# -- all formats -------------------------------------------------------------------------------------------------------


def test_coefficients_read_back_in_the_order_asked_for(tmp_path: Path, trajectory: Trajectory) -> None:
    write_trajectory(trajectory, tmp_path / "run.json", 100)
    found = read_trajectory(tmp_path / "run.json", NAMES[::-1], UNITS[::-1])
    t = np.linspace(0, 2.5, 20)
    assert (found.coordinates, found.units) == (NAMES[::-1], UNITS[::-1])
    np.testing.assert_allclose(found(t), trajectory(t)[:, ::-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("suffix", SAMPLED)
def test_samples_read_back_as_the_spline_through_them(tmp_path: Path, suffix: str) -> None:
    """Also where the end is no multiple of the step, and in another order."""
    there, path = smooth(2.0037), tmp_path / f"run{suffix}"
    write_trajectory(there, path, 250)
    found = read_trajectory(path, NAMES[::-1], UNITS[::-1])
    assert found.duration == pytest.approx(2.0037, abs=1e-9)
    t = np.linspace(0, found.duration, 501)
    mine, theirs = states(found, t), states(there, t)
    # times of messages are whole nanoseconds, which accelerations see divided by the step squared
    for order, tolerance in enumerate((1e-7, 1e-5, 2e-3)):
        np.testing.assert_allclose(
            mine[order][:, ::-1], theirs[order], rtol=0, atol=tolerance * np.abs(theirs[0]).max()
        )


def test_samples_end_with_the_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Equal steps, but for a last one that is shorter; evaluated piece by piece or at once."""
    for duration, rate, last in ((2.0037, 250, 0.0037 % 0.004), (0.7, 30, 1 / 30), (2 * np.pi, 10, 2 * np.pi % 0.1)):
        there = smooth(duration)
        found = sampled(there, rate)
        np.testing.assert_allclose(np.diff(found.t)[:-1], 1 / rate, rtol=1e-9)
        assert found.t[-1] == duration
        assert found.t[-1] - found.t[-2] == pytest.approx(last, abs=1e-9)
        monkeypatch.setattr(samples_module, "_AT_ONCE", 7 * there.basis.size)
        for whole, pieces in zip(found.states, sampled(there, rate).states, strict=True):
            np.testing.assert_allclose(pieces, whole, rtol=0, atol=1e-12 * np.abs(whole).max())
        np.testing.assert_array_equal(found.states[1], there(found.t, 1))
        monkeypatch.undo()


def test_rounded_times_of_messages_contradict_nothing(tmp_path: Path) -> None:
    """Fast samples of a slow motion: whole nanoseconds alone change its accelerations by 40 %."""
    basis = uniform_splines(0.5, 1)
    t = np.linspace(0, 0.5, 30)
    points = np.linalg.lstsq(basis.values(t), np.column_stack([t + 0.01 * t**2, t]), rcond=None)[0]
    there, path = Trajectory(NAMES, UNITS, basis, points), tmp_path / "run.mcap"
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
        assert np.all(np.abs(found(t, order)).max(axis=0) <= found.basis.bounds(found.coefficients, order) + 1e-9)


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
    with pytest.raises(InputError, match="repeats: a motion that is not periodic cannot be run 2 times"):
        write_trajectory(motion(uniform_splines(2.0, 3)), path, 100, repeats=2)
    with pytest.raises(InputError, match="repeats: 0 is no number of runs"):
        write_trajectory(smooth(), path, 100, repeats=0)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("rate", "problem"),
    [
        (0, "rate: 0 Hz is no sampling rate"),
        (-5.0, "no sampling rate"),
        (float("nan"), "no sampling rate"),
        (2, "rate: 2 Hz gives 5 samples in 2 s; at least 6"),
        (1e9, r"rate: 1e\+09 Hz gives 2e\+09 samples; at most"),
    ],
)
def test_rates_that_are_wrong(rate: float, problem: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=problem):
        write_trajectory(smooth(), tmp_path / "run.csv", rate)


def test_suffixes_that_are_not_known(tmp_path: Path) -> None:
    for call in (lambda p: write_trajectory(smooth(), p, 100), lambda p: read_trajectory(p, NAMES, UNITS)):
        with pytest.raises(InputError, match=r"'.xml' names no kind.*valid are .json, .csv, .parquet, .yaml, .mcap"):
            call(tmp_path / "run.xml")
    with pytest.raises(InputError, match="no such file"):
        read_trajectory(tmp_path / "run.csv", NAMES, UNITS)
    with pytest.raises(InputError, match="cannot be written"):
        write_trajectory(smooth(), tmp_path / "missing" / "run.csv", 100)


@pytest.mark.parametrize("suffix", [".json", *SAMPLED])
def test_equal_trajectories_give_equal_files_whole(tmp_path: Path, suffix: str) -> None:
    for name in ("one", "two"):
        write_trajectory(smooth(), tmp_path / f"{name}{suffix}", 100)
    assert (tmp_path / f"one{suffix}").read_bytes() == (tmp_path / f"two{suffix}").read_bytes()
    assert len(list(tmp_path.iterdir())) == 2  # nothing temporary is left


@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize("suffix", [".json", ".parquet", ".yaml", ".mcap"])
def test_a_file_that_was_cut_off_is_one_clear_error(tmp_path: Path, suffix: str, share: float) -> None:
    path = tmp_path / f"run{suffix}"
    write_trajectory(smooth(), path, 100)
    content = path.read_bytes()
    path.write_bytes(content[: max(1, int((len(content) - 1) * share))])  # a last line break is no loss
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


@pytest.mark.parametrize(
    ("package", "suffix", "extra"),
    [("pyarrow", ".parquet", "excite"), ("mcap.writer", ".mcap", "ros"), ("rosbags.typesys", ".mcap", "ros")],
)
def test_packages_that_are_missing(
    package: str, suffix: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=rf"echelon\[{extra}\]"):
        write_trajectory(smooth(), tmp_path / f"run{suffix}", 100)


# -- tables ------------------------------------------------------------------------------------------------------------

COLUMNS = ["t", "q_j1", "q_slider", "qd_j1", "qd_slider", "qdd_j1", "qdd_slider"]


def test_csv_holds_every_digit(tmp_path: Path) -> None:
    there = smooth(1.0)
    write_trajectory(there, tmp_path / "run.csv", 300, repeats=2)
    with (tmp_path / "run.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    assert header == COLUMNS
    found = np.array(rows, dtype=float)
    t = np.arange(601) / 300
    np.testing.assert_array_equal(found, np.column_stack([t, there(t), there(t, 1), there(t, 2)]))


def test_names_with_commas_are_quoted(tmp_path: Path) -> None:
    names = ('left, "upper"', "b")
    there = Trajectory(names, UNITS, smooth().basis, smooth().coefficients)
    write_trajectory(there, tmp_path / "run.csv", 100)
    assert read_trajectory(tmp_path / "run.csv", names, UNITS).coordinates == names


def test_parquet_states_units(tmp_path: Path) -> None:
    there = smooth(1.0)
    write_trajectory(there, tmp_path / "run.parquet", 300)
    table = pq.read_table(tmp_path / "run.parquet")
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    expected = ["s", "rad", "m", "rad/s", "m/s", "rad/s²", "m/s²"]
    assert units == dict(zip(COLUMNS, expected, strict=True))
    t = np.arange(301) / 300
    expected_values = np.column_stack([t, there(t), there(t, 1), there(t, 2)])
    np.testing.assert_array_equal(np.column_stack([table[name] for name in COLUMNS]), expected_values)


def test_units_of_parquet_are_compared(tmp_path: Path) -> None:
    write_trajectory(smooth(), tmp_path / "run.parquet", 100)
    with pytest.raises(InputError, match="column 'q_slider': is in m; needs rad"):
        read_trajectory(tmp_path / "run.parquet", NAMES, ("rad", "rad"))
    t = np.arange(9.0)
    fields = [pa.field("t", pa.float64()), pa.field("j1", pa.float64(), metadata={b"unit": b"deg"})]
    pq.write_table(pa.table([t, t], schema=pa.schema(fields)), tmp_path / "own.parquet")
    with pytest.raises(InputError, match="column 'j1': is in deg; needs rad"):
        read_trajectory(tmp_path / "own.parquet", ["j1"], ["rad"])


def table(path: Path, columns: dict[str, Any]) -> Path:
    rows = zip(*columns.values(), strict=True)
    path.write_text("\n".join([",".join(columns), *(",".join(map(repr, map(float, row))) for row in rows)]) + "\n")
    return path


T = np.arange(50) / 100
WAVE, SPEED = np.sin(6 * T), 6 * np.cos(6 * T)


def wave(**others: Any) -> dict[str, Any]:
    return {"t": T + 17.5, "j1": WAVE, "slider": 1 - WAVE} | others


def without(*names: str) -> dict[str, Any]:
    return {name: values for name, values in wave().items() if name not in names}


def with_value(name: str, row: int, value: float) -> dict[str, Any]:
    values = wave()[name].copy()
    values[row] = value
    return wave(**{name: values})


@pytest.mark.parametrize("prefix", ["", "q_"])
def test_tables_of_others(tmp_path: Path, prefix: str) -> None:
    """Times start anywhere; names with a prefix or without; derivatives of some coordinates only."""
    there = wave()
    columns = {"slider": there["slider"], "t": there["t"], "j1": there["j1"]}
    columns = {name if name == "t" else prefix + name: values for name, values in columns.items()}
    path = table(tmp_path / "run.csv", columns | {"qd_slider": -SPEED})
    found = read_trajectory(path, NAMES, UNITS)
    assert found.duration == pytest.approx(0.49)
    np.testing.assert_allclose(found(T), np.column_stack([WAVE, 1 - WAVE]), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found(T, 1), np.column_stack([SPEED, -SPEED]), rtol=0, atol=1e-5)


def test_steps_need_not_be_equal(tmp_path: Path) -> None:
    t = np.sort(np.random.default_rng(0).uniform(size=300))
    found = read_trajectory(table(tmp_path / "run.csv", {"t": t, "a": np.sin(t)}), ["a"], ["rad"])
    middle = np.linspace(0.2, 0.8, 50) * found.duration
    np.testing.assert_allclose(found(middle, 2)[:, 0], -np.sin(middle + t[0]), atol=1e-4)


def test_a_coordinate_at_rest_contradicts_nothing(tmp_path: Path) -> None:
    """Differences of what is zero but for rounding say nothing."""
    rest, wobble = np.full(50, np.pi), 1e-13 * (-1.0) ** np.arange(50)
    columns = {"t": T + 1e4, "j1": rest, "slider": WAVE, "qd_j1": wobble, "qdd_j1": 0 * T, "qdd_slider": -36 * WAVE}
    found = read_trajectory(table(tmp_path / "run.csv", columns), NAMES, UNITS)
    assert np.abs(found(T, 1)[:, 0]).max() < 1e-9


@pytest.mark.parametrize(
    ("columns", "problem"),
    [
        (without("t"), "column 't': the column of times is missing; there are 'j1', 'slider'"),
        (without("slider"), "coordinate 'slider': no column 'q_slider' or 'slider'; there are 't', 'j1'"),
        (wave(j3=WAVE, tau=WAVE), "columns: there is no coordinate for 'j3', 'tau'; .* of 'j1', 'slider'"),
        (wave(qd_j3=SPEED), "columns: there is no coordinate for 'qd_j3'"),
        (
            {"t": T, "q_j1": WAVE, "slider": WAVE},
            "coordinate 'slider': no column 'q_slider' or 'slider'; there are 't', 'q_j1', 'slider'",
        ),
        (with_value("t", 7, 17.5), r"column 't', row 7: 17.5 s follows 17.56 s; times must rise"),
        (with_value("t", 7, 17.56), r"column 't', row 7: 17.56 s follows 17.56 s"),
        (with_value("t", 3, np.nan), "column 't', row 3: nan is no finite number"),
        (with_value("slider", 4, np.inf), "column 'slider', row 4: inf is no finite number"),
        (wave(qd_j1=np.where(T == 0.25, np.nan, SPEED)), "column 'qd_j1', row 25: nan is no finite"),
        ({name: values[:5] for name, values in wave().items()}, "holds 5 samples; a trajectory needs at least 6"),
        (wave(qd_j1=1.3 * SPEED), r"column 'qd_j1': its velocities are not those of the positions, .* 23 %"),
        (wave(qd_slider=SPEED), "column 'qd_slider': its velocities .* 200 %"),
        (wave(qd_slider=0 * SPEED), "column 'qd_slider': its velocities .* 100 %"),
        (wave(qdd_j1=-WAVE), "column 'qdd_j1': its accelerations are not those of the positions"),
    ],
)
def test_tables_that_are_wrong(columns: dict[str, Any], problem: str, tmp_path: Path) -> None:
    path = table(tmp_path / "run.csv", columns)
    with pytest.raises(InputError, match=rf"run\.csv: {problem}"):
        read_trajectory(path, NAMES, UNITS)


def test_small_differences_of_derivatives_are_taken(tmp_path: Path) -> None:
    found = read_trajectory(table(tmp_path / "run.csv", wave(qd_j1=1.1 * SPEED)), NAMES, UNITS)
    np.testing.assert_allclose(found(T, 1)[:, 0], SPEED, atol=1e-5)


def test_six_samples_are_enough(tmp_path: Path) -> None:
    found = read_trajectory(table(tmp_path / "run.csv", {n: v[:6] for n, v in wave().items()}), NAMES, UNITS)
    np.testing.assert_allclose(found(T[:6])[:, 0], WAVE[:6], atol=1e-14)


def test_coordinates_of_documents_are_compared(tmp_path: Path) -> None:
    path = tmp_path / "run.json"
    write_trajectory(smooth(), path, 100)
    for names, units, problem in (
        (["j1", "j2"], UNITS, "coordinates: the coordinate 'j2' is missing; there are 'j1', 'slider'"),
        (["slider"], ["m"], "coordinates: there is no coordinate for 'j1'; valid are 'slider'"),
        (NAMES, ["rad", "rad"], "units: 'slider' is in m; needs rad"),
    ):
        with pytest.raises(InputError, match=problem):
            read_trajectory(path, names, units)


# -- messages ----------------------------------------------------------------------------------------------------------


def test_yaml_is_the_message_that_ros_takes(tmp_path: Path) -> None:
    """Every field of the type and no other, numbers as numbers: what ``ros2 topic pub`` sets by name."""
    there = smooth(1.0)
    there.coefficients[:, 1] *= 1e-7  # written with exponents
    write_trajectory(there, tmp_path / "run.yaml", 300)
    message = yaml.safe_load((tmp_path / "run.yaml").read_text())
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    assert message["joint_names"] == list(NAMES)
    assert list(message) == ["header", "joint_names", "points"]
    fields = STORE.fielddefs[f"{KIND}Point"][1]
    for point in message["points"]:
        assert list(point) == [name for name, _ in fields]
        assert point["effort"] == []
        assert set(point["time_from_start"]) == {"sec", "nanosec"}
        assert all(type(value) is int for value in point["time_from_start"].values())
    t = np.arange(301) / 300
    for order, field in enumerate(("positions", "velocities", "accelerations")):
        assert all(type(value) is float for point in message["points"] for value in point[field])
        np.testing.assert_array_equal([point[field] for point in message["points"]], there(t, order))
    times = [point["time_from_start"] for point in message["points"]]
    assert [time["sec"] * 10**9 + time["nanosec"] for time in times] == [round(k * 10**9 / 300) for k in range(301)]
    assert times[-1] == {"sec": 1, "nanosec": 0}


@pytest.mark.parametrize("value", [1e-05, -3e-300, 2e22, 0.0, -5.0])
def test_numbers_of_one_digit_stay_numbers_in_yaml(value: float) -> None:
    rest = Trajectory(("a",), ("m",), Fourier(1.0, 1), np.array([[value], [0.0], [0.0]]))
    points = yaml.safe_load(yaml_text(sampled(rest, 10)))["points"]
    assert [point["positions"] for point in points] == [[value]] * 11


awkward = st.text(st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(names=st.lists(awkward, min_size=2, max_size=2, unique=True))
def test_names_of_joints_survive_yaml(names: list[str]) -> None:
    """Those that YAML would take for numbers, truth values or syntax, too."""
    text = yaml_text(sampled(Trajectory(tuple(names), UNITS, smooth().basis, smooth().coefficients), 4))
    assert yaml.safe_load(text)["joint_names"] == names


def test_names_that_yaml_would_convert() -> None:
    test_names_of_joints_survive_yaml.hypothesis.inner_test(["no", "1"])
    test_names_of_joints_survive_yaml.hypothesis.inner_test(["[a, b]: *c", "1e3"])


def test_mcap_is_read_by_the_readers_of_others(tmp_path: Path) -> None:
    there, path = smooth(1.0), tmp_path / "run.mcap"
    write_trajectory(there, path, 300)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        ((schema, channel, record),) = reader.iter_messages()
    assert (schema.name, schema.encoding, channel.message_encoding) == (KIND, "ros2msg", "cdr")
    assert channel.topic == "/joint_trajectory_controller/joint_trajectory"
    store = get_typestore(Stores.EMPTY)  # the definition in the file is enough
    store.register(get_types_from_msg(schema.data.decode(), schema.name))
    check_message(store.deserialize_cdr(record.data, KIND), there)
    with AnyReader([path]) as bag:
        ((connection, _, raw),) = bag.messages()
        check_message(bag.deserialize(raw, connection.msgtype), there)


def check_message(message: Any, there: Trajectory) -> None:
    assert (message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id) == (0, 0, "")
    assert message.joint_names == list(NAMES)
    t = np.arange(301) / 300
    for order, field in enumerate(("positions", "velocities", "accelerations")):
        np.testing.assert_array_equal([getattr(point, field) for point in message.points], there(t, order))
    times = [point.time_from_start.sec * 10**9 + point.time_from_start.nanosec for point in message.points]
    assert times == [round(k * 10**9 / 300) for k in range(301)]
    assert all(len(point.effort) == 0 for point in message.points)


def message(**others: Any) -> dict[str, Any]:
    points = [
        {"positions": [float(q), 1 - float(q)], "time_from_start": {"sec": 3 + k // 100, "nanosec": k % 100 * 10**7}}
        for k, q in enumerate(WAVE)
    ]
    return {"joint_names": list(NAMES), "points": points} | others


def test_positions_alone_make_a_message(tmp_path: Path) -> None:
    """As other programs write it: block lists, three dashes, exponents that YAML 1.1 takes for texts."""
    path = tmp_path / "run.yml"
    text = yaml.safe_dump(message()).replace("- 0.0\n", "- 0e-05\n")
    path.write_text(f"---\n{text}---\n")
    found = read_trajectory(path, NAMES, UNITS)
    assert found.duration == pytest.approx(0.49)
    np.testing.assert_allclose(found(T), np.column_stack([WAVE, 1 - WAVE]), rtol=0, atol=1e-12)


def point(k: int, **others: Any) -> dict[str, Any]:
    points = message()["points"]
    points[k] |= others
    return message(points=points)


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ([], "is no trajectory: a JointTrajectory has joint_names and points"),
        ({"points": []}, "is no trajectory"),
        (message(points=[]), "points: holds no points with positions"),
        (message(points=message()["points"][:5]), "holds 5 samples"),
        (message(points=[7]), r"points\[0\].time_from_start: needs two integers"),
        (message(joint_names=["j1", "j1"]), "joint_names: a joint occurs twice: 'j1', 'j1'"),
        (message(joint_names=["j1", "b"]), "joint_names: the coordinate 'slider' is missing; there are 'j1', 'b'"),
        (message(joint_names=[*NAMES, "j9"]), "joint_names: there is no coordinate for 'j9'; valid are 'j1', 'slider'"),
        (message(joint_names=[True, "j9"]), "joint_names: holds bool where a name is needed"),
        (point(3, positions=[1.0]), r"points\[3\].positions: holds 1 numbers; needs 2"),
        (point(3, positions=None), r"points\[3\].positions: holds 0 numbers; needs 2"),
        (point(3, positions=5.0), r"points\[3\].positions: holds no list; needs 2"),
        (point(3, positions=["x", 0]), r"points\[3\].positions: 'x' is no number"),
        (point(3, positions=[[1], 0]), r"points\[3\].positions: holds list where a number is needed"),
        (point(3, positions=[float("nan"), 0]), "column 'q_j1', point 3: nan is no finite number"),
        (point(0, velocities=[0.0, 0.0]), r"points\[1\].velocities: holds 0 numbers; needs 2"),
        (point(3, time_from_start={"sec": 3, "nanosec": 0}), "column 't', point 3: 3.0 s follows 3.02 s"),
        (point(3, time_from_start={"sec": 3}), r"points\[3\].time_from_start: needs two integers, sec and nanosec"),
        (point(3, time_from_start={"sec": 10**400, "nanosec": 0}), r"points\[3\].time_from_start: needs two integers"),
        (
            message(points=[p | {"velocities": [0.0, 0.0]} for p in message()["points"]]),
            "column 'qd_j1': its velocities are not those of the positions",
        ),
    ],
)
def test_messages_that_are_wrong(content: Any, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=rf"run\.yaml: {problem}"):
        read_trajectory(path, NAMES, UNITS)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (b"# nothing\n", "holds 0 messages; needs one"),
        (b"a: 1\n---\na: 1\n", "holds 2 messages"),
        (b"a: 1\npoints: [\n", r"not well-formed YAML: .* \(line 3\)"),
        (b"points: \xff", "not UTF-8"),
        (b"points: \x00", "not readable as YAML"),
        (b"a: !!python/object:os.system {}", "not well-formed YAML"),
        (b"[" * 100_000 + b"]" * 100_000, "nested too deeply to be a message"),
    ],
)
def test_files_that_are_no_messages(text: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_bytes(text)
    with pytest.raises(InputError, match=problem):
        read_trajectory(path, NAMES, UNITS)


def test_aliases_cannot_blow_up(tmp_path: Path) -> None:
    """Ten lists of ten of the same list, nine times: a number in name only."""
    lines = ["a0: &a0 [1, 1]", *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 30))]
    lines += ["joint_names: [j1, slider]", "points: [{positions: [*a29, *a29], time_from_start: {sec: 0, nanosec: 0}}]"]
    (tmp_path / "run.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"points\[0\].positions: holds list where a number is needed"):
        read_trajectory(tmp_path / "run.yaml", NAMES, UNITS)


def recording(path: Path, *messages: tuple[str, dict[str, Any]]) -> Path:
    """An MCAP file of JSON messages."""
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="", library="own")
        channels: dict[str, int] = {}
        for k, (topic, content) in enumerate(messages):
            if topic not in channels:
                channels[topic] = writer.register_channel(topic=topic, message_encoding="json", schema_id=0)
            writer.add_message(channels[topic], log_time=k, publish_time=k, data=json.dumps(content).encode())
        writer.finish()
    return path


def test_other_messages_of_a_recording_do_not_matter(tmp_path: Path) -> None:
    path = recording(tmp_path / "run.mcap", ("/state", {"x": 1.0}), ("/plan", message()), ("/plan", {"y": 1.0}))
    found = read_trajectory(path, NAMES, UNITS)
    np.testing.assert_allclose(found(T), np.column_stack([WAVE, 1 - WAVE]), rtol=0, atol=1e-12)


def test_a_recording_holds_one_trajectory(tmp_path: Path) -> None:
    none = recording(tmp_path / "none.mcap", ("/state", {"x": 1.0}))
    with pytest.raises(InputError, match=rf"none.mcap: holds 0 messages of the type {KIND}; needs one"):
        read_trajectory(none, NAMES, UNITS)
    two = recording(tmp_path / "two.mcap", ("/plan", message()), ("/other", message()))
    with pytest.raises(InputError, match=rf"holds 2 messages of the type {KIND} in '/other', '/plan'; needs one"):
        read_trajectory(two, NAMES, UNITS)


def test_recombined_parts_are_written_by_name() -> None:
    """No matrix of the project's own appears in a file."""
    document = trajectory_to_json(motion(Recombined(Fourier(1.0, 1), np.array([[1.0], [2.0], [0.0]]))))
    own = document["motion"]["coefficients"]["j1"]
    assert (own["sin"], own["cos"]) == ([2 * own["constant"]], [0.0])
