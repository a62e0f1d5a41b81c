"""Bags: messages that rosbags and mcap wrote come back as columns, each with its clock."""

from __future__ import annotations

import json
import shutil
import sqlite3
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from echelon.identification.logs.files.bag_file import BagFile
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.files.open_log import log_paths, open_log, read_table
from echelon.shared.errors import InputError, MissingExtraError

START = 1_700_000_000_123_456_789
STORE = get_typestore(Stores.ROS2_HUMBLE)
TYPES = STORE.types

Message = tuple[str, int, Any]


def header(time: int) -> Any:
    stamp = TYPES["builtin_interfaces/msg/Time"](
        sec=time // 10**9, nanosec=time % 10**9
    )
    return TYPES["std_msgs/msg/Header"](stamp=stamp, frame_id="base")


def joints(
    time: int,
    names: Sequence[str],
    position: Iterable[float],
    velocity: Iterable[float] = (),
    effort: Iterable[float] = (),
) -> Any:
    arrays = [
        np.array(list(values), dtype=float) for values in (position, velocity, effort)
    ]
    return TYPES["sensor_msgs/msg/JointState"](header(time), list(names), *arrays)


def vector(*values: float) -> Any:
    return TYPES["geometry_msgs/msg/Vector3"](*values)


def numbers(values: Iterable[float]) -> Any:
    layout = TYPES["std_msgs/msg/MultiArrayLayout"]([], 0)
    return TYPES["std_msgs/msg/Float64MultiArray"](
        layout, np.array(list(values), dtype=float)
    )


def write(
    path: Path,
    messages: Iterable[Message],
    storage: str = "sqlite3",
    store: Any = STORE,
    mode: str = "none",
) -> Path:
    """A bag of messages: topic, time of reception, content."""
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    writer.set_compression(CompressionMode[mode.upper()], CompressionFormat.ZSTD)
    with writer:
        connections: dict[tuple[str, str], Any] = {}
        for topic, time, message in messages:
            kind = message.__msgtype__
            if (topic, kind) not in connections:
                connections[topic, kind] = writer.add_connection(
                    topic, kind, typestore=store
                )
            writer.write(
                connections[topic, kind], time, store.serialize_cdr(message, kind)
            )
    return path


def robot(count: int = 200) -> list[Message]:
    """A log of two joints, whose order in the messages changes, and of a wrist sensor that is slower."""
    messages: list[Message] = []
    for k in range(count):
        time = START + 1_000_003 * k
        state = joints(time, ["a", "b"], [k, -k], [1, 2], [k / 8, k / 16])
        if k % 3 == 1:
            state = joints(time, ["b", "a"], [-k, k], [2, 1], [k / 16, k / 8])
        messages.append(("/joint_states", time + 50, state))
        if k % 4 == 0:
            wrench = TYPES["geometry_msgs/msg/Wrench"](vector(k, 1, 2), vector(3, 4, 5))
            messages.append(
                (
                    "/ft",
                    time + 60,
                    TYPES["geometry_msgs/msg/WrenchStamped"](header(time + 7), wrench),
                )
            )
            messages.append(("/command", time + 70, numbers([k, 0.5])))
    return messages


