"""Small files that would cost much: each is one clear error, in little time and memory."""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import resource
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import echelon as ec
from echelon.base.claims.reading import read_claims
from echelon.excite.files.trajectory_file import read_trajectory
from echelon.identification.logs.files.open_log import open_log, read_table
from echelon.shared.errors import InputError
from echelon.shared.inputs import (
    COLUMNS,
    DEPTH,
    LIMITS,
    Limit,
    limits_table,
    parse_json,
    parse_xml,
    parse_yaml,
)
from fuzz.child import run_alone
from support.paths import ROOT
from support.selection import slow_unless

SECONDS = 10
MEMORY = 400 << 20
NAMES, UNITS = ("j1", "j2"), ("rad", "rad")

Act = Callable[[Path], object]


def refused(act: Callable[[], object], problem: str, log: Path) -> None:
    """The act ends with an error of input that matches, within seconds and some hundred megabytes."""

    def attempt() -> int:
        try:
            act()
        except InputError as error:
            print(error)  # noqa: T201
            return 2
        return 0

    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
    outcome = run_alone(attempt, log)
    assert outcome.code == 2, outcome
    assert re.search(problem, outcome.text), outcome.text
    assert outcome.seconds < SECONDS
    assert outcome.memory < before + MEMORY


# -- documents ---------------------------------------------------------------------------------------------------------

DEEP = "[" * 900 + "]" * 900
MERGED = "a0: &a0 {x: 1}\n" + "".join(
    f"a{k}: &a{k} {{<<: [{', '.join([f'*a{k - 1}'] * 9)}]}}\n" for k in range(1, 12)
)  # fmt: skip
LISTS = "a0: &a0 [1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 12)
)
ENDLESS = "- 1\n" * 1_500_000  # 6 MB
HARMONICS = json.dumps(
    {
        "echelon_trajectory": 1,
        "coordinates": ["j1"],
        "units": ["rad"],
        "motion": {
            "family": "fourier",
            "duration": 1.0,
            "harmonics": 10**9,
            "coefficients": {"j1": {"constant": 0.0, "sin": [], "cos": []}},
        },
    }
)
READERS: dict[str, Act] = {
    "robot.yaml": ec.load,
    "robot.json": ec.load,
    "robot.urdf": ec.load,
    "model.yaml": ec.load_linear,
    "setup.yaml": ec.load_setup,
    "base.json": ec.load_base,
    "model.json": ec.load_identified,
    "claims.json": lambda path: read_claims(path),
    "motion.json": lambda path: read_trajectory(path, NAMES, UNITS),
    "motion.yaml": lambda path: read_trajectory(path, NAMES, UNITS),
}
DOCUMENTS = {
    "merge keys": ("motion.yaml", MERGED, "aliases"),
    "aliases": ("motion.yaml", LISTS, "aliases"),
    "aliases in a description": ("robot.yaml", LISTS, "aliases"),
    "aliases in a set-up": ("setup.yaml", MERGED, "aliases"),
    "endless list": ("motion.yaml", ENDLESS[: 1 << 20], "not a JointTrajectory .* needs a mapping"),
    "endless list in a description": ("robot.yaml", ENDLESS, "has more than 250,000 numbers"),
    "endless JSON list": ("base.json", "[" + "0," * 5_000_000 + "0]", "has more than 4,000,000 numbers"),
    "harmonics": ("motion.json", HARMONICS, "has 0 entries; needs 1000000000"),
    "elements": ("robot.urdf", "<robot>" + "<a/>" * 1_100_000 + "</robot>", "has more than 1,000,000 elements"),
    "attributes": ("robot.urdf", "<robot " + "a='1' " * 1_100_000 + "/>", "has more than 1,000,000"),
    "nested elements": ("robot.urdf", "<a>" * 600 + "</a>" * 600, "nesting is too deep"),
    "size": ("robot.yaml", " " * (65 << 20), "has more than 64 MiB"),
    **{
        f"nested {name}": (name, DEEP, "nested too deeply")
        for name in READERS
        if not name.endswith("urdf")
    },
}  # fmt: skip


