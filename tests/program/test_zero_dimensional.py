"""Polynomial systems against solutions they were built from, and against what geometry says of their number."""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce
from itertools import product
from typing import TypeAlias

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from echelon.exact.field import PrimeField, Residues
from echelon.program.zero_dimensional import Solutions, Solver
from support.strategies import SMALL_FIELD

PRIMES = (SMALL_FIELD, PrimeField.random(np.random.default_rng(3)), PrimeField.of(1000151))
every_field = pytest.mark.parametrize("field", PRIMES, ids=lambda field: str(field.p))
seeds = st.integers(0, 2**32 - 1)
SAMPLES = 12

Poly: TypeAlias = dict[tuple[int, ...], Residues]
System: TypeAlias = list[Poly]


def solve(equations: Sequence[Poly], field: PrimeField, monomial_limit: int = 1500) -> Solutions:
    return Solver(monomial_limit).solve(equations, field)


class Ring:
    """Polynomials whose coefficients are arrays, one element per sample."""

    def __init__(self, field: PrimeField, variables: int, samples: int, seed: int = 0) -> None:
        self.field, self.variables, self.samples = field, variables, samples
        self.rng = np.random.default_rng([seed, field.p, variables])

    def constant(self, value: Residues | int) -> Poly:
        return {(0,) * self.variables: np.broadcast_to(value, (self.samples,)) % self.field.p}

    def variable(self, i: int) -> Poly:
        return {tuple(int(i == j) for j in range(self.variables)): np.ones(self.samples, dtype=np.int64)}

    def random(self) -> Residues:
        return self.field.draw(self.rng, (self.samples,))

    def add(self, *terms: Poly) -> Poly:
        total: Poly = {}
        for key, value in (item for term in terms for item in term.items()):
            total[key] = (total.get(key, 0) + value) % self.field.p
        return total

    def times(self, *factors: Poly) -> Poly:
        return reduce(self._times, factors)

    def _times(self, a: Poly, b: Poly) -> Poly:
        pairs = product(a.items(), b.items())
        return self.add(*({tuple(map(sum, zip(k, m, strict=True))): v * w % self.field.p} for (k, v), (m, w) in pairs))

    def scaled(self, value: Residues | int, polynomial: Poly) -> Poly:
        return self.times(self.constant(value), polynomial)

    def value(self, polynomial: Poly, point: Sequence[Residues]) -> Residues:
        total = np.zeros(self.samples, dtype=np.int64)
        for key, value in polynomial.items():
            for i, exponent in enumerate(key):
                for _ in range(exponent):
                    value = value * point[i] % self.field.p
            total = (total + value) % self.field.p
        return total

    def through(self, polynomial: Poly, point: Sequence[Residues]) -> Poly:
        """The polynomial, with the constant that makes it vanish at a point."""
        return self.add(polynomial, self.constant(-self.value(polynomial, point)))

    def linear(self, indices: Sequence[int]) -> Poly:
        return self.add(*(self.scaled(self.random(), self.variable(i)) for i in indices))

    def circles(self, count: int) -> System:
        squares = [self.times(self.variable(i), self.variable(i)) for i in range(2 * count)]
        return [self.add(squares[2 * k], squares[2 * k + 1], self.constant(-1)) for k in range(count)]

    def angles(self, count: int) -> list[Residues]:
        return [x for _ in range(count) for x in self.field.circle(self.random())]


def dyad(ring: Ring, target: Sequence[Residues] | None = None) -> tuple[System, list[Residues]]:
    """Two links of random lengths in a plane that reach a target, by default one within reach."""
    lengths, point = (ring.random(), ring.random()), ring.angles(2)
    sums = [ring.add(*(ring.scaled(lengths[k], ring.variable(2 * k + i)) for k in range(2))) for i in range(2)]
    if target is None:
        reach = [ring.through(polynomial, point) for polynomial in sums]
    else:
        reach = [ring.add(polynomial, ring.constant(-x)) for polynomial, x in zip(sums, target, strict=True)]
    return [*reach, *ring.circles(2)], point


def slider(ring: Ring) -> tuple[System, list[Residues]]:
    """A revolute and a prismatic joint in a plane: c, s and d."""
    c, s, d = (ring.variable(i) for i in range(3))
    offset, point = ring.random(), [*ring.angles(1), ring.random()]
    x = ring.add(ring.times(c, d), ring.scaled(-offset, s))
    y = ring.add(ring.times(s, d), ring.scaled(offset, c))
    return [ring.through(x, point), ring.through(y, point), *ring.circles(1)], point