STORAGES = ["sqlite3", "mcap"]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The log of the robot in every storage; writing takes far longer than copying."""
    folder = tmp_path_factory.mktemp("written")
    for storage in STORAGES:
        write(folder / storage / "run", robot(), storage)
    return folder


@pytest.fixture(params=["sqlite3", "mcap", "lone db3", "lone mcap"])
def bag(request: pytest.FixtureRequest, written: Path, tmp_path: Path) -> Path:
    """The log of the robot: as a directory and as the file in it."""
    storage = request.param.split()[-1].replace("db3", "sqlite3")
    path = shutil.copytree(written / storage / "run", tmp_path / "run")
    return next(path.glob("run.*")) if "lone" in request.param else path


def whole(path: Path, names: Sequence[str] | None = None) -> Table:
    (table,) = open_log(path).tables(names)
    return table


def test_joint_states_go_by_joint_and_wrenches_by_component(bag: Path) -> None:
    log = open_log(bag)
    assert isinstance(log, BagFile)
    table = whole(bag)
    assert sorted(log.names) == sorted(table.columns)
    k = np.arange(200)
    for name, values in {
        "/joint_states/position/a": k, "/joint_states/position/b": -k, "/joint_states/velocity/a": 0 * k + 1,
        "/joint_states/effort/b": k / 16, "/ft/wrench/force/x": k[::4], "/ft/wrench/torque/z": 0 * k[::4] + 5,
        "/command/data[0]": k[::4], "/command/data[1]": 0 * k[::4] + 0.5,
    }.items():  # fmt: skip
        np.testing.assert_array_equal(table.columns[name], values, err_msg=name)
    assert not any("header" in name for name in log.names)
    assert table.clocks["/ft/wrench/force/x"] == "/ft/time"
    assert table.clocks["/joint_states/effort/b"] == "/joint_states/time"
    assert set(table.clocks) | set(table.clocks.values()) == set(table.columns)


def test_times_are_those_of_the_header_to_the_nanosecond(bag: Path) -> None:
    log = open_log(bag)
    assert isinstance(log, BagFile)
    assert log.origin == START // 10**9
    columns = whole(bag).columns
    k = np.arange(200)
    for name, expected in {
        "/joint_states/time": START + 1_000_003 * k,
        "/ft/time": START + 1_000_003 * k[::4] + 7,
        "/command/time": START
        + 1_000_003 * k[::4]
        + 70,  # no header: when it was received
    }.items():
        nanoseconds = np.rint(columns[name] * 1e9).astype(np.int64) + log.origin * 10**9
        np.testing.assert_array_equal(nanoseconds, expected, err_msg=name)


def test_only_the_topics_that_are_needed_are_read(
    bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = open_log(bag)
    decoded = set()
    original = type(STORE).deserialize_cdr

    def watched(self: Any, message: bytes, kind: str) -> object:
        decoded.add(kind)
        return original(self, message, kind)

    monkeypatch.setattr(type(STORE), "deserialize_cdr", watched)
    (table,) = log.tables(["/ft/wrench/force/y"])
    assert list(table.columns) == ["/ft/time", "/ft/wrench/force/y"]
    assert decoded == {"geometry_msgs/msg/WrenchStamped"}


def test_missing_columns_of_a_bag(bag: Path) -> None:
    log = open_log(bag)
    for name, problem in {
        "/joint_states/positon/a": "no such column; did you mean '/joint_states/position/a'",
        "/joint_state/position/a": "no such column; did you mean '/joint_states/position/a'",
        "/joint_states/position": "has 2 columns; name one of them, such as '/joint_states/position/a'",
        "/command/data[2]": r"no such column; did you mean '/command/data\[",
    }.items():
        with pytest.raises(InputError, match=rf"{bag}: column '.*': {problem}"):
            list(log.tables([name]))


@pytest.mark.parametrize("storage", STORAGES)
def test_two_publishers_of_different_joints_share_a_topic(
    storage: str, tmp_path: Path
) -> None:
    """Each joint has the times at which it was published; and none is missed because it appears late."""
    messages = [
        ("/joint_states", START + k, joints(START + 1000 * k, ["arm"], [k]))
        for k in range(0, 300, 2)
    ]
    messages += [
        ("/joint_states", START + k, joints(START + 1000 * k, ["hand"], [k]))
        for k in range(201, 300, 2)
    ]
    log = open_log(
        write(
            tmp_path / "run", sorted(messages, key=lambda message: message[1]), storage
        )
    )
    assert log.names == ("/joint_states/time", "/joint_states/position/arm")
    (table,) = log.tables(["/joint_states/position/hand", "/joint_states/position/arm"])
    for joint, numbers_ in (
        ("arm", np.arange(0, 300, 2)),
        ("hand", np.arange(201, 300, 2)),
    ):
        name = f"/joint_states/position/{joint}"
        np.testing.assert_array_equal(table.columns[name], numbers_)
        assert table.clocks[name] == f"/joint_states/time/position/{joint}"
        times = START % 10**9 + 1000 * numbers_
        np.testing.assert_array_equal(
            np.rint(table.columns[table.clocks[name]] * 1e9), times
        )


@pytest.mark.parametrize("stamp", [7 * 10**9 + 5, 0])
def test_stamps_of_another_clock(stamp: int, tmp_path: Path) -> None:
    """A simulation counts from its own start; a stamp that nobody set is none."""
    messages = [
        ("/sim", START + k, joints(stamp and stamp + k, ["a"], [k])) for k in range(5)
    ]
    messages += [
        ("/real", START + 9 + k, joints(START + 9 + k, ["a"], [k])) for k in range(5)
    ]
    table = whole(write(tmp_path / "run", messages))
    expected = 5 if stamp else START % 10**9
    np.testing.assert_array_equal(
        np.rint(table.columns["/sim/time"] * 1e9), expected + np.arange(5)
    )
    np.testing.assert_array_equal(
        np.rint(table.columns["/real/time"] * 1e9), START % 10**9 + 9 + np.arange(5)
    )


def test_numbers_of_any_message(tmp_path: Path) -> None:
    """A type of one's own with everything in it, and a topic that is too wide to be a signal."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    text = "bool on\nuint8[3] code\nint64[] many\nstring note\nPart part\nPart[] parts\nstring[] joint_names\n"
    text += (
        "float32[] tau\n"
        + "=" * 80
        + "\nMSG: own_msgs/Part\nfloat64 x\nbuiltin_interfaces/Duration wait\n"
    )
    text += "=" * 80 + "\nMSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n"
    store.register(get_types_from_msg(text, "own_msgs/msg/Thing"))
    thing, part = store.types["own_msgs/msg/Thing"], store.types["own_msgs/msg/Part"]
    wait = store.types["builtin_interfaces/msg/Duration"](2, 500)
    message = thing(
        True, np.array([1, 2, 3], np.uint8), np.array([7, 8], np.int64), "text", part(0.5, wait),
        [part(1.0, wait), part(2.0, wait), part(3.0, wait)], ["a", "b"], np.array([1.5, 2.5], np.float32),
    )  # fmt: skip
    wide = store.types["std_msgs/msg/UInt8MultiArray"](
        store.types["std_msgs/msg/MultiArrayLayout"]([], 0), np.zeros(1000, np.uint8)
    )
    path = write(
        tmp_path / "run",
        [("/thing", START, message), ("/wide", START, wide)],
        store=store,
    )
    table = whole(path)
    expected = {
        "on": 1, "code[0]": 1, "code[1]": 2, "code[2]": 3, "many/a": 7, "many/b": 8, "tau/a": 1.5, "tau/b": 2.5,
        "part/x": 0.5, "part/wait/sec": 2, "part/wait/nanosec": 500,
        **{f"parts[{k}]/x": k + 1 for k in range(3)},
        **{f"parts[{k}]/wait/{unit}": value for k in range(3) for unit, value in (("sec", 2), ("nanosec", 500))},
    }  # fmt: skip
    found = {
        name.removeprefix("/thing/"): values[0]
        for name, values in table.columns.items()
        if "thing" in name
    }
    assert found.pop("time") == START % 10**9 / 1e9
    assert found == expected
    with pytest.raises(
        InputError,
        match=r"column '/wide/data\[3\]': has 1000 entries; arrays of at most 256",
    ):
        whole(path, ["/wide/data[3]"])


