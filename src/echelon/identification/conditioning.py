"""Conditioning: which of the parameters that sensors could see the data at hand show.

Base parameters can all be identified from some motion: a direction that stays open is the fault of the data.  Which
ones do is read from the singular vectors of the R-factor with columns of norm 1, where parameters of different units
compare by what they contribute to the outputs.

How to move so that the data show them is advice drawn from the mechanism.  Along a weak direction δ the outputs hardly
changed in the data, X̄(x) δ ≈ 0, though they do in general.  Which of the positions, velocities and accelerations make
them change is a question of sensitivity: total Sobol indices of X̄(x) δ over random states, by Jansen's estimator
(Computer Physics Communications 117, 1999), which needs no derivatives and takes sign functions as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from echelon.algebra import DEFAULT_SEED, random_generator
from echelon.compute import Observation, Triangle
from echelon.identification.estimators.estimate import (
    NEGLIGIBLE,
    ROUNDING,
    sparse_basis,
)
from echelon.identification.logs.finding import enumerated
from echelon.robot import MotionKind, characteristic_length
from echelon.shared import Floats, InputError

if TYPE_CHECKING:
    from echelon.base import BaseModel
    from echelon.robot import Mechanism


WEAK = 1e-2
"""Singular value, relative to the largest, below which a direction is weak: exciting trajectories are customarily asked
for a condition number below 100, and condition indices from 30 to 100 on are harmful collinearity (Belsley, Kuh and
Welsch, "Regression diagnostics", 1980)."""

NAMED = 0.2
"""Part of the largest share in a direction, or of the largest sensitivity, below which a parameter or a motion is not
named: all of these together matter less than what is named."""


@dataclass(frozen=True)
class Direction:
    """A combination of base parameters that the data hardly show."""

    singular_value: float  # of the weighted observation matrix with columns of norm 1, relative to the largest
    # parameters with their shares in the combination, largest first, small ones left out
    weights: tuple[tuple[str, float], ...]
    advice: str  # how to excite it, in a sentence


@dataclass(frozen=True)
class DataConditioning:
    """Conditioning of a set of data."""

    condition: float  # condition number of the weighted observation matrix
    scaled_condition: float  # the same with columns of norm 1
    singular_values: Floats  # shape (n,); of the scaled matrix, descending
    rank: int  # directions that the data determine at all
    # shape (n,); for each parameter 1/√(VIF): the share of its column that no other column explains, 0 to 1
    independent_share: Floats
    # combinations that the data leave open, or nearly so, weakest last
    weak: tuple[Direction, ...]

    @property
    def is_complete(self) -> bool:
        """Whether the data determine all base parameters."""
        return self.rank == len(self.independent_share)

    @property
    def verdict(self) -> str:
        """Quality of the data, in a sentence."""
        count = len(self.independent_share)
        start = f"the data determine {self.rank} of {count} base parameters"
        condition = f"condition number with scaled columns {self.scaled_condition:.3g}"
        if not self.weak:
            return f"{start}, all of them well ({condition})"
        some = (
            "one combination"
            if len(self.weak) == 1
            else f"{len(self.weak)} combinations"
        )
        state = "open" if self.rank < count else "poorly determined"
        return f"{start} and leave {some} {state} ({condition}); other motions would show them"


def conditioning(
    observation: Observation,
    weights: Sequence[float] | Floats | None = None,
    base: BaseModel | None = None,
) -> DataConditioning:
    """Conditioning of data, and the combinations of parameters that they hardly show.

    A direction is weak if its singular value is below :data:`WEAK` of the largest, or if the noise leaves it so
    uncertain that the parts which its parameters contribute, and which cancel, could each be as large as all that was
    measured.
    """
    if base is not None and base.pivots != observation.layout.parameters:
        raise InputError("the base model and the observation have different parameters")
    triangle = observation.combined(weights)
    n = len(triangle.parameters)
    _, singular, directions = np.linalg.svd(triangle.scaled)
    rank = triangle.rank
    weak = tuple(
        Direction(
            value,
            _shares(triangle.parameters, v),
            advice(triangle.parameters, v, v / triangle.safe_scales, base, value),
        )
        for value, v in _weak(triangle, singular, directions, rank)
    )
    condition, scaled_condition = triangle.condition, triangle.scaled_condition
    if rank < n:  # to within rounding
        condition = scaled_condition = float("inf")
    return DataConditioning(
        condition,
        scaled_condition,
        singular,
        rank,
        _independent_share(triangle, singular, directions),
        weak,
    )


def without_rounding(observation: Observation, units: Sequence[str]) -> Observation:
    """Data with zeros in columns of which only the rounding is left.

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


