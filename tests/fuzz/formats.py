"""How each format is mutated: inside, before it is packed, or as bytes."""

from __future__ import annotations

import gzip
import io
import json
import sqlite3
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from random import Random
from typing import Any
from xml.etree.ElementTree import ParseError

import numpy as np
import yaml

from fuzz import dialects
from fuzz.material import URDF, Material
from fuzz.mutations import (
    NUMBERS,
    changed_bytes,
    changed_data,
    changed_text,
    changed_xml,
    plain_value,
)

Maker = Callable[[Material, Random, Path], Path]
"""Writes a mutated file into a folder."""

_START = 1_700_000_000_000_000_000


def _document(name: str, choose: Callable[[Material, Random], Any]) -> Maker:
    """YAML or JSON, changed as data or as text."""

    def make(material: Material, rng: Random, folder: Path) -> Path:
        found = choose(material, rng)
        data = yaml.load(found, yaml.BaseLoader) if isinstance(found, str) else found
        as_yaml = name.endswith(".yaml")
        text = found if isinstance(found, str) else _dumped(data, as_yaml)
        if rng.random() < 0.6:
            text = _dumped(changed_data(data, rng), as_yaml)
        if rng.random() < 0.5:
            text = changed_text(text, rng)
        return _written(folder / name, text.encode(errors="surrogatepass"), rng)

    return make


def _dumped(data: Any, as_yaml: bool) -> str:
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(
        50 * limit
    )  # for deep documents; what reads them has the usual one
    try:
        return (
            str(yaml.safe_dump(data, sort_keys=False, allow_unicode=True))
            if as_yaml
            else json.dumps(data)
        )
    finally:
        sys.setrecursionlimit(limit)


def _written(path: Path, content: bytes, rng: Random, bytes_too: float = 0.05) -> Path:
    path.write_bytes(
        changed_bytes(content, rng) if rng.random() < bytes_too else content
    )
    return path


def _xml(name: str, choose: Callable[[Material, Random], str]) -> Maker:
    def make(material: Material, rng: Random, folder: Path) -> Path:
        text = choose(material, rng)
        if rng.random() < 0.6:
            with suppress(
                ParseError
            ):  # what is no XML by the book is read by some programs all the same
                text = changed_xml(text, rng)
        else:
            text = changed_text(text, rng)
        return _written(folder / name, text.encode(errors="surrogatepass"), rng)

    return make


def _columns(material: Material, rng: Random) -> dict[str, Any]:
    """The log with columns lost, renamed, reshaped, retyped, or with numbers that are none."""
    found: dict[str, Any] = dict(material.log)
    for _ in range(rng.choice((0, 1, 1, 2))):
        name = rng.choice(list(found))
        values, action = found[name], rng.randrange(9)
        if action == 0 and len(found) > 1:
            del found[name]
        elif action == 1:
            found[rng.choice(("t", "q1", "x", "", "a.b", "q1[0]", "x" * 3000))] = (
                found.pop(name)
            )
        elif action == 2:
            found[name] = np.asarray(values)[: rng.choice((0, 1, 10, 399))]
        elif action in (3, 4) and np.asarray(values).dtype.kind not in "fiub":
            found[name] = np.asarray(values)[
                ::2
            ]  # an earlier change made texts or dates of it
        elif action == 3:
            changed = np.array(values, dtype=float)
            changed.flat[
                rng.randrange(max(1, changed.size)) :: rng.choice((1, 7, 1000))
            ] = (
                rng.choice((np.nan, np.inf, 1e308, -1e308, 0.0, 1e-320, 1e18))
                if changed.size
                else 0
            )
            found[name] = changed
        elif action == 4:
            found[name] = np.asarray(values) * rng.choice(
                (0.0, 1e300, 1e-300, -1.0, 1e9)
            )
        elif action == 5:
            kinds = ("f4", "i1", "u8", "?", "c16", "U5", "S3", "f2", "M8[s]", ">f8")
            with suppress(ValueError, TypeError), np.errstate(all="ignore"):
                found[name] = np.nan_to_num(np.asarray(values, dtype=float)).astype(
                    rng.choice(kinds)
                )
        elif action == 6:
            found[name] = np.full(len(np.atleast_1d(values)), np.nan)
        elif action == 7:
            found.pop("t", None)
            found = found or {"q1": material.log["q1"]}
        else:
            found[name] = (
                np.roll(values, rng.randrange(400)) if np.ndim(values) else values
            )
    return found


def _csv_text(columns: dict[str, Any], rng: Random) -> str:
    cut = rng.choice((",", ",", ";", "\t", " "))
    names, length = (
        list(columns),
        max((len(np.atleast_1d(v)) for v in columns.values()), default=0),
    )
    rows = [
        [
            str(np.atleast_1d(columns[n])[k])
            if k < len(np.atleast_1d(columns[n]))
            else ""
            for n in names
        ]
        for k in range(length)
    ]
    return "\n".join(cut.join(row) for row in [names, *rows]) + "\n"


