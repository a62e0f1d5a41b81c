"""The cone programme of a physically consistent fit.

A modelling language compiles a programme before it is solved: for a humanoid with R as a parameter that takes minutes,
and without parameters as long as a solution, each time.  The blocks here are few and regular (ten numbers per body), so
they are written down as sparse rows at once and given to Clarabel, an interior-point method.

Unknown are, for every body, the ten parameters of K = L⁻¹ J L⁻ᵀ where L Lᵀ is the reference body's pseudo-inertia.  In
these variables the reference is the identity for a gripper of grams and for a torso of tons, so that solvers meet
neither units nor light links; they fail on them otherwise.  The divergence from the reference is
tr K − log det K − 4, and log det K ≥ Σ log Zᵢᵢ for a triangular Z with [[K, Z], [Zᵀ, diag Z]] ⪰ 0 (Nesterov &
Nemirovski; MOSEK Modeling Cookbook, 6.2.3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from echelon.base import BaseModel
from echelon.identification.physics.bounds import (
    Bounds,
    LinearLimits,
    Roles,
    linear_limits,
    roles,
)
from echelon.identification.physics.prior_information import (
    Reference,
    common_mass,
    reference,
)
from echelon.robot import SIZE, Parameter, factor, frame_change, margins, pseudo_inertia
from echelon.shared import PER_BODY, EchelonError, Floats, extra


def svec(matrix: Floats) -> Floats:
    """Upper triangle by columns, off-diagonal entries times √2; shape (n (n + 1)/2,)."""
    n = len(matrix)
    return np.array(
        [
            matrix[i, j] * (1.0 if i == j else np.sqrt(2))
            for j in range(n)
            for i in range(j + 1)
        ]
    )


def _order(length: int) -> int:
    """Rows of the matrix whose triangle has ``length`` entries."""
    return round((float(np.sqrt(8 * length + 1)) - 1) / 2)


SVEC = np.stack([svec(pseudo_inertia(unit)) for unit in np.eye(PER_BODY)], axis=1)
"""svec(J) = SVEC · (XX … M), shape (10, 10)."""


_CONES = ("zero", "nonnegative", "second_order", "semidefinite", "exponential")

# units of the objective that are tried one after another
_UNITS = (1.0, 1e-2, 1e-4, 1e-6, 1e2, 3.0, 0.3)
_ALMOST = "Almost"

SOLVED, INFEASIBLE, UNBOUNDED, FAILED = "solved", "infeasible", "unbounded", "failed"
_STATUSES = {
    "Solved": SOLVED,
    "PrimalInfeasible": INFEASIBLE,
    "DualInfeasible": UNBOUNDED,
}


@dataclass(frozen=True)
class ConeSolution:
    """Answer of a solver of cone programmes."""

    x: Floats  # shape (n,)
    status: str  # "solved", "infeasible", "unbounded" or "failed"
    message: str  # the solver's status
    iterations: int


@dataclass
class ConeProgram:
    """A cone programme that grows block by block."""

    size: int  # variables
    _blocks: dict[str, list[tuple[Any, Floats]]] = field(
        default_factory=lambda: {kind: [] for kind in _CONES}
    )

    def add(self, kind: str, matrix: Any, offset: Floats) -> None:
        """Require matrix · x + offset to be in a cone."""
        with extra("identify"):
            from scipy.sparse import csr_array

        if len(offset):
            self._blocks[kind].append(
                (csr_array(matrix), np.asarray(offset, dtype=float))
            )

    def solve(self, diagonal: Floats, linear: Floats) -> ConeSolution:
        """Minimise ½ Σ diagonal · x² + linearᵀ x, without a negative number in the diagonal."""
        with extra("identify"):
            import clarabel
            from scipy.sparse import csc_array, diags_array, vstack

        lengths = {
            kind: [len(offset) for _, offset in blocks]
            for kind, blocks in self._blocks.items()
        }
        cones = [clarabel.ZeroConeT(k) for k in lengths["zero"]]
        cones += [clarabel.NonnegativeConeT(k) for k in lengths["nonnegative"]]
        cones += [clarabel.SecondOrderConeT(k) for k in lengths["second_order"]]
        cones += [clarabel.PSDTriangleConeT(_order(k)) for k in lengths["semidefinite"]]
        cones += [
            clarabel.ExponentialConeT()
            for k in lengths["exponential"]
            for _ in range(k // 3)
        ]
        blocks = [block for kind in _CONES for block in self._blocks[kind]]
        rows = csc_array(vstack([-matrix for matrix, _ in blocks]))
        offsets = np.concatenate([offset for _, offset in blocks])
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        quadratic = diags_array(diagonal, format="csc")
        found = clarabel.DefaultSolver(
            quadratic, linear, rows, offsets, cones, settings
        ).solve()
        message = str(found.status)
        status = _STATUSES.get(message.removeprefix(_ALMOST), FAILED)
        return ConeSolution(
            np.array(found.x, dtype=float), status, message, found.iterations
        )


def solve_in_units(
    program: ConeProgram, diagonal: Floats, linear: Floats
) -> ConeSolution:
    """Solve; if the solver gives up without a verdict, with the objective in other units.

    Solvers stop by a mixture of relative and absolute tolerances, so the unit of the objective matters to them.
    """
    attempts = []
    for unit in _UNITS:
        attempts.append(program.solve(unit * diagonal, unit * linear))
        if attempts[-1].status != FAILED and not attempts[-1].message.startswith(
            _ALMOST
        ):
            return attempts[-1]
    almost = next((found for found in attempts if found.status != FAILED), None)
    if almost is None:
        problem = f"the solver gave up ({attempts[0].message}): check the scale of the data and of the prior"
        raise EchelonError(problem)
    return almost


_LOGS = SIZE
SMALL_FORCE = 0.1
"""Size that is expected of an offset or a spring, by what it could explain alone, where bodies could as well."""
ROUNDING = 1e-12
"""Relative error of sums of some dozen doubles; as a weight it keeps parameters at rest on which neither data nor a
prior say anything."""


@dataclass(frozen=True)
class Programme:
    """A family of fits to different data with the same constraints."""

    role: Roles
    limits: LinearLimits
    reference: Reference
    # magnitudes that data alone give to columns
    told: Mapping[int, float] = field(default_factory=dict)
    # columns that data do not tell from others, such as bodies
    shared: frozenset[int] = frozenset()

    @staticmethod
    def of(
        base: BaseModel,
        design: Floats,
        target: Floats,
        bounds: Bounds | None = None,
        prior: npt.ArrayLike | None = None,
        told: Mapping[int, float] | None = None,
        shared: frozenset[int] = frozenset(),
    ) -> Programme:
        """Fits of a robot within bounds; where there is no prior, bodies are those that explain the target best."""
        role = roles(base.mechanism)
        mass = common_mass(role, design, target)
        return Programme(
            role,
            linear_limits(role, bounds or Bounds()),
            reference(role, prior, mass),
            told or {},
            shared,
        )

    @cached_property
    def roots(self) -> Floats:
        """Factors L of the reference bodies, shape (b, 4, 4)."""
        if len(self.reference.bodies):
            return factor(self.reference.bodies)
        return np.zeros((0, SIZE, SIZE))

    @cached_property
    def others(self) -> list[int]:
        """Columns outside the pseudo-inertias."""
        return [*self.role.positive, *self.role.free]

    @cached_property
    def unwhiten(self) -> Floats:
        """Standard parameters from the unknowns: ten per body, then the others; shape (p, p)."""
        matrix = np.zeros((self.role.size, self.role.size))
        for number, (start, root) in enumerate(
            zip(self.role.starts, self.roots, strict=True)
        ):
            place = PER_BODY * number
            matrix[start : start + PER_BODY, place : place + PER_BODY] = frame_change(
                root
            )
        for number, column in enumerate(self.others, PER_BODY * len(self.roots)):
            matrix[column, number] = 1.0
        return matrix

    def fit(
        self,
        design: Floats,
        target: Floats,
        weights: Floats,
        drawing: float,
        *,
        exact: bool = False,
    ) -> tuple[Floats, ConeSolution]:
        """Minimise ‖design · ζ − target‖² + Σ weights · divergence + drawing of the others to their priors."""
        bodies, p, k = len(self.role.bodies), self.role.size, len(target)
        signed = self._signed() if exact else []
        logs = p + PER_BODY * bodies
        size = logs + _LOGS * bodies + (len(signed) if exact else k)
        program = ConeProgram(size)
        matrix = design @ self.unwhiten
        whole = np.zeros((k, size))
        whole[:, :p] = matrix
        if not exact:
            whole[:, size - k :] = -np.eye(k)
        program.add("zero", whole, -target)
        self.add_limits(program)
        self._add_bodies(program, size, p, logs)
        diagonal, linear = np.zeros(size), np.zeros(size)
        for body, weight in enumerate(weights):
            # tr K = ½ (XX + YY + ZZ) + M
            linear[[PER_BODY * body + i for i in (0, 3, 5)]] = weight / 2
            linear[PER_BODY * body + 9] = weight
            linear[logs + _LOGS * body : logs + _LOGS * (body + 1)] = -weight
        if exact:
            self._keep_inside(program, linear, signed, size)
        else:
            diagonal[size - k :] = 2.0
        self._draw(diagonal, linear, matrix, target, drawing)
        found = solve_in_units(program, diagonal, linear)
        return self.unwhiten @ found.x[:p], found

    def _signed(self) -> list[tuple[int, float]]:
        """Unknowns that only must not be negative, with their sizes."""
        rows = self.limits.least
        alone = (
            (np.count_nonzero(rows[:, :-1], axis=1) == 1)
            & (rows[:, -1] == 0)
            & (rows[:, :-1].max(axis=1) > 0)
        )
        columns = {int(np.argmax(row[:-1])) for row in rows[alone]}
        first, found = PER_BODY * len(self.role.bodies), []
        for place, column in enumerate(self.others, first):
            if column in columns:
                prior = self.reference.values[column]
                size = (
                    prior
                    if np.isfinite(prior) and prior > 0
                    else self._size(self.role.mechanism.columns[column])
                )
                found.append((place, float(size)))
        return found

    def _size(self, parameter: Parameter) -> float:
        """Size of a parameter outside the bodies: an inertia or a mass as a body's, else 1."""
        if not len(self.reference.bodies):
            return 1.0
        masses = self.reference.bodies[:, 9]
        inertias = self.reference.bodies[:, [0, 3, 5]].mean(axis=1)
        return float(
            {"kg": masses, "kg·m²": inertias}.get(parameter.unit, np.ones(1)).mean()
        )

    def _keep_inside(
        self,
        program: ConeProgram,
        linear: Floats,
        signed: list[tuple[int, float]],
        size: int,
    ) -> None:
        """log(x/x₀) ≥ u for each signed unknown, with the last variables for u."""
        for number, (place, scale) in enumerate(signed):
            u = size - len(signed) + number
            rows = np.zeros((3, size))
            rows[0, u], rows[2, place] = 1.0, 1 / scale
            program.add("exponential", rows, np.array([0.0, 1.0, 0.0]))
            linear[place] += 1 / scale
            linear[u] = -1.0

    def _draw(
        self,
        diagonal: Floats,
        linear: Floats,
        matrix: Floats,
        target: Floats,
        drawing: float,
    ) -> None:
        """Quadratic drawing of the parameters outside the bodies, and rest for what nothing determines.

        What bodies may explain as well, they explain: an offset that could be the weight of a slide is drawn to zero.
        """
        first = PER_BODY * len(self.role.bodies)
        for number, column in enumerate(self.others, first):
            square = float(matrix[:, number] @ matrix[:, number])
            diagonal[number] = 2 * max(ROUNDING * square, ROUNDING)
            alone = abs(float(matrix[:, number] @ target)) / max(square, ROUNDING)
            if column in self.shared and column in self.role.free and alone > 0:
                diagonal[number] += 2 * drawing / (SMALL_FORCE * alone) ** 2
            prior = self.reference.values[column]
            if np.isfinite(prior) and prior != 0:
                # a damping that a file states for a simulation may be a thousandth of what the data show
                square = max(abs(prior), self.told.get(column, 0.0)) ** 2
                diagonal[number] += 2 * drawing / square
                linear[number] -= 2 * drawing * prior / square

    def add_limits(self, program: ConeProgram, slack: int | None = None) -> None:
        """Signs and bounds, rows scaled to a largest entry of 1; inequalities leave as much room as a variable says."""
        p = self.role.size
        for kind, rows in (
            ("zero", self.limits.equal),
            ("nonnegative", self.limits.least),
        ):
            moved = np.zeros((len(rows), program.size))
            moved[:, :p] = rows[:, :p] @ self.unwhiten
            scale = np.maximum(np.abs(moved).max(axis=1, initial=0.0), 1e-300)
            moved /= scale[:, None]
            if slack is not None and kind == "nonnegative":
                moved[:, slack] = -1.0
            program.add(kind, moved, rows[:, p] / scale)
        for cone in self.limits.cones:
            moved = np.zeros((len(cone), program.size))
            moved[:, :p] = cone @ self.unwhiten
            moved /= np.abs(moved).max()
            if slack is not None:
                moved[0, slack] = -1.0
            program.add("second_order", moved, np.zeros(len(cone)))

    def _add_bodies(
        self, program: ConeProgram, size: int, triangles: int, logs: int
    ) -> None:
        """log det K ≥ Σ u for every body, by a triangle Z of ten numbers and four logarithms u."""
        with extra("identify"):
            from scipy.sparse import coo_array

        for body in range(len(self.role.bodies)):
            k, z, u = PER_BODY * body, triangles + PER_BODY * body, logs + _LOGS * body
            rows, columns, values = _determinant_block(k, z)
            program.add(
                "semidefinite",
                coo_array((values, (rows, columns)), shape=(36, size)),
                np.zeros(36),
            )
            exponential = coo_array(
                (
                    np.ones(2 * SIZE),
                    (
                        [*range(0, 12, 3), *range(2, 12, 3)],
                        [*range(u, u + 4), *_diagonal_of_z(z)],
                    ),
                ),
                shape=(12, size),
            )
            program.add("exponential", exponential, np.tile([0.0, 1.0, 0.0], SIZE))

    def margins(self, values: Floats) -> Floats:
        """Smallest eigenvalue of every K, shape (b,)."""
        if not self.role.bodies:
            return np.zeros(0)
        return margins(self.role.blocks(values), self.reference.bodies)


def _grid(rows: int, first: int) -> tuple[Any, Any]:
    return np.repeat(np.arange(rows), PER_BODY), np.tile(
        np.arange(first, first + PER_BODY), rows
    )


def _diagonal_of_z(z: int) -> list[int]:
    """Z's entries are stored by rows of its lower triangle."""
    return [z + i * (i + 1) // 2 + i for i in range(SIZE)]


def _determinant_block(k: int, z: int) -> tuple[Any, Any, Any]:
    """svec of [[K, Z], [Zᵀ, diag Z]] in the ten parameters of K from column k and the ten entries of Z from z."""
    first_rows, first_columns = _grid(PER_BODY, k)
    rows, columns, values = [*first_rows], [*first_columns], [*SVEC.ravel()]
    for i in range(SIZE):
        for j in range(i + 1):
            upper = SIZE + j  # Z[i, j] stands in row i, column 4 + j
            rows.append(upper * (upper + 1) // 2 + i)
            columns.append(z + i * (i + 1) // 2 + j)
            values.append(np.sqrt(2))
        corner = SIZE + i
        rows.append(corner * (corner + 1) // 2 + corner)
        columns.append(z + i * (i + 1) // 2 + i)
        values.append(1.0)
    return rows, columns, values
