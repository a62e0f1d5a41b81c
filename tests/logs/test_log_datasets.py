"""Logs that are no single files: LeRobot datasets, and samples in memory."""

from __future__ import annotations

import io
import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from echelon.identification.logs.files.numpy_file import MemoryLog
from echelon.identification.logs.files.open_log import log_paths, open_log, read_table
from echelon.shared.errors import InputError
from support.log_tables import same

JOINTS = ("shoulder_pan", "elbow_flex")


def dataset(folder: Path, version: str, names: Any = None) -> Path:
    """Three episodes of 40 frames, as LeRobot lays them out: a file each, or all in one."""
    names = [f"{joint}.pos" for joint in JOINTS] if names is None else names
    vector = {"dtype": "float32", "shape": [2], "names": names}
    about = {
        "codebase_version": version,
        "fps": 30,
        "features": {"observation.state": vector, "action": vector},
    }
    (folder / "meta").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(json.dumps(about))
    tables = []
    for episode in range(3):
        state = np.arange(80, dtype=np.float32).reshape(40, 2) + 100 * episode
        vectors = (
            pa.list_(pa.float32(), 2) if version == "v3.0" else pa.list_(pa.float32())
        )
        tables.append(
            pa.table(
                {
                    "action": pa.array((state + 1).tolist(), vectors),
                    "observation.state": pa.array(state.tolist(), vectors),
                    "timestamp": pa.array(np.arange(40, dtype=np.float32) / 30),
                    "episode_index": np.full(40, episode),
                }
            )
        )
    (folder / "data" / "chunk-000").mkdir(parents=True)
    if version == "v3.0":
        pq.write_table(
            pa.concat_tables(tables), folder / "data" / "chunk-000" / "file-000.parquet"
        )
    else:
        for episode, table in enumerate(tables):
            pq.write_table(
                table, folder / "data" / "chunk-000" / f"episode_{episode:06d}.parquet"
            )
    return folder


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
@pytest.mark.parametrize(
    "names", [None, {"motors": [f"{joint}.pos" for joint in JOINTS]}]
)
def test_every_episode_of_a_dataset_is_a_log(
    version: str, names: Any, tmp_path: Path
) -> None:
    folder = dataset(tmp_path / "pick", version, names)
    logs = log_paths(folder)
    assert [log.name for log in logs] == [
        "episode_000000",
        "episode_000001",
        "episode_000002",
    ]
    found = read_table(logs[1]).columns
    assert list(found) == [
        *(
            f"{vector}/{joint}.pos"
            for vector in ("action", "observation.state")
            for joint in JOINTS
        ),
        "timestamp",
    ]
    np.testing.assert_array_equal(
        found["observation.state/elbow_flex.pos"], np.arange(1, 80, 2) + 100
    )
    assert log_paths(logs[2]) == [logs[2]]
    with pytest.raises(InputError, match="has no frames of this episode"):
        open_log(folder / "episode_000007")


def test_a_damaged_dataset_is_one_clear_error(tmp_path: Path) -> None:
    folder = dataset(tmp_path / "pick", "v3.0")
    (file,) = (folder / "data").rglob("*.parquet")
    pq.write_table(pa.table({"action": [1.0]}), file)
    with pytest.raises(InputError, match="pick: cannot be read as a LeRobot dataset"):
        log_paths(folder)
    file.unlink()
    with pytest.raises(InputError, match="without data"):
        log_paths(folder)


def test_entries_without_names_are_numbered(tmp_path: Path) -> None:
    assert (
        "action[1]"
        in open_log(log_paths(dataset(tmp_path / "pick", "v2.1", ["x", "x"]))[0]).names
    )


T, Q = np.arange(50) / 100, np.random.default_rng(1).normal(size=(50, 2))
FLAT = {"t": T, "q[0]": Q[:, 0], "q[1]": Q[:, 1]}


@pytest.mark.parametrize(
    "samples",
    [
        {"t": T, "q": Q},
        {"t": T.tolist(), "q": Q.T},
        FLAT,
        pd.DataFrame(FLAT),
        pl.DataFrame(FLAT),
        pa.table(FLAT),
        pl.DataFrame({"t": T, "q": Q}),
        pd.DataFrame({"t": T, "q": list(Q)}),
        pl.DataFrame(FLAT).lazy(),
        pd.DataFrame(FLAT).astype(object),
        pd.DataFrame(FLAT).to_records(index=False),
    ],
    ids=["dict", "rows across", "flat", "pandas", "polars", "pyarrow", "polars of vectors", "pandas of vectors", "lazy",
         "objects", "records"],
)  # fmt: skip
def test_samples_in_memory_are_logs(samples: Any) -> None:
    (log,) = log_paths(samples)
    same(read_table(log).columns, FLAT)
    same(read_table(pickle.loads(pickle.dumps(log)), ["t"]).columns, {"t": T})
    assert log_paths([samples, log]) == [log, log]


def test_times_of_data_frames_are_seconds() -> None:
    stamps = pd.Timestamp("2026-05-01 12:00:00.25") + pd.to_timedelta(T, unit="s")
    for frame in (
        pd.DataFrame({"q": Q[:, 0]}, index=stamps),
        pl.DataFrame({"q": Q[:, 0], "time": stamps.to_numpy()}),
    ):
        np.testing.assert_allclose(
            read_table(MemoryLog.of(frame)).columns["time"], T + 0.25, atol=1e-6
        )


def test_nested_samples_and_matrices() -> None:
    (log,) = log_paths({"arm": {"q": Q, "t": T}, "left": {"arm": {"q": T}}})
    same(
        read_table(log).columns,
        {"arm/q[0]": Q[:, 0], "arm/q[1]": Q[:, 1], "arm/t": T, "left/arm/q": T},
    )
    for matrix in (Q, Q.T):
        (log,) = log_paths(matrix)
        same(read_table(log).columns, {"0": Q[:, 0], "1": Q[:, 1]})


@pytest.mark.parametrize(
    "clock",
    [{"rate": 100}, {"settings": {"Ts": np.array([[0.01]])}}, {"dt": 0.01, "fs": 5}],
)
def test_a_single_number_may_be_the_clock(clock: dict[str, Any]) -> None:
    columns = read_table(MemoryLog.of({"q": Q[:, 0], **clock})).columns
    np.testing.assert_allclose(columns["time [s]"], T, atol=1e-12)
    assert (
        "time [s]"
        not in read_table(MemoryLog.of({"q": Q[:, 0], "stamp": T, **clock})).columns
    )


def test_what_is_no_log() -> None:
    for nothing in (T, (T, Q), io.StringIO("t,q")):
        with pytest.raises(
            InputError, match="expected paths, data frames or dicts of arrays as logs"
        ):
            log_paths(nothing)
    with pytest.raises(
        InputError,
        match="expected paths, data frames or dicts of arrays as logs, found int",
    ):
        log_paths(3)
    with pytest.raises(
        InputError, match="holds no arrays of numbers with a row per sample"
    ):
        read_table(MemoryLog.of({"name": "arm"}))