def test_a_joint_that_is_named_twice_is_an_error(tmp_path: Path) -> None:
    path = write(
        tmp_path / "run", [("/joint_states", START, joints(START, ["a", "a"], [1, 2]))]
    )
    with pytest.raises(
        InputError, match=r"run: '/joint_states/name': a message names 'a' twice"
    ):
        open_log(path)


@pytest.mark.parametrize("mode", ["file", "message"])
def test_compressed_bags(mode: str, tmp_path: Path) -> None:
    path = write(tmp_path / "run", robot(20), mode=mode)
    np.testing.assert_array_equal(
        whole(path).columns["/joint_states/position/b"], -np.arange(20)
    )


def test_bags_without_definitions_use_those_of_ros(tmp_path: Path) -> None:
    """As all bags before ROS 2 Iron; a type that nobody knows costs its topic only."""
    path = write(tmp_path / "run", robot(20))
    with sqlite3.connect(path / "run.db3") as database:
        database.execute("DELETE FROM message_definitions")
        database.execute(
            "UPDATE topics SET type = 'own_msgs/msg/Unknown' WHERE name = '/command'"
        )
    metadata = path / "metadata.yaml"
    metadata.write_text(
        metadata.read_text().replace(
            "std_msgs/msg/Float64MultiArray", "own_msgs/msg/Unknown"
        )
    )
    for log in (open_log(path), open_log(path / "run.db3")):
        (table,) = log.tables(["/joint_states/position/b"])
        np.testing.assert_array_equal(
            table.columns["/joint_states/position/b"], -np.arange(20)
        )
        with pytest.raises(
            InputError,
            match=r"type own_msgs/msg/Unknown is defined neither in the bag nor by ROS 2",
        ):
            list(log.tables(["/command/data[0]"]))