def _csv(material: Material, rng: Random, folder: Path) -> Path:
    text = _csv_text(_columns(material, rng), rng)
    if rng.random() < 0.7:
        text = changed_text(text, rng)
    content = text.encode(errors="surrogatepass")
    if rng.random() < 0.3:
        return _written(
            folder / "run.csv.gz",
            gzip.compress(content * rng.choice((1, 1, 50)), mtime=0),
            rng,
            0.5,
        )
    return _written(folder / "run.csv", content, rng)


def _parquet(material: Material, rng: Random, folder: Path) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = _columns(material, rng)
    length = min((len(v) for v in columns.values()), default=0)
    arrays = {}
    for name, values in columns.items():
        with suppress(pa.ArrowException, TypeError, ValueError):
            arrays[name] = pa.array(np.asarray(values)[:length])
    if rng.random() < 0.2 and length:
        arrays["nested"] = pa.array(
            [{"x": [1.0] * rng.choice((2, 2, 2, 3))} for _ in range(length)]
        )
    sink = io.BytesIO()
    pq.write_table(
        pa.table(arrays), sink, compression=rng.choice(("snappy", "none", "zstd"))
    )
    return _written(folder / "run.parquet", sink.getvalue(), rng, 0.7)


def _npz(material: Material, rng: Random, folder: Path) -> Path:
    columns = _columns(material, rng)
    if rng.random() < 0.3:
        stream = io.BytesIO()
        np.save(stream, np.asarray(next(iter(columns.values()))), allow_pickle=False)
        return _written(
            folder / "run.npy", _lying_header(stream.getvalue(), rng), rng, 0.5
        )
    stream = io.BytesIO()
    (np.savez if rng.random() < 0.5 else np.savez_compressed)(
        stream, **{name.replace("/", "_"): v for name, v in columns.items()}
    )
    content = stream.getvalue()
    return _written(folder / "run.npz", _lying_header(content, rng), rng, 0.5)


def _lying_header(content: bytes, rng: Random) -> bytes:
    """Another shape or type in the header of an array, of the same length."""
    if rng.random() < 0.5:
        return content
    shapes = (
        b"'shape': (9" + b"9" * rng.randrange(12) + b",)",
        b"'shape': (4, 4, 4)",
        b"'descr': '<U9'",
        b"'descr': '|O'  ",
    )
    new = rng.choice(shapes)
    start = content.find(new[:8])
    return content if start < 0 else content[:start] + new + content[start + len(new) :]


def _mat(material: Material, rng: Random, folder: Path) -> Path:
    from scipy.io import savemat

    columns = {
        name[:30].replace(".", "_") or "x": v
        for name, v in _columns(material, rng).items()
    }
    columns = {
        name: v
        for name, v in columns.items()
        if np.asarray(v).dtype.kind in "fiubcU" and not name.startswith("_")
    }
    if rng.random() < 0.3:
        columns["log"] = {
            "q1": np.zeros(3),
            "cell": np.array([{"a": 1.0}, "x"], dtype=object),
        }
    stream = io.BytesIO()
    try:
        savemat(
            stream, columns, format=rng.choice("54"), do_compression=rng.random() < 0.3
        )
    except (TypeError, ValueError):  # such as structs, which version 4 does not know
        stream = io.BytesIO()
        savemat(stream, {"q1": material.log["q1"]}, format="4")
    return _written(folder / "run.mat", stream.getvalue(), rng, 0.8)


def _hdf5(material: Material, rng: Random, folder: Path) -> Path:
    """Data sets in groups; or, with conventions of MATLAB's own, a MAT file of version 7.3."""
    import h5py

    matlab, stream = rng.random() < 0.4, io.BytesIO()
    with h5py.File(stream, "w", userblock_size=512 if matlab else 0) as file:
        for name, values in _columns(material, rng).items():
            place = rng.choice(("", "", "log/")) + (name.strip("/.")[:60] or "x")
            with suppress(
                TypeError, ValueError, OSError
            ):  # texts, dates, names that are taken
                data = np.atleast_1d(values)
                found = file.create_dataset(
                    place, data=data.T, compression=rng.choice((None, "gzip"))
                )
                found.attrs["MATLAB_class"] = np.bytes_(
                    rng.choice(("double",) * 5 + ("char", "struct"))
                )
        if rng.random() < 0.3:
            cells = file.create_dataset(
                "cells", (rng.choice((1, 2, 300)),), dtype=h5py.ref_dtype
            )
            cells[0] = file.ref
    content = bytearray(stream.getvalue())
    if matlab:
        content[:26] = b"MATLAB 7.3 MAT-file, fuzz "
    return _written(
        folder / ("run.mat" if matlab else "run.h5"), bytes(content), rng, 0.7
    )


