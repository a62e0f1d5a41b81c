"""Names that no file brings into a mechanism any more: what shows names escapes them all the same."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch


@contextmanager
def unchecked_names() -> Iterator[None]:
    """Mechanisms that are made here may have any names."""
    with patch("echelon.robot.mechanism._check_names"):
        yield
