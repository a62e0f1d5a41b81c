"""Equal commands say and write equal bytes: whatever Python hashes, wherever they run, however busy the machine is."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path

import pytest

from echelon.cli.commands import app
from echelon.compute.machine.kernel import processors
from support.every_command import COMMANDS, LANGUAGES, SCHEMAS, write_inputs
from support.paths import ROOT, TESTS

LONG = {
    "excite",
    "identify",
    "predict",
    "loop",
    "structure-loop",
    "latex",
    "excite-json",
    "excite-loop",
    "complement",
    "identify-json",
    "regressor-sympy",
    "generate-loop",
    "modes",
}
LONG |= {
    "check",
    "what-logs-show",
    "regressor-latex",
    "numeric",
    "special",
    "markdown",
    "predict-parquet",
    *(f"generate-{name}" for name in LANGUAGES[2:]),
}
"""Commands that repeat, in more time, what others do."""


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, bytes]:
    folder = tmp_path_factory.mktemp("inputs")
    write_inputs(folder)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def prepared(folder: Path, inputs: Mapping[str, bytes]) -> Path:
    """A folder with copies of the inputs."""
    folder.mkdir(parents=True)
    for name, content in inputs.items():
        (folder / name).write_bytes(content)
    return folder


def started(
    folder: Path, names: Iterable[str], one: bool = False, **variables: str
) -> subprocess.Popen[bytes]:
    """A process that runs commands in a folder, on one processor if that is wanted."""
    path = os.pathsep.join([str(TESTS), str(ROOT / "src")])
    command = [sys.executable, str(TESTS / "support" / "every_command.py"), *names]
    bound = (
        partial(os.sched_setaffinity, 0, {min(os.sched_getaffinity(0))})
        if one
        else None
    )
    return subprocess.Popen(
        command, cwd=folder, env={**os.environ, "PYTHONPATH": path, **variables}, preexec_fn=bound,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def files(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def same_files(*folders: Path) -> dict[str, bytes]:
    """Files of several folders, which must be equal."""
    first, *others = map(files, folders)
    for other in others:
        assert other.keys() == first.keys()
        assert [name for name in first if other[name] != first[name]] == []
    return first


def test_every_command_is_among_them() -> None:
    from typing import get_args

    from echelon.cli.commands import Schema
    from echelon.codegen import TARGETS

    assert {line.split()[0] for line in COMMANDS.values()} == set(app.functions)
    assert (set(LANGUAGES), set(SCHEMAS)) == (set(TARGETS), set(get_args(Schema)))


def check_codes(written: Mapping[str, bytes]) -> None:
    """Every command did what it should: the claims are wrong, and all else succeeds."""
    said = {
        name.removesuffix(".out"): text
        for name, text in written.items()
        if name.endswith(".out")
    }
    assert [
        name for name, text in said.items() if not text.endswith(b"exit code 0\n")
    ] == ["audit"]
    assert {name for name in COMMANDS if name not in LONG} <= said.keys()


def test_equal_commands_give_equal_bytes(
    tmp_path: Path, inputs: Mapping[str, bytes]
) -> None:
    """With other hashes of strings, other numbers of threads, in another time zone and place, at the same time."""
    here, there = (
        prepared(tmp_path / "one", inputs),
        prepared(tmp_path / "another" / "place", inputs),
    )
    names = [name for name in COMMANDS if name not in LONG]
    runs = [
        started(
            here,
            names,
            PYTHONHASHSEED="1",
            OPENBLAS_NUM_THREADS="1",
            OMP_NUM_THREADS="1",
        ),
        started(
            there,
            names,
            PYTHONHASHSEED="2",
            OPENBLAS_NUM_THREADS="7",
            OMP_NUM_THREADS="7",
            TZ="Asia/Tokyo",
        ),
    ]
    assert [run.wait() for run in runs] == [0, 0]
    check_codes(same_files(here, there))


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux", reason="other systems do not bind processes to processors"
)
def test_also_on_a_busy_machine_on_one_processor_and_one_by_one(
    tmp_path: Path, inputs: Mapping[str, bytes]
) -> None:
    quiet, bound, alone = (
        prepared(tmp_path / name, inputs) for name in ("quiet", "bound", "alone")
    )
    assert started(quiet, COMMANDS).wait() == 0
    busy = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(2 * processors())
    ]
    try:
        assert started(bound, COMMANDS, one=True, PYTHONHASHSEED="3").wait() == 0
    finally:
        for process in busy:
            process.kill()
            process.wait()
    for name in COMMANDS:
        assert started(alone, [name]).wait() == 0
    check_codes(same_files(quiet, bound, alone))
