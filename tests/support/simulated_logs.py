"""Logs of simulated robots in the formats and units that robots log in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.robot.mechanism import Mechanism

Floats = npt.NDArray[np.float64]
START = 1_700_000_000_000_000_000
CONSTANT = 0.08
"""Torque constant of the motors of the geared arm, N·m/A."""


def write_log(
    path: Path, time: Floats, q: Floats, y: Floats, mechanism: Mechanism, motors: Floats
) -> Path:
    """Positions and outputs in the format that the path's ending says.

    Parameters
    ----------
    path : Path
    time : array of shape (N,)
    q, y : arrays of shape (N, positions) and (N, outputs)
    mechanism : Mechanism
        For names.
    motors : array of shape (N, drives)
        Angles of the drives, rad.
    """
    outputs = [output.name for output in mechanism.outputs]
    match path.suffix:
        case ".csv":
            names = [
                "time",
                *(f"q_{k + 1}" for k in range(q.shape[1])),
                *(f"tau_{k + 1}" for k in range(y.shape[1])),
            ]
            rows = np.column_stack([time, q, y]).tolist()
            path.write_text(
                "\n".join(
                    [",".join(names), *(",".join(map(repr, row)) for row in rows)]
                )
                + "\n"
            )
        case ".parquet":
            import pyarrow as pa
            import pyarrow.parquet as pq

            columns = {"time": time, **dict(zip(mechanism.positions, q.T, strict=True))}
            columns |= {
                f"force.{name}": some for name, some in zip(outputs, y.T, strict=True)
            }
            pq.write_table(pa.table(columns), path)
        case ".npz":
            np.savez(
                path,
                stamp=1e3 * time,
                angle=np.stack([q[:, 0], 0.25 - q[:, 1]], axis=1),
                torque=y,
            )
        case ".mat":
            import scipy.io

            columns = {f"q{k + 1}": some for k, some in enumerate(q.T)}
            columns |= {
                f"tau_{name}": some
                for name, some in zip(outputs, y.T, strict=True)
                if "." not in name
            }
            scipy.io.savemat(path, {"t": time, **columns, "wrench": y[:, -6:]})
        case ".mcap":
            _bag(path, time, np.degrees(motors), y / CONSTANT, outputs)
        case _:
            raise AssertionError(f"no logs are written to {path}")
    return path


def _bag(
    path: Path, time: Floats, degrees: Floats, currents: Floats, names: list[str]
) -> None:
    """Joint states of motors in an MCAP file without a folder around it."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    folder = path.with_suffix("")
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/motors", kind, typestore=store)
        for when, position, effort in zip(time, degrees, currents, strict=True):
            stamp = START + round(1e9 * when)
            message = _message(store.types, stamp, names, position, effort)
            writer.write(connection, stamp, store.serialize_cdr(message, kind))
    (found,) = folder.glob("*.mcap")
    found.rename(path)


def _message(
    types: Any, stamp: int, names: list[str], position: Floats, effort: Floats
) -> Any:
    clock = types["builtin_interfaces/msg/Time"](
        sec=stamp // 10**9, nanosec=stamp % 10**9
    )
    header = types["std_msgs/msg/Header"](stamp=clock, frame_id="")
    return types["sensor_msgs/msg/JointState"](
        header, names, position, np.zeros(0), effort
    )
