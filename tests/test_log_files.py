"""Files of logs: what was written is read, in pieces or whole, and what cannot be read is named."""

from __future__ import annotations

import contextlib
import datetime
import decimal
import gzip
import os
import shutil
import sys
import tracemalloc
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.sparse import issparse

from echelon.errors import InputError, MissingExtraError
from echelon.logs.files.csv import CsvFile
from echelon.logs.files.mat import MatFile
from echelon.logs.files.mat_elements import Group, Unread, Value, variables
from echelon.logs.files.npz import NpzFile
from echelon.logs.files.open import log_paths, open_log, read_table
from echelon.logs.files.parquet import ParquetFile
from echelon.logs.table import LogFile

ROOT = Path(__file__).parent.parent
DATA = Path(os.environ.get("ECHELON_DATA", ROOT.parent / "shared" / "data"))
RANDOM = np.random.default_rng(5)
MATLAB = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"
SAMPLES = {name: RANDOM.normal(size=500) * 10.0**exponent for exponent, name in enumerate(("t", "q1", "q2", "tau"))}


@pytest.fixture(params=["pyarrow", "numpy"])
def parser(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """Text is parsed with pyarrow, and as if it were not installed."""
    if request.param == "numpy":
        monkeypatch.setitem(sys.modules, "pyarrow", None)
    return str(request.param)


def text(directory: Path, content: str | bytes, name: str = "run.csv") -> Path:
    path = directory / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def joined(log: LogFile, names: list[str] | None = None, rows: int = 1 << 17) -> dict[str, npt.NDArray[np.float64]]:
    """All pieces of a log, after checking that each is as long as it may be and begins where the last one ended."""
    pieces = list(log.tables(names, rows))
    first = 0
    for piece in pieces:
        lengths = {len(values) for values in piece.columns.values()}
        assert len(lengths) == 1
        assert piece.first == first
        (length,) = lengths
        assert 0 < length <= rows
        first += length
    return {name: np.concatenate([piece.columns[name] for piece in pieces]) for name in pieces[0].columns}


def same(found: Mapping[str, npt.ArrayLike], expected: Mapping[str, npt.ArrayLike]) -> None:
    assert list(found) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


def write(path: Path, columns: Mapping[str, npt.NDArray[np.float64]] = SAMPLES) -> Path:
    """The columns in the format that the name says."""
    match path.suffix:
        case ".parquet":
            pq.write_table(pa.table(dict(columns)), path, row_group_size=130)
        case ".npz":
            np.savez_compressed(path, **columns)
        case ".npy":
            np.save(path, np.rec.fromarrays(list(columns.values()), names=list(columns)))
        case ".mat":
            scipy.io.savemat(path, dict(columns), do_compression=True)
        case _:
            rows = [
                ",".join(columns),
                *(",".join(map(repr, row)) for row in np.column_stack([*columns.values()]).tolist()),
            ]
            content = "\n".join(rows).encode() + b"\n"
            path.write_bytes(gzip.compress(content) if path.suffix == ".gz" else content)
    return path


FORMATS = ["run.csv", "run.csv.gz", "run.parquet", "run.npz", "run.npy", "run.mat"]


@pytest.mark.parametrize("name", FORMATS)
def test_round_trip_whole_and_in_pieces(name: str, tmp_path: Path) -> None:
    path = write(tmp_path / name)
    log = open_log(path)
    assert log.names == tuple(SAMPLES)
    assert log.source == str(path)
    same(joined(log), SAMPLES)
    same(joined(log, rows=77), SAMPLES)
    same(joined(log, ["tau", "t"], rows=100), {"tau": SAMPLES["tau"], "t": SAMPLES["t"]})
    same(read_table(path).columns, SAMPLES)
    same(read_table(path, ["q1"]).columns, {"q1": SAMPLES["q1"]})
    assert read_table(path, []).columns == {}


@pytest.mark.parametrize("name", FORMATS)
def test_a_missing_column_suggests_the_nearest(name: str, tmp_path: Path) -> None:
    log = open_log(write(tmp_path / name))
    with pytest.raises(
        InputError, match=r"run\.\S+: column 'tua': no such column; did you mean 'tau'\? \(valid: t, q1"
    ):
        list(log.tables(["t", "tua"]))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.999])
