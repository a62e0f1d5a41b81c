"""The content of documents: files that are read as a whole, and how large an input may be.

Pipes are read as well as files (``echelon derive <(xacro arm.xacro)``), so the size that the system states is not
relied on: a link to a device without end has size 0.

What streams, such as the samples of a log, may be as long as the disk is large.  What multiplies, such as nested
brackets, names, columns, or archives of zeros, is bounded, because a small file could otherwise keep the machine busy
or fill its memory.  No file of a robot known to us comes near any of these numbers.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from echelon.errors import InputError, one_line


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


_MIB = 1 << 20


@dataclass(frozen=True)
class Limit:
    """A bound of something that is counted in an input."""

    most: int  # the largest number that is accepted
    unit: str  # what is counted, in the plural
    advice: str = ""  # what to do about a file that has more

    def check(self, found: int, source: str | None = None, element: str | None = None) -> None:
        """Refuse an input that has more."""
        if found > self.most:
            problem = f"has more than {self}" + (f"; {self.advice}" if self.advice else "")
            raise InputError(problem, source=source, element=element)

    def __str__(self) -> str:
        if self.unit == "bytes" and self.most % _MIB == 0:
            return f"{self.most // _MIB} MiB"
        return f"{self.most:,} {self.unit}"


DOCUMENT = Limit(64 * _MIB, "bytes", "that is not a description, result or model")
DEPTH = Limit(64, "levels of brackets inside one another", "nested too deeply to be a document")
DESCRIPTION_NODES = Limit(250_000, "numbers, texts, lists and mappings", "that is not a description")
DATA_NODES = Limit(4_000_000, "numbers, texts, lists and mappings", "keep samples in a table (CSV, Parquet)")
SLOW_NODES = Limit(200_000, "numbers, texts, lists and mappings", "install PyYAML with libyaml, or write JSON")
XML_NODES = Limit(1_000_000, "elements and attributes", "that is not a robot")
XML_DEPTH = Limit(512, "elements inside one another", "the nesting is too deep for a robot")
INCLUDES = Limit(256, "included files", "put them together")
LINE = Limit(_MIB, "bytes in a line", "no log has lines as long")
COLUMNS = Limit(16_384, "columns", "write the quantities of the robot alone")
ARRAY_COLUMNS = Limit(4096, "columns of an array", "transpose it")
UNPACKED = Limit(64 * _MIB, "bytes")
EXPANSION = Limit(50, "times the size of the file")

LIMITS: Mapping[Limit, str] = {
    DOCUMENT: "size of every document: YAML, JSON, URDF, MJCF, set-ups, result files, claims, values, "
    "trajectories as JSON or YAML, metadata of bags",
    DEPTH: "nesting of JSON and YAML",
    DESCRIPTION_NODES: "content of descriptions, set-ups and linear models",
    DATA_NODES: "content of result files, claims, values and trajectories as JSON or YAML, and of every JSON message",
    SLOW_NODES: "content of YAML where PyYAML was built without libyaml",
    XML_NODES: "content of URDF and MJCF",
    XML_DEPTH: "nesting of URDF and MJCF",
    INCLUDES: "files that an MJCF file includes or attaches",
    LINE: "lines of CSV and other text logs",
    COLUMNS: "columns of a log of any kind, and arrays of an NPZ or MAT file",
    ARRAY_COLUMNS: "single arrays of NPZ, NPY and MAT files, which are left out if they have more",
    UNPACKED: "numbers of a packed log (gzip, NPZ, MAT, HDF5, Parquet, MCAP, bags), and besides",
    EXPANSION: "the same; a file that holds more for its size is packed zeros",
}
"""All limits, with what each of them bounds."""


def most_unpacked(packed: int) -> int:
    """Bytes that a file may hold after unpacking."""
    return UNPACKED.most + EXPANSION.most * packed


def check_unpacked(unpacked: int, packed: int, source: str | None = None, element: str | None = None) -> None:
    """Refuse an archive that grows out of proportion."""
    if unpacked > most_unpacked(packed):
        problem = f"unpacks to more than {UNPACKED} and {EXPANSION}; if that is meant, save it without compression"
        raise InputError(problem, source=source, element=element)


def limits_table() -> str:
    """All limits as a Markdown table."""
    rows = [f"| {limit} | {bounds} |" for limit, bounds in LIMITS.items()]
    return "\n".join(["| at most | of |", "|---|---|", *rows]) + "\n"
