"""Samples of trajectories: tables and messages of ROS, our own and those of others."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from echelon.excite.files.samples import sampled, yaml_text
from echelon.excite.files.trajectory_file import read_trajectory, write_trajectory
from echelon.excite.problem.trajectory import Fourier, Trajectory
from echelon.shared.errors import InputError
from support.selection import examples
from support.trajectory_motions import KIND, NAMES, SPEED, UNITS, WAVE, T, smooth

# -- our own -----------------------------------------------------------------------------------------------------------

COLUMNS = ["t", "q_j1", "q_slider", "qd_j1", "qd_slider", "qdd_j1", "qdd_slider"]


def test_csv_holds_every_digit(tmp_path: Path) -> None:
    there = smooth(1.0)
    write_trajectory(there, tmp_path / "run.csv", 300, repeats=2)
    with (tmp_path / "run.csv").open(newline="") as stream:
        header, *rows = csv.reader(stream)
    assert header == COLUMNS
    found = np.array(rows, dtype=float)
    t = np.arange(601) / 300
    np.testing.assert_array_equal(
        found, np.column_stack([t, there(t), there(t, 1), there(t, 2)])
    )


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
    np.testing.assert_array_equal(
        np.column_stack([table[name] for name in COLUMNS]), expected_values
    )


def test_units_of_parquet_are_compared(tmp_path: Path) -> None:
    write_trajectory(smooth(), tmp_path / "run.parquet", 100)
    with pytest.raises(InputError, match="column 'q_slider': is in m; needs rad"):
        read_trajectory(tmp_path / "run.parquet", NAMES, ("rad", "rad"))
    t = np.arange(9.0)
    fields = [
        pa.field("t", pa.float64()),
        pa.field("j1", pa.float64(), metadata={b"unit": b"deg"}),
    ]
    pq.write_table(pa.table([t, t], schema=pa.schema(fields)), tmp_path / "own.parquet")
    with pytest.raises(InputError, match="column 'j1': is in deg; needs rad"):
        read_trajectory(tmp_path / "own.parquet", ["j1"], ["rad"])


# -- those of others ---------------------------------------------------------------------------------------------------


def table(path: Path, columns: dict[str, Any]) -> Path:
    rows = zip(*columns.values(), strict=True)
    path.write_text(
        "\n".join(
            [",".join(columns), *(",".join(map(repr, map(float, row))) for row in rows)]
        )
        + "\n"
    )
    return path


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
    columns = {
        name if name == "t" else prefix + name: values
        for name, values in columns.items()
    }
    path = table(tmp_path / "run.csv", columns | {"qd_slider": -SPEED})
    found = read_trajectory(path, NAMES, UNITS)
    assert found.duration == pytest.approx(0.49)
    np.testing.assert_allclose(
        found(T), np.column_stack([WAVE, 1 - WAVE]), rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        found(T, 1), np.column_stack([SPEED, -SPEED]), rtol=0, atol=1e-5
    )


def test_steps_need_not_be_equal(tmp_path: Path) -> None:
    t = np.sort(np.random.default_rng(0).uniform(size=300))
    found = read_trajectory(
        table(tmp_path / "run.csv", {"t": t, "a": np.sin(t)}), ["a"], ["rad"]
    )
    middle = np.linspace(0.2, 0.8, 50) * found.duration
    np.testing.assert_allclose(
        found(middle, 2)[:, 0], -np.sin(middle + t[0]), atol=1e-4
    )


def test_a_coordinate_at_rest_contradicts_nothing(tmp_path: Path) -> None:
    """Differences of what is zero but for rounding say nothing."""
    rest, wobble = np.full(50, np.pi), 1e-13 * (-1.0) ** np.arange(50)
    columns = {
        "t": T + 1e4,
        "j1": rest,
        "slider": WAVE,
        "qd_j1": wobble,
        "qdd_j1": 0 * T,
        "qdd_slider": -36 * WAVE,
    }
    found = read_trajectory(table(tmp_path / "run.csv", columns), NAMES, UNITS)
    assert np.abs(found(T, 1)[:, 0]).max() < 1e-9


@pytest.mark.parametrize(
    ("columns", "problem"),
    [
        (
            without("t"),
            "column 't': the column of times is missing; there are 'j1', 'slider'",
        ),
        (
            without("slider"),
            "coordinate 'slider': no column 'q_slider' or 'slider'; there are 't', 'j1'",
        ),
        (
            wave(j3=WAVE, tau=WAVE),
            "columns: there is no coordinate for 'j3', 'tau'; .* of 'j1', 'slider'",
        ),
        (wave(qd_j3=SPEED), "columns: there is no coordinate for 'qd_j3'"),
        (
            {"t": T, "q_j1": WAVE, "slider": WAVE},
            "coordinate 'slider': no column 'q_slider' or 'slider'; there are 't', 'q_j1', 'slider'",
        ),
        (
            with_value("t", 7, 17.5),
            r"column 't', row 7: 17.5 s follows 17.56 s; times must rise",
        ),
        (with_value("t", 7, 17.56), r"column 't', row 7: 17.56 s follows 17.56 s"),
        (with_value("t", 3, np.nan), "column 't', row 3: nan is not a finite number"),
        (
            with_value("slider", 4, np.inf),
            "column 'slider', row 4: inf is not a finite number",
        ),
        (
            wave(qd_j1=np.where(T == 0.25, np.nan, SPEED)),
            "column 'qd_j1', row 25: nan is not a finite",
        ),
        (
            {name: values[:5] for name, values in wave().items()},
            "holds 5 samples; a trajectory needs at least 6",
        ),
        (
            wave(qd_j1=1.3 * SPEED),
            r"column 'qd_j1': its velocities differ from the derivatives of its positions by 23 %",
        ),
        (wave(qd_slider=SPEED), "column 'qd_slider': its velocities .* 200 %"),
        (wave(qd_slider=0 * SPEED), "column 'qd_slider': its velocities .* 100 %"),
        (
            wave(qdd_j1=-WAVE),
            "column 'qdd_j1': its accelerations differ from the derivatives of its positions",
        ),
    ],
)
def test_tables_that_are_wrong(
    columns: dict[str, Any], problem: str, tmp_path: Path
) -> None:
    path = table(tmp_path / "run.csv", columns)
    with pytest.raises(InputError, match=rf"run\.csv: {problem}"):
        read_trajectory(path, NAMES, UNITS)


def test_small_differences_of_derivatives_are_taken(tmp_path: Path) -> None:
    found = read_trajectory(
        table(tmp_path / "run.csv", wave(qd_j1=1.1 * SPEED)), NAMES, UNITS
    )
    np.testing.assert_allclose(found(T, 1)[:, 0], SPEED, atol=1e-5)


def test_six_samples_are_enough(tmp_path: Path) -> None:
    found = read_trajectory(
        table(tmp_path / "run.csv", {n: v[:6] for n, v in wave().items()}), NAMES, UNITS
    )
    np.testing.assert_allclose(found(T[:6])[:, 0], WAVE[:6], atol=1e-14)


STORE = get_typestore(Stores.ROS2_HUMBLE)


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
        assert all(
            type(value) is float
            for point in message["points"]
            for value in point[field]
        )
        np.testing.assert_array_equal(
            [point[field] for point in message["points"]], there(t, order)
        )
    times = [point["time_from_start"] for point in message["points"]]
    assert [time["sec"] * 10**9 + time["nanosec"] for time in times] == [
        round(k * 10**9 / 300) for k in range(301)
    ]
    assert times[-1] == {"sec": 1, "nanosec": 0}


@pytest.mark.parametrize("value", [1e-05, -3e-300, 2e22, 0.0, -5.0])
def test_numbers_of_one_digit_stay_numbers_in_yaml(value: float) -> None:
    rest = Trajectory(
        ("a",), ("m",), Fourier(1.0, 1), np.array([[value], [0.0], [0.0]])
    )
    points = yaml.safe_load(yaml_text(sampled(rest, 10)))["points"]
    assert [point["positions"] for point in points] == [[value]] * 11


awkward = st.text(
    st.characters(exclude_categories=["Cs", "Cc"]), min_size=1, max_size=8
)


@examples(60)
@given(names=st.lists(awkward, min_size=2, max_size=2, unique=True))
def test_names_of_joints_survive_yaml(names: list[str]) -> None:
    """Names that YAML would take for numbers, truth values or syntax are quoted."""
    text = yaml_text(
        sampled(
            Trajectory(tuple(names), UNITS, smooth().basis, smooth().coefficients), 4
        )
    )
    assert yaml.safe_load(text)["joint_names"] == names


def test_names_that_yaml_would_convert() -> None:
    test_names_of_joints_survive_yaml.hypothesis.inner_test(["no", "1"])
    test_names_of_joints_survive_yaml.hypothesis.inner_test(["[a, b]: *c", "1e3"])


def message(**others: Any) -> dict[str, Any]:
    points = [
        {
            "positions": [float(q), 1 - float(q)],
            "time_from_start": {"sec": 3 + k // 100, "nanosec": k % 100 * 10**7},
        }
        for k, q in enumerate(WAVE)
    ]
    return {"joint_names": list(NAMES), "points": points} | others


def point(k: int, **others: Any) -> dict[str, Any]:
    points = message()["points"]
    points[k] |= others
    return message(points=points)


def test_positions_alone_make_a_message(tmp_path: Path) -> None:
    """As other programs write it: block lists, three dashes, exponents that YAML 1.1 takes for texts."""
    path = tmp_path / "run.yml"
    text = yaml.safe_dump(message()).replace("- 0.0\n", "- 0e-05\n")
    path.write_text(f"---\n{text}---\n")
    found = read_trajectory(path, NAMES, UNITS)
    assert found.duration == pytest.approx(0.49)
    np.testing.assert_allclose(
        found(T), np.column_stack([WAVE, 1 - WAVE]), rtol=0, atol=1e-12
    )


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ([], "not a JointTrajectory with joint_names and points"),
        ({"points": []}, "joint_names: not a JointTrajectory"),
        (message(points=[]), "points: holds no points with positions"),
        (message(points=message()["points"][:5]), "holds 5 samples"),
        (message(points=[7]), "points.0: not a JointTrajectory"),
        (
            message(joint_names=["j1", "j1"]),
            "joint_names: a joint occurs twice: 'j1', 'j1'",
        ),
        (
            message(joint_names=["j1", "b"]),
            "joint_names: the coordinate 'slider' is missing; there are 'j1', 'b'",
        ),
        (
            message(joint_names=[*NAMES, "j9"]),
            "joint_names: there is no coordinate for 'j9'; valid are 'j1', 'slider'",
        ),
        (
            message(joint_names=[["j1"], "j9"]),
            "joint_names.0: .* needs a text",
        ),
        (point(3, positions=[1.0]), r"points\[3\].positions: holds 1 numbers; needs 2"),
        (point(3, positions=[]), r"points\[3\].positions: holds 0 numbers; needs 2"),
        (point(3, positions=5.0), "points.3.positions: .* needs a list"),
        (
            point(3, positions=["x", 0]),
            "points.3.positions.0: .* needs a (finite )?number",
        ),
        (
            point(3, positions=[[1], 0]),
            "points.3.positions.0: .* needs a (finite )?number",
        ),
        (
            point(3, positions=[float("nan"), 0]),
            "points.3.positions.0: .* needs a (finite )?number",
        ),
        (
            point(0, velocities=[0.0, 0.0]),
            r"points\[1\].velocities: holds 0 numbers; needs 2",
        ),
        (
            point(3, time_from_start={"sec": 3, "nanosec": 0}),
            "column 't', point 3: 3.0 s follows 3.02 s",
        ),
        (
            point(3, time_from_start={"sec": 3}),
            "points.3.time_from_start.nanosec: .* missing",
        ),
        (
            point(3, time_from_start={"sec": 10**400, "nanosec": 0}),
            "points.3.time_from_start.sec: .* less than",
        ),
        (
            message(
                points=[p | {"velocities": [0.0, 0.0]} for p in message()["points"]]
            ),
            "column 'qd_j1': its velocities differ from the derivatives of its positions",
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
        (b"a: 1\npoints: [\n", r"not well-formed YAML: .* \(line 2, column 1\)"),
        (b"points: \xff", "not UTF-8"),
        (b"points: \x00", "not readable as YAML"),
        (
            b"a: !!python/object:os.system {}",
            "tags such as !!python/object:os.system are not accepted",
        ),
        (b"[" * 100_000 + b"]" * 100_000, "nested too deeply to be a document"),
    ],
)
def test_files_that_are_no_messages(text: bytes, problem: str, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_bytes(text)
    with pytest.raises(InputError, match=problem):
        read_trajectory(path, NAMES, UNITS)


def test_aliases_cannot_blow_up(tmp_path: Path) -> None:
    """Ten lists of ten of the same list, nine times: a number in name only."""
    lines = [
        "a0: &a0 [1, 1]",
        *(f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 10)}]" for k in range(1, 30)),
    ]
    lines += [
        "joint_names: [j1, slider]",
        "points: [{positions: [*a29, *a29], time_from_start: {sec: 0, nanosec: 0}}]",
    ]
    (tmp_path / "run.yaml").write_text("\n".join(lines))
    with pytest.raises(InputError, match=r"aliases .* are not accepted"):
        read_trajectory(tmp_path / "run.yaml", NAMES, UNITS)
