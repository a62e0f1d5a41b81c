"""Object code on disk: what is whole and safe is used again, everything else is made anew."""

from __future__ import annotations

import hashlib
import os
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echelon.compute.machine import kernel as kernel_module
from echelon.compute.machine import target
from echelon.compute.machine.kernel import Kernel
from echelon.compute.machine.target import Target, host, object_code
from echelon.shared.errors import EchelonError
from support.small_kernels import function

posix = pytest.mark.skipif(
    os.name != "posix", reason="permissions are those of POSIX systems"
)
HEAD = len(b"echelon object code 1\n") + 64 + 1
"""Bytes before the digest of an entry: the kind of file, and the key."""


class Compilations:
    """Counts them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.count = 0
        monkeypatch.setattr(kernel_module, "object_code", self._counted)

    def _counted(self, text: str, target: Target) -> bytes:
        self.count += 1
        return object_code(text, target)


@pytest.fixture
def compilations(monkeypatch: pytest.MonkeyPatch) -> Compilations:
    return Compilations(monkeypatch)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of this test."""
    chosen = tmp_path / "cache" / "objects"
    monkeypatch.setenv("ECHELON_CACHE", str(chosen))
    return chosen


def check(factor: int = 3) -> None:
    """A kernel, made anew, gives what it should."""
    run = Kernel(function(lambda x: [x[0] * factor, x[0] + factor], {"x": 1}))
    np.testing.assert_array_equal(
        run({"x": [[2.0], [5.0]]}), [[2 * factor, 2 + factor], [5 * factor, 5 + factor]]
    )


def entries(folder: Path) -> list[Path]:
    return sorted(folder.iterdir())


def test_code_is_used_again(folder: Path, compilations: Compilations) -> None:
    check()
    (entry,) = entries(folder)
    first = entry.read_bytes()
    check()
    assert compilations.count == 1
    assert entries(folder) == [entry]
    assert entry.read_bytes() == first
    check(4)
    assert compilations.count == 2
    assert len(entries(folder)) == 2


@posix
def test_an_entry_that_is_a_link_is_neither_read_nor_written_through(
    folder: Path, tmp_path: Path, compilations: Compilations
) -> None:
    check()
    (entry,) = entries(folder)
    elsewhere = tmp_path / "elsewhere.bin"
    entry.rename(elsewhere)
    entry.symlink_to(elsewhere)
    before = elsewhere.read_bytes(), elsewhere.stat().st_mtime_ns
    check()
    assert compilations.count == 2
    assert not entry.is_symlink()
    assert (elsewhere.read_bytes(), elsewhere.stat().st_mtime_ns) == before
    check()
    assert compilations.count == 2


@posix
def test_a_pipe_in_the_place_of_an_entry_keeps_nobody_waiting(
    folder: Path, compilations: Compilations
) -> None:
    check()
    (entry,) = entries(folder)
    entry.unlink()
    os.mkfifo(entry, 0o600)
    check()
    assert compilations.count == 2
    assert entry.is_file()


@pytest.mark.usefixtures("folder")
def test_the_key_covers_everything() -> None:
    """Another source or another processor is another entry."""
    keys = [("a", "text"), ("a", "texts"), ("b", "text")]
    for key in (*keys, *keys):
        assert (
            target.cached_object(*key, lambda key=key: repr(key).encode())
            == repr(key).encode()
        )
    others = (
        {"lanes": 1},
        {"cpu": "x86-64"},
        {"features": "-avx"},
        {"triple": "arm64-apple"},
    )
    assert (
        len({host().identity, *(replace(host(), **other).identity for other in others)})
        == 5
    )


# -- damage --------------------------------------------------------------------------------------------------------


