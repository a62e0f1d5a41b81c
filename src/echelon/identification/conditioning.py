"""What the data at hand show of the parameters that the sensors could see.

Base parameters can all be identified from some motion: a direction that stays open is the fault of the data.  Which
ones do is read from the singular vectors of the R-factor with columns of norm 1, where parameters of different units
compare by what they contribute to the outputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.identification.motion_advice import advice
from echelon.observe.observation import Observation
from echelon.observe.triangle import Triangle

if TYPE_CHECKING:
    from echelon.base.model import BaseModel

WEAK = 1e-2
"""Singular value, relative to the largest, below which a direction is weak: exciting trajectories are customarily asked
for a condition number below 100, and condition indices from 30 to 100 on are harmful collinearity (Belsley, Kuh and
Welsch, "Regression diagnostics", 1980)."""

ROUNDING = 1.5e-8
"""Norm of a column, relative to the largest of its unit, below which it is no more than rounding: half of the digits
of a double, and more than any sensor has."""

_SHARE = 0.1  # shares below this part of the largest are left out of a direction
_INVOLVED = 1e-6  # share in an open direction from which on a parameter counts as open itself


@dataclass(frozen=True)
class Direction:
    """A combination of base parameters that the data hardly show.

    Attributes
    ----------
    singular_value : float
        Of the weighted observation matrix with columns of norm 1, relative to the largest.
    weights : mapping-like tuple of (str, float)
        Parameters with their shares in the combination, largest first, small ones left out.
    advice : str
        How to excite it, in a sentence.
    """

    singular_value: float
    weights: tuple[tuple[str, float], ...]
    advice: str


@dataclass(frozen=True)
class Conditioning:
    """Conditioning of a set of data.

    Attributes
    ----------
    condition, scaled_condition : float
        Condition number of the weighted observation matrix, and with columns of norm 1.
    singular_values : array of shape (n,)
        Of the scaled matrix, descending.
    rank : int
        Directions that the data determine at all.
    independent_share : array of shape (n,)
        For each parameter 1/√(VIF): the share of its column that no other column explains, 0 to 1.
    weak : tuple of Direction
        Combinations that the data leave open, or nearly so, weakest last.
    """

    condition: float
    scaled_condition: float
    singular_values: Floats
    rank: int
    independent_share: Floats
    weak: tuple[Direction, ...]

    @property
    def is_complete(self) -> bool:
        """Whether the data determine all base parameters."""
        return self.rank == len(self.independent_share)

    @property
    def verdict(self) -> str:
        """How good the data are, in a sentence."""
        count = len(self.independent_share)
        start = f"the data determine {self.rank} of {count} base parameters"
        condition = f"condition number with scaled columns {self.scaled_condition:.3g}"
        if not self.weak:
            return f"{start}, all of them well ({condition})"
        some = "one combination" if len(self.weak) == 1 else f"{len(self.weak)} combinations"
        state = "open" if self.rank < count else "poorly determined"
        return f"{start} and leave {some} {state} ({condition}); other motions would show them"


def conditioning(
    observation: Observation,
    weights: Sequence[float] | Floats | None = None,
    base: BaseModel | None = None,
    symbols: Mapping[str, float] | None = None,
) -> Conditioning:
    """Conditioning of data, and the combinations of parameters that they hardly show.

    A direction is weak if its singular value is below :data:`WEAK` of the largest, or if the noise leaves it so
    uncertain that the parts which its parameters contribute, and which cancel, could each be as large as all that was
    measured.
    """
    if base is not None and base.pivots != observation.layout.parameters:
        raise InputError("the base model and the observation have different parameters")
    triangle = observation.combined(weights)
    n = len(triangle.parameters)
    scaled = triangle.R / np.where(triangle.scales == 0, 1.0, triangle.scales)
    _, singular, directions = np.linalg.svd(scaled)
    rank = triangle.rank
    weak = tuple(
        Direction(
            value,
            _shares(triangle.parameters, v),
            advice(triangle.parameters, v, _unscaled(triangle, v), base, value, symbols),
        )
        for value, v in _weak(triangle, singular, directions, rank)
    )
    condition, scaled_condition = triangle.condition, triangle.scaled_condition
    if rank < n:  # to within rounding
        condition = scaled_condition = float("inf")
    return Conditioning(
        condition, scaled_condition, singular, rank, _independent_share(triangle, singular, directions), weak
    )


def without_rounding(observation: Observation, units: Sequence[str]) -> Observation:
    """The same data with zeros in columns of which only the rounding is left.

    With columns of norm 1, the cosine of a joint that rests at 90° would look as good as any other.  Columns of equal
    units compare; no sensor tells apart what differs as much as :data:`ROUNDING`.
    """
    norms = observation.combined().scales
    largest: dict[str, float] = {}
    for unit, norm in zip(units, norms, strict=True):
        largest[unit] = max(largest.get(unit, 0.0), float(norm))
    lost = {k for k, unit in enumerate(units) if norms[k] <= ROUNDING * largest[unit]}
    factors = []
    for columns, R in zip(observation.layout.columns, observation.factors, strict=True):
        kept = np.array([column not in lost for column in columns] + [True])
        factors.append(np.where(kept, R, 0.0))
    return replace(observation, factors=tuple(factors))


def _independent_share(triangle: Triangle, singular: Floats, directions: Floats) -> Floats:
    """1/√(VIF); the variance inflation of a column of norm 1 is its entry on the diagonal of (WᵀW)⁻¹."""
    rank = triangle.rank
    with np.errstate(divide="ignore"):
        inflation = ((directions[:rank] / singular[:rank, None]) ** 2).sum(axis=0)
        seen: Floats = np.where(inflation > 0, 1 / np.sqrt(inflation), 0.0)
    open_parameters = (np.abs(directions[rank:]) > _INVOLVED).any(axis=0)
    return np.where(open_parameters, 0.0, np.minimum(seen, 1.0))


def _weak(triangle: Triangle, singular: Floats, directions: Floats, rank: int) -> list[tuple[float, Floats]]:
    """Relative singular values and unit vectors of weak directions, weakest last."""
    if not singular.size or singular[0] == 0:
        return [(0.0, unit) for unit in np.eye(len(singular))]
    relative = singular / singular[0]
    size = float(np.hypot(np.linalg.norm(triangle.qty), triangle.residual))
    degrees = max(triangle.rows - rank, 1)
    noisy = singular * size < triangle.residual / np.sqrt(degrees)
    found = [(float(relative[k]), directions[k]) for k in range(rank) if relative[k] < WEAK or noisy[k]]
    return found + [(0.0, v) for v in sparse_basis(directions[rank:])]


def sparse_basis(vectors: Floats) -> list[Floats]:
    """Unit vectors of the same space with few entries each, so that every one names few parameters; shape (n,)."""
    rows = np.array(vectors, dtype=float)
    free = np.ones(rows.shape[1], dtype=bool)
    for k in range(len(rows)):
        r, c = np.unravel_index(np.argmax(np.abs(rows[k:] * free)), rows[k:].shape)
        rows[[k, k + int(r)]] = rows[[k + int(r), k]]
        rows[k] /= rows[k, c]
        others = np.arange(len(rows)) != k
        rows[others] -= np.outer(rows[others, c], rows[k])
        free[c] = False
    basis = [row / np.linalg.norm(row) for row in rows]
    return sorted(basis, key=lambda row: int(np.argmax(np.abs(row) > _SHARE)))


def _shares(names: Sequence[str], direction: Floats) -> tuple[tuple[str, float], ...]:
    """The parameters that matter in a direction, largest share first; the largest is positive."""
    order = np.argsort(-np.abs(direction), kind="stable")
    sign = np.sign(direction[order[0]]) or 1.0
    limit = _SHARE * np.abs(direction[order[0]])
    return tuple((names[k], float(sign * direction[k])) for k in order if np.abs(direction[k]) >= limit)


def _unscaled(triangle: Triangle, direction: Floats) -> Floats:
    """The change of parameters along a direction; a column that is zero changes by a unit."""
    return direction / np.where(triangle.scales == 0, 1.0, triangle.scales)