def test_a_file_that_was_cut_off_is_one_clear_error(name: str, share: float, tmp_path: Path) -> None:
    path = write(tmp_path / name)
    content = path.read_bytes()
    cut = content[: int(len(content) * share)]
    path.write_bytes(cut.rpartition(b"\n")[0] + b"\n1.5" if name == "run.csv" else cut)
    with pytest.raises(InputError, match=r"run\.") as caught:
        read_table(path)
    assert "\n" not in str(caught.value)
    assert any(word in str(caught.value) for word in ("damaged", "cut off", "has 1 cell where the file has 4"))


@pytest.mark.parametrize("name", FORMATS)
def test_no_damage_gets_past_the_reader_as_another_error(name: str, tmp_path: Path) -> None:
    content = bytearray(write(tmp_path / name).read_bytes())
    for seed in range(25):
        random = np.random.default_rng(seed)
        damaged = bytearray(content)
        for place in (*random.integers(len(content), size=3), *random.integers(min(200, len(content)), size=2)):
            damaged[place] = int(random.integers(256))
        with contextlib.suppress(InputError):  # damage that hits nothing of importance may pass
            read_table(text(tmp_path, bytes(damaged), name))


@pytest.mark.parametrize("name", FORMATS)
def test_what_is_no_file_with_content(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
    with pytest.raises(InputError, match=r"run_l\.csv: no such file; did you mean 'run_1\.csv'\?"):
        open_log(tmp_path / "run_l.csv")
    with pytest.raises(InputError, match="cannot be read"):
        open_log("a\0b.csv")


# -- text --------------------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("t,q\n0,1.5\n1,-2e-3\n", {"t": [0, 1], "q": [1.5, -0.002]}),
        ("0,1.5\n1,2\n", {"0": [0, 1], "1": [1.5, 2]}),
        ("0,1.5\n1,2", {"0": [0, 1], "1": [1.5, 2]}),
        ("t;q\r\n0,25;1,5\r\n1;2\r\n", {"t": [0.25, 1], "q": [1.5, 2]}),
        ("t;q\n0.25;1.5\n", {"t": [0.25], "q": [1.5]}),
        ("t\tq\n0,5\t1\n", {"t": [0.5], "q": [1]}),
        ("t q\n  0   1.5\n 1\t2 \n", {"t": [0, 1], "q": [1.5, 2]}),
        ("1,5 2,5\n3,5 4\n", {"0": [1.5, 3.5], "1": [2.5, 4]}),
        ("\ufefft,q\n0,1\n", {"t": [0], "q": [1]}),
        ("\ufeff0,1\n2,3\n", {"0": [0, 2], "1": [1, 3]}),
        ('"time, s","joint ""1"""\n0,"1.5"\n', {"time, s": [0], 'joint "1"': [1.5]}),
        ('time "joint 1"\n0 1.5\n', {"time": [0], "joint 1": [1.5]}),
        ("# a log\n#\n# t q\n0 1\n", {"t": [0], "q": [1]}),
        ("# recorded today by me\n0 1\n", {"0": [0], "1": [1]}),
        ("# robot\nt,q\n0,1\n# pause\n\n1,2\n", {"t": [0, 1], "q": [1, 2]}),
        ("t,q\n0,\n1,nan\n2,NA\n,3\n", {"t": [0, 1, 2, np.nan], "q": [np.nan, np.nan, np.nan, 3]}),
        ("t,on\n0,true\n1,False\n", {"t": [0, 1], "on": [1, 0]}),
        ("t,q\n0,inf\n1,-Infinity\n+2,+.5\n", {"t": [0, 1, 2], "q": [np.inf, -np.inf, 0.5]}),
        ("t,,q\n0,1,2\n", {"t": [0], "1": [1], "q": [2]}),
        ("q\n1.5\n\n2.5\n", {"q": [1.5, 2.5]}),
        ("1.5\n2.5\n", {"0": [1.5, 2.5]}),
    ],
)
def test_layouts_of_text(content: str, expected: dict[str, list[float]], tmp_path: Path) -> None:
    log = CsvFile(text(tmp_path, content))
    assert log.names == tuple(expected)
    same(joined(log), expected)
    same(joined(log, rows=1), expected)


