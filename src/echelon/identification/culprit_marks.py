"""How well the best parameters of a robot that can exist predict rows: the mark of a change of a set-up.

Base parameters are fitted by weighted least squares from the normal matrices of the outputs, then moved to those of the
nearest physical robot.  A change that mixes outputs only needs no new rows: their products are taken with all outputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import log

import numpy as np

from echelon.arrays import Flags, Floats, Integers
from echelon.base.model import BaseModel
from echelon.errors import EchelonError
from echelon.identification.physics.feasibility import nearest_physical
from echelon.identification.rows.rows import rows_taken
from echelon.logs.recording import Samples

_LARGEST = 120  # base parameters beyond which physics is not asked: programmes of that size take seconds
_RIDGE = 1e-9  # of squares of columns: what the data leave open stays small
_FLOOR = 1e-4  # of an output's spread: smaller residuals count as equal


@dataclass(frozen=True)
class States:
    """Samples of the logs that changes are tried on."""

    q: Floats
    qd: Floats
    qdd: Floats
    y: Floats
    inputs: Mapping[str, Floats]
    pieces: tuple[Samples, ...]  # stretches that the samples are, with the filter of both sides

    def rows(self, values: Floats) -> Floats:
        """Signals (samples, …) after the filter of both sides, shape (rows, …)."""
        ends = np.cumsum([len(piece) for piece in self.pieces])
        parts = zip(self.pieces, np.split(values, ends[:-1]), strict=True)
        return np.concatenate([rows_taken(piece, part)[1] for piece, part in parts])

    @cached_property
    def fitted(self) -> Flags:
        """Rows that are fitted, shape (rows, outputs)."""
        found = [rows_taken(piece, piece.q[:, :1]) for piece in self.pieces]
        every = (np.ones((len(rows), self.y.shape[1]), dtype=bool) for _, rows, _ in found)
        return np.concatenate([a if flags is None else flags for a, (_, _, flags) in zip(every, found, strict=True)])


@dataclass(frozen=True)
class Normal:
    """Normal equations of one output's rows: [W y]ᵀ[W y], the mean square of y about its mean, and rows."""

    columns: Integers  # shape (n_i,); parameters that it can depend on
    matrix: Floats  # shape (n_i + 1, n_i + 1)
    spread: float
    rows: int

    def square(self, values: Floats) -> float:
        """Mean square of the residual."""
        full = np.append(values[self.columns], -1.0)
        return float(max(full @ self.matrix @ full, 0.0)) / max(self.rows, 1)


class Marks:
    """How well the best parameters predict rows: mean logarithm of residual over spread, of all outputs."""

    def __init__(self, base: BaseModel, outputs: int) -> None:
        self._base, self._outputs = base, outputs
        places, parameters = base.sparsity
        self._entries: list[Integers] = [np.flatnonzero(places == i) for i in range(outputs)]
        self.columns = [parameters[entries] for entries in self._entries]

    def products(self, rows: States) -> list[Floats]:
        """Of each output [W Y 1]ᵀ[W Y 1] over its rows, with the measured values Y of all outputs."""
        entries = self._base.regressor_entries(rows.q, rows.qd, rows.qdd, None, dict(rows.inputs), threads=1)
        filtered = rows.rows(np.column_stack([entries, rows.y, np.ones(len(rows.y))]))
        beside = np.arange(entries.shape[1], filtered.shape[1])
        found = []
        for i, chosen in enumerate(self._entries):
            whole = filtered[np.ix_(rows.fitted[:, i], np.append(chosen, beside))]
            found.append(whole.T @ whole)
        return found

    def normals(self, products: Sequence[Floats], outputs: Floats | None = None) -> list[Normal]:
        """Normal equations where outputs are linear combinations of what was read."""
        mixed = np.eye(self._outputs) if outputs is None else outputs
        found = []
        for columns, product, mix in zip(self.columns, products, mixed, strict=True):
            n = len(columns)
            T = np.zeros((n + 2, len(product)))
            T[:n, :n], T[n, n:-1], T[n + 1, -1] = np.eye(n), mix, 1.0
            whole = T @ product @ T.T
            count = round(float(whole[-1, -1]))
            spread = (whole[n, n] - whole[n, -1] ** 2 / max(count, 1)) / max(count, 1)
            found.append(Normal(columns, whole[:-1, :-1], float(max(spread, 0.0)), count))
        return found

    def free(self, normals: Sequence[Normal]) -> float:
        """Of any parameters."""
        return self.mark(normals, self._solved(normals)[0])

    def physical(self, normals: Sequence[Normal], failed: float | None = None) -> float:
        """Of those of the nearest robot that can exist; where none is found ``failed``, or the mark of any."""
        values, matrix = self._solved(normals)
        if len(values) > _LARGEST:
            return self.mark(normals, values)
        try:
            standard, _ = nearest_physical(self._base, values, np.linalg.inv(matrix))
        except (EchelonError, np.linalg.LinAlgError):
            return self.mark(normals, values) if failed is None else failed
        return self.mark(normals, self._base.B_float() @ standard)

    def _solved(self, normals: Sequence[Normal]) -> tuple[Floats, Floats]:
        """Parameters by iteratively reweighted least squares, and the normal matrix, shape (r,) and (r, r)."""
        size = self._base.rank
        floors = np.array([_FLOOR**2 * some.spread or 1.0 for some in normals])
        noise = np.array([some.spread or 1.0 for some in normals])
        for _ in range(4):
            matrix, right = np.zeros((size, size)), np.zeros(size)
            for some, square in zip(normals, noise, strict=True):
                matrix[np.ix_(some.columns, some.columns)] += some.matrix[:-1, :-1] / square
                right[some.columns] += some.matrix[:-1, -1] / square
            scale = np.sqrt(np.where(np.diagonal(matrix) > 0, np.diagonal(matrix), 1.0))
            matrix += np.diag(_RIDGE * scale**2)
            values = np.linalg.solve(matrix / np.outer(scale, scale), right / scale) / scale
            noise = np.maximum([some.square(values) for some in normals], floors)
        return values, matrix

    @staticmethod
    def mark(normals: Sequence[Normal], values: Floats) -> float:
        """Of some parameters."""
        told = [some for some in normals if some.spread > 0]
        return float(np.mean([0.5 * log(max(some.square(values) / some.spread, _FLOOR**2)) for some in told]))