def _states(material: Material) -> list[dict[str, Any]]:
    log = material.log
    return [
        {
            "header": {
                "stamp": {
                    "sec": 1_700_000_000 + int(log["t"][k]),
                    "nanosec": int(log["t"][k] * 1e9) % 10**9,
                }
            },
            "name": ["j1", "j2"],
            "position": [float(log["q1"][k]), float(log["q2"][k])],
            "effort": [float(log["tau1"][k]), float(log["tau2"][k])],
        }
        for k in range(0, len(log["t"]), 20)
    ]


def _mcap(material: Material, rng: Random, folder: Path) -> Path:
    from mcap.writer import CompressionType, Writer

    stream = io.BytesIO()
    writer = Writer(
        stream,
        compression=rng.choice(list(CompressionType)),
        use_chunking=rng.random() < 0.8,
    )
    writer.start(profile="", library="fuzz")
    channel = writer.register_channel(
        topic="/joint_states",
        message_encoding=rng.choice(("json",) * 9 + ("cdr",)),
        schema_id=0,
    )
    for k, message in enumerate(_states(material)):
        changed = changed_data(message, rng) if rng.random() < 0.1 else message
        text = json.dumps(changed)
        text = changed_text(text, rng) if rng.random() < 0.02 else text
        time = (
            _START + 10**7 * k
            if rng.random() < 0.99
            else rng.choice((0, 2**63, 2**64 - 1))
        )
        writer.add_message(channel, time, text.encode(errors="surrogatepass"), time)
    writer.finish()
    return _written(folder / "run.mcap", stream.getvalue(), rng, 0.5)


