"""From files as recorders write them, by their own libraries, to a model without a map of columns."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import hdf5storage
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import echelon as ec
from support.selection import slow_unless
from support.swinging_arm import ARM, Motion, swinging

JOINTS = ("shoulder_joint", "elbow_joint")
START = 1_700_000_000 * 10**9


def bag(ros: int, folder: Path, motion: Motion) -> Path:
    """JointState messages, whose joints are in the other order, under a namespace."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    kinds, kind, path = (
        store.types,
        "sensor_msgs/msg/JointState",
        folder / ("run.bag" if ros == 1 else "run"),
    )
    writer = (
        Writer1(path)
        if ros == 1
        else Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
    )
    with writer:
        topic = writer.add_connection("/arm/joint_states", kind, typestore=store)
        for k, t in enumerate(motion["t"]):
            time = START + round(1e9 * t)
            stamp = kinds["builtin_interfaces/msg/Time"](
                sec=time // 10**9, nanosec=time % 10**9
            )
            head = {"seq": k} if ros == 1 else {}
            header = kinds["std_msgs/msg/Header"](stamp=stamp, frame_id="", **head)
            values = (
                np.ascontiguousarray(motion[name][k, ::-1])
                for name in ("q", "qd", "tau")
            )
            message = kinds[kind](header, list(JOINTS[::-1]), *values)
            raw = (
                store.serialize_ros1(message, kind)
                if ros == 1
                else store.serialize_cdr(message, kind)
            )
            writer.write(topic, time + 1000, raw)
    return path


def matlab(folder: Path, motion: Motion) -> Path:
    """Version 7.3, with samples across."""
    content = {"time": motion["t"], "q": motion["q"].T, "tau": motion["tau"].T}
    hdf5storage.savemat(str(folder / "run.mat"), content, format="7.3")
    return folder / "run.mat"


def aloha(folder: Path, motion: Motion) -> Path:
    with h5py.File(folder / "episode_0.hdf5", "w") as file:
        file["observations/qpos"], file["observations/qvel"] = motion["q"], motion["qd"]
        file["observations/effort"], file["timestamp"] = motion["tau"], motion["t"]
        file["action"] = motion["q"]
    return folder / "episode_0.hdf5"


def lerobot(folder: Path, motion: Motion) -> Path:
    """Version 3: two episodes in a file, positions in degrees."""
    names = [name.removesuffix("_joint") for name in JOINTS]
    features = {
        "observation.state": {
            "dtype": "float32",
            "shape": [2],
            "names": [f"{name}.pos" for name in names],
        },
        "observation.effort": {
            "dtype": "float32",
            "shape": [2],
            "names": [f"{name}.effort" for name in names],
        },
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
    }
    (folder / "meta").mkdir()
    (folder / "data" / "chunk-000").mkdir(parents=True)
    (folder / "meta" / "info.json").write_text(
        json.dumps({"codebase_version": "v3.0", "features": features})
    )
    half = len(motion["t"]) // 2
    vector = pa.list_(pa.float32(), 2)
    columns = {
        "observation.state": pa.array((np.degrees(motion["q"])).tolist(), vector),
        "observation.effort": pa.array(motion["tau"].tolist(), vector),
        "timestamp": pa.array(np.tile(motion["t"][:half], 2).astype(np.float32)),
        "episode_index": np.repeat([0, 1], half),
    }
    pq.write_table(
        pa.table(columns), folder / "data" / "chunk-000" / "file-000.parquet"
    )
    return folder


