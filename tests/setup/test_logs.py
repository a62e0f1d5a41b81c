"""First results of a robot file and a log whose columns nobody described."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import echelon as ec
from echelon.identification.logs.read_log import opened
from echelon.identification.setup.logs import with_logs
from support.selection import slow_unless
from support.swinging_arm import ARM, Motion, swinging


@pytest.fixture(scope="module")
def motion() -> Motion:
    return swinging()


def well(result: ec.Identification) -> bool:
    return min(score.r2 for score in result.validations[-1].scores) > 0.99


def test_samples_in_memory_are_identified_and_saved(
    motion: Motion, tmp_path: Path
) -> None:
    frame = pd.DataFrame({"t": motion["t"]})
    for k in (0, 1):
        frame[f"q{k}"], frame[f"tau{k}"] = motion["q"][:, k], motion["tau"][:, k]
    result = ec.identify(ARM, frame)
    assert well(result)
    same = ec.identify(
        ec.load_setup(ARM), {name: frame[name].to_numpy() for name in frame}
    )
    np.testing.assert_array_equal(result.values, same.values)
    ec.save_identification(result, tmp_path / "model.json")
    model = ec.load_identified(tmp_path / "model.json")
    frame.to_csv(tmp_path / "log.csv", index=False)
    assert len(ec.predict_log(model.plan, model.values, tmp_path / "log.csv").time) > 0


def test_columns_without_names(motion: Motion, tmp_path: Path) -> None:
    table = np.column_stack([motion[name] for name in ("t", "q", "qd", "tau")])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",")
    result = ec.identify(ARM, str(tmp_path / "log.csv"))
    assert well(result)
    texts = [str(finding) for finding in result.findings]
    assert any(
        "1, 2 are read as the positions of shoulder_joint, elbow_joint, judging by their values"
        in text
        for text in texts
    )
    setup, _, _ = with_logs(
        ARM, {"log": np.column_stack([motion["t"], motion["q"], motion["tau"]])}
    )
    assert [channel.column for channel in setup.columns[0].outputs.values()] == [
        "log[3]",
        "log[4]",
    ]
    assert not any("another robot" in text for text in texts)


@pytest.mark.parametrize("clocked", slow_unless([True], [True, False]))
def test_files_that_share_a_clock_are_one_log(
    clocked: bool, motion: Motion, tmp_path: Path
) -> None:
    """Times of the one in ms; the torques at other times, or in the same rows without times."""
    names = ["shoulder_joint", "elbow_joint"]
    positions = pd.DataFrame(motion["q"], columns=names)
    torques = pd.DataFrame(motion["tau"], columns=names)
    positions.insert(0, "time_ms", 1e3 * motion["t"])
    if clocked:
        torques = torques.iloc[::2]
        torques.insert(0, "time", motion["t"][::2])
    positions.to_csv(tmp_path / "positions.csv", index=False)
    torques.to_csv(tmp_path / "torques.csv", index=False)
    both = [tmp_path / "positions.csv", tmp_path / "torques.csv"]
    setup, logs, _ = with_logs(ARM, both)
    assert logs == (Path(f"{both[0]}+{both[1]}"),)
    (table,) = opened(logs[0]).tables(["torques/elbow_joint"])
    assert len(table.columns[table.clocks["torques/elbow_joint"]]) == len(torques)
    assert well(ec.identify(setup, logs))
    assert with_logs(ARM, tmp_path)[1] == logs
    assert with_logs(ARM, f"{both[0]}+{both[1]}")[1] == logs


def test_a_log_in_a_file_per_quantity_or_joint(motion: Motion, tmp_path: Path) -> None:
    for name in ("q", "qd", "tau", "t"):
        np.savetxt(tmp_path / f"{name}.txt", motion[name])
    both = [tmp_path / f"{name}.txt" for name in ("q", "tau", "qd")]
    with pytest.raises(ec.InputError, match="its samples have no time"):
        ec.identify(ARM, both)
    setup, (log,), _ = with_logs(ARM, [*both, tmp_path / "t.txt"])
    assert log == Path("+".join(map(str, [*both, tmp_path / "t.txt"])))
    assert [channel.column for channel in setup.columns[0].velocities.values()] == [
        "qd/0",
        "qd/1",
    ]
    for k, joint in enumerate(("shoulder", "elbow")):
        frame = pd.DataFrame(
            {
                "t": motion["t"],
                "position": motion["q"][:, k],
                "torque": motion["tau"][:, k],
            }
        )
        frame.to_csv(tmp_path / f"{joint}.csv", index=False)
    files = [tmp_path / "shoulder.csv", tmp_path / "elbow.csv"]
    setup, logs, _ = with_logs(ARM, files)
    assert logs == (Path("+".join(map(str, files))),)
    assert setup.columns[0].positions["elbow_joint"].column == "elbow/position"
    assert with_logs(setup, files)[1] == logs


def test_files_without_a_common_clock(tmp_path: Path) -> None:
    pd.DataFrame({"t": np.arange(9) / 10, "q1": 0, "q2": 0}).to_csv(
        tmp_path / "positions.csv", index=False
    )
    pd.DataFrame({"tau1": np.zeros(5), "tau2": 0}).to_csv(
        tmp_path / "torques.csv", index=False
    )
    with pytest.raises(
        ec.InputError,
        match=r"torques.csv: has no column of times, and another number of rows",
    ):
        next(opened(f"{tmp_path}/positions.csv+{tmp_path}/torques.csv").tables())


def test_arrays_that_are_too_short_are_named(motion: Motion) -> None:
    with pytest.raises(
        ec.InputError,
        match=r"no output columns .*; not read: 'tau' has 2999 rows where most arrays .* 3000",
    ):
        with_logs(ARM, {"t": motion["t"], "q": motion["q"], "tau": motion["tau"][1:]})


def test_every_kind_of_log_is_understood_once(motion: Motion) -> None:
    """Small angles in degrees mean the same as the large ones of the log before."""
    large: dict[str, Any] = {
        "t": motion["t"],
        "q": 57.3 * motion["q"],
        "tau": motion["tau"],
    }
    setup, _, _ = with_logs(ARM, [large, {**large, "q": large["q"] / 50}])
    assert len(setup.columns) == 1
    assert {channel.unit for channel in setup.columns[0].positions.values()} == {"deg"}
    assert any("read as degrees" in text for text in setup.assumed)
