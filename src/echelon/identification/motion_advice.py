"""How to move so that the data show a combination of base parameters: advice drawn from the mechanism.

Along a weak direction δ the outputs hardly changed in the data, X̄(x) δ ≈ 0, though they do in general.  Which of the
positions, velocities and accelerations make them change is a question of sensitivity: total Sobol indices of X̄(x) δ
over random states, by Jansen's estimator (Computer Physics Communications 117, 1999), which needs no derivatives and
takes sign functions as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from echelon.arrays import Floats
from echelon.mechanism.joint import Motion, MotionKind
from echelon.mechanism.stated import characteristic_length
from echelon.seeds import DEFAULT_SEED, random_generator

if TYPE_CHECKING:
    from echelon.base.model import BaseModel
    from echelon.mechanism.mechanism import Mechanism

State = dict[str, Floats]
Symbols = Mapping[str, float] | None

_STATES = 256
"""Random states: indices are wanted to a tenth or so."""
_SPEED, _ACCELERATION = 1.5, 6.0
"""Typical speeds and accelerations of arms, rad/s and rad/s² (per characteristic length for sliding joints)."""
_MATTERS = 0.25  # index, relative to the largest, from which on a variable is named
_NAMED = 0.2  # share, relative to the largest, from which on a parameter is named
_MOST = 6  # parameters named
_KINDS = ("qdd", "qd", "q")


def advice(
    names: Sequence[str],
    direction: Floats,
    change: Floats,
    base: BaseModel | None,
    seen: float = 0.0,
    symbols: Symbols = None,
) -> str:
    """What the data do not show and how to show it, in a sentence."""
    size = np.abs(direction)
    order = [int(k) for k in np.argsort(-size, kind="stable") if size[k] >= _NAMED * size.max()]
    shown = [names[k] for k in order[:_MOST]] + (["others"] if len(order) > _MOST else [])
    how = "hardly" if seen else "do not"
    problem = (
        f"the data {how} show {shown[0]}"
        if len(shown) == 1
        else f"the data {how} tell {', '.join(shown[:-1])} and {shown[-1]} apart"
    )
    # what hardly belongs to the direction would only blur its sensitivity
    motion = None if base is None else _motion(base, np.where(size >= _NAMED * size.max(), change, 0.0), symbols)
    return f"{problem}: {motion}" if motion else f"{problem}: move in other ways"


def _motion(base: BaseModel, change: Floats, symbols: Symbols) -> str:
    """Which joints to move, and how."""
    if base.mechanism.closures:
        # positions that close the loops cannot be drawn one by one
        return f"move {_listed(base.mechanism.independent_velocities)} further, faster and with larger accelerations"
    found = sensitivities(base, change, symbols)
    largest = max((value for values in found.values() for value in values.values()), default=0.0)
    if largest == 0:
        return "the outputs they change do not depend on the motion; record more samples"
    chosen = {
        kind: [name for name, value in found[kind].items() if value >= _MATTERS * largest]
        for kind in _KINDS
        if found.get(kind)
    }
    phrases = {
        "qdd": "{} with larger and more varied accelerations",
        "qd": "{} at more different speeds, in both directions",
        "q": "{} over more of the range",
        "inputs": "the drives of {} at other loads",
    }
    parts = [phrases[kind].format(_listed(some)) for kind, some in chosen.items() if some]
    if not parts:
        parts = [phrases["inputs"].format(_listed(list(found["inputs"])))]
    return "move " + "; ".join(parts)


def sensitivities(
    base: BaseModel, change: Floats, symbols: Symbols = None, seed: int = DEFAULT_SEED
) -> dict[str, dict[str, float]]:
    """Total Sobol indices of the change of outputs X̄(x) δ."""
    rng = random_generator(seed)
    first, second = (_random_states(base.mechanism, rng) for _ in range(2))
    start = _outputs(base, first, change, symbols)
    variance = start.var(axis=0)
    # rounding of an output that δ does not change is no variance
    counted = variance > 1e-20 * np.maximum((start**2).mean(axis=0).max(), 1e-300)
    found: dict[str, dict[str, float]] = {kind: {} for kind in ("q", "qd", "qdd", "inputs")}
    if not counted.any():
        return found
    for kind, name, columns in _variables(base.mechanism):
        mixed = {key: value.copy() for key, value in first.items()}
        mixed[kind][:, columns] = second[kind][:, columns]
        moved = ((_outputs(base, mixed, change, symbols) - start) ** 2).mean(axis=0) / 2
        found[kind][name] = float((moved[counted] / variance[counted]).mean())
    return found


def _outputs(base: BaseModel, state: State, change: Floats, symbols: Symbols) -> Floats:
    values = base.regressor(state["q"], state["qd"], state["qdd"], symbols, _inputs(base.mechanism, state))
    result: Floats = values @ change
    return result


def _inputs(mechanism: Mechanism, state: State) -> Mapping[str, Floats]:
    return {name: state["inputs"][:, k] for k, name in enumerate(_input_names(mechanism))}


def _input_names(mechanism: Mechanism) -> tuple[str, ...]:
    return tuple(dict.fromkeys([*mechanism.velocities, *(a.name for a in mechanism.transmission.actuators)]))


def _moving(mechanism: Mechanism) -> list[Motion]:
    return [motion for motion in mechanism.motions if motion.name not in mechanism.dependent]


def _variables(mechanism: Mechanism) -> list[tuple[str, str, list[int]]]:
    """Kind, coordinate and columns of everything that varies."""
    found = []
    position = velocity = 0
    for motion in _moving(mechanism):
        q = list(range(position, position + len(motion.positions)))
        v = list(range(velocity, velocity + len(motion.velocities)))
        position, velocity = q[-1] + 1, v[-1] + 1
        found += [("q", motion.name, q), ("qd", motion.name, v), ("qdd", motion.name, v)]
    return found + [("inputs", name, [k]) for k, name in enumerate(_input_names(mechanism))]


def _random_states(mechanism: Mechanism, rng: np.random.Generator) -> State:
    """States as an arm may have them: any pose, and speeds and accelerations of usual size."""
    length = characteristic_length(mechanism)
    moving = _moving(mechanism)
    sizes = [length if m.kind is MotionKind.TRANSLATION else 1.0 for m in moving for _ in m.velocities]
    positions = []
    for motion in moving:
        if motion.kind is MotionKind.BALL:
            quaternions = rng.normal(size=(_STATES, 4))
            positions.append(quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True))
        else:
            reach = length if motion.kind is MotionKind.TRANSLATION else np.pi
            positions.append(rng.uniform(-reach, reach, (_STATES, 1)))
    return {
        "q": np.concatenate(positions, axis=1) if positions else np.zeros((_STATES, 0)),
        "qd": _SPEED * rng.normal(size=(_STATES, len(sizes))) * sizes,
        "qdd": _ACCELERATION * rng.normal(size=(_STATES, len(sizes))) * sizes,
        "inputs": rng.normal(size=(_STATES, len(_input_names(mechanism)))),
    }


def _listed(names: Sequence[str]) -> str:
    if len(names) == 1:
        return names[0]
    return f"{', '.join(names[:-1])} and {names[-1]}{' together' if len(names) < _MOST else ''}"
