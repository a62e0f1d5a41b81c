"""What keeps recorded forms on closed configurations, with random real states there."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.mechanism.closed_pose import stated_exactly
from echelon.mechanism.mechanism import Mechanism
from echelon.mechanism.stated import all_symbols, known_values
from echelon.program.tape import Scalar
from echelon.regressor.loops.assembly import Assembly
from echelon.regressor.loops.closures import Loops, record_closures, record_wrists
from echelon.regressor.steps import Probes, Recorder

_DRAWS = 8  # of values for symbols that have none


def loops_of(
    mechanism: Mechanism, recorder: Recorder, probes: Probes | None = None, speeds: Mapping[str, Scalar] | None = None
) -> Loops:
    """What keeps forms that were recorded for a mechanism with loops on closed configurations."""
    nodes = None if speeds is None else {name: speed.node for name, speed in speeds.items()}
    record = recorder.program.polynomial
    return Loops(
        mechanism,
        record_closures(mechanism, recorder, probes),
        partial(record_wrists, mechanism, recorder),
        nodes,
        {name: tuple(record(x).node for x in value) for name, value in stated_exactly(mechanism).items()},
        partial(real_inputs, mechanism),
    )


def real_inputs(mechanism: Mechanism, rng: np.random.Generator, count: int, reach: float = 1.0) -> dict[str, Floats]:
    """Random closed states and values of symbols, by the names of program inputs.

    Symbols without a value get a random one.
    """
    unknown = [name for name in all_symbols(mechanism) if name not in known_values(mechanism)]
    drawn: dict[str, float] = {}
    for attempt in range(_DRAWS):
        drawn = {name: float(rng.uniform(0.5, 1.5)) for name in unknown}
        try:
            q, qd, qdd = Assembly(mechanism, drawn).random_closed_states(rng, count, reach)
            break
        except InputError:
            if not unknown or attempt == _DRAWS - 1:
                raise
    symbols = {name: np.full(count, value) for name, value in (known_values(mechanism) | drawn).items()}
    return symbols | state_inputs(mechanism, q, qd, qdd)


def state_inputs(mechanism: Mechanism, q: Floats, qd: Floats, qdd: Floats) -> dict[str, Floats]:
    """Values of the inputs of states of all coordinates, by name."""
    velocities, found = mechanism.velocities, dict[str, Floats]()
    for kind, array, names in (("q", q, mechanism.positions), ("qd", qd, velocities), ("qdd", qdd, velocities)):
        if array.ndim != 2 or array.shape[1] != len(names):
            raise InputError(f"{kind} has shape {array.shape}; expected (samples, {len(names)}): {', '.join(names)}")
        found |= {f"{kind}[{name}]": array[:, k] for k, name in enumerate(names)}
    return found
