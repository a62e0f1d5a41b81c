"""Logs in files of NumPy and MATLAB."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import hdf5storage
import numpy as np
import numpy.typing as npt
import pytest
import scipy.io

from echelon.identification.logs.files.mat_file import MatFile, check_elements
from echelon.identification.logs.files.numpy_file import NpzFile
from echelon.identification.logs.files.open_log import open_log, read_table
from echelon.shared.errors import InputError
from support.log_tables import joined, same

RANDOM = np.random.default_rng(5)
MATLAB = Path(scipy.io.__file__).parent / "matlab" / "tests" / "data"


def test_arrays_of_an_archive(tmp_path: Path) -> None:
    path = tmp_path / "run.npz"
    q, cube = (
        RANDOM.normal(size=(2, 10, 2))[0],
        RANDOM.normal(size=(10, 2, 2)).astype(np.float32),
    )
    records = np.zeros(
        10,
        dtype=[
            ("x", ">i4"),
            ("v", "f8", (2,)),
            ("label", "U3"),
            ("deep", [("y", "?")]),
        ],
    )
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
        "turned[0]": q[:, 0], "turned[1]": q[:, 1],
    }  # fmt: skip
    same(joined(log), expected)
    same(joined(log, rows=3), expected)
    for name, problem in {
        "gear": "has 3 rows where most arrays of the file have 10",
        "label": "holds text, not real numbers",
        "rate": "is a single value, not a value per row",
        "objects": "holds Python objects, not real numbers",
        "wide[0]": "has 5000 columns; at most 4096 are read",
        "day": "holds dates or spans of time",
        "q": r"has 2 columns; name one of them, such as 'q\[0\]'",
    }.items():
        with pytest.raises(
            InputError, match=rf"column '{name.replace('[', chr(92) + '[')}': {problem}"
        ):
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
def test_a_single_array(
    array: npt.NDArray[Any], names: tuple[str, ...], tmp_path: Path
) -> None:
    np.save(tmp_path / "run.npy", array)
    log = NpzFile(tmp_path / "run.npy")
    assert log.names == names
    found = np.column_stack(list(joined(log, rows=2).values()))
    if array.dtype.names is None:
        np.testing.assert_array_equal(found, array.reshape(5, -1))


def test_pickles_are_never_loaded(tmp_path: Path) -> None:
    np.save(tmp_path / "run.npy", np.array([{}, {}]), allow_pickle=True)
    with pytest.raises(
        InputError,
        match="pickled Python objects, which are not loaded: they can run code",
    ):
        NpzFile(tmp_path / "run.npy")
    np.savez(tmp_path / "run.npz", a=np.array([{}, {}]), b="x")
    with pytest.raises(
        InputError,
        match=r"no arrays of numbers.*: 'a' holds Python objects.*; 'b' is a single value",
    ):
        NpzFile(tmp_path / "run.npz")


def test_matlab_files(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    q = RANDOM.normal(size=(10, 3))
    content: dict[str, Any] = {
        "t": np.arange(10.0),
        "column": q[:, :1],
        "q": q,
        "gear": np.ones(3),
        "rate": 5.0,
    }
    expected = {
        "t": np.arange(10),
        "column": q[:, 0],
        "q[0]": q[:, 0],
        "q[1]": q[:, 1],
        "q[2]": q[:, 2],
    }
    cell = np.empty(2, dtype=object)
    cell[:] = [np.arange(10) * 2.0, "text"]
    content |= {
        "log": {"tau": q[:, 1], "deep": {"f": q[:, :2]}},
        "cell": cell,
        "empty": np.zeros((0, 0)),
    }
    expected |= {
        "log.tau": q[:, 1],
        "log.deep.f[0]": q[:, 0],
        "log.deep.f[1]": q[:, 1],
        "cell[0]": np.arange(10) * 2,
    }
    scipy.io.savemat(path, content, format="5")
    log = MatFile(path)
    same(joined(log), expected)
    same(joined(log, rows=4), expected)
    with pytest.raises(
        InputError,
        match=r"column 'gear': has 3 rows where most arrays of the file have 10",
    ):
        list(log.tables(["gear"]))


def matlab_files() -> list[Path]:
    """Files of versions 5 to 7."""
    starts = {path: path.read_bytes()[:520] for path in sorted(MATLAB.glob("*.mat"))}
    return [
        path
        for path, start in starts.items()
        if 0 not in start[:4] and b"\x89HDF" not in start
    ]


@pytest.mark.parametrize("path", matlab_files(), ids=lambda path: path.stem)
@pytest.mark.filterwarnings("ignore")
def test_files_that_matlab_wrote(path: Path) -> None:
    """The files with which scipy tests its own reader, where it brings them along: what it reads is not refused."""
    try:
        scipy.io.loadmat(path)
    except Exception:
        with pytest.raises(InputError):
            MatFile(path)
        return
    check_elements(path.read_bytes())


def test_columns_of_a_file_that_matlab_wrote() -> None:
    path = MATLAB / "teststructarr_7.4_GLNX86.mat"
    if not path.is_file():
        pytest.skip("scipy comes without the files of its tests")
    with pytest.raises(
        InputError, match="holds no arrays of numbers with a row per sample"
    ):
        MatFile(path)
    matrix = MATLAB / "testmatrix_7.4_GLNX86.mat"
    rows = list(read_table(matrix).columns.values())  # a log has more rows than columns
    np.testing.assert_array_equal(rows, scipy.io.loadmat(matrix)["testmatrix"])


@pytest.mark.parametrize(
    "seeds", [range(300), pytest.param(range(300, 24000), marks=pytest.mark.slow)]
)
def test_damage_of_a_plain_file_is_an_error(seeds: range, tmp_path: Path) -> None:
    """Where scipy alone would end the process, or be busy for ever."""
    cell = np.empty(2, dtype=object)
    cell[:] = [np.arange(10.0), "text"]
    samples = {
        "t": np.arange(50.0),
        "log": {"tau": np.arange(50.0), "deep": {"f": np.ones((50, 2))}},
        "cell": cell,
    }
    path = tmp_path / "run.mat"
    scipy.io.savemat(path, samples)
    content = path.read_bytes()
    refused = 0
    for seed in seeds:
        random = np.random.default_rng(seed)
        damaged = bytearray(content)
        for place in (
            *random.integers(len(content), size=3),
            *random.integers(400, size=2),
        ):
            damaged[place] = int(random.integers(256))
        path.write_bytes(damaged)
        try:
            read_table(path)
        except InputError:
            refused += 1
    assert refused > len(seeds) / 10


def test_old_matlab_files_say_how_to_save_them(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "old.mat", {"q": np.arange(10.0)}, format="4")
    with pytest.raises(
        InputError,
        match=r"version 4, which is not read; save it in MATLAB with  save\(…, '-v7'\)",
    ):
        open_log(tmp_path / "old.mat")


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_matlab_files_of_every_version_say_the_same(
    version: str, tmp_path: Path
) -> None:
    """Samples along either axis, inside structs and cells; version 7.3 is HDF5, which stores the axes reversed."""
    t, q, tau = (
        np.arange(40) / 100,
        RANDOM.normal(size=(40, 3)),
        RANDOM.normal(size=(40, 3)),
    )
    content = {
        "t": t,
        "q": q,
        "tau": tau.T,
        "more": {"a": t + 1, "note": "text"},
        "gain": 2.0,
    }
    path = tmp_path / "run.mat"
    if version == "5":
        scipy.io.savemat(path, content)
    else:
        hdf5storage.savemat(str(path), content, format="7.3")
    found = read_table(path).columns
    expected = {"t": t, "more.a": t + 1}
    expected |= {f"q[{k}]": q[:, k] for k in range(3)} | {
        f"tau[{k}]": tau[:, k] for k in range(3)
    }
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
    with pytest.raises(InputError, match=r"(holds text|class char)"):
        read_table(path, ["more.note"])


def test_groups_of_an_hdf5_file(tmp_path: Path) -> None:
    """As ALOHA records episodes; links to other files and virtual data sets are not followed."""
    path = tmp_path / "episode_0.hdf5"
    q = RANDOM.normal(size=(30, 2)).astype(np.float32)
    with h5py.File(path, "w") as file:
        file["observations/qpos"], file["observations/effort"], file["action"] = (
            q,
            2 * q,
            q,
        )
        file["observations/images/top"] = np.zeros((30, 4, 4, 3), dtype=np.uint8)
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/q")
        file.create_virtual_dataset("virtual", h5py.VirtualLayout((30,), float))
        file.attrs["sim"], file["notes"], file["words"] = (
            True,
            "hello",
            ["left", "right"],
        )
    log = open_log(path)
    assert [name for name in log.names if "images" not in name] == [
        *("action[0]", "action[1]", "observations/effort[0]", "observations/effort[1]"),
        *("observations/qpos[0]", "observations/qpos[1]"),
    ]
    same(
        joined(log, ["observations/qpos[1]"], rows=7), {"observations/qpos[1]": q[:, 1]}
    )
    with pytest.raises(InputError, match="is stored in another file"):
        list(log.tables(["virtual"]))