# -- MCAP --------------------------------------------------------------------------------------------------------------


def write_mcap(
    path: Path,
    messages: Iterable[tuple[str, int, bytes]],
    encoding: str = "json",
    **options: Any,
) -> Path:
    with path.open("wb") as stream:
        writer = McapWriter(stream, **options)
        writer.start()
        schema = writer.register_schema(
            name="robot.State", encoding="jsonschema", data=b'{"type":"object"}'
        )
        channels: dict[str, int] = {}
        for topic, time, data in messages:
            if topic not in channels:
                channels[topic] = writer.register_channel(
                    topic=topic, message_encoding=encoding, schema_id=schema
                )
            writer.add_message(
                channels[topic], log_time=time, publish_time=time, data=data
            )
        writer.finish()
    return path


def coded(*messages: object, topic: str = "/state") -> list[tuple[str, int, bytes]]:
    return [
        (topic, START + 1000 * k, json.dumps(message).encode())
        for k, message in enumerate(messages)
    ]


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"compression": CompressionType.NONE},
        {"compression": CompressionType.LZ4, "chunk_size": 200},
        {"use_chunking": False},
        {"use_statistics": False},
        {
            "use_summary_offsets": False,
            "repeat_channels": False,
            "repeat_schemas": False,
        },
    ],
)
def test_json_messages(options: dict[str, Any], tmp_path: Path) -> None:
    messages = coded(
        *(
            {"q": [k, 2 * k], "tau": {"a": k / 4}, "on": k > 1, "mode": "run"}
            for k in range(50)
        )
    )
    messages += coded(
        *({"name": ["x", "y"], "position": [k, -k]} for k in range(50)), topic="/named"
    )
    table = whole(write_mcap(tmp_path / "run.mcap", messages, **options))
    k = np.arange(50)
    expected = {
        "/state/time": None, "/state/q[0]": k, "/state/q[1]": 2 * k, "/state/tau/a": k / 4, "/state/on": k > 1,
        "/named/time": None, "/named/position/x": k, "/named/position/y": -k,
    }  # fmt: skip
    assert set(table.columns) == set(expected)
    for name, values in expected.items():
        if values is None:
            values = (START % 10**9 + 1000 * k) / 1e9
        np.testing.assert_array_equal(table.columns[name], values, err_msg=name)


def test_json_with_gaps_and_clocks_of_its_own(tmp_path: Path) -> None:
    stamped = [
        {
            "timestamp": {"sec": 5, "nsec": k},
            "time": k,
            "v": None if k == 1 else [k, None],
        }
        for k in range(3)
    ]
    messages = [*coded(*stamped), *coded(1.5, 2.5, topic="/plain")]
    table = whole(write_mcap(tmp_path / "run.mcap", messages))
    np.testing.assert_array_equal(table.columns["/state/log_time"], [0, 1e-9, 2e-9])
    np.testing.assert_array_equal(table.columns["/state/time"], [0, 1, 2])
    np.testing.assert_array_equal(table.columns["/state/v[0]"], [0, 2])
    np.testing.assert_array_equal(table.columns["/state/v[1]"], [np.nan, np.nan])
    np.testing.assert_array_equal(table.columns[table.clocks["/state/v[0]"]], [0, 2e-9])
    np.testing.assert_array_equal(table.columns["/plain"], [1.5, 2.5])


