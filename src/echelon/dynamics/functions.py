"""The functions of a robot, by name.

Most take the measured outputs y of a mechanism as functions of its state and of dynamic parameters, usually base
parameters: since the base matrix is the identity in the pivot columns, base parameters in the place of the pivots, and
zero in all other places, give the same outputs.  Of mechanisms with loops there are also closed positions, what moves
dependently, and the forces of closures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from echelon.algebra import (
    DEFAULT_SEED,
    FloatArithmetic,
    Function,
    Op,
    Program,
    Scalar,
    Schedule,
    derivatives,
    random_generator,
    replayed,
)
from echelon.algebra import recorded as recorded_operation
from echelon.dynamics.arguments import Arguments, coordinate_units, row_names
from echelon.dynamics.articulated import solved
from echelon.dynamics.contact_motion import ContactMotion
from echelon.dynamics.control import ControlOutputs
from echelon.dynamics.linear_forms import inverse_dynamics_regressor
from echelon.dynamics.loop_rows import dependent_motion
from echelon.dynamics.outputs import RecordedOutputs
from echelon.robot import Array, Mechanism, refuse_contacts
from echelon.shared import InputError

if TYPE_CHECKING:
    from echelon.loops import DependentMotion

Index = tuple[int, ...]

STATES = 8
"""Random states that show whether closures are redundant."""
DETERMINED = 1e-9
"""Part of a motion that closures leave undetermined at most, in poses that are closed to 1e-12."""
_COMPONENTS = ("moment x", "moment y", "moment z", "force x", "force y", "force z")


def closed_positions(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record one step of Newton's iteration to positions that close the loops."""
    motion = _motion(mechanism, "closed_positions")
    meaning = "positions nearer to where the loops are closed (one step of Newton's iteration); independent ones stay"
    units = tuple(coordinate_units(mechanism, "q"))
    return motion_function(
        "closed_positions",
        motion,
        motion.closed_positions(),
        mechanism.positions,
        "q",
        meaning,
        units,
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
    return motion_function(
        "closure_pivots",
        motion,
        list(motion.pivots.values()),
        tuple(motion.pivots),
        "q",
        meaning,
    )


def constraint_forces(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record the wrenches that closures exert on their second bodies, about the first frame's origin, in its axes.

    Components that redundant constraints leave undetermined are left out.  Base parameters do not determine the others:
    they are functions of all standard parameters.
    """
    recorded = RecordedOutputs(
        mechanism, range(len(mechanism.parameters)), dependent=True
    )
    motion = _not_of_tree(mechanism, "constraint_forces", recorded.dependent_motion)
    forces = dict(zip(motion.dependent, recorded.forces(), strict=True))
    found = _labelled(motion.closing_wrenches(forces))
    shares = _determined(mechanism, motion)
    kept = tuple(name for name, share in shares.items() if share > 1 - DETERMINED)
    if not kept:
        raise InputError(
            "redundant constraints leave all forces of the closures undetermined"
        )
    meaning = "moments and forces of closures on their second bodies, about the first frame's origin, in its axes"
    left_out = ", ".join(name for name in shares if name not in kept)
    meaning += (
        f"; redundant constraints leave undetermined: {left_out}" if left_out else ""
    )
    units = tuple("N" if "force" in name else "N*m" for name in kept)
    entries: dict[Index, Scalar] = {(k,): found[name] for k, name in enumerate(kept)}
    arguments = "q qd qdd inputs parameters symbols"
    return recorded.arguments.function(
        "constraint_forces", entries, (kept,), arguments, meaning, units
    )


def contact_jacobian(mechanism: Mechanism, _pivots: Sequence[int]) -> Function:
    """Record J with y = X ζ - Jᵀ λ, where λ are the forces that act on bodies at contacts, in the contacts' axes."""
    if not mechanism.contacts:
        raise InputError(
            f"contact_jacobian is a function of mechanisms with contacts; {mechanism.name} has none"
        )
    motion = ContactMotion(mechanism, Program())
    entries: dict[Index, Scalar] = {
        (row, column): slip
        for row, slips in enumerate(motion.slips_of_outputs)
        for column, slip in enumerate(slips)
    }
    names = tuple(
        f"{contact.name}.{component}"
        for contact in mechanism.contacts
        for component in contact.kind.components
    )
    return Arguments(mechanism, motion.program, {}).function(
        "contact_jacobian",
        entries,
        (names, row_names(mechanism)),
        "q symbols",
        "velocities of contacts per unit of the velocity of each output",
    )


def _determined(mechanism: Mechanism, motion: DependentMotion) -> dict[str, float]:
    """Share of every component of closing wrenches that the motion determines, the least in some closed states."""
    from echelon.loops import real_inputs  # robots without loops do without it

    shares = {
        name: value
        for name, value in _labelled(motion.determined()).items()
        if value.number is None
    }
    values = real_inputs(mechanism, random_generator(DEFAULT_SEED), STATES)
    schedule = Schedule(motion.program, [share.node for share in shares.values()])
    leaves = {
        node: values[motion.program.inputs[node].name] for node in schedule.leaves
    }
    with np.errstate(
        invalid="ignore"
    ):  # a component that is zero in all poses has no share
        found = schedule.run(FloatArithmetic(), leaves, STATES)
    least = zip(shares, found.min(axis=1).tolist(), strict=True)
    return {name: share for name, share in least if not np.isnan(share)}


def _labelled(wrenches: Mapping[str, tuple[Scalar, ...]]) -> dict[str, Scalar]:
    pairs = (
        (name, zip(_COMPONENTS, wrench, strict=True))
        for name, wrench in wrenches.items()
    )
    return {
        f"{name}: {component}": value
        for name, wrench in pairs
        for component, value in wrench
    }


def _motion(mechanism: Mechanism, name: str) -> DependentMotion:
    return _not_of_tree(mechanism, name, dependent_motion(mechanism, Program()))


def _not_of_tree(
    mechanism: Mechanism, name: str, motion: DependentMotion | None
) -> DependentMotion:
    if motion is None:
        raise InputError(
            f"{name} is a function of mechanisms with loops; {mechanism.name} has none"
        )
    return motion


def _rates(mechanism: Mechanism, kind: str, what: str, arguments: str) -> Function:
    name = f"closed_{what}"
    motion = _motion(mechanism, name)
    given = motion.given()
    values = [given[f"{kind}[{n}]"] for n in mechanism.velocities]
    units = tuple(coordinate_units(mechanism, kind))
    return motion_function(
        name,
        motion,
        values,
        mechanism.velocities,
        arguments,
        f"{what} of all coordinates",
        units,
    )


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
    entries: dict[Index, Scalar] = {(k,): value for k, value in enumerate(values)}
    make = Arguments(motion.mechanism, motion.program, {})
    return make.function(
        name, entries, (labels,), f"{arguments} symbols", meaning, units
    )


Builder = Callable[[Mechanism, Sequence[int]], Function]


Parts = Callable[
    [ControlOutputs], Sequence[Scalar]
]  # what every output is, or a part of it

_VECTORS: Mapping[str, tuple[Parts, str, str]] = {
    "inverse_dynamics": (
        RecordedOutputs.forces,
        "q qd qdd inputs",
        "outputs that a motion needs",
    ),
    "gravity": (RecordedOutputs.weight, "q", "outputs that hold the bodies' weight"),
    "coriolis": (
        lambda r: r.inertial(False, "qdd"),
        "q qd",
        "Coriolis and centrifugal outputs",
    ),
    "effects": (
        lambda r: r.effects("qdd"),
        "q qd inputs",
        "outputs of friction, springs and other effects",
    ),
    "slotine_li": (
        ControlOutputs.reference_forces,
        "q qd qdr qddr inputs",
        "outputs M qddr + C(q, qd) qdr + g with C of Christoffel's symbols, and effects at qd",
    ),
    "momentum": (ControlOutputs.momentum, "q qd", "momentum p = M qd"),
    "momentum_bias": (
        ControlOutputs.momentum_bias,
        "q qd inputs",
        "outputs less the rate of the momentum, g - C' qd and effects: no accelerations",
    ),
}
"""Functions with one value for each output: what is recorded, of which arguments, and its meaning."""

_BY_COORDINATE: Mapping[str, tuple[Parts, str, str]] = {
    "kinetic_energy": (ControlOutputs.kinetic_energy, "q qd", "kinetic energy"),
    "potential_energy": (
        ControlOutputs.potential_energy,
        "q",
        "potential energy of the weight, up to a constant",
    ),
    "forward_dynamics": (
        ControlOutputs.accelerations,
        "q qd y inputs",
        "accelerations that outputs y cause",
    ),
}
"""Energies and accelerations likewise, which need the force of every coordinate."""


def vector(name: str, recorded: ControlOutputs) -> Function:
    """Record one of the functions in :data:`_VECTORS` or :data:`_BY_COORDINATE`."""
    labels = recorded.names
    units = tuple(output.unit for output in recorded.mechanism.outputs)
    if name in _BY_COORDINATE:
        recorded, labels, units = recorded.by_coordinate(name), (name,), ("J",)
    if name == "forward_dynamics":
        (moved,) = recorded.arguments.of(["qdd"], [])
        labels, units = moved.labels, moved.units
    parts, arguments, meaning = {**_VECTORS, **_BY_COORDINATE}[name]
    entries: dict[Index, Scalar] = {
        (row,): force for row, force in enumerate(parts(recorded))
    }
    arguments = f"{arguments} parameters symbols"
    return recorded.arguments.function(
        name, entries, (labels,), arguments, meaning, units
    )


def _slopes(
    name: str, of: str, by: str, arguments: str, recorded: ControlOutputs
) -> Function:
    """Record the derivatives of one of these functions by the entries of an argument that it is linear in."""
    function = vector(of, recorded)
    program = function.program
    (argument,) = (a for a in function.arguments if a.name == by)
    found = derivatives(program, list(function.outputs), argument.nodes)
    rows = [row for (row,) in function.entries]
    # column by column: the order in which intermediate values are soonest done with
    entries: dict[Index, Scalar] = {
        (rows[row], column): Scalar(program, found[row, column])
        for row, column in sorted(found, key=lambda index: index[1])
    }
    axes = (*function.axes, argument.labels)
    meaning = f"{function.meaning}, per unit of each entry of {by}"
    made = replace(recorded.arguments, program=program)
    return made.function(name, entries, axes, arguments, meaning)


def forward_dynamics_derivatives(recorded: ControlOutputs) -> Function:
    """Record [∂q̈/∂q, ∂q̈/∂q̇, ∂q̈/∂y] = M⁻¹ [−∂r/∂q, −∂r/∂q̇, T], where r are the forces that the motion needs.

    Columns of unit quaternions are those of :func:`inverse_dynamics_derivatives`.
    """
    recorded = recorded.by_coordinate("forward_dynamics_derivatives")
    mechanism, program, copy = recorded.mechanism, recorded.program, Program()
    free, width = mechanism.independent_velocities, len(recorded.state)
    right = np.full((len(free), width + len(mechanism.outputs)), program.zero)
    for index, slope in recorded.state_derivatives().items():
        right[index] = -slope
    for (row, column), rate in recorded.applied.items():
        right[row, width + column] = rate
    known: dict[int, int] = {}

    def copied(values: Array) -> Array:
        nodes = [value.node for value in values.flat]
        found = replayed(program, nodes, copy, known, recorded_operation)
        scalars = [Scalar(copy, node) for node in found]
        return np.array(scalars, dtype=object).reshape(values.shape)

    # the derivatives are those at given accelerations, which the forces cause
    moved = copied(np.array(recorded.accelerations(articulated=False), dtype=object))
    for name, value in zip(free, moved, strict=True):
        known[program.input(f"qdd[{name}]").node] = value.node
    found = solved(copied(recorded.mass_array), copied(right))
    entries: dict[Index, Scalar] = dict(np.ndenumerate(found))
    driven = tuple(f"y[{name}]" for name in row_names(mechanism))
    return replace(recorded.arguments, program=copy).function(
        "forward_dynamics_derivatives",
        entries,
        (free, (*recorded.state, *driven)),
        "q qd y inputs parameters symbols",
        "derivatives of the forward dynamics by positions, velocities and outputs",
    )


def mass_matrix(recorded: ControlOutputs) -> Function:
    """Record M = ∂y/∂q̈."""
    entries = recorded.masses()
    axes = (recorded.names, recorded.mechanism.independent_velocities)
    meaning = "outputs per unit of each acceleration"
    return recorded.arguments.function(
        "mass_matrix", entries, axes, "q parameters symbols", meaning
    )


def inverse_dynamics_derivatives(recorded: ControlOutputs) -> Function:
    """Record [∂y/∂q, ∂y/∂q̇].

    A unit quaternion's four columns are the derivatives of the quaternion of the same direction: they vanish along it,
    so that they hold for changes along the unit sphere and for normalised ones.
    """
    entries = recorded.state_derivatives()
    meaning = "derivatives of the inverse dynamics by positions and velocities"
    axes = (recorded.names, recorded.state)
    arguments = "q qd qdd inputs parameters symbols"
    return recorded.arguments.function(
        "inverse_dynamics_derivatives", entries, axes, arguments, meaning
    )


def regressor(mechanism: Mechanism, pivots: Sequence[int]) -> Function:
    """Record X̄, the columns of the regressor that belong to the parameters."""
    forms = inverse_dynamics_regressor(mechanism, pivots)
    columns = [mechanism.columns[p] for p in pivots]
    parameters = {column.name: column.unit for column in columns}
    arguments = Arguments(mechanism, forms.program, parameters)
    made = arguments.of(["q", "qd", "qdd", "inputs", "symbols"], forms.entries.values())
    meaning = "outputs per unit of each parameter"
    entries: dict[Index, int] = {
        (row, column): node for (row, column), node in forms.entries.items()
    }
    axes = (row_names(mechanism), tuple(parameters))
    return Function("regressor", forms.program, made, entries, axes, meaning=meaning)


def _cheapest(build: Callable[[ControlOutputs], Function]) -> Builder:
    """Record with and without sums of angles, and keep what costs less."""

    def builder(mechanism: Mechanism, pivots: Sequence[int]) -> Function:
        return min(
            (build(ControlOutputs(mechanism, pivots, sums)) for sums in (False, True)),
            key=_price,
        )

    return builder


def _price(function: Function) -> int:
    """Time per sample, roughly: sines, exponentials and the like cost several multiplications each."""
    counts = function.operations()
    return sum(
        n * (_FUNCTION_PRICE if Op[name] >= Op.SIN else 1)
        for name, n in counts.items()
        if name != "NEG"
    )


_DERIVED: Mapping[str, tuple[str, str, str]] = {
    "slotine_li_regressor": (
        "slotine_li",
        "parameters",
        "q qd qdr qddr inputs symbols",
    ),
    "coriolis_matrix": ("slotine_li", "qdr", "q qd parameters symbols"),
    "momentum_regressor": ("momentum", "parameters", "q qd symbols"),
    "momentum_bias_regressor": ("momentum_bias", "parameters", "q qd inputs symbols"),
    "kinetic_energy_regressor": ("kinetic_energy", "parameters", "q qd symbols"),
    "potential_energy_regressor": ("potential_energy", "parameters", "q symbols"),
}
"""Functions that are derivatives: of which function, by which argument, and their own arguments."""

_FUNCTION_PRICE = 25
"""Cost of a sine or cosine in multiplications: in vectorised machine code a pair takes as long as about fifty."""

FUNCTIONS: Mapping[str, Builder] = {
    **{name: _cheapest(partial(vector, name)) for name in (*_VECTORS, *_BY_COORDINATE)},
    "forward_dynamics_derivatives": _cheapest(forward_dynamics_derivatives),
    "mass_matrix": _cheapest(mass_matrix),
    "inverse_dynamics_derivatives": _cheapest(inverse_dynamics_derivatives),
    "regressor": regressor,
    **{name: _cheapest(partial(_slopes, name, *of)) for name, of in _DERIVED.items()},
}
"""Builders by the name of the function."""

CONTACT_FUNCTIONS: Mapping[str, Builder] = {"contact_jacobian": contact_jacobian}
"""Builders of functions that only mechanisms with contacts have, by name."""

WITH_CONTACTS = ("regressor", "contact_jacobian")
"""Functions that base parameters of a mechanism with contacts determine, the first but for forces at the contacts."""

LOOP_FUNCTIONS: Mapping[str, Builder] = {
    "closed_positions": closed_positions,
    "closed_velocities": closed_velocities,
    "closed_accelerations": closed_accelerations,
    "closure_pivots": closure_pivots,
    "constraint_forces": constraint_forces,
}
"""Builders of functions that only mechanisms with loops have, by name."""

ALL_FUNCTIONS: Mapping[str, Builder] = {
    **FUNCTIONS,
    **LOOP_FUNCTIONS,
    **CONTACT_FUNCTIONS,
}


def robot_function(name: str, mechanism: Mechanism, pivots: Sequence[int]) -> Function:
    """Record one function of a mechanism, by its name in :data:`ALL_FUNCTIONS`.

    ``pivots`` are the columns of the regressor whose parameters are arguments: the pivots of the base matrix for base
    parameters, all columns for standard parameters.  Forces of closures depend on all standard parameters.  With loops,
    ``q`` holds all positions, which must be closed, and ``qd`` and ``qdd`` are independent.
    """
    if name not in ALL_FUNCTIONS:
        raise InputError(
            f"there is no function '{name}' (valid: {', '.join(ALL_FUNCTIONS)})"
        )
    if name not in WITH_CONTACTS:
        refuse_contacts(
            mechanism,
            f"{name} needs all that moves, and base parameters of a robot with contacts exclude the effect of "
            f"unknown forces: ask for {' and '.join(WITH_CONTACTS)}, or leave the contacts out",
        )
    return ALL_FUNCTIONS[name](mechanism, pivots)
