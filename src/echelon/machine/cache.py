"""Object code kept on disk between processes.

An entry holds the key it was made for and a digest of its contents.  A file that is damaged, that was made for another
key, or that others could write to, itself or its folder, is not used: the code is then made again.  The key covers the
source text and everything else the code depends on, so nothing is ever stale.
"""

from __future__ import annotations

import hashlib
import os
import stat
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from echelon.errors import InputError
from echelon.files import write_atomically

_MAGIC = b"echelon object code 1\n"
_MOST_ENTRIES = 1000
_VARIABLE = "ECHELON_CACHE"


def cached_object(identity: str, text: str, make: Callable[[], bytes]) -> bytes:
    """Object code from the cache, or made and stored there."""
    folder = cache_folder()
    if folder is None:
        return make()
    key = hashlib.sha256(f"{identity}\n{text}".encode()).hexdigest()
    path = folder / f"{key}.bin"
    stored = _stored(path, key)
    if stored is not None:
        return stored
    code = make()
    _store(path, key, code)
    return code


def cache_folder() -> Path | None:
    """Where object code is kept: ``ECHELON_CACHE``, or the user's usual cache folder; None if there is no safe place.

    An empty ``ECHELON_CACHE`` switches the cache off.
    """
    chosen = os.environ.get(_VARIABLE)
    if chosen == "":
        return None
    if chosen is None:
        from platformdirs import user_cache_path

        folder = user_cache_path("echelon", appauthor=False) / "objects"
    else:
        folder = Path(chosen)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        problem = _unsafe(folder.stat())
    except OSError as error:
        problem = error.strerror or str(error)
    if problem is None:
        return folder
    text = f"compiled code is not kept: {folder}: {problem}; set {_VARIABLE} to a folder of your own, or to nothing"
    warnings.warn(text, RuntimeWarning, stacklevel=2)
    return None


def _unsafe(found: os.stat_result) -> str | None:
    """Why code from a folder or file must not be trusted, if there is a reason."""
    if os.name != "posix":
        return None  # the user's own folders are protected by the system's access lists
    if found.st_uid != os.geteuid():
        return "it belongs to another user"
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        return "others can write to it"
    return None


def _stored(path: Path, key: str) -> bytes | None:
    """The code in an entry, if the entry is whole and was made for this key."""
    try:
        with path.open("rb") as stream:
            if _unsafe(os.fstat(stream.fileno())) is not None:
                return None
            content = stream.read()
    except OSError:
        return None
    head = _MAGIC + key.encode() + b"\n"
    digest, code = content[len(head) : len(head) + 32], content[len(head) + 32 :]
    whole = content.startswith(head) and hashlib.sha256(code).digest() == digest
    return code if whole else None


def _store(path: Path, key: str, code: bytes) -> None:
    """Write an entry; without room or permission there is none, and the code is made again next time."""
    try:
        write_atomically(path, _MAGIC + key.encode() + b"\n" + hashlib.sha256(code).digest() + code, private=True)
    except InputError as error:
        warnings.warn(f"compiled code is not kept: {error}", RuntimeWarning, stacklevel=2)
        return
    with suppress(OSError):  # another process may remove entries at the same time
        entries = sorted(path.parent.glob("*.bin"), key=lambda entry: entry.stat().st_mtime)
        for old in entries[:-_MOST_ENTRIES]:
            old.unlink(missing_ok=True)