@pytest.mark.usefixtures("parser")
@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("t,q\n0,1\n1,AUTO\n", r"line 3, column 'q': 'AUTO' is no number"),
        (
            "t,q\n2026-03-01 12:00:00,1\n",
            r"column 't': '2026-03-01 12:00:00' is no number; times have to be in seconds",
        ),
        ("t,q\n0,1_000\n", r"line 2, column 'q': '1_000' is no number"),
        ("t,q\n0,0x10\n", r"line 2, column 'q': '0x10' is no number"),
        ("t;q\n0;1.234,5\n", r"line 2, column 'q': '1.234,5' is no number"),
        ("# log\nt,q\n0,1\n\n2\n", r"line 5: has 1 cell where the file has 2 columns"),
        ("t,q\n0,1\n0,1,\n", r"line 3: has 3 cells where the file has 2 columns"),
        ("t q\n0 1\n0 1 2\n", r"line 3: has 3 cells where the file has 2 columns"),
        ("t,q,t\n0,1,2\n", r"line 1, column 't': columns 0 and 2 have the same name"),
        ("t,q\n", "holds the names of columns but no numbers"),
        ("# nothing\n\n", "holds no numbers: all lines are blank or comments"),
        ("t,q\n0,1\n".encode("utf-16"), "is UTF-16 text; save it as UTF-8"),
        ("t,Gelenk °\n0,1\n".encode("latin-1"), r"line 1: byte 0xb0 is no UTF-8 text"),
        (b"t,q\n0,1\n\0\0", "is no text"),
        ("t,q\r0,1\r", "carriage returns inside lines"),
        ("1" * (2 << 20), "a line is longer than 1 MB"),
    ],
)
def test_text_that_is_no_log(content: str | bytes, problem: str, tmp_path: Path) -> None:
    path = text(tmp_path, content)
    with pytest.raises(InputError, match=problem) as caught:
        read_table(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.usefixtures("parser")
def test_text_that_nobody_asks_for_may_stand_beside_numbers(tmp_path: Path) -> None:
    path = text(tmp_path, "t,mode,q\n" + "".join(f"{k},AUTO,{k / 8}\n" for k in range(100)))
    same(read_table(path, ["q", "t"]).columns, {"q": np.arange(100) / 8, "t": np.arange(100)})
    with pytest.raises(InputError, match=r"line 2, column 'mode': 'AUTO' is no number"):
        read_table(path)


@pytest.mark.usefixtures("parser")
def test_lines_are_counted_over_pieces(tmp_path: Path) -> None:
    path = text(tmp_path, "# log\nt,q\n" + "0,1\n" * 50 + "# pause\n" + "0,1\n" * 20 + "0,x\n")
    with pytest.raises(InputError, match=r"line 74, column 'q': 'x' is no number"):
        list(CsvFile(path).tables(rows=7))


NUMBERS = st.floats(allow_nan=True, allow_infinity=True) | st.integers(-(10**30), 10**30)
STYLES = {"repr": repr, "short": lambda value: f"{value:.3g}", "exponent": lambda value: f"{value:+.17E}"}


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    rows=st.lists(st.tuples(NUMBERS, NUMBERS, st.none() | NUMBERS), min_size=1, max_size=12),
    delimiter=st.sampled_from([",", ";", "\t", ", "]),
    style=st.sampled_from(sorted(STYLES)),
    newline=st.sampled_from(["\n", "\r\n"]),
)
def test_numbers_are_read_as_python_reads_them(
    parser: str, rows: list[tuple[Any, ...]], delimiter: str, style: str, newline: str, tmp_path: Path
) -> None:
    cells = [["" if value is None else STYLES[style](value) for value in row] for row in rows]
    if delimiter in (";", "\t"):
        cells = [[cell.replace(".", ",") for cell in row] for row in cells]
    content = newline.join(delimiter.join(row) for row in [["a", "b", "c"], *cells]) + newline
    found = read_table(text(tmp_path, content, f"{parser}.csv")).columns
    expected = np.array([[float(cell.replace(",", ".") or "nan") for cell in row] for row in cells])
    np.testing.assert_array_equal(np.column_stack([found["a"], found["b"], found["c"]]), expected)


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
        "second": (pa.array([1_700_000_001] * 3, pa.timestamp("s")), {"second": [1] * 3}),
        "day": (pa.array([datetime.date(2023, 11, 15)] * 3), {"day": [6400] * 3}),
        "span": (pa.array([1, 2, 3], pa.duration("ms")), {"span": [0.001, 0.002, 0.003]}),
        "clock": (pa.array([1, 2, 3], pa.time32("ms")), {"clock": [0.001, 0.002, 0.003]}),
        "level": (pa.array([1.5, 2.5, 1.5]).dictionary_encode(), {"level": [1.5, 2.5, 1.5]}),
        "nothing": (pa.nulls(3), {"nothing": [np.nan] * 3}),
        "list": (pa.array([[1, 2], None, [5, 6]]), {"list[0]": [1, np.nan, 5], "list[1]": [2, np.nan, 6]}),
        "fixed": (
            pa.array([[1.5, 2], [3, 4], None], pa.list_(pa.float32(), 2)),
            {"fixed[0]": [1.5, 3, np.nan], "fixed[1]": [2, 4, np.nan]},
        ),
        "pose": (
            pa.array([{"x": 1, "r": {"w": 2.5}}, None, {"x": 3, "r": None}]),
            {"pose.x": [1, np.nan, 3], "pose.r.w": [2.5, np.nan, np.nan]},
        ),
        "matrix": (pa.array([[[1, 2]]] * 3), {"matrix[0][0]": [1] * 3, "matrix[0][1]": [2] * 3}),
        "a.b": (pa.array([7, 8, 9]), {"a.b": [7, 8, 9]}),
    }
    path = tmp_path / "types.parquet"
    pq.write_table(pa.table({name: array for name, (array, _) in columns.items()}), path)
    log = ParquetFile(path)
    assert log.origin == start // 10**9
    same(joined(log), {name: values for _, expected in columns.values() for name, values in expected.items()})
    for _, expected in columns.values():
        same(joined(log, list(expected), rows=2), expected)


