"""The content of documents: files that are read as a whole, never more of them than a document can have.

Pipes are read as well as files (``echelon derive <(xacro arm.xacro)``), so the size that the system states is not
relied on: a link to a device without end has size 0.
"""

from __future__ import annotations

import os
from pathlib import Path

from echelon.errors import InputError, one_line
from echelon.inputs.limits import DOCUMENT


def read_content(path: str | os.PathLike[str]) -> bytes:
    """All bytes of a document."""
    source = one_line(os.fspath(path))
    try:
        with Path(path).open("rb") as stream:
            content = stream.read(DOCUMENT.most + 1)
    except FileNotFoundError:
        raise InputError("cannot be read: no such file", source=source) from None
    except (OSError, ValueError) as error:  # ValueError: a name that no system allows
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read: {reason}", source=source) from None
    DOCUMENT.check(len(content), source)
    return content


def decoded(content: str | bytes, source: str) -> str:
    """The text of a document, without a byte order mark."""
    DOCUMENT.check(len(content), source)
    if isinstance(content, str):
        return content.removeprefix("\ufeff")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"not UTF-8 text: {error.reason} at byte {error.start}", source=source) from None


def read_document(path: str | os.PathLike[str]) -> str:
    """The text of a document in UTF-8."""
    return decoded(read_content(path), os.fspath(path))
