"""Opening files of logs: what can go wrong with a path, and what is wrong inside, each as one clear error.

The packages that decode files raise whatever their parsers stumble over when a file is cut off or damaged: assertions,
struct errors, look-ups of keys.  A list of them would never be complete, so the guard below takes every exception that
arises while a file's content is decoded for what it is: a file that cannot be read.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from echelon.errors import EchelonError, InputError, one_line
from echelon.hints import nearest

_SHOWN = 160


def existing_file(path: str | os.PathLike[str]) -> Path:
    """A path at which a file with content can be read.

    Parameters
    ----------
    path : path

    Raises
    ------
    InputError
        If there is no such file, it is a directory, a pipe, a device or empty, or it may not be read.
    """
    found, source = Path(path), os.fspath(path)
    if os.path.isdir(found):
        raise InputError("is a directory; name a file in it", source=source)
    if os.path.exists(found) and not os.path.isfile(found):
        raise InputError("is a pipe or a device, which cannot be read twice; save it to a file first", source=source)
    try:
        with found.open("rb") as stream:
            content = stream.read(1)
    except FileNotFoundError:
        raise InputError(f"no such file{_neighbour(found)}", source=source) from None
    except (OSError, ValueError) as error:  # ValueError: a name that no system allows
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot be read: {reason}", source=one_line(source)) from None
    if not content:
        raise InputError("is empty", source=source)
    return found


@contextmanager
def decoding(source: str, kind: str, advice: str = "") -> Iterator[None]:
    """What another package cannot decode becomes one error that names the file.

    Parameters
    ----------
    source : str
        Name of the file.
    kind : str
        What the file should be, such as ``"a Parquet file"``.
    advice : str
        What to do about a damaged file of this kind.

    Raises
    ------
    InputError
        For every exception in the block that is not an error of this package.
    """
    try:
        yield
    except InputError as error:
        raise error.located(source) from None
    except EchelonError:
        raise
    except PermissionError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=source) from None
    except Exception as error:  # see the head of this file
        reason = one_line(str(error))[:_SHOWN].strip().rstrip(".") or type(error).__name__
        problem = f"cannot be read as {kind}; it is damaged or was cut off ({reason})"
        raise InputError(f"{problem}; {advice}" if advice else problem, source=source) from error


def _neighbour(path: Path) -> str:
    """A question for the file beside it that was probably meant."""
    try:
        return nearest(path.name, sorted(entry.name for entry in path.parent.iterdir()))
    except OSError:
        return ""