def test_parquet_columns_without_numbers_only_fail_when_asked_for(tmp_path: Path) -> None:
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
        with pytest.raises(InputError, match=rf"run\.parquet: column '{name.split('[')[0]}.*': {problem}"):
            list(log.tables([name]))


def test_a_list_that_changes_its_length_is_named_by_row(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"q": [[1.0, 2.0]] * 40 + [[1.0]] + [[1.0, 2.0]] * 9}), path)
    with pytest.raises(InputError, match=r"column 'q\[0\]', row 40: a list of 1 entries where others have 2"):
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
    monkeypatch.setitem(sys.modules, "pyarrow.parquet", None)
    with pytest.raises(MissingExtraError, match=r"pyarrow.*echelon\[identify\]"):
        open_log(path)


def test_parquet_streams_in_constant_memory(tmp_path: Path) -> None:
    """What pyarrow and numpy hold at once does not grow with the rows, not even in a single row group."""
    peaks = []
    before = pa.default_memory_pool()
    for rows in (1 << 17, 1 << 20):
        path = tmp_path / f"{rows}.parquet"
        values = np.random.default_rng(rows).normal(size=rows)
        pq.write_table(pa.table({f"c{k}": values + k for k in range(6)}), path, row_group_size=rows)
        pool = pa.proxy_memory_pool(before)
        pa.set_memory_pool(pool)
        tracemalloc.start()
        try:
            assert sum(len(piece.columns["c3"]) for piece in ParquetFile(path).tables(rows=1 << 14)) == rows
            peaks.append(pool.max_memory() + tracemalloc.get_traced_memory()[1])
        finally:
            tracemalloc.stop()
            pa.set_memory_pool(before)
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[1] < path.stat().st_size / 2


@pytest.mark.parametrize("file", ["emps/data_emps_pulses.parquet", "staubli_tx40/tx40_5kHz.parquet"])
def test_real_logs(file: str, tmp_path: Path) -> None:
    """The same numbers through Parquet and through text, as pyarrow itself reads them."""
    path = DATA / file
    if not path.is_file():
        pytest.skip(f"the log is not there: {path}")
    content = pq.read_table(path).slice(0, 5000)
    expected = {name: content.column(name).to_numpy().astype(float) for name in content.column_names}
    found = read_table(path).columns
    same({name: values[:5000] for name, values in found.items()}, expected)
    rows = np.column_stack(list(expected.values()))
    np.savetxt(tmp_path / "run.txt", rows, fmt="%.17g", header=" ".join(expected))
    same(read_table(tmp_path / "run.txt").columns, expected)


