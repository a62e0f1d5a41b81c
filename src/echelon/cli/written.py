"""Which files commands wrote, so that a command that runs again may replace what it wrote before, and nothing else.

Formats of outputs have no place for a mark in common, and a mark would stay in a file that somebody edits.  So digests
of what was written are kept in the user's folder for state: for every path a small file of its own, which needs no
locks.  Without it nothing is lost: files that Echelon wrote then count as somebody else's.
"""

from __future__ import annotations

import hashlib
import os
from contextlib import suppress
from pathlib import Path

from echelon.errors import InputError
from echelon.files import write_atomically

_VARIABLE = "ECHELON_STATE"
_KEPT = 8
"""Digests per path: a command that is stopped may leave the file as it was, or the one before that."""
_MOST_PATHS = 10_000


def remember(path: Path, content: bytes) -> None:
    """Note what is about to be written."""
    record = _record(path)
    digest = hashlib.sha256(content).hexdigest()
    digests = [line for line in _digests(record) if line != digest]
    try:
        record.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror or error}", source=str(record.parent)) from None
    write_atomically(record, "\n".join([*digests[-_KEPT + 1 :], digest]) + "\n", private=True)
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
            for record in sorted(records, key=lambda record: record.stat().st_mtime)[:-_MOST_PATHS]:
                record.unlink(missing_ok=True)