def _independent_share(
    triangle: Triangle, singular: Floats, directions: Floats
) -> Floats:
    """1/√(VIF); the variance inflation of a column of norm 1 is its entry on the diagonal of (WᵀW)⁻¹."""
    rank = triangle.rank
    with np.errstate(divide="ignore"):
        inflation = ((directions[:rank] / singular[:rank, None]) ** 2).sum(axis=0)
        seen: Floats = np.where(inflation > 0, 1 / np.sqrt(inflation), 0.0)
    open_parameters = (np.abs(directions[rank:]) > NEGLIGIBLE).any(axis=0)
    return np.where(open_parameters, 0.0, np.minimum(seen, 1.0))


def _weak(
    triangle: Triangle, singular: Floats, directions: Floats, rank: int
) -> list[tuple[float, Floats]]:
    """Relative singular values and unit vectors of weak directions, weakest last."""
    if not singular.size or singular[0] == 0:
        return [(0.0, unit) for unit in np.eye(len(singular))]
    relative = singular / singular[0]
    size = float(np.hypot(np.linalg.norm(triangle.qty), triangle.residual))
    degrees = max(triangle.rows - rank, 1)
    noisy = singular * size < triangle.residual / np.sqrt(degrees)
    found = [
        (float(relative[k]), directions[k])
        for k in range(rank)
        if relative[k] < WEAK or noisy[k]
    ]
    if rank == len(singular):
        return found
    # few entries each, so that every one names few parameters
    rest = [row / np.linalg.norm(row) for row in sparse_basis(directions[rank:])[0]]
    return found + [
        (0.0, row)
        for row in sorted(rest, key=lambda row: int(np.argmax(np.abs(row) > NAMED)))
    ]


def _shares(names: Sequence[str], direction: Floats) -> tuple[tuple[str, float], ...]:
    """The parameters that matter in a direction, largest share first; the largest is positive."""
    order = np.argsort(-np.abs(direction), kind="stable")
    sign = np.sign(direction[order[0]]) or 1.0
    limit = NAMED * np.abs(direction[order[0]])
    return tuple(
        (names[k], float(sign * direction[k]))
        for k in order
        if np.abs(direction[k]) >= limit
    )


State = dict[str, Floats]

TYPICAL_SPEED, TYPICAL_ACCELERATION = 1.5, 6.0
"""Speeds and accelerations of arms, rad/s and rad/s² (per characteristic length for sliding joints)."""

_SIGNALS = ("qdd", "qd", "q")


def advice(
    names: Sequence[str],
    direction: Floats,
    change: Floats,
    base: BaseModel | None,
    seen: float = 0.0,
) -> str:
    """Motions that would show a direction that the data hardly show, in a sentence."""
    size = np.abs(direction)
    order = [
        int(k)
        for k in np.argsort(-size, kind="stable")
        if size[k] >= NAMED * size.max()
    ]
    how = "hardly" if seen else "do not"
    tell = "show {}" if len(order) == 1 else "tell {} apart"
    problem = f"the data {how} {tell.format(enumerated([names[k] for k in order]))}"
    # what hardly belongs to the direction would only blur its sensitivity
    motion = (
        None
        if base is None
        else _motion(base, np.where(size >= NAMED * size.max(), change, 0.0))
    )
    return f"{problem}: {motion}" if motion else f"{problem}: move in other ways"