# -- NumPy and MATLAB --------------------------------------------------------------------------------------------------


def test_arrays_of_an_archive(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    q, cube = RANDOM.normal(size=(2, 10, 2))[0], RANDOM.normal(size=(10, 2, 2)).astype(np.float32)
    records = np.zeros(10, dtype=[("x", ">i4"), ("v", "f8", (2,)), ("label", "U3"), ("deep", [("y", "?")])])
    records["x"], records["v"], records["deep"]["y"] = np.arange(10), q, True
    np.savez(
        path, t=np.arange(10), q=q, cube=cube, records=records, gear=np.ones(3), turned=q.T, label=np.array(["a"] * 10),
        rate=100.0, objects=np.array([{}] * 10), wide=np.zeros((10, 5000)), day=np.zeros(10, "datetime64[s]"),
    )  # fmt: skip
    log = NpzFile(path)
    expected = {
        "t": np.arange(10), "q[0]": q[:, 0], "q[1]": q[:, 1],
        **{f"cube[{j}][{k}]": cube[:, j, k] for j in range(2) for k in range(2)},
        "records.x": np.arange(10), "records.v[0]": q[:, 0], "records.v[1]": q[:, 1], "records.deep.y": np.ones(10),
    }  # fmt: skip
    same(joined(log), expected)
    same(joined(log, rows=3), expected)
    for name, problem in {
        "gear": "has 3 rows where most arrays of the file have 10",
        "turned[0]": "has 2 rows where most arrays of the file have 10; transpose it",
        "label": "holds text, not real numbers",
        "rate": "is a single value, not a value per row",
        "objects": "holds Python objects, not real numbers",
        "wide[0]": "has 5000 columns; at most 4096 are read",
        "day": "holds dates or spans of time",
        "q": r"has 2 columns; name one of them, such as 'q\[0\]'",
    }.items():
        with pytest.raises(InputError, match=rf"column '{name.replace('[', chr(92) + '[')}': {problem}"):
            list(log.tables([name]))


@pytest.mark.parametrize(
    ("array", "names"),
    [
        (np.arange(5.0), ("0",)),
        (np.arange(15).reshape(5, 3), ("0", "1", "2")),
        (np.asfortranarray(np.arange(15).reshape(5, 3)), ("0", "1", "2")),
        (np.arange(20).reshape(5, 2, 2), ("0[0]", "0[1]", "1[0]", "1[1]")),
        (np.zeros(5, dtype=[("t", "f8"), ("q", "f4", (2,))]), ("t", "q[0]", "q[1]")),
    ],
)
def test_a_single_array(array: npt.NDArray[Any], names: tuple[str, ...], tmp_path: Path) -> None:
    np.save(tmp_path / "run.npy", array)
    log = NpzFile(tmp_path / "run.npy")
    assert log.names == names
    found = np.column_stack(list(joined(log, rows=2).values()))
    if array.dtype.names is None:
        np.testing.assert_array_equal(found, array.reshape(5, -1))


def test_pickles_are_never_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "run.npy", np.array([{}, {}]), allow_pickle=True)
    with pytest.raises(InputError, match="pickled Python objects, which are not loaded: they can run code"):
        NpzFile(tmp_path / "run.npy")
    np.savez(tmp_path / "run.npz", a=np.array([{}, {}]), b="x")
    with pytest.raises(InputError, match=r"no arrays of numbers.*: 'a' holds Python objects.*; 'b' is a single value"):
        NpzFile(tmp_path / "run.npz")


