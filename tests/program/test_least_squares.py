"""Linear systems that programs solve, against NumPy."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import numpy.typing as npt
import pytest

from echelon.algebra.program.least_squares import LeastSquares
from echelon.algebra.program.schedule import FloatArithmetic, Schedule
from echelon.algebra.program.tape import Program, Scalar

Floats = npt.NDArray[np.float64]
NAMES = ("a", "b", "c", "d")


class System:
    """A program that solves one system of six equations and four unknowns, with some zeros."""

    def __init__(
        self, redundant: bool, weights: dict[int, Fraction] | None = None
    ) -> None:
        rng = np.random.default_rng(2)
        self.matrix = rng.normal(size=(6, 4)) * (rng.random((6, 4)) > 0.3)
        if redundant:
            self.matrix[4:] = rng.normal(size=(2, 4)) @ self.matrix[:4]
        self.program, self.weights = (
            Program(),
            np.array([float((weights or {}).get(k, 1)) for k in range(6)]),
        )
        places = np.argwhere(self.matrix)
        self._inputs = {
            (i, j): self.program.input(f"A[{i},{j}]") for i, j in places.tolist()
        }
        columns = {
            n: {i: x for (i, k), x in self._inputs.items() if k == j}
            for j, n in enumerate(NAMES)
        }
        self.solver = LeastSquares(self.program, columns, weights)

    def values(self, scalars: list[Scalar]) -> Floats:
        schedule = Schedule(self.program, [scalar.node for scalar in scalars])
        given = {
            x.node: np.array([self.matrix[place]]) for place, x in self._inputs.items()
        }
        return schedule.run(
            FloatArithmetic(), {n: given[n] for n in schedule.leaves}, 1
        )[:, 0]

    def constants(self, values: Floats) -> dict[int, Scalar]:
        return {
            k: self.program.constant(Fraction(v).limit_denominator(1000))
            for k, v in enumerate(values)
        }


@pytest.mark.parametrize(
    "weights", [None, {0: Fraction(4), 3: Fraction(1, 16)}], ids=["plain", "weighted"]
)
@pytest.mark.parametrize("redundant", [False, True])
def test_solutions_are_those_of_least_squares(
    redundant: bool, weights: dict[int, Fraction] | None
) -> None:
    system, root = System(redundant, weights), None
    root = np.sqrt(system.weights)
    right = np.round(np.random.default_rng(3).normal(size=6), 2)
    found = system.solver.solve(system.constants(right))
    expected = np.linalg.lstsq(root[:, None] * system.matrix, root * right, rcond=None)[
        0
    ]
    np.testing.assert_allclose(
        system.values([found[n] for n in NAMES]), expected, atol=1e-12
    )
    wanted = np.round(np.random.default_rng(4).normal(size=4), 2)
    given = dict(zip(NAMES, system.constants(wanted).values(), strict=True))
    rows = system.solver.solve_transposed(given)
    smallest = (
        root * np.linalg.lstsq((root[:, None] * system.matrix).T, wanted, rcond=None)[0]
    )
    np.testing.assert_allclose(
        system.values([rows[k] for k in range(6)]), smallest, atol=1e-12
    )


def test_inverse_square_and_pivots() -> None:
    system, units = System(False), {"b": Fraction(2)}
    singular = np.linalg.svd(system.matrix * [1, 2, 1, 1], compute_uv=False)
    (found,) = system.values([system.solver.inverse_square(units)])
    assert found == pytest.approx(np.sum(singular**-2.0), rel=1e-10)
    pivots = system.values(list(system.solver.pivots.values()))
    sizes = np.prod((system.matrix**2).sum(axis=0))
    assert np.prod(pivots) * sizes == pytest.approx(
        np.linalg.det(system.matrix.T @ system.matrix), rel=1e-10
    )


def test_what_redundant_rows_determine() -> None:
    """A form in y is the same for all solutions of Aᵀ y = c where it lies in the span of A."""
    system = System(True)
    inside = system.constants(np.round(system.matrix @ [1, -2, 1, 3], 3))
    outside = system.constants(np.round(np.linalg.svd(system.matrix)[0][:, 5], 3))
    shares = system.values([system.solver.share(inside), system.solver.share(outside)])
    np.testing.assert_allclose(shares, [1.0, 0.0], atol=1e-4)


def test_columns_without_a_common_row_cost_nothing() -> None:
    program = Program()
    x = [program.input(f"x{k}") for k in range(6)]
    blocks = {"a": {0: x[0], 1: x[1]}, "b": {2: x[2], 3: x[3]}}
    solver = LeastSquares(program, blocks)
    found = solver.solve({0: x[4], 2: x[5]})
    inputs = {
        program.inputs[n].name
        for n in program.needed([found["a"].node])
        if n in program.inputs
    }
    assert inputs == {"x0", "x1", "x4"}
