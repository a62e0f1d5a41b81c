"""Functions of mechanisms with loops only: closed positions, what moves dependently, and the forces of closures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from echelon.dynamics.arguments import Arguments, coordinate_units
from echelon.dynamics.outputs import RecordedOutputs
from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function
from echelon.program.schedule import FloatArithmetic, Schedule
from echelon.program.tape import Program, Scalar
from echelon.regressor.loops.dependent_motion import DependentMotion
from echelon.regressor.loops.recorded_loops import real_inputs
from echelon.seeds import DEFAULT_SEED, random_generator

Index = tuple[int, ...]

_STATES = 8  # at which it is looked whether closures are redundant
_DETERMINED = 1e-9  # is lacking at the most, of what rounding leaves in poses that are closed to 1e-12
_COMPONENTS = ("moment x", "moment y", "moment z", "force x", "force y", "force z")


def closed_positions(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record one step of Newton's iteration to positions that close the loops."""
    motion = _motion(mechanism, "closed_positions")
    meaning = "positions nearer to where the loops are closed (one step of Newton's iteration); independent ones stay"
    units = tuple(coordinate_units(mechanism, "q"))
    return motion_function(
        "closed_positions", motion, motion.closed_positions(), mechanism.positions, "q", meaning, units
    )


def closed_velocities(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record the velocities of all coordinates."""
    return _rates(mechanism, "qd", "velocities", "q qd")


def closed_accelerations(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record the accelerations of all coordinates."""
    return _rates(mechanism, "qdd", "accelerations", "q qd qdd")


def closure_pivots(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record how far every dependent coordinate is from being undetermined."""
    motion = _motion(mechanism, "closure_pivots")
    meaning = "squares of sines, 0 where the dependent coordinate does not follow from the others: a singular position"
    return motion_function("closure_pivots", motion, list(motion.pivots.values()), tuple(motion.pivots), "q", meaning)


def constraint_forces(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record the wrenches that closures exert on their second bodies, about the first frame's origin and in its axes.

    Components that redundant constraints leave undetermined are left out.  Base parameters do not determine the others:
    they are functions of all standard parameters.
    """
    _motion(mechanism, "constraint_forces")
    recorded = RecordedOutputs(mechanism, range(len(mechanism.parameters)), dependent=True)
    motion = recorded.dependent_motion
    assert motion is not None
    forces = (a + b for a, b in zip(recorded.inertial(True), recorded.effects(), strict=True))
    found = dict(_labelled(mechanism, motion.closing_wrenches(dict(zip(motion.dependent, forces, strict=True)))))
    shares = _determined(mechanism, motion)
    kept = tuple(name for name, share in shares.items() if share > 1 - _DETERMINED)
    if not kept:
        raise InputError("redundant constraints leave all forces of the closures undetermined")
    meaning = "moments and forces of closures on their second bodies, about the first frame's origin, in its axes"
    left_out = ", ".join(name for name in shares if name not in kept)
    meaning += f"; redundant constraints leave undetermined: {left_out}" if left_out else ""
    units = tuple("N" if "force" in name else "N*m" for name in kept)
    entries: dict[Index, int] = {(k,): found[name].node for k, name in enumerate(kept) if not found[name].is_zero}
    names = ["q", "qd", "qdd", "inputs", "parameters", "symbols"]
    made = Arguments(mechanism, recorded.program, recorded.parameters, standard=True).of(names, entries.values())
    return Function("constraint_forces", recorded.program, made, entries, (kept,), units, meaning)


def _determined(mechanism: Mechanism, motion: DependentMotion) -> dict[str, float]:
    """How much of every component of closing wrenches the motion determines in some closed states."""
    shares = {name: value for name, value in _labelled(mechanism, motion.determined()) if value.number is None}
    values = real_inputs(mechanism, random_generator(DEFAULT_SEED), _STATES)
    schedule = Schedule(motion.program, [share.node for share in shares.values()])
    leaves = {node: values[motion.program.inputs[node].name] for node in schedule.leaves}
    with np.errstate(invalid="ignore"):  # a component that is zero in all poses has no share
        found = schedule.run(FloatArithmetic(), leaves, _STATES)
    least = zip(shares, found.min(axis=1).tolist(), strict=True)
    return {name: share for name, share in least if not np.isnan(share)}


def _labelled(mechanism: Mechanism, wrenches: Sequence[tuple[Scalar, ...]]) -> Iterator[tuple[str, Scalar]]:
    for closure, wrench in zip(mechanism.closures, wrenches, strict=True):
        for component, value in zip(_COMPONENTS, wrench, strict=True):
            yield f"{closure.name}: {component}", value


def _motion(mechanism: Mechanism, name: str) -> DependentMotion:
    if not mechanism.closures:
        raise InputError(f"{name} is a function of mechanisms with loops; {mechanism.name} has none")
    return DependentMotion(mechanism, Program())


def _rates(mechanism: Mechanism, kind: str, what: str, arguments: str) -> Function:
    name = f"closed_{what}"
    motion = _motion(mechanism, name)
    given = motion.given()
    values = [given[f"{kind}[{n}]"] for n in mechanism.velocities]
    units = tuple(coordinate_units(mechanism, kind))
    return motion_function(name, motion, values, mechanism.velocities, arguments, f"{what} of all coordinates", units)


def motion_function(
    name: str,
    motion: DependentMotion,
    values: Sequence[Scalar],
    labels: tuple[str, ...],
    arguments: str,
    meaning: str,
    units: tuple[str, ...] = (),
) -> Function:
    """A function of positions, and perhaps independent velocities and accelerations."""
    entries: dict[Index, int] = {(k,): value.node for k, value in enumerate(values) if not value.is_zero}
    make = Arguments(motion.mechanism, motion.program, {})
    made = make.of([*arguments.split(), "symbols"], entries.values())
    return Function(name, motion.program, made, entries, (labels,), units, meaning)
