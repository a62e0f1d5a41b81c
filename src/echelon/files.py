"""Output files: written whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from echelon.errors import InputError

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


def write_atomically(path: str | os.PathLike[str], content: str | bytes, *, private: bool = False) -> None:
    """Write a file, text as UTF-8, under a temporary name, then rename it.

    Parameters
    ----------
    path : path
    content : str or bytes
    private : bool
        Nobody but the owner can read or write the file; otherwise its permissions are those of any new file.

    Raises
    ------
    InputError
        If the file cannot be written; an existing file is left as it was.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(8)}")
    try:
        descriptor = os.open(temporary, _NEW, 0o600 if private else 0o666)  # the system applies the user's mask
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(target)) from None
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        os.replace(temporary, target)
    except OSError as error:
        os.unlink(temporary)
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(target)) from None
    except BaseException:
        os.unlink(temporary)
        raise
