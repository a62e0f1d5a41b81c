"""The functions of a robot, by name.

All of them take the measured outputs y of a mechanism as functions of its state and of dynamic parameters, usually
base parameters: since the base matrix is the identity in the pivot columns, base parameters in the place of the
pivots, and zero in all other places, give the same outputs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from echelon.dynamics.arguments import Arguments, row_names
from echelon.dynamics.loop_functions import (
    closed_accelerations,
    closed_positions,
    closed_velocities,
    closure_pivots,
    constraint_forces,
)
from echelon.dynamics.outputs import RecordedOutputs
from echelon.errors import InputError
from echelon.mechanism.mechanism import Mechanism
from echelon.program.function import Function
from echelon.program.operations import Op
from echelon.program.tape import Scalar
from echelon.regressor.virtual_power import inverse_dynamics_regressor

Index = tuple[int, ...]
Builder = Callable[[Mechanism, Sequence[int]], Function]


def inverse_dynamics(recorded: RecordedOutputs) -> Function:
    """Record y(q, q̇, q̈): inertial forces with gravity, and all effects."""
    forces = _total(recorded.inertial(True), recorded.effects())
    return _vector("inverse_dynamics", recorded, forces, "q qd qdd inputs", "outputs that a motion needs")


def gravity(recorded: RecordedOutputs) -> Function:
    """Record the inertial forces at rest."""
    return _vector("gravity", recorded, recorded.weight(), "q", "outputs that hold the bodies' weight")


def coriolis(recorded: RecordedOutputs) -> Function:
    """Record the inertial forces that depend on the velocities, C(q, q̇) q̇."""
    forces = recorded.inertial(False, "qdd")
    return _vector("coriolis", recorded, forces, "q qd", "Coriolis and centrifugal outputs")


def effects(recorded: RecordedOutputs) -> Function:
    """Record the forces of all effects while accelerations are zero."""
    forces = recorded.effects("qdd")
    return _vector("effects", recorded, forces, "q qd inputs", "outputs of friction, springs and other effects")


def mass_matrix(recorded: RecordedOutputs) -> Function:
    """Record M = ∂y/∂q̈."""
    entries: dict[Index, Scalar] = dict(recorded.inertial_mass().items())
    for index, slope in recorded.effect_inertia().items():
        entries[index] = entries[index] + slope
    axes = (recorded.names, recorded.mechanism.independent_velocities)
    return _function("mass_matrix", recorded, entries, axes, "q", "outputs per unit of each acceleration")


def inverse_dynamics_derivatives(recorded: RecordedOutputs) -> Function:
    """Record [∂y/∂q, ∂y/∂q̇].

    A unit quaternion's four columns are the derivatives of the quaternion of the same direction: they vanish along it,
    so that they hold for changes along the unit sphere and for normalised ones.
    """
    entries = recorded.inertial_derivatives()
    for index, slope in recorded.effect_derivatives().items():
        entries[index] = entries[index] + slope
    meaning = "derivatives of the inverse dynamics by positions and velocities"
    axes = (recorded.names, recorded.state)
    return _function("inverse_dynamics_derivatives", recorded, entries, axes, "q qd qdd inputs", meaning)


def regressor(mechanism: Mechanism, pivots: Sequence[int]) -> Function:
    """Record X̄, the columns of the regressor that belong to the parameters."""
    forms = inverse_dynamics_regressor(mechanism, pivots)
    columns = [mechanism.columns[p] for p in pivots]
    parameters = {column.name: column.unit for column in columns}
    arguments = Arguments(mechanism, forms.program, parameters)
    made = arguments.of(["q", "qd", "qdd", "inputs", "symbols"], forms.entries.values())
    meaning = "outputs per unit of each parameter"
    entries: dict[Index, int] = {(row, column): node for (row, column), node in forms.entries.items()}
    axes = (row_names(mechanism), tuple(parameters))
    return Function("regressor", forms.program, made, entries, axes, meaning=meaning)


def _cheapest(build: Callable[[RecordedOutputs], Function]) -> Builder:
    """Record with and without sums of angles, and keep what costs less."""

    def builder(mechanism: Mechanism, pivots: Sequence[int]) -> Function:
        return min((build(RecordedOutputs(mechanism, pivots, sums)) for sums in (False, True)), key=_price)

    return builder


def _price(function: Function) -> int:
    """Time per sample, roughly: sines, exponentials and the like cost several multiplications each."""
    counts = function.operations()
    return sum(n * (_FUNCTION_PRICE if Op[name] >= Op.SIN else 1) for name, n in counts.items() if name != "NEG")


_FUNCTION_PRICE = 25
"""Of a sine or cosine; in vectorised machine code a pair takes as long as about fifty multiplications."""

FUNCTIONS: Mapping[str, Builder] = {
    "inverse_dynamics": _cheapest(inverse_dynamics),
    "gravity": _cheapest(gravity),
    "coriolis": _cheapest(coriolis),
    "effects": _cheapest(effects),
    "mass_matrix": _cheapest(mass_matrix),
    "inverse_dynamics_derivatives": _cheapest(inverse_dynamics_derivatives),
    "regressor": regressor,
}
"""Builders by the name of the function."""

LOOP_FUNCTIONS: Mapping[str, Builder] = {
    "closed_positions": closed_positions,
    "closed_velocities": closed_velocities,
    "closed_accelerations": closed_accelerations,
    "closure_pivots": closure_pivots,
    "constraint_forces": constraint_forces,
}
"""The same, of functions of mechanisms with loops only."""

ALL_FUNCTIONS: Mapping[str, Builder] = {**FUNCTIONS, **LOOP_FUNCTIONS}
"""Both."""


def robot_function(name: str, mechanism: Mechanism, pivots: Sequence[int]) -> Function:
    """Record one function of a mechanism, by its name in :data:`ALL_FUNCTIONS`.

    ``pivots`` are the columns of the regressor whose parameters are arguments: the pivots of the base matrix for base
    parameters, all columns for standard parameters.  Forces of closures depend on all standard parameters.  With loops,
    ``q`` holds all positions, which must be closed, and ``qd`` and ``qdd`` are independent.
    """
    if name not in ALL_FUNCTIONS:
        raise InputError(f"there is no function '{name}' (valid: {', '.join(ALL_FUNCTIONS)})")
    return ALL_FUNCTIONS[name](mechanism, pivots)


# -- putting together --------------------------------------------------------------------------------------------------


def _total(first: Sequence[Scalar], second: Sequence[Scalar]) -> list[Scalar]:
    return [a + b for a, b in zip(first, second, strict=True)]


def _vector(name: str, recorded: RecordedOutputs, forces: Sequence[Scalar], arguments: str, meaning: str) -> Function:
    entries: dict[Index, Scalar] = {(row,): force for row, force in enumerate(forces)}
    units = tuple(output.unit for output in recorded.mechanism.outputs)
    return _function(name, recorded, entries, (recorded.names,), arguments, meaning, units)


def _function(
    name: str,
    recorded: RecordedOutputs,
    entries: Mapping[Index, Scalar],
    axes: tuple[tuple[str, ...], ...],
    arguments: str,
    meaning: str,
    units: tuple[str, ...] = (),
) -> Function:
    nodes = {index: value.node for index, value in entries.items() if not value.is_zero}
    make = Arguments(recorded.mechanism, recorded.program, recorded.parameters)
    made = make.of([*arguments.split(), "parameters", "symbols"], nodes.values())
    return Function(name, recorded.program, made, nodes, axes, units, meaning)
