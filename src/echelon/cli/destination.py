"""Where commands write: never over a file that they read, nor over one that no command wrote, unless they are told to.

The folder of every output has a manifest with digests of what commands wrote there, so that a file that was edited or
copied counts as its owner's.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from echelon.cli.screen import say_written, show
from echelon.shared import (
    READ,
    FileTarget,
    InputError,
    one_line,
    write_all,
    written_into,
)

MANIFEST = ".echelon.json"
"""Name of the file that holds, for a folder, the SHA-256 digest of every output by its name."""


@dataclass(frozen=True)
class Destination:
    """A file or a directory to write to."""

    path: Path
    force: bool = False  # replace files that no command wrote

    def check(self, names: Iterable[str] | None = None) -> None:
        """Raise an error now, before a long computation, if the file could not be written in the end."""
        if names is None:
            self._protect([self.path])
        elif self.path.is_dir():
            self._protect([self.path / name for name in names])

    def write(self, content: str | bytes) -> None:
        """Write the file."""
        self._protect([self.path])
        contents = {self.path: content}
        write_all(contents | _manifests(contents))

    def write_into(self, contents: Mapping[str, str | bytes]) -> list[Path]:
        """Write files into the directory, which is made if need be: all of them or none; returns their paths."""
        self.check(contents)
        paths = {self.path / name: content for name, content in contents.items()}
        manifests = {str(path): text for path, text in _manifests(paths).items()}
        written_into(self.path, {**contents, **manifests})
        return list(paths)

    def _protect(self, paths: Iterable[Path]) -> None:
        targets = [FileTarget.of(path) for path in paths]
        read = {os.path.realpath(path) for path in READ}
        for target in targets:
            if str(target.path) in read and not target.stream:
                problem = "this command reads the file; choose another output"
                raise InputError(problem, source=one_line(target.shown))
        foreign = [target for target in targets if _is_foreign(target)]
        if foreign and not self.force:
            more = f" (and {len(foreign) - 1} more)" if len(foreign) > 1 else ""
            raise InputError(
                f"the file exists and was not written by Echelon, or was changed since{more}; choose another "
                "output, or replace it with --force",
                source=one_line(foreign[0].shown),
            )


def output_file(path: Path | None, force: bool) -> Destination | None:
    """The destination of a command that will write a file, if it can be written; called before the command reads."""
    if path is None:
        return None
    found = Destination(path, force)
    found.check()
    return found


def deliver(text: str, output: Destination | None) -> None:
    """Print text that ends with a line break; or write it, and say where, unless a pipe or a terminal got it."""
    if output is None:
        show(text)
        return
    output.write(text)
    if not FileTarget.of(output.path).stream:
        say_written([output.path])


def _is_foreign(target: FileTarget) -> bool:
    """Whether a file has content that no command wrote."""
    if target.found is None or target.stream or target.found.st_size == 0:
        return False
    stated = _digests(target.path.parent / MANIFEST).get(target.path.name)
    try:
        with target.path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest() != stated
    except OSError:
        return True


def _manifests(contents: Mapping[Path, str | bytes]) -> dict[Path, str]:
    """Manifests that name the files, by their paths."""
    found: dict[Path, dict[str, str]] = {}
    for path, content in contents.items():
        if path.exists() and FileTarget.of(path).stream:
            continue
        actual = Path(os.path.realpath(path))
        manifest = actual.parent / MANIFEST
        digests = found.setdefault(manifest, _digests(manifest))
        written = content.encode() if isinstance(content, str) else content
        digests[actual.name] = hashlib.sha256(written).hexdigest()
    return {
        path: json.dumps(digests, indent=1) + "\n" for path, digests in found.items()
    }


def _digests(manifest: Path) -> dict[str, str]:
    """The digests of a manifest; none if it is missing or damaged."""
    try:
        found = json.loads(manifest.read_bytes())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