@pytest.mark.parametrize(
    ("messages", "problem"),
    [
        (
            [("/state", START, b"{")],
            r"not well-formed JSON: Expecting",
        ),
        (coded("text"), r"holds no messages with numbers"),
        ([], r"holds no messages with numbers"),
        (
            coded({"x": 10**400}),
            r"topic '/state': a message holds an integer that is too large",
        ),
        (
            coded({"q[0]": 1, "q": [2]}),
            r"column '/state/q\[0\]': a message holds two numbers of this name",
        ),
        (
            coded({"header": {"stamp": {"sec": 5, "nsec": 0}}, "v": 1}, {"v": 2}),
            "a message carries no time, unlike",
        ),
        (
            coded({"b/x": 1}, topic="/a") + coded({"x": 1}, topic="/a/b"),
            "two topics have columns of this name",
        ),
    ],
)
def test_messages_that_cannot_be_columns(
    messages: list[tuple[str, int, bytes]], problem: str, tmp_path: Path
) -> None:
    path = write_mcap(tmp_path / "run.mcap", messages)
    with pytest.raises(
        InputError, match=rf"run\.mcap: .*{problem}|run\.mcap: {problem}"
    ):
        read_table(path)


def test_encodings_that_are_not_read_name_the_schema(tmp_path: Path) -> None:
    path = write_mcap(
        tmp_path / "run.mcap", [("/imu", START, b"\x08\x01")], encoding="protobuf"
    )
    problem = r"its messages are encoded as 'protobuf' \(schema robot\.State\); JSON and ROS 2's CDR are read"
    with pytest.raises(
        InputError,
        match=rf"run\.mcap: holds no messages with numbers \('/imu': {problem}\)",
    ):
        open_log(path)


def test_ros_messages_and_json_in_one_file(tmp_path: Path) -> None:
    """The encoding is the channel's, not the file's."""
    path, kind = tmp_path / "run.mcap", "sensor_msgs/msg/JointState"
    with path.open("wb") as stream:
        writer = McapWriter(stream)
        writer.start(profile="", library="own")
        text, _ = STORE.generate_msgdef(kind, ros_version=2)
        schema = writer.register_schema(
            name=kind, encoding="ros2msg", data=text.encode()
        )
        ros = writer.register_channel(
            topic="/joint_states", message_encoding="cdr", schema_id=schema
        )
        plain = writer.register_channel(
            topic="/current", message_encoding="json", schema_id=0
        )
        other = writer.register_channel(
            topic="/imu", message_encoding="protobuf", schema_id=0
        )
        for k in range(10):
            state = STORE.serialize_cdr(joints(START + k, ["a"], [k]), kind)
            writer.add_message(
                ros, log_time=START + k, publish_time=0, data=bytes(state)
            )
            writer.add_message(
                plain, log_time=START + k, publish_time=0, data=b'{"i": %d}' % k
            )
            writer.add_message(
                other, log_time=START + k, publish_time=0, data=b"\x08\x01"
            )
        writer.finish()
    table = whole(path)
    np.testing.assert_array_equal(
        table.columns["/joint_states/position/a"], np.arange(10)
    )
    np.testing.assert_array_equal(table.columns["/current/i"], np.arange(10))
    with pytest.raises(
        InputError,
        match="encoded as 'protobuf', without a schema; JSON and ROS 2's CDR are read",
    ):
        whole(path, ["/imu/x"])


# -- what goes wrong ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.001, 0.1, 0.5, 0.9, 0.999])
def test_a_bag_that_was_cut_off_is_one_clear_error(bag: Path, share: float) -> None:
    file = next(bag.glob("run.*")) if bag.is_dir() else bag
    content = file.read_bytes()
    file.write_bytes(content[: int(len(content) * share)])
    with pytest.raises(InputError, match="cut off") as caught:
        read_table(bag)
    assert "\n" not in str(caught.value)
    if bag.suffix == ".mcap":
        assert "mcap recover" in str(caught.value)


