"""Output files: written whole or not at all.

New content is written under another name in the same directory and then renamed, so that neither a reader nor a full
disk nor a signal ever sees half a file.  A path may lead through symbolic links, which stay; what is no regular file (a
pipe, a terminal, a device) has no content to protect, and is written into.
"""

from __future__ import annotations

import atexit
import os
import secrets
import signal
import stat
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from echelon.shared.errors import InputError, one_line

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)
_PERMISSIONS = stat.S_IRWXU | stat.S_IRWXG | stat.S_IRWXO

_unfinished: set[Path] = set()
"""Temporary files that exist now."""


@dataclass(frozen=True)
class FileTarget:
    """Destination of a path."""

    shown: str  # the path as it was given, for messages
    path: (
        Path  # behind all symbolic links; the path itself where that is no regular file
    )
    found: os.stat_result | None  # what exists there

    @property
    def stream(self) -> bool:
        """Whether content is written into it, rather than put in its place."""
        return self.found is not None and (
            not stat.S_ISREG(self.found.st_mode) or _standard(self.found) is not None
        )

    @staticmethod
    def of(path: str | os.PathLike[str]) -> FileTarget:
        """Destination of a path; an InputError if nothing can be written there."""
        shown = os.fspath(path)
        with _naming(shown):
            try:
                found = os.stat(path)
            except FileNotFoundError:  # perhaps a link to a file that is yet to be
                found = None
            if found is not None and stat.S_ISDIR(found.st_mode):
                raise InputError("is a directory; name a file", source=shown)
            if found is not None and not stat.S_ISREG(found.st_mode):
                return FileTarget(shown, Path(path), found)
            actual = Path(os.path.realpath(path))
            os.stat(actual.parent)
        effective = os.access in os.supports_effective_ids
        if not os.access(
            actual.parent if found is None else actual, os.W_OK, effective_ids=effective
        ):
            raise InputError("cannot be written: Permission denied", source=shown)
        return FileTarget(shown, actual, found)


def write_atomically(
    path: str | os.PathLike[str], content: str | bytes, *, private: bool = False
) -> None:
    """Write one file as :func:`write_all` does; only its owner can read or write a private one."""
    write_all({Path(path): content}, private=private)


def write_all(contents: Mapping[Path, str | bytes], *, private: bool = False) -> None:
    """Write files that belong together, text as UTF-8: none appears before all of them are written."""
    targets = {
        FileTarget.of(path): text.encode() if isinstance(text, str) else text
        for path, text in contents.items()
    }
    _check_distinct(targets)
    staged: dict[FileTarget, Path] = {}
    try:
        for target, content in targets.items():
            if not target.stream:
                staged[target] = _stage(target, content, private)
        for target, content in targets.items():
            if target.stream:
                _pour(target, content)
        with _undisturbed():
            _put_in_place(staged)
    finally:
        for temporary in staged.values():
            _discard(temporary)


def written_into(folder: Path, contents: Mapping[str, str | bytes]) -> list[Path]:
    """Write files into a directory, which is made if need be: all of them or none."""
    if folder.exists() and not folder.is_dir():
        listed = ", ".join(contents)
        raise InputError(
            f"is not a directory, and there are several files to write: {listed}",
            source=str(folder),
        )
    made = [parent for parent in (folder, *folder.parents) if not parent.exists()]
    try:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"cannot be made: {error.strerror or error}", source=str(folder)
            ) from None
        write_all({folder / name: content for name, content in contents.items()})
    except BaseException:
        for parent in made:
            with suppress(OSError):
                parent.rmdir()
        raise
    return [folder / name for name in contents]


@contextmanager
def _naming(shown: str) -> Iterator[None]:
    """Errors of the system name the file; a reader that went away is no error of the file."""
    try:
        yield
    except BrokenPipeError:
        raise
    except (OSError, ValueError) as error:  # ValueError: a name that no system allows
        reason = getattr(error, "strerror", None) or error
        raise InputError(
            f"cannot be written: {reason}", source=one_line(shown)
        ) from None


