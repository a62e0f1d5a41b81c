"""Faults from outside a command: signals at any moment, full disks, pipes and terminals that go away.

``make faults`` runs every command with many more moments.
"""

from __future__ import annotations

import json
import os
import pty
import random
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from support.command_line import run
from support.paths import ROOT
from support.selection import slow_unless
from support.writing_commands import COMMANDS, OUTPUTS, Contents, contents, workplace

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="processes and terminals of Linux"
)
MAIN = "from echelon.cli import main; main()"
ANNOUNCED = f"""
import os
from echelon.cli import process
prepare = process.prepare
process.prepare = lambda: (os.write(2, b'*'), prepare())
{MAIN}"""
"""Says when signals find an answer, inside of ``main``: before, Python itself starts."""


def start(
    folder: Path, *arguments: str, code: str = MAIN, **options: object
) -> subprocess.Popen[bytes]:
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT / "src"),
    }
    environment |= options.pop("environment", {})  # type: ignore[operator]
    pipes = {
        "stdout": subprocess.PIPE,
        "stderr": subprocess.PIPE,
        "stdin": subprocess.DEVNULL,
        "cwd": folder,
    }
    ways = {**pipes, "preexec_fn": heed_signals, **options}
    return subprocess.Popen(
        [sys.executable, "-c", code, *arguments], env=environment, **ways
    )  # type: ignore[call-overload, no-any-return]


def heed_signals() -> None:
    """Not to ignore what the tests' own process ignores, as one in the background of a shell does."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def ended(process: subprocess.Popen[bytes]) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=120)
    return process.returncode, (out or b"").decode(), (err or b"").decode()


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return workplace(tmp_path / "work")


# -- signals -----------------------------------------------------------------------------------------------------------


def stopped(
    folder: Path, arguments: tuple[str, ...], number: int, seconds: float
) -> tuple[int, str]:
    """Exit code, and what was said, of a command that gets a signal so long after its start."""
    process = start(folder, *arguments, code=ANNOUNCED)
    assert process.stderr is not None
    assert process.stderr.read(1) == b"*"
    time.sleep(seconds)
    process.send_signal(number)
    code, _, err = ended(process)
    return code, err


def assert_whole(name: str, folder: Path, before: Contents) -> None:
    """The user's files are as they were, and all outputs are there, or none."""
    after = contents(folder)
    assert {file: after.get(file) for file in before} == before
    assert after.keys() - before.keys() in (set(), OUTPUTS[name])
    assert all(after[file] for file in after.keys() - before.keys())


def check_moments(name: str, folder: Path, moments: int) -> None:
    arguments = COMMANDS[name]
    if name == "excite":
        setup = (folder / "slide.yaml").read_text()
        (folder / "slide.yaml").write_text(setup.replace("starts: 1", "starts: 2"))
    before = contents(folder)
    started = time.perf_counter()
    assert ended(start(folder, *arguments))[0] == 0
    whole = time.perf_counter() - started
    draw = random.Random(f"moments of {name}")
    for k in range(moments):
        number = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)[k % 3]
        for file in OUTPUTS[name] if k % 2 else ():
            (folder / file).unlink(missing_ok=True)
        code, err = stopped(folder, arguments, number, draw.uniform(0, whole))
        assert (code in (0, 128 + number, -number), err) == (True, "")
        assert_whole(name, folder, before)
        if code in (
            0,
            -number,
        ):  # the latter at the very end, when Python has let go of signals
            assert contents(folder).keys() >= OUTPUTS[name]
    assert (
        ended(start(folder, *arguments))[0] == 0
    )  # what is left counts as the command's own


@pytest.mark.slow
@pytest.mark.parametrize("name", ["derive", "generate"])
def test_signals_at_a_few_moments(folder: Path, name: str) -> None:
    check_moments(name, folder, 2)


@pytest.mark.slow
@pytest.mark.parametrize("name", COMMANDS)
def test_signals_at_many_moments(folder: Path, name: str) -> None:
    check_moments(name, folder, 50)


def test_an_interruption_during_the_first_imports_is_silent(folder: Path) -> None:
    for milliseconds in (0, 5, 20, 60):
        code, err = stopped(folder, ("--help",), signal.SIGINT, milliseconds / 1000)
        assert (code in (130, 0, -signal.SIGINT), err) == (
            True,
            "",
        )  # the last at the very end, as above


def test_ignored_signals_stay_ignored(folder: Path) -> None:
    nohup = f"import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN)\n{ANNOUNCED}"
    process = start(folder, "derive", "slide.yaml", code=nohup)
    assert process.stderr is not None
    process.stderr.read(1)
    process.send_signal(signal.SIGHUP)
    assert ended(process)[0] == 0


# -- disks -------------------------------------------------------------------------------------------------------------


def small_disk() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (20, 20))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(n, marks=() if n == "derive" else pytest.mark.slow)
        for n in COMMANDS
    ],
)
def test_a_full_disk_leaves_everything_as_it_was(folder: Path, name: str) -> None:
    before = contents(folder)
    # no cache of compiled code: that it cannot be written is only worth a warning
    process = start(
        folder,
        *COMMANDS[name],
        preexec_fn=small_disk,
        environment={"ECHELON_CACHE": ""},
    )
    code, out, err = ended(process)
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert err.endswith(": cannot be written: File too large\n")
    assert contents(folder) == before