@pytest.mark.parametrize(
    "seeds", [range(6), pytest.param(range(6, 40), marks=pytest.mark.slow)]
)
def test_no_damage_of_a_bag_becomes_another_error(bag: Path, seeds: range) -> None:
    file = next(bag.glob("run.*")) if bag.is_dir() else bag
    content = file.read_bytes()
    refused = 0
    for seed in seeds:
        random = np.random.default_rng(seed)
        damaged = bytearray(content)
        for place in (
            *random.integers(len(content), size=3),
            *random.integers(200, size=2),
        ):
            damaged[place] = int(random.integers(256))
        file.write_bytes(damaged)
        try:
            read_table(bag)
        except InputError:
            refused += 1
    assert refused > 0


def test_bags_that_are_not_complete(tmp_path: Path) -> None:
    path = write(tmp_path / "run", robot(10))
    (path / "run.db3-wal").write_bytes(b"pages")
    with pytest.raises(
        InputError, match=r"was not closed: run\.db3-wal still holds messages"
    ):
        open_log(path)
    (path / "run.db3-wal").unlink()
    (path / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 99}")
    with pytest.raises(InputError, match="cannot be read as a ROS bag"):
        open_log(path)
    (path / "metadata.yaml").unlink()
    with pytest.raises(
        InputError,
        match=r"metadata\.yaml is missing; name run\.db3 in it, or repair the bag",
    ):
        open_log(path)
    for name in ("run.db3", "run.mcap"):
        (path / name).unlink(missing_ok=True)
        with pytest.raises(InputError, match="no such file"):
            open_log(path / name)
        (path / name).touch()
        with pytest.raises(InputError, match="is empty"):
            open_log(path / name)


def test_directories_of_bags(tmp_path: Path) -> None:
    for name in ("run_10", "run_9"):
        write(tmp_path / name, robot(3))
    assert [path.name for path in log_paths(tmp_path)] == ["run_9", "run_10"]
    assert log_paths(tmp_path / "run_9") == [tmp_path / "run_9"]


@pytest.mark.parametrize("compression", ["none", "bz2", "lz4"])
def test_bags_of_ros_1(compression: str, tmp_path: Path) -> None:
    """As rosbags writes them, with the definitions of Noetic."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds, path = store.types, tmp_path / "run.bag"
    writer = Writer1(path)
    if compression != "none":
        writer.set_compression(Writer1.CompressionFormat[compression.upper()])
    with writer:
        states = writer.add_connection(
            "/joint_states", "sensor_msgs/msg/JointState", typestore=store
        )
        for k in range(100):
            time = START + 10_000_000 * k
            stamp = kinds["builtin_interfaces/msg/Time"](
                sec=time // 10**9, nanosec=time % 10**9
            )
            head = kinds["std_msgs/msg/Header"](seq=k, stamp=stamp, frame_id="")
            values = [np.array([k, -k], dtype=float) * factor for factor in (1, 2, 3)]
            message = kinds["sensor_msgs/msg/JointState"](head, ["a", "b"], *values)
            writer.write(
                states, time + 5, store.serialize_ros1(message, message.__msgtype__)
            )
    assert log_paths(path) == [path]
    found = read_table(path).columns
    np.testing.assert_array_equal(
        found["/joint_states/effort/b"], -3.0 * np.arange(100)
    )
    np.testing.assert_allclose(np.diff(found["/joint_states/time"]), 0.01, rtol=1e-6)
    for share in (0.3, 0.9):
        cut = tmp_path / "cut.bag"
        cut.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        with pytest.raises(
            InputError,
            match="cannot be read as a ROS bag; it is damaged or was cut off",
        ):
            read_table(cut)


@pytest.mark.parametrize(
    ("package", "file"), [("rosbags.rosbag2", ""), ("mcap.reader", "run.mcap")]
)
def test_bags_need_the_extra(
    package: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "run", robot(3), "mcap") / file
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=r"echelon-robotics\[ros\]"):
        open_log(path)
