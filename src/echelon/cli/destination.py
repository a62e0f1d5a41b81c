"""Where commands write: never over a file that they read or that no command wrote, unless they are told to.

Python itself is asked which files it reads, so that no reader can forget to say so, and files that other files name are
among them.  Which files commands wrote before is known by digests: formats of outputs have no place for a mark in
common, and a mark would stay in a file that somebody edits.  The digests are kept in the user's folder for state, for
every path in a small file of its own, which needs no locks.  Without them nothing is lost: files that Echelon wrote
then count as somebody else's.
"""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import typer

from echelon.cli.screen import show
from echelon.errors import InputError, one_line
from echelon.files import Target, target_of, write_all, write_atomically, written_into

_WRITING = os.O_WRONLY | os.O_RDWR
_VARIABLE = "ECHELON_STATE"
_KEPT = 8  # digests per path: a command that is stopped may leave the file as it was, or the one before that
_MOST_PATHS = 10_000

_paths: set[str] = set()
_state = {"watching": False}


@dataclass(frozen=True)
class Destination:
    """A file or a directory to write to."""

    path: Path
    force: bool = False  # replace whatever is there

    def check(self, names: Iterable[str] | None = None) -> None:
        """Raise an error now, before a long computation, if the file could not be written in the end."""
        if names is None:
            self._protect([self.path])
        elif self.path.is_dir():
            self._protect([self.path / name for name in names])

    def write(self, content: str | bytes) -> None:
        """Write the file."""
        self._protect([self.path])
        with _remembered({self.path: content}):
            write_all({self.path: content})

    def write_into(self, contents: Mapping[str, str | bytes]) -> list[Path]:
        """Write files into the directory, which is made if need be: all of them or none; returns their paths."""
        self.check(contents)
        with _remembered(
            {self.path / name: content for name, content in contents.items()}
        ):
            return written_into(self.path, contents)

    def _protect(self, paths: Iterable[Path]) -> None:
        targets = [target_of(path) for path in paths]
        problems = [
            (target, problem)
            for target in targets
            if not self.force and (problem := _problem(target))
        ]
        if problems:
            (target, problem), *others = problems
            more = f" (and {len(others)} more)" if others else ""
            advice = "choose another place, or replace it with --force"
            raise InputError(
                f"{problem}{more}; {advice}", source=one_line(target.shown)
            )


def output_folder(path: Path, force: bool) -> Destination:
    """The destination of a command that will write one or several files; called before it reads any."""
    _install()
    _paths.clear()
    _state["watching"] = True
    return Destination(path, force)


def output_file(path: Path | None, force: bool) -> Destination | None:
    """The destination of a command that will write a file, if it can be written; called before the command reads."""
    if path is None:
        return None
    found = output_folder(path, force)
    found.check()
    return found


def deliver(text: str, output: Destination | None) -> None:
    """Write text that ends with a line break, or print it."""
    if output is None:
        show(text)
    else:
        output.write(text)


def _problem(target: Target) -> str | None:
    """Why a file must not be replaced."""
    if target.found is None or target.stream:
        return None
    with unwatched():
        if os.fspath(target.path) in {os.path.realpath(found) for found in _paths}:
            return "this command reads the file"
        if target.found.st_size == 0 or is_as_written(target.path):
            return None
    return "the file is there already, and is not as an earlier command wrote it"


@contextmanager
def _remembered(contents: Mapping[Path, str | bytes]) -> Iterator[None]:
    """Note what is written in the block, before it is; that this fails is no reason not to write."""
    problem = None
    try:
        for path, content in contents.items():
            if path.is_file() or not path.exists():
                actual = Path(os.path.realpath(path))
                remember(
                    actual, content.encode() if isinstance(content, str) else content
                )
    except InputError as error:
        problem = one_line(str(error))
    yield
    if problem:
        typer.echo(
            f"echelon: {problem}; to replace these files later will need --force",
            err=True,
        )


# -- which files this process reads ----------------------------------------------------------------------------------


@contextmanager
def unwatched() -> Iterator[None]:
    """For looking into files that are about to be replaced."""
    before, _state["watching"] = _state["watching"], False
    try:
        yield
    finally:
        _state["watching"] = before


@cache  # a hook stays until the process ends
def _install() -> None:
    sys.addaudithook(_note)


def _note(event: str, arguments: tuple[object, ...]) -> None:
    if event != "open" or not _state["watching"]:
        return
    path, _, flags = arguments
    if (
        isinstance(path, str | bytes)
        and isinstance(flags, int)
        and not flags & _WRITING
    ):
        _paths.add(os.fsdecode(path))


# -- which files commands wrote --------------------------------------------------------------------------------------


def remember(path: Path, content: bytes) -> None:
    """Note what is about to be written to a path behind all symbolic links; an InputError if it cannot be noted."""
    record = _record(path)
    digest = hashlib.sha256(content).hexdigest()
    digests = [line for line in _digests(record) if line != digest]
    try:
        record.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot be made: {error.strerror or error}", source=str(record.parent)
        ) from None
    write_atomically(
        record, "\n".join([*digests[-_KEPT + 1 :], digest]) + "\n", private=True
    )
    _forget_oldest(record.parent)


def is_as_written(path: Path) -> bool:
    """Whether a file holds what a command of this user wrote there."""
    digests = _digests(_record(path))
    if not digests:
        return False
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() in digests
    except OSError:
        return False


def state_folder() -> Path:
    """Where digests are kept: ``ECHELON_STATE``, or the user's usual folder for state."""
    chosen = os.environ.get(_VARIABLE)
    if chosen:
        return Path(chosen)
    from platformdirs import user_state_path

    return user_state_path("echelon", appauthor=False)


def _record(path: Path) -> Path:
    return state_folder() / "written" / hashlib.sha256(os.fsencode(path)).hexdigest()


def _digests(record: Path) -> list[str]:
    try:
        return record.read_text(encoding="ascii").split()
    except (OSError, UnicodeDecodeError):
        return []


def _forget_oldest(folder: Path) -> None:
    with suppress(OSError):  # another process may forget some at the same time
        records = list(folder.iterdir())
        if len(records) > _MOST_PATHS:
            for record in sorted(records, key=lambda record: record.stat().st_mtime)[
                :-_MOST_PATHS
            ]:
                record.unlink(missing_ok=True)
