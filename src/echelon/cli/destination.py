"""Where commands write: never over a file that they read or that no command wrote, unless they are told to."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import typer

from echelon.cli.reads import unwatched, was_read, watch_reads
from echelon.cli.show import show
from echelon.cli.written import is_as_written, remember
from echelon.errors import InputError, one_line
from echelon.files import Target, target_of, write_all, written_into


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
        with _remembered({self.path / name: content for name, content in contents.items()}):
            return written_into(self.path, contents)

    def _protect(self, paths: Iterable[Path]) -> None:
        targets = [target_of(path) for path in paths]
        problems = [(target, problem) for target in targets if not self.force and (problem := _problem(target))]
        if problems:
            (target, problem), *others = problems
            more = f" (and {len(others)} more)" if others else ""
            advice = "choose another place, or replace it with --force"
            raise InputError(f"{problem}{more}; {advice}", source=one_line(target.shown))


def output_folder(path: Path, force: bool) -> Destination:
    """Where a command that is about to read its files will write one or several."""
    watch_reads()
    return Destination(path, force)


def output_file(path: Path | None, force: bool) -> Destination | None:
    """Where a command that is about to read its files will write a file, if the file can be written."""
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
    if was_read(target.path):
        return "this command reads the file"
    with unwatched():
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
                remember(actual, content.encode() if isinstance(content, str) else content)
    except InputError as error:
        problem = one_line(str(error))
    yield
    if problem:
        typer.echo(f"echelon: {problem}; to replace these files later will need --force", err=True)
