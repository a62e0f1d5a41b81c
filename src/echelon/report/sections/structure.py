"""Structure: the matrix B as a picture, and where the parameters of each body went."""

from __future__ import annotations

from typing import Any

from echelon.identification.result import Identification
from echelon.report.matrix_picture import matrix_picture, mergings


def context(run: Identification) -> dict[str, Any]:
    """What the section on the structure of B shows."""
    return {"picture": matrix_picture(run.base), "mergings": mergings(run.base)}
