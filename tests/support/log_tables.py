"""Text as a log, and logs read back piece by piece."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.files.log_file import LogFile


def text(directory: Path, content: str | bytes, name: str = "run.csv") -> Path:
    path = directory / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def joined(
    log: LogFile, names: list[str] | None = None, rows: int = 1 << 17
) -> dict[str, npt.NDArray[np.float64]]:
    """All pieces of a log, after checking that each is as long as it may be and begins where the last one ended."""
    pieces = list(log.tables(names, rows))
    first = 0
    for piece in pieces:
        lengths = {len(values) for values in piece.columns.values()}
        assert len(lengths) == 1
        assert piece.first == first
        (length,) = lengths
        assert 0 < length <= rows
        first += length
    return {
        name: np.concatenate([piece.columns[name] for piece in pieces])
        for name in pieces[0].columns
    }


def same(
    found: Mapping[str, npt.ArrayLike], expected: Mapping[str, npt.ArrayLike]
) -> None:
    assert list(found) == list(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)