def franka(folder: Path, motion: Motion) -> Path:
    """As libfranka's logToCSV writes it: time in ms, a blank behind commas of a family, columns of commands."""
    head = ["time", "success_rate"]
    parts = [1e3 * motion["t"][:, None], np.ones((len(motion["t"]), 1))]
    for name, values in (
        ("q", "q"),
        ("q_d", "q"),
        ("dq", "qd"),
        ("dq_d", "qd"),
        ("tau_J", "tau"),
    ):
        head += [f"state.{name}[0]", f" state.{name}[1]"]
        parts.append(motion[values])
    head += [
        "state.tau_ext_hat_filtered[0]",
        " state.tau_ext_hat_filtered[1]",
        "cmd.q_d[0]",
        " cmd.q_d[1]",
    ]
    parts += [0 * motion["tau"], motion["q"]]
    table = pd.DataFrame(np.hstack(parts), columns=head)
    table.to_csv(folder / "log.csv", index=False)
    return folder / "log.csv"


def stamped(folder: Path, motion: Motion) -> Path:
    """ISO time stamps, as polars writes them."""
    times = (START // 1000 + np.round(1e6 * motion["t"]).astype(np.int64)).astype(
        "datetime64[us]"
    )
    columns = {"time": times} | {f"joint_{k}": motion["q"][:, k] for k in (0, 1)}
    pl.DataFrame(
        columns | {f"torque_{k}": motion["tau"][:, k] for k in (0, 1)}
    ).write_csv(folder / "log.csv")
    return folder / "log.csv"


def lists(folder: Path, motion: Motion) -> Path:
    """Vectors as text, and the stamp of a message in two columns."""
    time = START + np.round(1e9 * motion["t"]).astype(np.int64)
    head = {"header.stamp.sec": time // 10**9, "header.stamp.nanosec": time % 10**9}
    pd.DataFrame(head | {name: motion[name].tolist() for name in ("q", "tau")}).to_csv(
        folder / "log.csv"
    )
    return folder / "log.csv"


def levels(folder: Path, motion: Motion) -> pd.DataFrame:
    """A data frame with two levels of columns, and of whose clock the name says nothing."""
    del folder
    parts = {
        name: pd.DataFrame(motion[key], columns=JOINTS)
        for name, key in (("pos", "q"), ("eff", "tau"))
    }
    frame = pd.concat(parts, axis=1)
    frame["Uhr", ""] = 1e6 * motion["t"]
    return frame


def listing(folder: Path, motion: Motion) -> Path:
    """A file whose ending says nothing, in degrees, as a German controller names its columns."""
    frame = pd.DataFrame({"Zeit [ms]": 1e3 * motion["t"]})
    for k in (0, 1):
        frame[f"Achse{k + 1}_Istwinkel [Grad]"] = np.degrees(motion["q"][:, k])
        frame[f"Achse{k + 1}_Sollwinkel [Grad]"] = np.degrees(motion["q"][:, k])
        frame[f"Achse{k + 1}_Drehmoment [Nm]"] = motion["tau"][:, k]
    frame.to_csv(folder / "spur.log", sep=";", decimal=",", index=False)
    return folder / "spur.log"


RECORDERS: dict[str, Callable[[Path, Motion], Path | pd.DataFrame]] = {
    "ROS 1": lambda folder, motion: bag(1, folder, motion),
    "ROS 2": lambda folder, motion: bag(2, folder, motion),
    **{
        function.__name__: function
        for function in (
            matlab,
            aloha,
            lerobot,
            franka,
            stamped,
            lists,
            levels,
            listing,
        )
    },
}


@pytest.fixture(scope="module")
def motion() -> Motion:
    return swinging()


@pytest.mark.parametrize(
    "recorder", slow_unless(lambda recorder: recorder != "ROS 1", RECORDERS)
)
def test_a_recording_and_a_urdf_are_enough(
    recorder: str, motion: Motion, tmp_path: Path
) -> None:
    result = ec.identify(
        ec.load_setup(ARM).with_settings(physical=False),
        RECORDERS[recorder](tmp_path, motion),
    )
    assert min(score.r2 for score in result.pooled[-1].scores) > 0.99
    assert not [
        f for f in result.findings if f.kind in ("contradiction", "stranger", "robot")
    ]