@pytest.mark.parametrize("case", DOCUMENTS)
def test_documents_that_multiply(case: str, tmp_path: Path) -> None:
    name, text, problem = DOCUMENTS[case]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    refused(lambda: READERS[name](path), problem, tmp_path / "printed")


@pytest.mark.parametrize(
    "name", [*READERS, "run.csv", "run.npz", "run.mat", "run.parquet", "run.mcap"]
)
def test_links_to_devices_without_end(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.symlink_to("/dev/zero")
    refused(
        lambda: READERS.get(name, read_table)(path),
        "has more than 64 MiB|is a pipe or a device",
        tmp_path / "printed",
    )


def test_a_log_is_no_pipe(tmp_path: Path) -> None:
    """It would wait for a writer for ever."""
    os.mkfifo(tmp_path / "run.csv")
    with pytest.raises(InputError, match="is a pipe or a device"):
        open_log(tmp_path / "run.csv")


def test_depth_counts_brackets_outside_of_texts() -> None:
    inside = "[" * DEPTH.most + json.dumps("[" * 99 + '\\"') + "]" * DEPTH.most
    assert parse_json(inside, "x.json")
    with pytest.raises(InputError, match="nested too deeply"):
        parse_json(f"[{inside}]", "x.json")
    with pytest.raises(InputError, match="not well-formed"):
        parse_json("[" * 63 + '["' + '\\"' * 100_000, "x.json")
    assert parse_yaml("[" * DEPTH.most + "]" * DEPTH.most, "x.yaml")
    with pytest.raises(InputError, match="nested too deeply"):
        parse_yaml("[" * (DEPTH.most + 1) + "]" * (DEPTH.most + 1), "x.yaml")


def test_yaml_without_libyaml_is_bounded_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import yaml

    monkeypatch.setattr(yaml, "__with_libyaml__", False)
    assert parse_yaml("a: [1, ~, 'x']", "x.yaml")[0].data == {"a": ["1", None, "x"]}
    with pytest.raises(InputError, match=r"has more than 20 numbers, .*; too many"):
        parse_yaml(
            "[" + "1, " * 30 + "]",
            "x.yaml",
            Limit(20, "numbers, texts, lists and mappings", "too many"),
        )


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_elements_are_counted_in_every_encoding(encoding: str) -> None:
    text = "<robot>" + "<a/>" * 1_000_000 + "</robot>"
    with pytest.raises(InputError, match="has more than 1,000,000 elements"):
        parse_xml(text.encode(encoding), "robot.urdf")


# -- logs --------------------------------------------------------------------------------------------------------------

MIB = 1 << 20


def zeros(size: int = 256 * MIB) -> bytes:
    """Deflated zeros, without a header."""
    packer = zlib.compressobj(1)
    return b"".join(
        [*(packer.compress(bytes(MIB)) for _ in range(size // MIB)), packer.flush()]
    )


def npy(shape: object, content: bytes = b"", kind: str = "<f8") -> bytes:
    header = (
        repr({"descr": kind, "fortran_order": False, "shape": shape})
        .encode()
        .ljust(117)
        + b"\n"
    )
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + content


def npz(path: Path) -> None:
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open("q.npy", "w") as file,
    ):
        file.write(npy((256 * MIB // 8,)))
        for _ in range(256):
            file.write(bytes(MIB))


def mat(path: Path) -> None:
    packed = zeros()
    path.write_bytes(
        b"MATLAB 5.0".ljust(124)
        + b"\x00\x01IM"
        + struct.pack("<II", 15, len(packed))
        + packed
    )


def mat_of_elements(path: Path) -> None:
    """A cell of a cell of … with a million empty matrices."""
    empty = struct.pack("<II", 14, 0)
    inside = struct.pack("<IIIIIIiiII", 6, 8, 1, 0, 5, 8, 250, 1, 1, 0) + empty * 250
    cell = struct.pack("<II", 14, len(inside)) + inside
    whole = struct.pack("<IIIIIIiiII", 6, 8, 1, 0, 5, 8, 250, 1, 1, 0) + cell * 250
    path.write_bytes(
        b"MATLAB 5.0".ljust(124)
        + b"\x00\x01IM"
        + struct.pack("<II", 14, len(whole))
        + whole
    )


def parquet(path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pa.table({"q": np.zeros(MIB)})
    with pq.ParquetWriter(path, table.schema) as writer:
        for _ in range(40):
            writer.write_table(table)


def mcap(compression: str) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        import lz4.frame
        import zstandard

        pack = {
            "zstd": zstandard.compress,
            "lz4": lambda data: lz4.frame.compress(data, store_size=False),
        }
        data = pack[compression](bytes(192 * MIB))
        chunk = (
            struct.pack("<QQQII", 0, 0, 100, 0, len(compression)) + compression.encode()
        )
        chunk += struct.pack("<Q", len(data)) + data
        footer = struct.pack("<BQQQI", 2, 20, 0, 0, 0)
        mark = b"\x89MCAP0\r\n"
        header = struct.pack("<BQII", 1, 8, 0, 0)
        path.write_bytes(
            mark + header + struct.pack("<BQ", 6, len(chunk)) + chunk + footer + mark
        )

    return write


def mcap_of_deep_json(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="own")
        channel = writer.register_channel(
            topic="/a", message_encoding="json", schema_id=0
        )
        writer.add_message(channel, 0, b'{"a": ' + DEEP.encode() + b"}", 0)
        writer.finish()


def write(content: Callable[[], bytes]) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(content())


LOGS: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "gzip": (
        "run.csv.gz",
        write(lambda: gzip.compress(b"a,b,c,d,e,f,g\n") + gzip.compress(b"0,0,0,0,0,0,0\n" * MIB) * 10),
        "unpacks to more",
    ),
    "gzip of one line": ("run.csv.gz", write(lambda: gzip.compress(bytes(MIB)) * 256), "no text|in a line"),
    "gzip of blank lines": (
        "run.csv.gz",
        write(lambda: gzip.compress(b"t,q\n1,2\n") + gzip.compress(b"\n" * MIB) * 96),
        "unpacks to more",
    ),
    "line in the middle": ("run.csv", write(lambda: b"t,q\n" + b"1,2\n" * 99 + b"1" * 2 * MIB), "in a line"),
    "NPZ": ("run.npz", npz, "unpacks to more than 64 MiB"),
    "NPY, product beyond 2^64": ("run.npy", write(lambda: npy((2**32, 2**32), bytes(80))), "damaged"),
    "NPY, product 0 modulo 2^64": ("run.npy", write(lambda: npy((2, 2**63), bytes(80))), "damaged"),
    "NPY of wide fields": (
        "run.npy",
        lambda path: path.write_bytes(npy((0,), b"", "('<f8', (1000000000,))").replace(b"\"", b" ")),
        "holds no arrays|damaged",
    ),
    "MAT": ("run.mat", mat, "unpacks to more than 64 MiB"),
    "MAT of empty elements": ("run.mat", mat_of_elements, f"has more than {COLUMNS}"),
    "Parquet": ("run.parquet", parquet, "unpacks to more than 64 MiB"),
    "MCAP, zstd": ("run.mcap", mcap("zstd"), "unpacks to more than 64 MiB"),
    "MCAP, lz4": ("run.mcap", mcap("lz4"), "unpacks to more than 64 MiB"),
    "MCAP, deep JSON": ("run.mcap", mcap_of_deep_json, "nested too deeply"),
    "columns": (
        "run.csv",
        lambda path: path.write_text(",".join(f"q{k}" for k in range(100_000)) + "\n" + "0," * 99_999 + "0\n"),
        f"has more than {COLUMNS}",
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    "case",
    slow_unless(lambda case: case not in ("gzip", "gzip of blank lines", "MAT"), LOGS),
)
def test_logs_that_multiply(case: str, tmp_path: Path) -> None:
    name, make, problem = LOGS[case]
    make(tmp_path / name)
    assert (tmp_path / name).stat().st_size < 8 * MIB
    refused(lambda: read_table(tmp_path / name), problem, tmp_path / "printed")


def test_as_many_columns_as_allowed_are_read_in_no_time(tmp_path: Path) -> None:
    names = [f"q{k}" for k in range(COLUMNS.most)]
    rows = "\n".join(
        ",".join(map(str, range(row, row + COLUMNS.most))) for row in range(3)
    )
    (tmp_path / "run.csv").write_text(",".join(names) + "\n" + rows + "\n")
    assert read_table(tmp_path / "run.csv").columns["q16383"].tolist() == [
        16383,
        16384,
        16385,
    ]


def test_packed_numbers_are_read_as_before(tmp_path: Path) -> None:
    """Noise hardly packs, and constants are no bomb as long as they are few."""
    q = np.random.default_rng(0).normal(size=(10_000, 3))
    np.savez_compressed(tmp_path / "run.npz", q=q, still=np.zeros(10_000))
    assert read_table(tmp_path / "run.npz").columns["q[2]"].tolist() == q[:, 2].tolist()
    stream = io.StringIO()
    np.savetxt(stream, q, delimiter=",")
    (tmp_path / "run.csv.gz").write_bytes(
        gzip.compress(b"0,0,0\n" * 100_000 + stream.getvalue().encode())
    )
    assert read_table(tmp_path / "run.csv.gz").columns["1"].size == 110_000


# -- bags --------------------------------------------------------------------------------------------------------------


def bag(folder: Path) -> tuple[Path, Path]:
    """A bag with one message; the directory and its database."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "std_msgs/msg/Float64"
    with Writer(
        folder / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3
    ) as writer:
        connection = writer.add_connection("/x", kind, typestore=store)
        writer.write(
            connection, 10**9, store.serialize_cdr(store.types[kind](1.5), kind)
        )
    assert read_table(folder / "bag").columns["/x/data"].tolist() == [1.5]
    (database,) = (folder / "bag").glob("*.db3")
    return folder / "bag", database


def test_settings_of_bags_have_no_aliases(tmp_path: Path) -> None:
    path, database = bag(tmp_path)
    with sqlite3.connect(database) as connection:
        connection.execute("UPDATE topics SET offered_qos_profiles = ?", (LISTS,))
    connection.close()
    refused(lambda: read_table(database), "aliases", tmp_path / "printed")
    (path / "metadata.yaml").write_text(LISTS)
    refused(lambda: read_table(path), "aliases", tmp_path / "printed")


@pytest.mark.parametrize(
    "change",
    [
        "ALTER TABLE messages ADD COLUMN more BLOB AS (zeroblob(1000000000))",
        "CREATE VIEW schema_ AS WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT x FROM n",
    ],
)
def test_tables_of_bags_are_not_computed(change: str, tmp_path: Path) -> None:
    _, database = bag(tmp_path)
    with sqlite3.connect(database) as connection:
        connection.execute(change)
        if "schema_" in change:
            connection.execute("DROP TABLE schema")
            connection.execute(change.replace("schema_", "schema"))
    connection.close()
    refused(lambda: read_table(database), "rows are computed", tmp_path / "printed")


# -- the declaration ---------------------------------------------------------------------------------------------------


def test_every_limit_is_documented() -> None:
    import echelon.shared.inputs as module

    declared = [value for value in vars(module).values() if isinstance(value, Limit)]
    assert set(declared) == set(LIMITS)
    assert limits_table() in (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