def _check_distinct(targets: Mapping[FileTarget, bytes]) -> None:
    seen: dict[Path, FileTarget] = {}
    for target in targets:
        other = seen.setdefault(target.path, target)
        if other is not target:
            raise InputError(
                f"leads to the same file as {other.shown}", source=target.shown
            )


def _standard(found: os.stat_result) -> int | None:
    """Number of the standard stream that this is: ``/dev/stdout`` in whatever guise."""
    for number, stream in ((1, sys.stdout), (2, sys.stderr)):
        with suppress(OSError):
            if stream is not None and os.path.samestat(found, os.fstat(number)):
                return number
    return None


def _temporary(path: Path) -> Path:
    """A new name beside a file, which is removed when the process ends, if not before."""
    temporary = path.with_name(f".echelon-{secrets.token_hex(8)}")
    _unfinished.add(temporary)
    return temporary


def _discard(temporary: Path) -> None:
    with suppress(OSError):
        temporary.unlink()
    _unfinished.discard(temporary)


@atexit.register
def _discard_unfinished() -> None:
    """For signals that arrive between the making of a file and the ``try`` that removes it."""
    for temporary in tuple(_unfinished):
        _discard(temporary)


def _stage(target: FileTarget, content: bytes, private: bool) -> Path:
    """Write content under a temporary name."""
    temporary = _temporary(target.path)
    mode = 0o600 if private else 0o666
    try:
        # the system applies the user's mask to the mode
        with (
            _naming(target.shown),
            os.fdopen(os.open(temporary, _NEW, mode), "wb") as stream,
        ):
            if target.found is not None and not private:
                _make_alike(stream.fileno(), target.found)
            stream.write(content)
    except BaseException:
        _discard(temporary)
        raise
    return temporary


def _make_alike(descriptor: int, found: os.stat_result) -> None:
    """Owner, where the user may give it, and permissions of the file that will be replaced."""
    if os.name != "posix":
        return
    with suppress(PermissionError):
        os.fchown(descriptor, found.st_uid, found.st_gid)
    os.fchmod(descriptor, found.st_mode & _PERMISSIONS)


def _pour(target: FileTarget, content: bytes) -> None:
    """Write into what is no regular file, or is a standard stream already."""
    assert target.found is not None
    number = _standard(target.found)
    for stream in (sys.stdout, sys.stderr) if number is not None else ():
        stream.flush()
    with _naming(target.shown):
        descriptor = (
            os.open(target.path, os.O_WRONLY) if number is None else os.dup(number)
        )
        with os.fdopen(descriptor, "wb") as sink:
            sink.write(content)


def _put_in_place(staged: Mapping[FileTarget, Path]) -> None:
    """Rename all, or put back what was there."""
    aside: dict[Path, Path | None] = {}
    try:
        for target, temporary in staged.items():
            with _naming(target.shown):
                if len(staged) > 1:
                    aside[target.path] = _set_aside(target.path)
                os.replace(temporary, target.path)
    except BaseException:
        for path, kept in aside.items():
            with suppress(OSError):
                path.unlink() if kept is None else os.replace(kept, path)
        raise
    finally:
        for kept in aside.values():
            if kept is not None:
                _discard(kept)


def _set_aside(path: Path) -> Path | None:
    """Another name for a file that is to be replaced; none where there is no file."""
    kept = path.with_name(f".echelon-{secrets.token_hex(8)}")
    try:
        os.link(path, kept)
    except FileNotFoundError:
        return None
    except OSError:  # a file system without links
        if not path.is_file():
            raise
        os.replace(path, kept)
    return kept


@contextmanager
def _undisturbed() -> Iterator[None]:
    """Signals wait until the block is done: between two renames there is no good moment to stop."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    names = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]
    before = {
        number: signal.getsignal(number)
        for number in (getattr(signal, name) for name in names)
    }
    arrived: list[int] = []
    try:
        for number, handler in before.items():
            if handler is not None:  # none: a handler that Python cannot put back
                signal.signal(number, lambda number, _frame: arrived.append(number))
        yield
    finally:
        for number, handler in before.items():
            if handler is not None:
                signal.signal(number, handler)
        for number in arrived:
            signal.raise_signal(number)