# -- pipes and terminals -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "arguments",
    [("--help",), ("derive", "--help"), ("--version",), ("schema", "description")],
)
def test_readers_may_leave(folder: Path, arguments: tuple[str, ...]) -> None:
    leave = "import os; r, w = os.pipe(); os.close(r); os.dup2(w, 1); "
    assert ended(start(folder, *arguments, code=leave + MAIN)) == (0, "", "")


@pytest.mark.slow
def test_the_reader_of_a_named_pipe_may_leave(folder: Path) -> None:
    os.mkfifo(folder / "pipe")
    process = start(folder, "derive", "slide.yaml", "-o", "pipe")
    descriptor = os.open(folder / "pipe", os.O_RDONLY)  # waits for the writer
    os.close(descriptor)
    code, _, err = ended(process)
    assert (code, err) == (0, "")


CLOSED = {
    "output": ((1,), ("derive", "slide.yaml"), 0),
    "errors": ((2,), ("derive", "nothing"), 2),
    "all": ((0, 1, 2), ("derive", "slide.yaml", "-o", "set.txt"), 0),
}


@pytest.mark.parametrize("case", slow_unless(["all"], CLOSED))
def test_closed_streams(folder: Path, case: str) -> None:
    numbers, arguments, expected = CLOSED[case]
    exec_ = f"import os, sys; [os.close(n) for n in {numbers}]; os.execv(sys.executable, sys.argv[1:])"
    code, _, err = ended(
        start(folder, sys.executable, "-c", MAIN, *arguments, code=exec_)
    )
    assert (code, err) == (expected, "")
    if "-o" in arguments:
        assert (folder / "set.txt").read_text().startswith("slide: 2 base parameters")


@pytest.mark.slow
def test_standard_output_by_its_name(folder: Path) -> None:
    code, out, err = ended(start(folder, "derive", "slide.yaml", "-o", "/dev/stdout"))
    assert (code, out.startswith("slide: 2 base parameters"), err) == (0, True, "")
    with (folder / "log").open("w") as log:
        log.write("earlier\n")
        log.flush()
        assert (
            ended(
                start(folder, "derive", "slide.yaml", "-o", "/dev/stdout", stdout=log)
            )[0]
            == 0
        )
    assert (folder / "log").read_text().startswith("earlier\nslide: 2 base parameters")


@pytest.mark.slow
def test_a_terminal_that_goes_away(folder: Path) -> None:
    controller, terminal = pty.openpty()
    before = contents(folder)
    process = start(
        folder,
        "identify",
        "slide.yaml",
        "run.csv",
        "-o",
        ".",
        stdout=terminal,
        stderr=terminal,
    )
    os.close(terminal)
    os.close(controller)
    process.wait(timeout=120)
    assert_whole("identify", folder, before)


def test_a_terminal_gets_its_cursor_back(folder: Path) -> None:
    controller, terminal = pty.openpty()
    process = start(folder, "excite", "slide.yaml", stdout=terminal, stderr=terminal)
    os.close(terminal)
    seen = b""
    while b"\x1b[?25l" not in seen:  # hidden
        seen += os.read(controller, 1000)
    process.send_signal(signal.SIGTERM)
    code = process.wait(timeout=60)
    seen += os.read(controller, 100_000)
    os.close(controller)
    assert code == 128 + signal.SIGTERM
    assert seen.rfind(b"\x1b[?25h") > seen.rfind(b"\x1b[?25l")  # shown


# -- texts -------------------------------------------------------------------------------------------------------------

PLAIN = {"LANG": "C", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}


@pytest.mark.slow
def test_plain_locales(folder: Path) -> None:
    (folder / "größe.yaml").write_bytes(
        (folder / "slide.yaml")
        .read_bytes()
        .replace(b"name: slide\n", "name: größe\n".encode())
    )
    code, out, err = ended(
        start(folder, "derive", "größe.yaml", "-o", "größe.txt", environment=PLAIN)
    )
    assert (code, out, err) == (0, "", "")
    assert (
        (folder / "größe.txt")
        .read_text(encoding="utf-8")
        .startswith("größe: 2 base parameters")
    )
    code, out, err = ended(
        start(folder, "derive", "größe.yaml", "--json", environment=PLAIN)
    )
    assert json.loads(out)["name"] == "größe"


TEXTS = {
    "utf-8-sig": ("slide.yaml", "motion.csv", "run.csv", "claims.txt"),
    "utf-16": ("slide.yaml", "motion.csv", "run.csv", "claims.txt"),
}


@pytest.mark.parametrize(
    ("encoding", "file"), [(e, f) for e, files in TEXTS.items() for f in files]
)
def test_marks_of_other_encodings(
    folder: Path, encoding: str, file: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Read as what it is, or refused in one line that names the file; never half."""

    name = {
        "slide.yaml": "derive",
        "motion.csv": "check-trajectory",
        "run.csv": "predict",
        "claims.txt": "audit",
    }[file]
    monkeypatch.chdir(folder)
    assert run(*COMMANDS[name]).returncode == 0
    expected = {output: (folder / output).read_bytes() for output in OUTPUTS[name]}
    (folder / file).write_text((folder / file).read_text(), encoding=encoding)
    done = run(*COMMANDS[name])
    if done.returncode == 0:
        assert {
            output: (folder / output).read_bytes() for output in OUTPUTS[name]
        } == expected
    else:
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert file in done.stderr
        assert "UTF" in done.stderr
