"""Random models with signs whose rank is known from their construction, exactly and without any search.

All surfaces but those of cosines are affine, so every region has a corner: a point where as many surfaces meet as there
are variables (far walls close the unbounded ones).  At a corner the other surfaces have a known sign, and those that
meet there take every combination.  So all regions follow from exact linear algebra.  A column is a combination of
independent functions in every region, so the rank is that of the matrix of its coefficients.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from flint import fmpq, fmpq_mat

FAR = 10**9
FUNCTIONS = ("1", "x0", "x1", "x2", "x0**2", "sin(x0)", "exp(x0/7)", "x0*z")
_OF_EVERY_MODEL = (0, 1, 4, 5, 6, 7)


@dataclass(frozen=True)
class _Term:
    """factor · function · Π sign · Π (1 ± sign), by numbers of functions and surfaces."""

    factor: int
    function: int
    signs: tuple[int, ...] = ()
    corner: tuple[tuple[int, int], ...] = ()

    def values(self, cell: tuple[int, ...]) -> dict[int, Fraction]:
        """The coefficients of functions in a region."""
        sides = [1 + side * cell[k] for k, side in self.corner]
        return {
            self.function: Fraction(
                self.factor * math.prod(cell[k] for k in self.signs) * math.prod(sides)
            )
        }

    def text(self, surfaces: list[str]) -> str:
        factors = [f"sign({surfaces[k]})" for k in self.signs]
        factors += [f"(1 + ({side})*sign({surfaces[k]}))" for k, side in self.corner]
        return "*".join([f"({self.factor})", FUNCTIONS[self.function], *factors])


@dataclass(frozen=True)
class SignModel:
    """A model with one output, and its rank."""

    columns: tuple[str, ...]
    variables: tuple[str, ...]
    regions: int
    rank: int


@dataclass(frozen=True)
class _Affine:
    """normal · x + offset."""

    normal: tuple[int, ...]
    offset: Fraction

    def __str__(self) -> str:
        terms = [f"({a})*x{k}" for k, a in enumerate(self.normal) if a]
        return (
            f"{' + '.join(terms)} + ({self.offset.numerator}/{self.offset.denominator})"
        )


@dataclass(frozen=True)
class _Stop:
    """max(0, surface), by number and as the affine function that it is."""

    surface: int
    affine: _Affine

    def values(self, cell: tuple[int, ...]) -> dict[int, Fraction]:
        """The coefficients of functions in a region."""
        if cell[self.surface] < 0:
            return {}
        return {
            0: self.affine.offset,
            **{1 + k: Fraction(a) for k, a in enumerate(self.affine.normal)},
        }

    def text(self, surfaces: list[str]) -> str:
        return f"max(0, {surfaces[self.surface]})"


def sign_model(seed: int) -> SignModel:
    """A random model: affine signs, dead zones and stops of all magnitudes, narrow peaks of cosines."""
    rng = np.random.default_rng(seed)
    while True:
        variables = int(rng.integers(1, 4))
        affine = _affine_surfaces(rng, variables, int(rng.integers(1, 5)))
        regions = _regions(affine, variables)
        if regions is not None:
            break
    peaks = int(rng.integers(0, 2))
    texts = [*map(str, affine), *(_peak(rng, k) for k in range(peaks))]
    cells = [
        (*cell, *peak)
        for cell in sorted(regions)
        for peak in itertools.product((-1, 1), repeat=peaks)
    ]
    columns = _columns(rng, affine, len(texts))
    names = (
        *(f"x{k}" for k in range(variables)),
        *(f"y{k}" for k in range(peaks)),
        "z",
    )
    written = tuple(
        " + ".join(term.text(texts) for term in column) for column in columns
    )
    return SignModel(written, names, len(cells), _rank(columns, cells))


def _affine_surfaces(
    rng: np.random.Generator, variables: int, count: int
) -> list[_Affine]:
    found: list[_Affine] = []
    while len(found) < count:
        normal = [0] * variables
        for k in rng.choice(
            variables, int(rng.integers(1, variables + 1)), replace=False
        ):
            normal[k] = int(rng.choice([-2, -1, 1, 3]))
        offset = Fraction(int(rng.integers(1, 1000)), 1000) * Fraction(10) ** int(
            rng.integers(-3, 5)
        )
        found.append(_Affine(tuple(normal), -offset))
        if rng.random() < 0.4:  # a dead zone
            found.append(_Affine(tuple(normal), offset))
    return found


def _peak(rng: np.random.Generator, k: int) -> str:
    return f"cos(y{k}) - (1 - {10.0 ** -int(rng.integers(1, 5)):.4f})"


def _regions(surfaces: list[_Affine], variables: int) -> set[tuple[int, ...]] | None:
    """Sign vectors of all regions; None if more surfaces meet at a corner than there are variables."""
    walls = [
        _Affine(
            tuple(side if j == k else 0 for j in range(variables)),
            Fraction(FAR + 7 * k),
        )
        for k in range(variables)
        for side in (-1, 1)
    ]
    every = [*surfaces, *walls]
    found: set[tuple[int, ...]] = set()
    for meeting in itertools.combinations(range(len(every)), variables):
        corner = _corner([every[k] for k in meeting])
        if corner is None:
            continue
        values = [
            sum(a * x for a, x in zip(s.normal, corner, strict=True)) + s.offset
            for s in every
        ]
        others = [k for k in range(len(every)) if k not in meeting]
        if any(values[k] == 0 for k in others):
            return None
        if any(values[k] < 0 for k in others if k >= len(surfaces)):
            continue
        for signs in itertools.product((-1, 1), repeat=variables):
            here = dict(zip(meeting, signs, strict=True))
            if all(here.get(k, 1) > 0 for k in range(len(surfaces), len(every))):
                found.add(
                    tuple(
                        here.get(k, 1 if values[k] > 0 else -1)
                        for k in range(len(surfaces))
                    )
                )
    return found


def _corner(meeting: list[_Affine]) -> list[Fraction] | None:
    matrix = fmpq_mat([[fmpq(a) for a in s.normal] for s in meeting])
    if matrix.det() == 0:
        return None
    right = fmpq_mat(
        [[fmpq(-s.offset.numerator, s.offset.denominator)] for s in meeting]
    )
    return [Fraction(int(x.p), int(x.q)) for x in matrix.solve(right).entries()]


def _columns(
    rng: np.random.Generator, affine: list[_Affine], surfaces: int
) -> list[list[_Term | _Stop]]:
    """Columns, some of which differ from combinations of others in a corner of the space only."""
    columns: list[list[_Term | _Stop]] = [
        [_term(rng, surfaces) for _ in range(rng.integers(1, 3))]
        for _ in range(rng.integers(2, 6))
    ]
    stops = rng.choice(
        len(affine), int(rng.integers(0, len(affine) + 1)), replace=False
    )
    columns += [[_Stop(int(k), affine[k])] for k in stops]
    for _ in range(int(rng.integers(1, 4))):
        chosen = [t for k in rng.choice(len(columns), 2) for t in columns[k]]
        columns.append(
            [*chosen, _in_a_corner(rng, surfaces)] if rng.random() < 0.5 else chosen
        )
    return columns


def _term(rng: np.random.Generator, surfaces: int) -> _Term:
    signs = rng.choice(
        surfaces, int(rng.integers(0, min(3, surfaces) + 1)), replace=False
    )
    return _Term(
        int(rng.choice([-2, -1, 1, 2])),
        int(rng.choice(_OF_EVERY_MODEL)),
        tuple(sorted(map(int, signs))),
    )


def _in_a_corner(rng: np.random.Generator, surfaces: int) -> _Term:
    """A function that is there on one side of some surfaces only."""
    chosen = rng.choice(surfaces, int(rng.integers(1, surfaces + 1)), replace=False)
    corner = tuple((int(k), int(rng.choice([-1, 1]))) for k in chosen)
    return _Term(1, int(rng.choice(_OF_EVERY_MODEL)), (), corner)


def _rank(columns: list[list[_Term | _Stop]], cells: list[tuple[int, ...]]) -> int:
    table = [[Fraction(0)] * len(columns) for _ in range(len(cells) * len(FUNCTIONS))]
    for c, column in enumerate(columns):
        for term in column:
            for r, cell in enumerate(cells):
                for function, value in term.values(cell).items():
                    table[r * len(FUNCTIONS) + function][c] += value
    return int(
        fmpq_mat(
            [[fmpq(x.numerator, x.denominator) for x in row] for row in table]
        ).rank()
    )