def _motion(base: BaseModel, change: Floats) -> str:
    """Which joints to move, and how."""
    if base.mechanism.contacts:
        # what unknown forces leave of the outputs is not X̄ δ
        return ""
    if base.mechanism.dependent_velocities:
        # positions that follow from others cannot be drawn one by one
        return f"move {_together(base.mechanism.independent_velocities)} further, faster and with larger accelerations"
    found = sensitivities(base, change)
    largest = max(
        (value for values in found.values() for value in values.values()), default=0.0
    )
    if largest == 0:
        return (
            "the outputs they change do not depend on the motion; record more samples"
        )
    chosen = {
        kind: [name for name, value in found[kind].items() if value >= NAMED * largest]
        for kind in _SIGNALS
        if found.get(kind)
    }
    phrases = {
        "qdd": "with larger and more varied accelerations",
        "qd": "at more different speeds, in both directions",
        "q": "over more of the range",
    }
    ways: dict[str, list[str]] = {}
    for kind, some in chosen.items():
        if some:
            ways.setdefault(_together(some), []).append(phrases[kind])
    if not ways:
        return f"move the drives of {_together(list(found['inputs']))} at other loads"
    return "move " + "; ".join(
        f"{who} {', and '.join(how)}" for who, how in ways.items()
    )


def sensitivities(
    base: BaseModel, change: Floats, count: int = 256
) -> dict[str, dict[str, float]]:
    """Total Sobol indices of the change of outputs X̄(x) δ: of 256 random states they are right to a tenth or so."""
    rng = random_generator(DEFAULT_SEED)
    first, second = (_random_states(base.mechanism, rng, count) for _ in range(2))
    start = _outputs(base, first, change)
    variance = start.var(axis=0)
    # rounding of an output that δ does not change is no variance
    counted = variance > 1e-20 * np.maximum((start**2).mean(axis=0).max(), 1e-300)
    found: dict[str, dict[str, float]] = {
        kind: {} for kind in ("q", "qd", "qdd", "inputs")
    }
    if not counted.any():
        return found
    for kind, name, columns in _variables(base.mechanism):
        mixed = {key: value.copy() for key, value in first.items()}
        mixed[kind][:, columns] = second[kind][:, columns]
        moved = ((_outputs(base, mixed, change) - start) ** 2).mean(axis=0) / 2
        found[kind][name] = float((moved[counted] / variance[counted]).mean())
    return found


def _outputs(base: BaseModel, state: State, change: Floats) -> Floats:
    values = base.regressor(
        state["q"], state["qd"], state["qdd"], inputs=_inputs(base.mechanism, state)
    )
    return values @ change


def _inputs(mechanism: Mechanism, state: State) -> Mapping[str, Floats]:
    return {
        name: state["inputs"][:, k] for k, name in enumerate(_input_names(mechanism))
    }


def _input_names(mechanism: Mechanism) -> tuple[str, ...]:
    return tuple(
        dict.fromkeys(
            [*mechanism.velocities, *(a.name for a in mechanism.transmission.actuators)]
        )
    )


def _variables(mechanism: Mechanism) -> list[tuple[str, str, list[int]]]:
    """Kind, coordinate and columns of everything that varies."""
    found = []
    position = velocity = 0
    for motion in mechanism.free_motions:
        q = list(range(position, position + len(motion.positions)))
        v = list(range(velocity, velocity + len(motion.velocities)))
        position, velocity = q[-1] + 1, v[-1] + 1
        found += [
            ("q", motion.name, q),
            ("qd", motion.name, v),
            ("qdd", motion.name, v),
        ]
    return found + [
        ("inputs", name, [k]) for k, name in enumerate(_input_names(mechanism))
    ]


def _random_states(mechanism: Mechanism, rng: np.random.Generator, count: int) -> State:
    """States as an arm may have them: any pose, and speeds and accelerations of usual size."""
    length = characteristic_length(mechanism)
    moving = mechanism.free_motions
    sizes = [
        length if m.kind is MotionKind.TRANSLATION else 1.0
        for m in moving
        for _ in m.velocities
    ]
    positions = []
    for motion in moving:
        if motion.kind is MotionKind.BALL:
            quaternions = rng.normal(size=(count, 4))
            positions.append(
                quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
            )
        else:
            reach = length if motion.kind is MotionKind.TRANSLATION else np.pi
            positions.append(rng.uniform(-reach, reach, (count, 1)))
    return {
        "q": np.concatenate(positions, axis=1) if positions else np.zeros((count, 0)),
        "qd": TYPICAL_SPEED * rng.normal(size=(count, len(sizes))) * sizes,
        "qdd": TYPICAL_ACCELERATION * rng.normal(size=(count, len(sizes))) * sizes,
        "inputs": rng.normal(size=(count, len(_input_names(mechanism)))),
    }


def _together(names: Sequence[str]) -> str:
    return enumerated(names) + (" together" if len(names) > 1 else "")
