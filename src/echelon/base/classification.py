"""What the outputs can say about each standard parameter."""

from __future__ import annotations

from enum import Enum

from echelon.base.matrix import BaseMatrix


class Identifiability(Enum):
    """What the outputs can say about one standard parameter."""

    UNIDENTIFIABLE = "unidentifiable"
    ALONE = "identifiable alone"
    COMBINATION = "identifiable in combination"


def classify(matrix: BaseMatrix) -> dict[str, Identifiability]:
    """Class of every standard parameter, in column order.

    A zero column of B is unidentifiable; a unit row whose parameter occurs in no other row is identifiable alone.
    """
    seen: dict[int, Identifiability] = {}
    for row in matrix.rows:
        kind = Identifiability.ALONE if len(row) == 1 else Identifiability.COMBINATION
        for column in row:
            seen[column] = kind
    return {name: seen.get(column, Identifiability.UNIDENTIFIABLE) for column, name in enumerate(matrix.parameters)}