def flipped(content: bytes, place: int) -> bytes:
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "empty": lambda _: b"",
    "cut in the head": lambda c: c[:10],
    "cut in the digest": lambda c: c[: HEAD + 5],
    "cut in the code": lambda c: c[:-1],
    "longer": lambda c: c + b"\0",
    "flipped in the kind": lambda c: flipped(c, 0),
    "flipped in the key": lambda c: flipped(c, HEAD - 10),
    "flipped in the digest": lambda c: flipped(c, HEAD + 3),
    "flipped in the code": lambda c: flipped(c, len(c) // 2),
    "flipped at the end": lambda c: flipped(c, len(c) - 1),
    "a forgotten key": lambda c: c[: HEAD - 65] + c[HEAD:],
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
def test_damaged_entries_are_repaired(
    folder: Path, compilations: Compilations, damage: Callable[[bytes], bytes]
) -> None:
    check()
    (entry,) = entries(folder)
    whole = entry.read_bytes()
    entry.write_bytes(damage(whole))
    check()
    assert compilations.count == 2
    assert entries(folder) == [entry]
    assert entry.read_bytes() == whole
    check()
    assert compilations.count == 2


def test_an_entry_under_another_name(folder: Path, compilations: Compilations) -> None:
    check(3)
    (entry,) = entries(folder)
    three = entry.read_bytes()
    check(4)
    (other,) = (e for e in entries(folder) if e != entry)
    four = other.read_bytes()
    other.write_bytes(three)
    check(4)
    assert compilations.count == 3
    assert other.read_bytes() == four


def test_code_without_the_function(folder: Path, compilations: Compilations) -> None:
    """An object file of this processor that is another one; only a forger could make such an entry."""
    check()
    (entry,) = entries(folder)
    strange = object_code("define void @strange() {\n  ret void\n}\n", host())
    entry.write_bytes(
        entry.read_bytes()[:HEAD] + hashlib.sha256(strange).digest() + strange
    )
    with pytest.raises(EchelonError, match="the object code has no function 'run'"):
        check()
    assert compilations.count == 1


# -- folders -------------------------------------------------------------------------------------------------------


@posix
def test_only_the_owner_can_write(folder: Path) -> None:
    """Whatever the user's mask says."""
    mask = os.umask(0)
    try:
        check()
    finally:
        os.umask(mask)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    (entry,) = entries(folder)
    assert stat.S_IMODE(entry.stat().st_mode) & 0o022 == 0


@posix
def test_entries_that_others_can_write_to_are_not_used(
    folder: Path, compilations: Compilations
) -> None:
    check()
    (entry,) = entries(folder)
    entry.chmod(0o666)
    check()
    assert compilations.count == 2
    assert stat.S_IMODE(entry.stat().st_mode) & 0o022 == 0


@posix
@pytest.mark.parametrize("mode", [0o777, 0o770, 0o702])
def test_folders_that_others_can_write_to_are_not_used(
    folder: Path, compilations: Compilations, mode: int
) -> None:
    check()
    folder.chmod(mode)
    with pytest.warns(
        RuntimeWarning,
        match="compiled code is not kept: .* others can write to it; set ECHELON_CACHE",
    ):
        check()
    assert compilations.count == 2


@posix
def test_folders_of_others_are_not_used(
    folder: Path, compilations: Compilations, monkeypatch: pytest.MonkeyPatch
) -> None:
    check()
    monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    with pytest.warns(RuntimeWarning, match="it belongs to another user"):
        check()
    assert compilations.count == 2


def test_no_folder_can_be_made(
    folder: Path, compilations: Compilations, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = folder.parents[1] / "file"
    file.write_text("a file", encoding="utf-8")
    for below in (file, file / "objects"):
        monkeypatch.setenv("ECHELON_CACHE", str(below))
        with pytest.warns(RuntimeWarning, match="compiled code is not kept: .*file"):
            check()
    assert compilations.count == 2
    assert file.read_text(encoding="utf-8") == "a file"


def test_entries_that_cannot_be_written(
    folder: Path, compilations: Compilations
) -> None:
    """A folder in the place of an entry: the code is made, and a warning says that it is not kept."""
    check()
    (entry,) = entries(folder)
    entry.unlink()
    entry.mkdir()
    with pytest.warns(RuntimeWarning, match="compiled code is not kept"):
        check()
    assert compilations.count == 2
    assert entries(folder) == [entry]


def test_switched_off(
    tmp_path: Path, compilations: Compilations, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ECHELON_CACHE", "")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    check()
    check()
    assert compilations.count == 2
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="the usual folder is that of Linux"
)
def test_the_usual_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ECHELON_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    check()
    assert target.cache_folder() == tmp_path / "echelon" / "objects"
    assert len(entries(tmp_path / "echelon" / "objects")) == 1


def test_old_entries_are_removed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(target, "MOST_ENTRIES", 3)
    folder.mkdir(parents=True, mode=0o700)
    (folder / "notes.txt").write_text("not ours", encoding="utf-8")
    for age, name in enumerate("abcde"):
        (folder / f"{name}.bin").write_bytes(b"")
        os.utime(folder / f"{name}.bin", (1e9 - age, 1e9 - age))
    check()
    names = [entry.name for entry in entries(folder)]
    assert {"a.bin", "b.bin", "notes.txt"} < set(names)
    assert len(names) == 4


def test_entries_that_vanish_while_they_are_looked_at(
    folder: Path, compilations: Compilations
) -> None:
    folder.mkdir(parents=True, mode=0o700)
    (folder / "gone.bin").symlink_to(folder / "nowhere")
    check()
    check()
    assert compilations.count == 1


# -- at the same time ----------------------------------------------------------------------------------------------

PROCESS = """
import sys
sys.path[:0] = sys.argv[1:]
import test_machine_cache
for factor in range(3, 9):
    test_machine_cache.check(factor)
"""


def test_processes_at_the_same_time(folder: Path) -> None:
    paths = [str(Path(__file__).parent), *filter(None, sys.path)]
    command = [sys.executable, "-W", "error:compiled code", "-c", PROCESS, *paths]
    running = [
        subprocess.Popen(command, stderr=subprocess.PIPE, text=True) for _ in range(2)
    ]
    for process in running:
        _, errors = process.communicate(timeout=60)
        assert (process.returncode, errors) == (0, "")
    assert len(entries(folder)) == 6
    assert all(entry.suffix == ".bin" for entry in entries(folder))


def test_threads_at_the_same_time(folder: Path) -> None:
    failed: list[BaseException] = []

    def work() -> None:
        try:
            for factor in range(3, 7):
                check(factor)
        except BaseException as error:
            failed.append(error)

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed
    assert len(entries(folder)) == 4
