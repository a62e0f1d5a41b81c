"""Files of logs: what was written is read, in pieces or whole, and what cannot be read is named."""

from __future__ import annotations

import contextlib
import datetime
import decimal
import gzip
import shutil
import sys
import tracemalloc
from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from echelon.identification.logs.files.open_log import log_paths, open_log, read_table
from echelon.identification.logs.files.parquet_file import ParquetFile
from echelon.shared.errors import InputError, MissingExtraError
from support.log_tables import joined, same, text
from support.measured_logs import measured

RANDOM = np.random.default_rng(5)
SAMPLES = {
    name: RANDOM.normal(size=500) * 10.0**exponent
    for exponent, name in enumerate(("t", "q1", "q2", "tau"))
}


def write(path: Path, columns: Mapping[str, npt.NDArray[np.float64]] = SAMPLES) -> Path:
    """The columns in the format that the name says."""
    match path.suffix:
        case ".parquet":
            pq.write_table(pa.table(dict(columns)), path, row_group_size=130)
        case ".npz":
            np.savez_compressed(path, **columns)
        case ".npy":
            np.save(
                path, np.rec.fromarrays(list(columns.values()), names=list(columns))
            )
        case ".h5":
            with h5py.File(path, "w", track_order=True) as file:
                for name, values in columns.items():
                    file.create_dataset(name, data=values, compression="gzip")
        case ".mat":
            scipy.io.savemat(path, dict(columns), do_compression=True)
        case _:
            rows = [
                ",".join(columns),
                *(
                    ",".join(map(repr, row))
                    for row in np.column_stack([*columns.values()]).tolist()
                ),
            ]
            content = "\n".join(rows).encode() + b"\n"
            path.write_bytes(
                gzip.compress(content) if path.suffix == ".gz" else content
            )
    return path


FORMATS = [
    "run.csv",
    "run.csv.gz",
    "run.parquet",
    "run.npz",
    "run.npy",
    "run.mat",
    "run.h5",
]


@pytest.mark.parametrize("name", FORMATS)
def test_round_trip_whole_and_in_pieces(name: str, tmp_path: Path) -> None:
    path = write(tmp_path / name)
    log = open_log(path)
    assert log.names == tuple(SAMPLES)
    assert log.source == str(path)
    same(joined(log), SAMPLES)
    same(joined(log, rows=77), SAMPLES)
    same(
        joined(log, ["tau", "t"], rows=100), {"tau": SAMPLES["tau"], "t": SAMPLES["t"]}
    )
    same(read_table(path).columns, SAMPLES)
    same(read_table(path, ["q1"]).columns, {"q1": SAMPLES["q1"]})
    assert read_table(path, []).columns == {}


@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_column_suggests_the_nearest(name: str, tmp_path: Path) -> None:
    log = open_log(write(tmp_path / name))
    with pytest.raises(
        InputError,
        match=r"run\.\S+: column 'tua': no such column; did you mean 'tau'\? \(valid: t, q1",
    ):
        list(log.tables(["t", "tua"]))


@pytest.mark.parametrize("name", FORMATS[1:])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.999])
def test_a_file_that_was_cut_off_is_one_clear_error(
    name: str, share: float, tmp_path: Path
) -> None:
    path = write(tmp_path / name)
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(InputError, match=r"run\.") as caught:
        read_table(path)
    assert "\n" not in str(caught.value)
    assert any(word in str(caught.value) for word in ("damaged", "cut off"))


@pytest.mark.parametrize("name", FORMATS)
def test_no_damage_gets_past_the_reader_as_another_error(
    name: str, tmp_path: Path
) -> None:
    content = bytearray(write(tmp_path / name).read_bytes())
    for seed in range(25):
        random = np.random.default_rng(seed)
        damaged = bytearray(content)
        for place in (
            *random.integers(len(content), size=3),
            *random.integers(min(200, len(content)), size=2),
        ):
            damaged[place] = int(random.integers(256))
        with contextlib.suppress(
            InputError
        ):  # damage that hits nothing of importance may pass
            read_table(text(tmp_path, bytes(damaged), name))


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_no_file_with_content(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / name
    with pytest.raises(InputError, match="no such file"):
        open_log(path)
    path.touch()
    with pytest.raises(InputError, match="is empty"):
        open_log(path)
    path.unlink()
    path.mkdir()
    with pytest.raises(InputError, match="is a directory"):
        open_log(path)
    path.rmdir()
    write(path)

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match=r"run.*: cannot be read: Permission denied"):
        open_log(path)