def _bag(material: Material, rng: Random, folder: Path) -> Path:
    """A database of CDR messages with its metadata, each changed in its own way."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    path = folder / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        kind = "sensor_msgs/msg/JointState"
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for state in _states(material)[:8]:
            header = types["std_msgs/msg/Header"](
                types["builtin_interfaces/msg/Time"](**state["header"]["stamp"]), "base"
            )
            q, tau = np.array(state["position"]), np.array(state["effort"])
            message = types[kind](header, state["name"], q, np.zeros(0), tau)
            data = bytes(store.serialize_cdr(message, kind))
            writer.write(
                connection,
                _START,
                changed_bytes(data, rng) if rng.random() < 0.1 else data,
            )
    metadata = path / "metadata.yaml"
    if rng.random() < 0.5:
        text = metadata.read_text(encoding="utf-8")
        data = yaml.safe_load(text)
        text = (
            _dumped(changed_data(data, rng), True)
            if rng.random() < 0.6
            else changed_text(text, rng)
        )
        metadata.write_bytes(text.encode(errors="surrogatepass"))
    (database,) = path.glob("*.db3")
    if rng.random() < 0.3:
        _change_rows(database, rng)
    if rng.random() < 0.3:
        database.write_bytes(changed_bytes(database.read_bytes(), rng))
    return path if rng.random() < 0.7 else database


def _first_bag(material: Material, rng: Random, folder: Path) -> Path:
    """A bag of ROS 1, packed or not."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    types, kind, path = store.types, "sensor_msgs/msg/JointState", folder / "run.bag"
    writer = Writer(path)
    if rng.random() < 0.6:
        writer.set_compression(rng.choice(list(Writer.CompressionFormat)))
    with writer:
        connection = writer.add_connection("/joint_states", kind, typestore=store)
        for k, state in enumerate(_states(material)[:8]):
            stamp = types["builtin_interfaces/msg/Time"](**state["header"]["stamp"])
            header = types["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="base")
            q, tau = np.array(state["position"]), np.array(state["effort"])
            data = bytes(
                store.serialize_ros1(
                    types[kind](header, state["name"], q, np.zeros(0), tau), kind
                )
            )
            writer.write(
                connection,
                _START,
                changed_bytes(data, rng) if rng.random() < 0.1 else data,
            )
    return _written(path, path.read_bytes(), rng, 0.8)


def _change_rows(database: Path, rng: Random) -> None:
    columns = [
        ("topics", "name"),
        ("topics", "type"),
        ("topics", "offered_qos_profiles"),
        ("messages", "timestamp"),
    ]
    columns += [
        ("message_definitions", "encoded_message_definition"),
        ("messages", "topic_id"),
        ("messages", "data"),
    ]
    table, column = rng.choice(columns)
    with (
        sqlite3.connect(database) as connection,
        suppress(sqlite3.Error, OverflowError),
    ):
        (old,) = connection.execute(f"SELECT {column} FROM {table}").fetchone()
        new = (
            changed_text(old, rng)
            if isinstance(old, str)
            else rng.choice((*NUMBERS, plain_value(rng)))
        )
        connection.execute(
            f"UPDATE {table} SET {column} = ?",
            (new if isinstance(new, str | int | float) else None,),
        )
    connection.close()


def _flags(material: Material, rng: Random, folder: Path) -> Path:
    """A saved set that says another thing about itself: flags turned, counts, names and seeds changed."""
    data = json.loads(json.dumps(material.base))
    for _ in range(rng.choice((1, 1, 2, 3))):
        holder = rng.choice(
            [
                data,
                data["certificate"],
                data["model"],
                data["reading"],
                rng.choice(data["base"]),
            ]
        )
        key = rng.choice([*holder, "rounding", "generic", "numbers", "special"])
        value = holder.get(key)
        if isinstance(value, bool) or value is None:
            holder[key] = rng.choice((True, False, None, 0, "false", {}, []))
        elif isinstance(value, int | float):
            holder[key] = rng.choice(
                (0, -value, value + 1, str(value), float(value), True)
            )
        elif isinstance(value, str):
            holder[key] = rng.choice(
                (value.upper(), value + "\u200b", "", changed_text(value, rng))
            )
        elif isinstance(value, list):
            holder[key] = rng.choice(
                (value[::-1], value[:-1], [*value, *value[:1]], [], None)
            )
    return _written(
        folder / "base.json", json.dumps(data).encode(errors="surrogatepass"), rng
    )


def _one_line(material: Material, rng: Random, folder: Path) -> Path:
    """Text of one line that is given instead of a path: JSON, XML, or a path that is none."""
    data = changed_data(
        yaml.load(rng.choice(material.descriptions), yaml.BaseLoader), rng
    )
    text = rng.choice(
        (_dumped(data, False), "".join(URDF.splitlines()), " " + _dumped(data, False))
    )
    text = changed_text(text, rng) if rng.random() < 0.4 else text
    return _written(folder / "text", text.encode(errors="surrogatepass"), rng)


def _claims(material: Material, rng: Random, folder: Path) -> Path:
    name = rng.choice(("claims.txt", "claims.csv", "claims.json"))
    lines = material.claims.splitlines()
    text = (
        json.dumps(changed_data(lines, rng))
        if name.endswith("json")
        else changed_text(material.claims, rng)
    )
    return _written(folder / name, text.encode(errors="surrogatepass"), rng)


def _values(material: Material, rng: Random, folder: Path) -> Path:
    values = dict(material.model["values"])
    name = rng.choice(("values.json", "values.csv"))
    lines = "\n".join(f"{key},{value}" for key, value in values.items())
    text = (
        json.dumps(changed_data(values, rng))
        if name.endswith("json")
        else changed_text(lines, rng)
    )
    return _written(folder / name, text.encode(errors="surrogatepass"), rng)


def _sampled(material: Material, rng: Random, folder: Path) -> Path:
    """The motion as a table."""
    points = material.message["points"]
    times = [
        p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"]
        for p in points
    ]
    columns = {"t": np.array(times)} | {
        f"q_j{j + 1}": np.array([p["positions"][j] for p in points]) for j in range(2)
    }
    inner = Material(**{**vars(material), "log": columns})
    return (_csv if rng.random() < 0.5 else _parquet)(inner, rng, folder)


FORMATS: dict[str, Maker] = {
    "description": _document("robot.yaml", lambda m, rng: rng.choice(m.descriptions)),
    "description as JSON": _document(
        "robot.json",
        lambda m, rng: yaml.load(rng.choice(m.descriptions), yaml.BaseLoader),
    ),
    "linear model": _document("robot.yaml", lambda m, rng: rng.choice(m.linear)),
    "set-up": _document("setup.yaml", lambda m, _: m.descriptions[-1]),
    "URDF": _xml("robot.urdf", lambda *_: URDF),
    "URDF of other programs": _xml("robot.urdf", lambda _, rng: dialects.urdf(rng)),
    "SDF": _xml("robot.sdf", lambda _, rng: dialects.sdf(rng)),
    "text of one line": _one_line,
    "MJCF": _xml("robot.xml", lambda m, rng: rng.choice(m.mjcf)),
    "base model": _document("base.json", lambda m, _: m.base),
    "base model with other flags": _flags,
    "identified model": _document("model.json", lambda m, _: m.model),
    "claims": _claims,
    "values": _values,
    "trajectory as JSON": _document("motion.json", lambda m, _: m.trajectory),
    "trajectory as YAML": _document("motion.yaml", lambda m, _: m.message),
    "trajectory as a table": _sampled,
    "CSV log": _csv,
    "Parquet log": _parquet,
    "NumPy log": _npz,
    "MAT log": _mat,
    "HDF5 log": _hdf5,
    "MCAP log": _mcap,
    "ROS bag": _bag,
    "ROS 1 bag": _first_bag,
}
