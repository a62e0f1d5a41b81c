"""Output files: written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from echelon.errors import InputError


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
    try:
        descriptor, temporary = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(target)) from None
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        if not private:
            os.chmod(temporary, _usual_mode())
        os.replace(temporary, target)
    except OSError as error:
        os.unlink(temporary)
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(target)) from None
    except BaseException:
        os.unlink(temporary)
        raise


def _usual_mode() -> int:
    """Permissions that a plainly created file would have."""
    mask = os.umask(0)
    os.umask(mask)
    return 0o666 & ~mask
