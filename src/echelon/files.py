"""Output files: written whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping
from pathlib import Path

from echelon.errors import InputError

_NEW = os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0)


def write_all(contents: Mapping[Path, str | bytes]) -> None:
    """Write several files that belong together: none appears before all of them are written.

    Parameters
    ----------
    contents : mapping of Path to str or bytes
        By path; text is written as UTF-8.

    Raises
    ------
    InputError
        If one cannot be written; existing files are left as they were.
    """
    written: dict[Path, Path] = {}
    try:
        for path, text in contents.items():
            temporary = path.with_name(f".{path.name}.{secrets.token_hex(8)}")
            write_atomically(temporary, text, shown=path)
            written[path] = temporary
        for path, temporary in written.items():
            os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(path)) from None
    finally:
        for temporary in written.values():
            temporary.unlink(missing_ok=True)


def written_into(folder: Path, contents: Mapping[str, str | bytes]) -> list[Path]:
    """Write files into a directory, which is made if need be: all of them or none.

    Parameters
    ----------
    folder : Path
    contents : mapping of str to str or bytes
        By name.

    Returns
    -------
    list of Path

    Raises
    ------
    InputError
        If it is a file, or something cannot be written.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError("is not a directory; several files are written", source=str(folder))
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be made: {error.strerror or error}", source=str(folder)) from None
    write_all({folder / name: content for name, content in contents.items()})
    return [folder / name for name in contents]


def write_atomically(
    path: str | os.PathLike[str], content: str | bytes, *, private: bool = False, shown: Path | None = None
) -> None:
    """Write a file, text as UTF-8, under a temporary name, then rename it.

    Parameters
    ----------
    path : path
    content : str or bytes
    private : bool
        Nobody but the owner can read or write the file; otherwise its permissions are those of any new file.
    shown : Path, optional
        The name that messages give; that of the file if omitted.

    Raises
    ------
    InputError
        If the file cannot be written; an existing file is left as it was.
    """
    target = Path(path)
    name = str(shown or target)
    temporary = target.with_name(f".{target.name}.{secrets.token_hex(8)}")
    try:
        descriptor = os.open(temporary, _NEW, 0o600 if private else 0o666)  # the system applies the user's mask
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=name) from None
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content.encode() if isinstance(content, str) else content)
        os.replace(temporary, target)
    except OSError as error:
        os.unlink(temporary)
        raise InputError(f"cannot be written: {error.strerror or error}", source=name) from None
    except BaseException:
        os.unlink(temporary)
        raise