def test_a_missing_file_suggests_its_neighbour(tmp_path: Path) -> None:
    write(tmp_path / "run_1.csv")
    with pytest.raises(
        InputError, match=r"run_l\.csv: no such file; did you mean 'run_1\.csv'\?"
    ):
        open_log(tmp_path / "run_l.csv")
    with pytest.raises(InputError, match="cannot be read"):
        open_log("a\0b.csv")


# -- Parquet -----------------------------------------------------------------------------------------------------------


def test_types_of_parquet_columns(tmp_path: Path) -> None:
    start = 1_700_000_000_123_456_789
    columns: dict[str, tuple[pa.Array, dict[str, list[float]]]] = {
        "int": (pa.array([1, None, -3], pa.int16()), {"int": [1, np.nan, -3]}),
        "large": (pa.array([2**63, 1, 0], pa.uint64()), {"large": [2.0**63, 1, 0]}),
        "half": (pa.array(np.array([0.5, 1, 2], np.float16)), {"half": [0.5, 1, 2]}),
        "flag": (pa.array([True, False, None]), {"flag": [1, 0, np.nan]}),
        "decimal": (pa.array([decimal.Decimal("1.25")] * 3), {"decimal": [1.25] * 3}),
        "stamp": (
            pa.array([start, start + 1000, start + 10**9], pa.timestamp("ns", "UTC")),
            {"stamp": [0.123456789, 0.123457789, 1.123456789]},
        ),
        "second": (
            pa.array([1_700_000_001] * 3, pa.timestamp("s")),
            {"second": [1] * 3},
        ),
        "day": (pa.array([datetime.date(2023, 11, 15)] * 3), {"day": [6400] * 3}),
        "span": (
            pa.array([1, 2, 3], pa.duration("ms")),
            {"span": [0.001, 0.002, 0.003]},
        ),
        "clock": (
            pa.array([1, 2, 3], pa.time32("ms")),
            {"clock": [0.001, 0.002, 0.003]},
        ),
        "level": (
            pa.array([1.5, 2.5, 1.5]).dictionary_encode(),
            {"level": [1.5, 2.5, 1.5]},
        ),
        "nothing": (pa.nulls(3), {"nothing": [np.nan] * 3}),
        "list": (
            pa.array([[1, 2], None, [5, 6]]),
            {"list[0]": [1, np.nan, 5], "list[1]": [2, np.nan, 6]},
        ),
        "fixed": (
            pa.array([[1.5, 2], [3, 4], None], pa.list_(pa.float32(), 2)),
            {"fixed[0]": [1.5, 3, np.nan], "fixed[1]": [2, 4, np.nan]},
        ),
        "pose": (
            pa.array([{"x": 1, "r": {"w": 2.5}}, None, {"x": 3, "r": None}]),
            {"pose.x": [1, np.nan, 3], "pose.r.w": [2.5, np.nan, np.nan]},
        ),
        "matrix": (
            pa.array([[[1, 2]]] * 3),
            {"matrix[0][0]": [1] * 3, "matrix[0][1]": [2] * 3},
        ),
        "a.b": (pa.array([7, 8, 9]), {"a.b": [7, 8, 9]}),
    }
    path = tmp_path / "types.parquet"
    pq.write_table(
        pa.table({name: array for name, (array, _) in columns.items()}), path
    )
    log = ParquetFile(path)
    assert log.origin == start // 10**9
    same(
        joined(log),
        {
            name: values
            for _, expected in columns.values()
            for name, values in expected.items()
        },
    )
    for _, expected in columns.values():
        same(joined(log, list(expected), rows=2), expected)


def test_parquet_columns_without_numbers_only_fail_when_asked_for(
    tmp_path: Path,
) -> None:
    path = tmp_path / "run.parquet"
    table = pa.table({
        "t": [0.0, 1.0], "mode": ["a", "b"], "ragged": [[1], [1, 2]], "empty": pa.array([[], []], pa.list_(pa.int8())),
        "wide": [[0] * 1000] * 2,
    })  # fmt: skip
    pq.write_table(table, path)
    log = ParquetFile(path)
    same(joined(log), {"t": [0, 1]})
    for name, problem in {
        "mode": "holds string, not numbers",
        "ragged": r"holds lists of different lengths \(1 and 2\)",
        "ragged[0]": "holds lists of different lengths",
        "empty": "holds empty lists",
        "wide[3]": "holds lists of 1000 entries; at most 256 become columns",
    }.items():
        with pytest.raises(
            InputError,
            match=rf"run\.parquet: column '{name.split('[')[0]}.*': {problem}",
        ):
            list(log.tables([name]))