@pytest.mark.parametrize("version", ["4", "5"])
def test_matlab_files(version: str, tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    q = RANDOM.normal(size=(10, 3))
    content: dict[str, Any] = {"t": np.arange(10.0), "column": q[:, :1], "q": q, "gear": np.ones(3), "rate": 5.0}
    expected = {"t": np.arange(10), "column": q[:, 0], "q[0]": q[:, 0], "q[1]": q[:, 1], "q[2]": q[:, 2]}
    if version == "5":
        cell = np.empty(2, dtype=object)
        cell[:] = [np.arange(10) * 2.0, "text"]
        content |= {"log": {"tau": q[:, 1], "deep": {"f": q[:, :2]}}, "cell": cell, "empty": np.zeros((0, 0))}
        expected |= {
            "log.tau": q[:, 1],
            "log.deep.f[0]": q[:, 0],
            "log.deep.f[1]": q[:, 1],
            "cell[0]": np.arange(10) * 2,
        }
    scipy.io.savemat(path, content, format=version)
    log = MatFile(path)
    same(joined(log), expected)
    same(joined(log, rows=4), expected)
    with pytest.raises(InputError, match=r"column 'gear': has 3 rows where most arrays of the file have 10"):
        list(log.tables(["gear"]))


def same_as_scipy(found: Value, expected: Any) -> bool:
    """Whether a value of a MAT file is what scipy makes of it."""
    if isinstance(found, Unread):
        return expected.dtype.kind not in "biuf" or expected.dtype.names is not None or issparse(expected)
    if not isinstance(found, Group):
        return found.shape == expected.shape and np.array_equal(found, expected, equal_nan=True)
    flat = [tuple(entry) if found.fields else (entry,) for entry in expected.ravel(order="F")]
    members = [member for entry in flat for member in entry]
    return (expected.dtype.names or ()) == found.fields and all(
        same_as_scipy(own, other) for own, other in zip(found.members, members, strict=True)
    )


def matlab_files() -> list[Path]:
    """Of versions 5 to 7; without names that scipy changes or refuses, and a struct that it fills with nothing."""
    strange = ("nasty_duplicate_fieldnames", "bad_miutf8_array_name", "test_empty_struct")
    starts = {path: path.read_bytes()[:520] for path in sorted(MATLAB.glob("*.mat")) if path.stem not in strange}
    return [path for path, start in starts.items() if 0 not in start[:4] and b"\x89HDF" not in start]


@pytest.mark.parametrize("path", matlab_files(), ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore")
def test_files_that_matlab_wrote(path: Path) -> None:
    """The files with which scipy tests its own reader, where it brings them along."""
    try:
        expected = {name: value for name, value in scipy.io.loadmat(path).items() if not name.startswith("__")}
    except Exception:
        with pytest.raises(InputError):
            MatFile(path)
        return
    found = dict(variables(path.read_bytes()))
    assert all(same_as_scipy(found[name], value) for name, value in expected.items() if name != "None")


def test_matlab_files_of_version_7_3_say_how_to_save_them(tmp_path: Path) -> None:
    header = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(512) + b"\x89HDF\r\n\x1a\n"
    for content in (header, header[512:]):
        with pytest.raises(
            InputError, match=r"version 7\.3, which is not read; save it in MATLAB with  save\(…, '-v7'\)"
        ):
            open_log(text(tmp_path, content, "run.mat"))


# -- logs of any kind --------------------------------------------------------------------------------------------------


def test_content_goes_before_names(tmp_path: Path) -> None:
    write(tmp_path / "run.parquet").rename(tmp_path / "run.csv")
    assert isinstance(open_log(tmp_path / "run.csv"), ParquetFile)
    for content, name, problem in [
        (b"#ROSBAG V2.0\n", "run.bag", "is a bag of ROS 1; convert it with  rosbags-convert"),
        (b"PK\x03\x04".ljust(30) + b"[Content_Types].xml", "run.xlsx", "is a spreadsheet; save it as CSV"),
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
    assert [path.name for path in found] == ["Run 3.tsv", "run1.csv.gz", "run2.csv", "run10.csv"]
    assert log_paths(found[0]) == [found[0]]
    with pytest.raises(InputError, match=r"is a directory, not a log; name a file in it, such as Run 3\.tsv"):
        open_log(tmp_path)
    write(tmp_path / "run4.npz")
    with pytest.raises(InputError, match=r"several kinds: CSV \(.*\), NumPy \(run4\.npz\)|several kinds: NumPy"):
        log_paths(tmp_path)
    with pytest.raises(InputError, match="is a directory without logs"):
        log_paths(tmp_path / "plots")
    with pytest.raises(InputError, match="no such file"):
        log_paths(tmp_path / "other")
    shutil.rmtree(tmp_path / "plots")
