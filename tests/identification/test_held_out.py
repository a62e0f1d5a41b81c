"""Predictions of held-out blocks are those of refits to the rows of all other blocks."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest

from echelon.identification.judge.evidence import BLOCKS, OutputRows, Products, States
from echelon.identification.judge.held_out import Beside, HeldOut
from echelon.identification.logs.recording import Samples

Floats = npt.NDArray[np.float64]

COUNT, SIZE = 230, 6
"""Rows and parameters; blocks have 23 rows."""
COLUMNS = (np.array([0, 2, 3, 5]), np.array([4, 1, 2]), np.array([0, 1, 5]))
"""Parameters of each output, some shared and not in their order."""
NOISE = np.array([0.3, 2.0, 0.05])
RIDGE = 1e-6  # relative error that the ridge of the fits may cause


@dataclass(frozen=True)
class Problem:
    """Rows of three outputs, two terms, and what is made of them."""

    tables: tuple[Floats, ...]  # [W y] of each output, all rows
    fitted: npt.NDArray[np.bool_]  # shape (rows, outputs)
    terms: tuple[dict[int, Floats], ...]

    @property
    def states(self) -> States:
        """States without a filter, of which only outputs matter."""
        none = np.zeros((COUNT, 1))
        y = np.column_stack([table[:, -1] for table in self.tables])
        piece = Samples("log", 0.0, 10.0, none, none, none, y)
        return States(none, none, none, y, {}, (piece,), np.ones(len(self.tables)))

    @property
    def rows(self) -> list[OutputRows]:
        """Rows of each output that are fitted."""
        found = []
        for columns, table, some in zip(
            COLUMNS, self.tables, self.fitted.T, strict=True
        ):
            ends = [int(np.sum(some & (blocks() <= block))) for block in range(BLOCKS)]
            parts = tuple(
                slice(begin, end) for begin, end in zip([0, *ends], ends, strict=False)
            )
            found.append(OutputRows(columns, table[some], some, parts))
        return found

    @property
    def beside(self) -> Beside:
        """The object under test, made of the same rows as the tables."""
        held = HeldOut(Products.of(SIZE, self.rows), NOISE)
        return Beside(held, self.rows, self.states, self.terms)

    def whole(self, output: int, chosen: list[int]) -> tuple[Floats, Floats]:
        """All rows of an output with the columns of all parameters, those of some terms' columns last; and y."""
        full = np.zeros((COUNT, SIZE + 3))
        full[:, COLUMNS[output]] = self.tables[output][:, :-1]
        for first, term in zip((SIZE, SIZE + 2), self.terms, strict=True):
            if output in term:
                full[:, first : first + term[output].shape[1]] = term[output]
        return full[:, [*range(SIZE), *(SIZE + c for c in chosen)]], self.tables[
            output
        ][:, -1]

    def refitted(self, block: int, chosen: list[int]) -> Floats:
        """Parameters by least squares on the rows of all blocks but one, divided by the noise."""
        rows, right = [], []
        for output, noise in enumerate(NOISE):
            W, y = self.whole(output, chosen)
            some = self.fitted[:, output] & (blocks() != block)
            rows.append(W[some] / np.sqrt(noise))
            right.append(y[some] / np.sqrt(noise))
        return np.asarray(
            np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
        )

    def left(self, chosen: list[int]) -> Floats:
        """Squares of residuals of each block by the refit to the others, shape (blocks, outputs)."""
        found = np.empty((BLOCKS, len(NOISE)))
        for block in range(BLOCKS):
            values = self.refitted(block, chosen)
            for output in range(len(NOISE)):
                W, y = self.whole(output, chosen)
                some = self.fitted[:, output] & (blocks() == block)
                found[block, output] = np.sum((y[some] - W[some] @ values) ** 2)
        return found


def blocks() -> npt.NDArray[np.intp]:
    """The block of every row."""
    return np.repeat(np.arange(BLOCKS), COUNT // BLOCKS)


@pytest.fixture
def problem() -> Problem:
    """Outputs follow their columns, both terms, and noise; a tenth of the rows is not fitted."""
    rng = np.random.default_rng(5)
    fitted = rng.random((COUNT, 3)) > 0.1
    one = {0: rng.normal(size=(COUNT, 2)), 2: rng.normal(size=(COUNT, 2))}
    other = {1: rng.normal(size=(COUNT, 1)), 2: rng.normal(size=(COUNT, 1))}
    tables = []
    for output, columns in enumerate(COLUMNS):
        W = rng.normal(size=(COUNT, len(columns)))
        y = W @ (1.0 + columns) + rng.normal(size=COUNT) * np.sqrt(NOISE[output])
        y += sum(
            term[output] @ np.full(term[output].shape[1], 0.7)
            for term in (one, other)
            if output in term
        )
        tables.append(np.column_stack([W, y]))
    return Problem(tuple(tables), fitted, (one, other))


@pytest.mark.parametrize("chosen", [[0], [2], [0, 1], [1, 2], [0, 1, 2]])
def test_squares_are_those_of_refits(problem: Problem, chosen: list[int]) -> None:
    expected = problem.left(chosen)
    assert not np.allclose(expected, problem.left([]), rtol=1e-2)
    np.testing.assert_allclose(problem.beside.squares(chosen), expected, rtol=RIDGE)


def test_squares_without_columns_are_those_of_refits(problem: Problem) -> None:
    held = HeldOut(Products.of(SIZE, problem.rows), NOISE)
    np.testing.assert_allclose(held.squares, problem.left([]), rtol=RIDGE)


@pytest.mark.parametrize("chosen", [[0], [1, 2], [0, 1, 2]])
def test_sizes_are_means_of_refits(problem: Problem, chosen: list[int]) -> None:
    refits = [problem.refitted(block, chosen)[SIZE:] for block in range(BLOCKS)]
    np.testing.assert_allclose(
        problem.beside.sizes(chosen), np.mean(refits, axis=0), rtol=RIDGE
    )


def test_new_is_what_projections_leave(problem: Problem) -> None:
    expected = []
    for column in range(3):
        shares = []
        for block in range(BLOCKS):
            pairs = [problem.whole(output, [column])[0] for output in range(len(NOISE))]
            keeps = [
                problem.fitted[:, output] & (blocks() != block)
                for output in range(len(NOISE))
            ]
            parts = [
                W[some] / np.sqrt(noise)
                for W, some, noise in zip(pairs, keeps, NOISE, strict=True)
            ]
            stacked = np.concatenate(parts)
            W, x = stacked[:, :-1], stacked[:, -1]
            left = x - W @ np.linalg.lstsq(W, x, rcond=None)[0]
            shares.append(left @ left / (x @ x))
        expected.append(min(shares))
    np.testing.assert_allclose(problem.beside.new, expected, rtol=RIDGE)


def test_column_of_the_model_is_not_new(problem: Problem) -> None:
    """Nothing is left of a term that the model's own parameter 4 says, which acts on one output alone."""
    known = problem.tables[1][:, [0]]
    rows, states = problem.rows, problem.states
    beside = Beside(
        HeldOut(Products.of(SIZE, rows), NOISE), rows, states, [{1: 3 * known}]
    )
    assert beside.new[0] < RIDGE
