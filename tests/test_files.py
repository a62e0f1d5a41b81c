"""Output files: whole or not at all, through links, into pipes, whatever fails and whenever it is stopped."""

from __future__ import annotations

import os
import resource
import signal
import stat
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import pytest

from echelon.shared import files
from echelon.shared.errors import InputError
from echelon.shared.files import FileTarget, write_all, write_atomically, written_into

pytestmark = pytest.mark.skipif(
    os.name != "posix", reason="links, pipes, modes and signals of POSIX"
)


def tree(folder: Path) -> dict[str, str | None]:
    """Contents by path; directories have none."""
    found = sorted(folder.rglob("*"))
    return {
        str(path.relative_to(folder)): path.read_text() if path.is_file() else None
        for path in found
    }


# -- where a path leads ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o666, 0o755])
def test_permissions_stay(tmp_path: Path, mode: int) -> None:
    file = tmp_path / "file"
    file.touch()
    file.chmod(mode)
    write_atomically(file, "new")
    assert (file.read_text(), file.stat().st_mode & 0o777) == ("new", mode)


def test_new_files_obey_the_mask(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_atomically(tmp_path / "file", "")
        write_atomically(tmp_path / "private", "", private=True)
    finally:
        os.umask(before)
    assert [
        (tmp_path / name).stat().st_mode & 0o777 for name in ("file", "private")
    ] == [0o640, 0o600]


@pytest.mark.parametrize("exists", [True, False])
def test_links_stay(tmp_path: Path, exists: bool) -> None:
    (tmp_path / "there").mkdir()
    actual = tmp_path / "there" / "file"
    if exists:
        actual.write_text("old")
    (tmp_path / "first").symlink_to("second")
    (tmp_path / "second").symlink_to("there/file")
    write_atomically(tmp_path / "first", "new")
    assert (tmp_path / "first").is_symlink()
    assert (tmp_path / "second").is_symlink()
    assert tree(tmp_path / "there") == {"file": "new"}


def test_a_pipe_is_written_into(tmp_path: Path) -> None:
    pipe, got = tmp_path / "pipe", list[str]()
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_text()))
    reader.start()
    write_all({tmp_path / "file": "beside", pipe: "through"})
    reader.join()
    assert got == ["through"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert (tmp_path / "file").read_text() == "beside"


def test_a_standard_stream_is_written_into(tmp_path: Path) -> None:
    """Also where it leads to a file, behind what is there already."""
    log = tmp_path / "log"
    log.write_text("earlier\n")
    kept = os.dup(1)
    sys.stdout.flush()
    descriptor = os.open(log, os.O_WRONLY | os.O_APPEND)
    try:
        os.dup2(descriptor, 1)
        write_atomically("/dev/fd/1", "later\n")
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(descriptor)
    assert log.read_text() == "earlier\nlater\n"


BAD = {
    "directory": ("folder", "is a directory; name a file"),
    "the directory that it is in": (".", "is a directory; name a file"),
    "no directory": ("missing/file", "cannot be written: No such file or directory"),
    "file as directory": ("file/file", "cannot be written: Not a directory"),
    "endless links": ("loop", "cannot be written: Too many levels of symbolic links"),
    "link to nowhere": ("nowhere", "cannot be written: No such file or directory"),
    "long name": ("x" * 300, "cannot be written: File name too long"),
    "impossible name": ("a\0b", "cannot be written: embedded null byte"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_cannot_be_written_is_said_before_anything_is(
    tmp_path: Path, case: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, problem = BAD[case]
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_text("old")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "nowhere").symlink_to("missing/file")
    monkeypatch.chdir(tmp_path)
    before = sorted(tmp_path.rglob("*"))
    for write in (
        FileTarget.of,
        lambda path: write_all({Path("new"): "", Path("file"): "", Path(path): ""}),
    ):
        with pytest.raises(InputError) as caught:
            write(name)
        assert caught.value.problem == problem
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "file").read_text() == "old"


def test_a_long_name_is_no_problem(tmp_path: Path) -> None:
    write_atomically(tmp_path / ("x" * 255), "new")


def test_two_names_of_one_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("file")
    with pytest.raises(InputError, match="leads to the same file as"):
        write_all({tmp_path / "file": "1", tmp_path / "link": "2"})
    assert not (tmp_path / "file").exists()


@contextmanager
def unprivileged() -> Iterator[None]:
    """Permissions mean nothing to root."""
    root = os.geteuid() == 0
    if root:
        os.seteuid(65534)
    try:
        yield
    finally:
        if root:
            os.seteuid(0)


@pytest.mark.parametrize("name", ["file", "new"])
def test_read_only_folders_and_files(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # the folders above need not be open to others
    Path("file").write_text("old")
    Path("file").chmod(0o444)
    tmp_path.chmod(0o555)
    try:
        with (
            unprivileged(),
            pytest.raises(InputError, match="cannot be written: Permission denied"),
        ):
            write_atomically(name, "new")
    finally:
        tmp_path.chmod(0o755)
    assert tree(tmp_path) == {"file": "old"}


# -- what fails on the way ---------------------------------------------------------------------------------------------


def test_a_full_disk(tmp_path: Path) -> None:
    """A limit on the size of files fails as a full disk does: in the middle of writing."""
    write_all({tmp_path / "1": "old", tmp_path / "2": "old"})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(InputError, match=r"2: cannot be written: File too large"):
            write_all(
                {
                    tmp_path / "1": "new",
                    tmp_path / "2": "new" * 10_000,
                    tmp_path / "3": "",
                }
            )
        with pytest.raises(InputError, match="too large"):
            written_into(tmp_path / "made" / "here", {"4": "new" * 10_000})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert tree(tmp_path) == {"1": "old", "2": "old"}


@pytest.mark.parametrize("linked", [True, False], ids=["links", "no links"])
@pytest.mark.parametrize("failing", range(3))
def test_all_or_none_when_a_rename_fails(
    tmp_path: Path, failing: int, linked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a").write_text("old")
    (tmp_path / "c").write_text("old")
    contents = {tmp_path / name: "new" for name in "abc"}
    replace = os.replace

    def fails(source: Path, goal: Path) -> None:
        if goal == list(contents)[failing] and source.read_text() == "new":
            raise OSError(5, "Input/output error")
        replace(source, goal)

    def no_links(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    def missing_or_none(source: Path, *_: object) -> None:
        os.stat(source)
        no_links()

    monkeypatch.setattr(files.os, "replace", fails)
    if not linked:
        monkeypatch.setattr(files.os, "link", missing_or_none)
    with pytest.raises(InputError, match="Input/output error"):
        write_all(contents)
    assert tree(tmp_path) == {"a": "old", "c": "old"}
    monkeypatch.setattr(files.os, "replace", replace)
    write_all(contents)
    assert tree(tmp_path) == dict.fromkeys("abc", "new")


# -- when it is stopped ------------------------------------------------------------------------------------------------


class Stopped(BaseException):
    """Exception that stands for a signal."""


_armed = {"events": -1, "signal": 0}


def _trip(*_: object) -> None:
    if _armed["events"] >= 0:
        _armed["events"] -= 1
        if _armed["events"] < 0:
            signal.raise_signal(_armed["signal"])


@pytest.fixture(scope="module")
def tripwire() -> None:
    """Signals at any event of the interpreter: opening, linking, renaming, removing; stays until the process ends."""
    sys.addaudithook(_trip)


@contextmanager
def stopped_after(events: int, number: int) -> Iterator[None]:
    """A signal at the event of this number."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise Stopped

    before = signal.signal(number, stop)
    _armed.update(events=events, signal=number)
    try:
        yield
    finally:
        _armed["events"] = -1
        signal.signal(number, before)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
@pytest.mark.usefixtures("tripwire")
def test_signals_at_every_event_of_writing(tmp_path: Path, number: int) -> None:
    old, new = {"a": "old", "c": "old"}, dict.fromkeys("abc", "new")
    seen, stopped = [], True
    for events in range(1000):
        folder = tmp_path / str(events)
        written_into(folder, old)
        stopped = False
        try:
            with stopped_after(events, number):
                written_into(folder, new)
        except Stopped:
            stopped = True
        files._discard_unfinished()  # what the interpreter does when it ends
        found = tree(folder)
        assert found in (old, new), f"after {events} events"
        seen.append((stopped, found == new))
        if not stopped:
            break
    assert {(True, False), (True, True), (False, True)} == set(seen)