def leg(ring: Ring, joints: int, prismatic: bool) -> tuple[System, list[Residues]]:
    """A spatial chain of revolute joints, and maybe a prismatic one, whose tip reaches a point."""
    position = [ring.constant(ring.random()) for _ in range(3)]
    if prismatic:
        d = ring.variable(2 * joints)
        position = [ring.add(x, ring.scaled(ring.random(), d)) for x in position]
    for k in reversed(range(joints)):
        position = [ring.add(*terms) for terms in zip(rotated(ring, k, position), offset(ring), strict=True)]
    point = ring.angles(joints) + ([ring.random()] if prismatic else [])
    return [*(ring.through(x, point) for x in position), *ring.circles(joints)], point


def offset(ring: Ring) -> System:
    return [ring.constant(ring.random()) for _ in range(3)]


def rotated(ring: Ring, k: int, vector: System) -> System:
    """A vector turned about a random axis by the angle whose cosine and sine are the k-th pair of variables."""
    return apply(ring, rotation(ring, k), vector)


def rotation(ring: Ring, k: int) -> list[System]:
    c, s = ring.variable(2 * k), ring.variable(2 * k + 1)
    axis = ring.field.sphere(ring.field.draw(ring.rng, (2, ring.samples)))
    x, y, z = axis
    cross = np.array([[0 * x, -z, y], [z, 0 * x, -x], [-y, x, 0 * x]])
    versine = ring.add(ring.constant(1), ring.scaled(-1, c))
    return [
        [
            ring.add(
                ring.scaled(axis[i] * axis[j] % ring.field.p, versine),
                ring.scaled(cross[i, j], s),
                ring.scaled(int(i == j), c),
            )
            for j in range(3)
        ]
        for i in range(3)
    ]


def apply(ring: Ring, matrix: list[System], vector: System) -> System:
    return [ring.add(*(ring.times(a, x) for a, x in zip(row, vector, strict=True))) for row in matrix]


def wrist(ring: Ring) -> tuple[System, list[Residues]]:
    """Three intersecting axes that reach an orientation, with all nine entries as equations."""
    first, second, third = (rotation(ring, k) for k in range(3))
    columns = [[row[j] for row in third] for j in range(3)]
    entries = [x for column in columns for x in apply(ring, first, apply(ring, second, column))]
    point = ring.angles(3)
    return [*(ring.through(x, point) for x in entries), *ring.circles(3)], point


CASES = {
    "dyad": (4, dyad),
    "slider": (3, slider),
    "universal and prismatic": (5, lambda ring: leg(ring, 2, True)),
    "three revolutes": (6, lambda ring: leg(ring, 3, False)),
    "spherical wrist": (6, wrist),
}
every_case = pytest.mark.parametrize(("variables", "build"), CASES.values(), ids=CASES.keys())


# other solutions than the planted one may lie outside GF(p)
COUNTS = {dyad: {2}, slider: {2}, wrist: {2}}


def as_set(points: Residues) -> set[tuple[int, ...]]:
    return {tuple(map(int, point)) for point in points}


@every_field
@every_case
def test_planted_solutions_are_found_and_all_are_solutions(field, variables, build):
    ring = Ring(field, variables, SAMPLES)
    system, point = build(ring)
    solutions = solve(system, field)
    assert set(solutions.counts.tolist()) <= COUNTS.get(build, {1, 2, 3, 4})
    assert [len(points) for points in solutions.points] == solutions.counts.tolist()
    for k, points in enumerate(solutions.points):
        assert tuple(int(x[k]) for x in point) in as_set(points)
        assert len(as_set(points)) == len(points)
        for candidate in points:
            everywhere = np.broadcast_to(candidate[:, None], (variables, SAMPLES))
            assert not any(ring.value(equation, everywhere)[k] for equation in system)


@every_case
def test_samples_do_not_influence_each_other(variables, build):
    system, _ = build(Ring(SMALL_FIELD, variables, SAMPLES))
    together = solve(system, SMALL_FIELD)
    for k in range(3):
        single = solve([{key: c[k : k + 1] for key, c in terms.items()} for terms in system], SMALL_FIELD)
        assert single.counts[0] == together.counts[k]
        assert as_set(single.points[0]) == as_set(together.points[k])