def test_a_list_that_changes_its_length_is_named_by_row(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pq.write_table(
        pa.table({"q": [[1.0, 2.0]] * 40 + [[1.0]] + [[1.0, 2.0]] * 9}), path
    )
    with pytest.raises(
        InputError,
        match=r"column 'q\[0\]', row 40: a list of 1 entries where others have 2",
    ):
        joined(ParquetFile(path), rows=16)


def test_parquet_without_rows_or_numbers(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"t": pa.array([], pa.float64())}), path)
    with pytest.raises(InputError, match="holds no rows"):
        ParquetFile(path)
    pq.write_table(pa.table({"mode": ["a"]}), path)
    with pytest.raises(InputError, match="none of its columns holds numbers"):
        ParquetFile(path)


def test_parquet_needs_pyarrow(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "run.parquet")
    monkeypatch.delitem(sys.modules, "echelon.identification.logs.files.parquet_file")
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(
        MissingExtraError, match=r"pyarrow.*echelon-robotics\[identify\]"
    ):
        open_log(path)


def test_parquet_streams_in_constant_memory(tmp_path: Path) -> None:
    """The memory that pyarrow and numpy hold does not grow with the rows, not even in a single row group."""
    peaks = []
    before = pa.default_memory_pool()
    for rows in (1 << 17, 1 << 20):
        path = tmp_path / f"{rows}.parquet"
        values = np.random.default_rng(rows).normal(size=rows)
        pq.write_table(
            pa.table({f"c{k}": values + k for k in range(6)}), path, row_group_size=rows
        )
        pool = pa.proxy_memory_pool(before)
        pa.set_memory_pool(pool)
        tracemalloc.start()
        try:
            assert (
                sum(
                    len(piece.columns["c3"])
                    for piece in ParquetFile(path).tables(rows=1 << 14)
                )
                == rows
            )
            peaks.append(pool.max_memory() + tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
            pa.set_memory_pool(before)
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[1] < path.stat().st_size / 2


@pytest.mark.parametrize(
    "file", ["emps/data_emps_pulses.parquet", "staubli_tx40/tx40_5kHz.parquet"]
)
def test_real_logs(file: str, tmp_path: Path) -> None:
    """Parquet and text give the numbers that pyarrow reads."""
    path = measured(file)
    content = pq.read_table(path).slice(0, 5000)
    expected = {
        name: content.column(name).to_numpy().astype(float)
        for name in content.column_names
    }
    found = read_table(path).columns
    same({name: values[:5000] for name, values in found.items()}, expected)
    rows = np.column_stack(list(expected.values()))
    np.savetxt(tmp_path / "run.txt", rows, fmt="%.17g", header=" ".join(expected))
    same(read_table(tmp_path / "run.txt").columns, expected)


# -- logs of any kind --------------------------------------------------------------------------------------------------


def test_content_goes_before_names(tmp_path: Path) -> None:
    write(tmp_path / "run.parquet").rename(tmp_path / "run.csv")
    assert isinstance(open_log(tmp_path / "run.csv"), ParquetFile)
    for content, name, problem in [
        (
            b"#ROSBAG V2.0\n",
            "run.bag",
            "cannot be read as a ROS bag; it is damaged or was cut off",
        ),
        (
            b"PK\x03\x04".ljust(30) + b"[Content_Types].xml",
            "run.xlsx",
            "is a spreadsheet; save it as CSV",
        ),
        (b"{}", "run.json", r"its kind is not known; valid are \.csv"),
        (b"0,1\n", "run.parquet.gz", r"its kind is not known; valid are \.csv"),
    ]:
        with pytest.raises(InputError, match=problem):
            open_log(text(tmp_path, content, name))


def test_logs_of_a_directory(tmp_path: Path) -> None:
    for name in ("run10.csv", "run2.csv", "run1.csv.gz", "Run 3.tsv"):
        write(tmp_path / name)
    text(tmp_path, "about", "README.md")
    text(tmp_path, "0,1", ".hidden.parquet")
    (tmp_path / "plots").mkdir()
    found = log_paths(tmp_path)
    assert [path.name for path in found] == [
        "Run 3.tsv",
        "run1.csv.gz",
        "run2.csv",
        "run10.csv",
    ]
    assert log_paths(found[0]) == [found[0]]
    with pytest.raises(
        InputError,
        match=r"is a directory, not a log; name a file in it, such as Run 3\.tsv",
    ):
        open_log(tmp_path)
    write(tmp_path / "run4.npz")
    with pytest.raises(
        InputError,
        match=r"several kinds: CSV \(.*\), NumPy \(run4\.npz\)|several kinds: NumPy",
    ):
        log_paths(tmp_path)
    with pytest.raises(InputError, match="is a directory without logs"):
        log_paths(tmp_path / "plots")
    with pytest.raises(InputError, match="no such file"):
        log_paths(tmp_path / "other")
    shutil.rmtree(tmp_path / "plots")