@every_field
def test_a_target_is_within_reach_of_a_dyad_or_not(field):
    """Two circles meet in GF(p) where the discriminant of their distance is a square."""
    ring = Ring(field, 4, 200)
    target = (ring.random(), ring.random())
    system, _ = dyad(ring, target)
    first, second = system[0][1, 0, 0, 0], system[0][0, 0, 1, 0]
    counts = []
    for x, y, a, b in zip(*(values.tolist() for values in (*target, first, second)), strict=True):
        square = x * x + y * y
        discriminant = (4 * a * a * square - (square + a * a - b * b) ** 2) % field.p
        counts.append(2 if pow(discriminant, (field.p - 1) // 2, field.p) == 1 else 0)
    assert solve(system, field).counts.tolist() == counts
    assert 60 < sum(counts) / 2 < 140


@given(seeds, st.integers(1, 3), st.lists(st.integers(1, 3), min_size=3, max_size=3))
@settings(max_examples=40, deadline=None)
def test_grids_of_points_are_found_in_full(seed, variables, sizes):
    """Products of parallel planes in random directions; repeated planes make multiple points."""
    ring = Ring(SMALL_FIELD, variables, 2, seed)
    directions = SMALL_FIELD.draw(ring.rng, (variables, variables))
    offsets = [ring.rng.integers(0, 3, size) for size in sizes[:variables]]
    forms = [
        ring.add(*(ring.scaled(int(x), ring.variable(i)) for i, x in enumerate(direction))) for direction in directions
    ]
    system = [
        ring.times(*(ring.add(form, ring.constant(-int(value))) for value in values))
        for form, values in zip(forms, offsets, strict=True)
    ]
    solutions = solve(system, SMALL_FIELD)
    expected = set(product(*({int(v) for v in values} for values in offsets)))
    for points in solutions.points:
        images = [tuple(int(x) for x in (directions.astype(object) @ point) % SMALL_FIELD.p) for point in points]
        assert len(images) == len(expected)
        assert set(images) == expected


def test_a_multiple_point_with_many_tangents():
    ring = Ring(SMALL_FIELD, 2, 2)
    x, y = (ring.add(ring.variable(i), ring.constant(-value)) for i, value in enumerate((5, 7)))
    solutions = solve([ring.times(x, x), ring.times(x, y), ring.times(y, y, y)], SMALL_FIELD)
    assert [points.tolist() for points in solutions.points] == [[[5, 7]], [[5, 7]]]


@every_case
def test_redundant_equations_change_nothing(variables, build):
    ring = Ring(SMALL_FIELD, variables, 3)
    system, _ = build(ring)
    mixture = ring.add(*(ring.scaled(ring.random(), equation) for equation in system))
    surplus = [system[0], {}, ring.scaled(0, system[0]), mixture, ring.times(mixture, ring.variable(0))]
    plain, redundant = (solve(equations, SMALL_FIELD) for equations in (system, surplus + system))
    assert list(map(as_set, plain.points)) == list(map(as_set, redundant.points))


@every_case
def test_a_contradiction_has_no_solutions(variables, build):
    ring = Ring(SMALL_FIELD, variables, 3)
    system, _ = build(ring)
    for extra in (ring.linear(range(variables)), ring.constant(1), ring.add(system[0], ring.constant(1))):
        solutions = solve([*system, extra], SMALL_FIELD)
        assert solutions.counts.tolist() == [0, 0, 0]
        assert [points.shape for points in solutions.points] == [(0, variables)] * 3


@pytest.mark.parametrize("variables", [4, 5, 6])
def test_infinitely_many_solutions_are_marked(variables):
    ring = Ring(SMALL_FIELD, variables, 2)
    circles = ring.circles(variables // 2)
    for system in (circles, [ring.scaled(0, circles[0])]):
        assert solve(system, SMALL_FIELD, monomial_limit=300).counts.tolist() == [-1, -1]


def test_too_small_a_limit_is_marked():
    system, _ = dyad(Ring(SMALL_FIELD, 4, 1))
    assert solve(system, SMALL_FIELD, monomial_limit=10).counts.tolist() == [-1]


def altered(system: System, sample: int, changes: dict[tuple[int, tuple[int, ...]], int]) -> System:
    """The system with some coefficients of one sample replaced."""
    result = [{key: values.copy() for key, values in terms.items()} for terms in system]
    for (equation, key), value in changes.items():
        result[equation][key][sample] = value
    return result


ONE, C1, S1, C2, S2 = (0, 0, 0, 0), (1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)


@pytest.mark.parametrize("sample", [0, 4])
def test_special_samples_are_solved_by_themselves(sample):
    """One sample has its target on the first axis, straight ahead: two solutions coincide."""
    system, _ = dyad(Ring(SMALL_FIELD, 4, SAMPLES))
    changes = {(0, C1): 2, (1, S1): 2, (0, C2): 3, (1, S2): 3, (0, ONE): -5, (1, ONE): 0}
    solutions = solve(altered(system, sample, changes), SMALL_FIELD)
    assert solutions.points[sample].tolist() == [[1, 0, 1, 0]]
    assert np.delete(solutions.counts, sample).tolist() == [2] * (SAMPLES - 1)


def test_a_special_sample_that_cannot_be_solved_is_marked():
    """The second link of one sample has no length, so that its angle does not matter."""
    system, _ = dyad(Ring(SMALL_FIELD, 4, SAMPLES))
    changes = {(0, C1): 2, (1, S1): 2, (0, C2): 0, (1, S2): 0, (0, ONE): -2, (1, ONE): 0}
    for sample in (0, 4):
        solutions = solve(altered(system, sample, changes), SMALL_FIELD)
        assert solutions.counts[sample] == -1
        assert solutions.points[sample].shape == (0, 4)
        assert np.delete(solutions.counts, sample).tolist() == [2] * (SAMPLES - 1)


def test_samples_of_different_kinds():
    """Contradictory, simple and multiple solutions side by side: a line that meets a circle, or touches it."""
    ones = np.ones(4, dtype=np.int64)
    circle = {(2, 0): ones, (0, 2): ones, (0, 0): -ones}
    line = {(1, 0): np.array([0, 1, 0, 3]), (0, 1): np.array([0, 0, 1, 0]), (0, 0): np.array([1, 0, -1, 0])}
    solutions = solve([circle, line], SMALL_FIELD)
    last = SMALL_FIELD.p - 1
    assert [as_set(points) for points in solutions.points] == [
        set(),
        {(0, 1), (0, last)},
        {(0, 1)},
        {(0, 1), (0, last)},
    ]


@every_case
def test_a_solver_repeats_itself_with_other_coefficients_and_primes(variables, build, monkeypatch):
    solver = Solver()
    solver.solve(build(Ring(SMALL_FIELD, variables, 2))[0], SMALL_FIELD)
    systems = [(build(Ring(field, variables, SAMPLES, 5))[0], field) for field in PRIMES]
    expected = [solve(system, field) for system, field in systems]
    monkeypatch.setattr("echelon.program.zero_dimensional._explore", None)
    for (system, field), solutions in zip(systems, expected, strict=True):
        assert list(map(as_set, solver.solve(system, field).points)) == list(map(as_set, solutions.points))


def test_a_solver_explores_again_where_needed():
    """What it remembers is that of most samples, also if it has met a special one first."""
    system, _ = dyad(Ring(SMALL_FIELD, 4, SAMPLES))
    changes = {(0, C1): 2, (1, S1): 2, (0, C2): 3, (1, S2): 3, (0, ONE): -5, (1, ONE): 0}
    solver = Solver()
    for sample in (0, 0, 4):
        solutions = solver.solve(altered(system, sample, changes), SMALL_FIELD)
        assert solutions.points[sample].tolist() == [[1, 0, 1, 0]]
        assert np.delete(solutions.counts, sample).tolist() == [2] * (SAMPLES - 1)
    contradiction = [*system, {ONE: np.ones(SAMPLES, dtype=np.int64)}]
    assert solver.solve(contradiction, SMALL_FIELD).counts.tolist() == [0] * SAMPLES


def conic_with_line(slope: Residues) -> System:
    """Parabola and line through (0, 0), which meet a second time at x = slope."""
    ones = np.ones(len(slope), dtype=np.int64)
    return [{(2, 0): ones, (0, 1): -ones}, {(0, 1): ones, (1, 0): -slope}]


def test_a_solver_does_not_take_special_samples_for_regular_ones():
    solver = Solver()
    solver.solve(conic_with_line(np.array([3, 5])), SMALL_FIELD)
    solutions = solver.solve(conic_with_line(np.array([4, 0, 7, 0])), SMALL_FIELD)
    assert list(map(as_set, solutions.points)) == [{(0, 0), (4, 16)}, {(0, 0)}, {(0, 0), (7, 49)}, {(0, 0)}]


@pytest.mark.parametrize("roots", [[], [0], [3], [2, 2], [1, 5], [4, 4, 4], [1, 1, 2], [1, 2, 3, 3], [1, 2, 3, 4, 5]])
@pytest.mark.parametrize("irreducible", [0, 1, 2])
@every_field
def test_roots_of_one_polynomial(roots, irreducible, field):
    """Distinct ones are found, whatever their multiplicity; x² + k² has none."""
    ring = Ring(field, 1, 2)
    factors = [ring.add(ring.variable(0), ring.constant(-root)) for root in roots]
    factors += [ring.add({(2,): np.ones(2, dtype=np.int64)}, ring.constant(k * k)) for k in range(1, irreducible + 1)]
    if factors:
        solutions = solve([ring.times(ring.constant(3), *factors)], field)
        assert [sorted(points[:, 0].tolist()) for points in solutions.points] == [sorted(set(roots))] * 2


def test_large_batches_are_solved_in_parts(monkeypatch):
    system, _ = dyad(Ring(SMALL_FIELD, 4, SAMPLES))
    whole = solve(system, SMALL_FIELD)
    monkeypatch.setattr("echelon.program.zero_dimensional._ENTRIES", 1000)
    parts = solve(system, SMALL_FIELD)
    assert list(map(as_set, whole.points)) == list(map(as_set, parts.points))


def test_no_samples():
    nothing = np.zeros(0, dtype=np.int64)
    solutions = solve([{(1,): nothing}], SMALL_FIELD)
    assert solutions.counts.shape == (0,)
    assert solutions.points == []
