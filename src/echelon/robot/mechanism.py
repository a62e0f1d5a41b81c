"""The mechanism: bodies with joints, couplings, drives, effects and gravity, and what is measured on it.

The rows of the regressor X are its measured outputs.  An output is a linear combination of what sensors can measure.  A
sensor is a freedom that never moves: the power of the bodies' wrenches in a virtual motion of that freedom is what it
measures.  A joint torque is the power of the joint's own freedom, a torque or force sensor anywhere between two bodies
that of a turn or a shift of one against the other.  The columns of X are the standard parameters.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Protocol

from echelon.algebra import PER_PI, PI, Polynomial, RationalFunction, inverse_matrix
from echelon.robot.closure import Closure
from echelon.robot.contact import Contact
from echelon.robot.coupling import Coupling
from echelon.robot.effect import Effect, Side
from echelon.robot.impossible import warn_of_impossible
from echelon.robot.joint import (
    GROUND,
    Body,
    Joint,
    Motion,
    MotionKind,
    Placement,
    Symbol,
    Vector,
)
from echelon.robot.term import read_term
from echelon.shared import (
    LENGTH_DEGREE,
    PARAMETERS,
    PER_BODY,
    UNITS,
    InputError,
    check_distinct,
    check_identifier,
    check_text,
    check_title,
    public,
    symbol_stem,
)


@dataclass(frozen=True)
class Force:
    """Torque or force on one side of a drive."""

    at: str  # joint coordinate or actuator
    # at a joint: that of rigid bodies and of effects there; of an actuator: that of everything that its motion moves,
    # and of the effects in the drive
    side: Side

    def output(self, name: str, unit: str) -> Output:
        """The output that is this force."""
        return Output(name, unit, forces=((self, _ONE),))


@dataclass(frozen=True)
class Cut:
    """One component of the wrench that a body gets from its parent (from the ground: all bodies that hang on it)."""

    body: int  # the body; GROUND for the wrench under the base
    frame: Placement  # the sensor's frame in the frame of the body, or of its parent
    on_parent: bool  # whether the frame is fixed to the parent
    axis: int  # 0, 1, 2 for x, y, z of the sensor's frame
    angular: bool  # moment (N·m) or force (N)

    @property
    def component(self) -> str:
        """Its name on a force/torque sensor, such as ``fx`` or ``tz``."""
        return ("t" if self.angular else "f") + "xyz"[self.axis]

    def output(self, name: str, unit: str) -> Output:
        """The output that is this component."""
        return Output(name, unit, cuts=((self, _ONE),))

    def of_sensor(self, name: str) -> Output:
        """The output that is this component of a force/torque sensor."""
        return self.output(f"{name}.{self.component}", "N·m" if self.angular else "N")


@dataclass(frozen=True)
class Output:
    """One measured output, a row of X: y = Σ weight · force + Σ weight · cut.

    Forces and cuts span all that is linear in the bodies' wrenches, so that every kind of sensor is such a sum.
    """

    name: str
    unit: str
    forces: tuple[tuple[Force, Polynomial], ...] = ()
    cuts: tuple[tuple[Cut, Polynomial], ...] = ()
    reads: str = ""  # the output whose measured values are its own as well, by the force of a spring that is zero

    @property
    def sensor(self) -> str:
        """Name of the sensor that it belongs to: one component of a wrench is named after its sensor."""
        if self.reads:
            return self.reads
        alone = not self.forces and len(self.cuts) == 1
        return (self.name.rpartition(".")[0] if alone else "") or self.name


_ONE = Polynomial.constant(1)


@dataclass(frozen=True)
class Parameter:
    """One standard parameter."""

    name: str
    unit: str  # SI unit
    body: int | None = (
        None  # index of the body whose inertia it describes; None for parameters of effects
    )
    kind: int | None = None  # its place in XX … M, for a body's parameter

    @property
    def length_degree(self) -> int:
        """Power of length in the unit of an inertial parameter; 0 for other parameters."""
        return 0 if self.kind is None else LENGTH_DEGREE[self.kind]


@dataclass(frozen=True)
class Actuator:
    """One row of T."""

    name: str  # the actuator's coordinate
    terms: tuple[tuple[str, Polynomial], ...]  # ratio to each joint coordinate


@dataclass(frozen=True)
class Transmission:
    """All actuators, θ = T q and so τ_q = Tᵀ τ_θ, and what an actuator's motion moves."""

    # those stated, then one of the same name for every coordinate that none of them drives
    actuators: tuple[Actuator, ...]
    # T⁻¹ by columns: for each actuator, the joint velocities that a unit of its velocity causes alone
    inverse: Mapping[str, Mapping[str, RationalFunction]]


def transmission(
    stated: Sequence[Actuator], coordinates: Sequence[str]
) -> Transmission:
    """Complete the stated actuators by direct drives and invert T."""
    driven = [
        name
        for name in coordinates
        if any(name == joint for a in stated for joint, _ in a.terms)
    ]
    if len(driven) != len(stated):
        raise InputError(
            f"{len(stated)} actuators drive {len(driven)} coordinates ({', '.join(driven) or 'none'}); their torques "
            "follow from the motion only if the numbers are equal: measure combinations of them as outputs instead",
            element="transmission",
        )
    matrix = [
        [RationalFunction(dict(a.terms).get(name, Polynomial({}))) for name in driven]
        for a in stated
    ]
    solved = inverse_matrix(matrix)
    if solved is None:
        names = ", ".join(a.name for a in stated)
        raise InputError(
            f"the transmission of {names} is singular: its actuators cannot move independently"
        )
    one = Polynomial.constant(1)
    direct = tuple(
        Actuator(name, ((name, one),)) for name in coordinates if name not in driven
    )
    inverse: dict[str, dict[str, RationalFunction]] = {
        a.name: {a.name: RationalFunction(1)} for a in direct
    }
    for k, actuator in enumerate(stated):
        inverse[actuator.name] = {
            name: row[k] for name, row in zip(driven, solved, strict=True) if row[k]
        }
    return Transmission((*stated, *direct), inverse)


@public
@dataclass(frozen=True, repr=False)
class Mechanism:
    """A tree of bodies, its drives, and what is measured.

    Attributes
    ----------
    name : str
    bodies : tuple of Body
        Parents before children; this is the base-to-tip order of the parameters.
    gravity : 3 of Polynomial, or None
        Gravity in the base frame, m/s²; None where there is none.
    couplings : tuple of Coupling
        Relations that make coordinates depend on others.
    symbols : mapping of str to Symbol
        Geometry symbols with their values.
    actuators : tuple of Actuator
        Rows of a transmission θ = T q; coordinates that no actuator drives have a drive of their own name.
    effects : tuple of Effect
        Friction, springs, rotor inertia and other forces with parameters of their own.
    measured : tuple of Output, or None
        The measured outputs; None for the forces of all actuators.
    closures : tuple of Closure
        Joints that close loops.
    independent : tuple of str
        With loops, the velocity coordinates that the others depend on, as many as there are degrees of freedom; empty
        for all of them (see :func:`echelon.loops.closing.close`).
    assembly : mapping of str to float
        Positions near which the loops close, which picks one of several ways to assemble them; zero where absent.
    rounding : float
        Unit of the last decimal of the numbers of its geometry, rad or a share of its size; 0 if they are exact.
    contacts : tuple of Contact
        Places where bodies touch something, and unknown forces act.
    experiments : tuple of str
        Where it stands for several experiments (:func:`echelon.joined`), their names, which are those of the bodies
        that their trees hang on.
    locked : mapping of str to float
        Coordinates and drives that it has no more because they are locked, and where they stand, rad or m.
    reading : Reading, optional
        How it was read from a file; absent if it was not, or was changed since (:meth:`as_read`).

    Raises
    ------
    InputError
        If the parts do not fit together.
    """

    name: str
    bodies: tuple[Body, ...]
    gravity: Vector | None
    couplings: tuple[Coupling, ...] = ()
    symbols: Mapping[str, Symbol] = field(default_factory=dict)
    actuators: tuple[Actuator, ...] = ()
    effects: tuple[Effect, ...] = ()
    measured: tuple[Output, ...] | None = None
    closures: tuple[Closure, ...] = ()
    independent: tuple[str, ...] = ()
    assembly: Mapping[str, float] = field(default_factory=dict)
    rounding: float = 0.0
    contacts: tuple[Contact, ...] = ()
    experiments: tuple[str, ...] = ()
    locked: Mapping[str, float] = field(default_factory=dict, compare=False)
    reading: Reading | None = field(init=False, default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        _check_tree(self)
        _check_couplings(self)
        _check_closures(self)
        _check_contacts(self)
        _check_effects(self)
        _check_outputs(self)
        _check_experiments(self)
        _check_names(self)
        _check_fitted(self)

    def measuring(self, outputs: Iterable[Output]) -> Mechanism:
        """The mechanism with other outputs and all its parameters; effects in sensors that are gone act nowhere."""
        measured = tuple(outputs)
        left = {output.name for output in measured}
        effects = []
        for effect in self.effects:
            actions = [
                action
                for action in effect.actions
                if action.side is not Side.OUTPUT or action.at in left
            ]
            effects.append(replace(effect, actions=tuple(actions)))
        return replace(self, measured=measured, effects=tuple(effects))

    def as_read(self, reading: Reading) -> Mechanism:
        """A copy that remembers its reading; copies by :func:`dataclasses.replace` do not."""
        found = copy(self)
        object.__setattr__(found, "reading", reading)
        return found

    @cached_property
    def motions(self) -> tuple[Motion, ...]:
        """All elementary motions in body order."""
        return tuple(motion for body in self.bodies for motion in body.joint.motions)

    @cached_property
    def dependent(self) -> frozenset[str]:
        """Names of the coordinates that couplings express through others."""
        return frozenset(coupling.coordinate for coupling in self.couplings)

    @cached_property
    def free_motions(self) -> tuple[Motion, ...]:
        """The motions that no coupling makes dependent."""
        return tuple(
            motion for motion in self.motions if motion.name not in self.dependent
        )

    @cached_property
    def positions(self) -> tuple[str, ...]:
        """Names of the position coordinates that no coupling makes dependent, the columns of ``q``."""
        return tuple(name for motion in self.free_motions for name in motion.positions)

    @cached_property
    def velocities(self) -> tuple[str, ...]:
        """Names of the velocity coordinates that no coupling makes dependent, the columns of ``qd`` and ``qdd``."""
        return tuple(name for motion in self.free_motions for name in motion.velocities)

    @cached_property
    def floating_joints(self) -> tuple[Joint, ...]:
        """Joints of floating bases, which have neither drives nor friction."""
        return tuple(body.joint for body in self.bodies if body.joint.is_floating)

    @cached_property
    def floating_velocities(self) -> frozenset[str]:
        """Names of the velocity coordinates of floating bases."""
        motions = (motion for joint in self.floating_joints for motion in joint.motions)
        return frozenset(name for motion in motions for name in motion.velocities)

    @property
    def independent_velocities(self) -> tuple[str, ...]:
        """Names of the velocity coordinates that all others depend on, through couplings and loops."""
        return self.independent or self.velocities

    @cached_property
    def dependent_velocities(self) -> tuple[str, ...]:
        """Names of the velocity coordinates that loops make dependent."""
        return tuple(
            name for name in self.velocities if name not in self.independent_velocities
        )

    @cached_property
    def independent_positions(self) -> tuple[str, ...]:
        """Names of the position coordinates that all others follow from.

        They are those of the independent motions; all of them where a ball is independent in part.
        """
        of = {
            name: motion for motion in self.free_motions for name in motion.velocities
        }
        motions = dict.fromkeys(of[name] for name in self.independent_velocities)
        whole = (
            sum(len(motion.velocities) for motion in motions) == self.degrees_of_freedom
        )
        return (
            tuple(name for motion in motions for name in motion.positions)
            if whole
            else self.positions
        )

    @property
    def degrees_of_freedom(self) -> int:
        """Number of independent velocity coordinates."""
        return len(self.independent_velocities)

    @cached_property
    def sharing(self) -> tuple[tuple[int, ...], ...]:
        """For every body, all bodies with its label, which share its parameters; itself among them."""
        by_label: dict[str, list[int]] = {}
        for index, body in enumerate(self.bodies):
            by_label.setdefault(body.label, []).append(index)
        return tuple(tuple(by_label[body.label]) for body in self.bodies)

    @property
    def carriers(self) -> tuple[int, ...]:
        """The bodies with parameters, of those that share them the first."""
        return tuple(
            k
            for k, body in enumerate(self.bodies)
            if body.carried and self.sharing[k][0] == k
        )

    def carrier_name(self, body: int) -> str:
        """Names of a body and of those that share its parameters; in experiments, those that their robots have."""
        names = [self.bodies[k].name for k in self.sharing[body]]
        prefixes = tuple(f"{name}." for name in self.experiments)
        if prefixes:
            names = [
                n.partition(".")[2] if n.startswith(prefixes) else n for n in names
            ]
        return ", ".join(dict.fromkeys(names))

    def ends(self, closure: str) -> str:
        """Names of the bodies that a closure of some name connects."""
        found = next(c for c in self.closures if c.name == closure)
        return " and ".join(
            "the base" if b == GROUND else self.bodies[b].name
            for b in (found.first, found.second)
        )

    def joint_label(self, body: int) -> str:
        """The ending of names of effects at a body's joint: its label, or the joint's name if the label is shared."""
        shared = len(self.sharing[body]) > 1
        return (
            symbol_stem(self.bodies[body].joint.name)
            if shared
            else self.bodies[body].label
        )

    @cached_property
    def columns(self) -> tuple[Parameter, ...]:
        """The standard parameters: those of the bodies, then those of the effects."""
        bodies = self.bodies
        pairs = ((i, k) for i in self.carriers for k in bodies[i].carried)
        inertial = (
            Parameter(f"{PARAMETERS[k]}{bodies[i].label}", UNITS[k], i, k)
            for i, k in pairs
        )
        return (
            *inertial,
            *(Parameter(effect.parameter, effect.unit) for effect in self.effects),
        )

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the standard parameters, in column order."""
        return tuple(parameter.name for parameter in self.columns)

    @cached_property
    def first_column(self) -> dict[int, int]:
        """For every body that carries parameters, its own or those that it shares, the column of the first."""
        first: dict[int, int] = {}
        for column, parameter in enumerate(self.columns):
            for body in () if parameter.body is None else self.sharing[parameter.body]:
                first.setdefault(body, column)
        return dict(sorted(first.items()))

    @cached_property
    def transmission(self) -> Transmission:
        """The transmission, completed by direct drives."""
        return transmission(self.actuators, self.independent_velocities)

    @cached_property
    def outputs(self) -> tuple[Output, ...]:
        """The measured outputs, the rows of X."""
        if self.measured is not None:
            return self.measured
        sliding = {
            n
            for m in self.motions
            if m.kind is MotionKind.TRANSLATION
            for n in m.velocities
        }
        return tuple(
            Force(a.name, Side.ACTUATOR).output(
                a.name, "N" if a.terms[0][0] in sliding else "N·m"
            )
            for a in self.transmission.actuators
        )

    @property
    def sensed(self) -> tuple[Output, ...]:
        """The outputs with measured values of their own."""
        return tuple(output for output in self.outputs if not output.reads)

    @property
    def stated_outputs(self) -> tuple[Output, ...]:
        """Sensors that are stated, with measured values of their own: those that may have effects such as a zero."""
        return () if self.measured is None else self.sensed

    @property
    def springs(self) -> frozenset[str]:
        """Drives without motors: the springs of elastic drives."""
        sensed = {force.at for output in self.sensed for force, _ in output.forces}
        every = {force.at for output in self.outputs for force, _ in output.forces}
        return frozenset(every - sensed)

    @cached_property
    def cuts(self) -> tuple[Cut, ...]:
        """Components of wrenches between bodies that some output measures."""
        return tuple(
            dict.fromkeys(
                cut for output in self.measured or () for cut, _ in output.cuts
            )
        )

    @property
    def measures_every_force(self) -> bool:
        """Whether the outputs are the forces of all independent coordinates, through a transmission or not."""
        return self.measured is None

    def standard_values(self) -> tuple[float | None, ...]:
        """Standard parameters stated by the file, None where it is silent.

        Warns with a :class:`~echelon.DoubtWarning` of every link whose inertia no body can have.
        """
        warn_of_impossible(
            [self.bodies[k] for index in self.carriers for k in self.sharing[index]]
        )
        values: list[float | None] = []
        for index in self.carriers:
            stated = (self.bodies[k].inertial for k in self.sharing[index])
            inertial = next((values for values in stated if values is not None), None)
            values += [
                None if inertial is None else inertial[k]
                for k in self.bodies[index].carried
            ]
        return (*values, *(effect.value for effect in self.effects))

    def __repr__(self) -> str:
        return f"Mechanism({self})"

    def __str__(self) -> str:
        return f"{self.name}: {len(self.bodies)} bodies, {self.degrees_of_freedom} degrees of freedom"


@dataclass(frozen=True)
class Snap:
    """One number of a file that was read as a nearby exact one."""

    element: str  # where it stands, e.g. ``"joint 'elbow' rpy[0]"``
    literal: str  # the number in the file
    intended: str  # what it was taken for
    difference: float  # size of the change, rad or m

    def __str__(self) -> str:
        return f"{self.element}: {self.literal} read as {self.intended}"


class ReadableFile(Protocol):
    """A file that mechanisms can be built from (:class:`echelon.formats.robot_file.RobotFile`)."""

    def mechanism(
        self, options: Any = ..., literal: Collection[str] = ...
    ) -> Mechanism:
        """The robot, with the numbers of some elements taken literally."""
        ...

    @property
    def motions(self) -> Mapping[str, Any]:
        """Motions that were driven, by experiment."""
        ...


@dataclass(frozen=True)
class Reading:
    """The file that a mechanism was read from, and what its reader made of it."""

    snaps: tuple[Snap, ...]  # numbers that were read as nearby exact ones
    notes: tuple[str, ...]  # remarks of the reader for the user
    file: ReadableFile
    options: Any  # how the file was read
    couples: bool = False  # whether the file couples joints, whatever was made of it
    driven: tuple[
        str, ...
    ] = ()  # coordinates, or joints, of which the file says that they have drives

    def literal(self, elements: Collection[str] | None = None) -> Mechanism:
        """The mechanism with these snapped elements (all, if omitted) taken literally."""
        chosen = {snap.element for snap in self.snaps} if elements is None else elements
        return self.file.mechanism(self.options, chosen)

    def recoupled(self) -> Mechanism | None:
        """The mechanism with the file's couplings ignored, or kept if they are ignored; None if it has none."""
        if not self.couples:
            return None
        return self.file.mechanism(
            replace(
                self.options, independent_mimics=not self.options.independent_mimics
            )
        )


def setup_placements(mechanism: Mechanism) -> list[Placement]:
    """Placements beside those of the joints: of sensors and closures."""
    frames = [frame for closure in mechanism.closures for frame in closure.placements]
    frames += [contact.frame for contact in mechanism.contacts]
    return [*(cut.frame for cut in mechanism.cuts), *frames]


def setup_ratios(mechanism: Mechanism) -> list[Polynomial]:
    """Expressions beside those of placements and of gravity: ratios and weights."""
    found = [
        value
        for coupling in mechanism.couplings
        for _, f in coupling.terms
        for value in f.expressions
    ]
    found += [ratio for actuator in mechanism.actuators for _, ratio in actuator.terms]
    return found + [
        weight
        for output in mechanism.measured or ()
        for _, weight in (*output.forces, *output.cuts)
    ]


def _check_tree(mechanism: Mechanism) -> None:
    coordinates: set[str] = set()
    for index, body in enumerate(mechanism.bodies):
        where = f"body '{body.name}'"
        if not GROUND <= body.parent < index:
            raise InputError("its parent must come before it", element=where)
        if body.inertial is not None and len(body.inertial) != PER_BODY:
            raise InputError(
                f"expected {PER_BODY} inertial values, got {len(body.inertial)}",
                element=where,
            )
        first = mechanism.bodies[mechanism.sharing[index][0]]
        shared = f"it shares the label '{body.label}', and so its parameters, with '{first.name}'"
        if body.carried != first.carried:
            raise InputError(
                f"{shared}, which carries others of the ten", element=where
            )
        if (
            None not in (body.inertial, first.inertial)
            and body.inertial != first.inertial
        ):
            raise InputError(
                f"{shared}, for which other inertial values are stated", element=where
            )
        for motion in body.joint.motions:
            if motion.name in coordinates:
                raise InputError(
                    f"coordinate '{motion.name}' occurs twice",
                    element=f"joint '{body.joint.name}'",
                )
            coordinates.add(motion.name)
    names = [
        parameter.name for parameter in mechanism.columns if parameter.body is not None
    ]
    twice = (
        sorted({name for name in names if names.count(name) > 1})
        if len(set(names)) < len(names)
        else []
    )
    if twice:
        raise InputError(
            f"labels such as 1 and X1 give two parameters the name '{twice[0]}'; choose other labels"
        )


def _check_couplings(mechanism: Mechanism) -> None:
    scalar = {m.name for m in mechanism.motions if len(m.positions) == 1}
    dependent = [coupling.coordinate for coupling in mechanism.couplings]
    for coupling in mechanism.couplings:
        where = f"coupling of '{coupling.coordinate}'"
        if dependent.count(coupling.coordinate) > 1:
            raise InputError("the coordinate is coupled more than once", element=where)
        for name in (coupling.coordinate, *(name for name, _ in coupling.terms)):
            if name not in scalar:
                valid = ", ".join(sorted(scalar)) or "none"
                raise InputError(
                    f"'{name}' is not a single coordinate (valid: {valid})",
                    element=where,
                )
        if mechanism.closures and any(function.knots for _, function in coupling.terms):
            raise InputError(
                "with loops, couplings must be polynomials; state the right piece of the spline, or read the "
                "model without couplings (--mimic independent, independent_mimics=True)",
                element=where,
            )
        for name, _ in coupling.terms:
            if name in dependent:
                raise InputError(
                    f"'{name}' is itself dependent; refer to independent ones only",
                    element=where,
                )


def _check_closures(mechanism: Mechanism) -> None:
    for closure in mechanism.closures:
        where = f"closure '{closure.name}'"
        for body in (closure.first, closure.second):
            if not GROUND <= body < len(mechanism.bodies):
                raise InputError(
                    "it connects a body that does not exist", element=where
                )
        if closure.first == closure.second:
            raise InputError("it connects a body to itself", element=where)
    for name in mechanism.independent:
        if name not in mechanism.velocities:
            valid = ", ".join(mechanism.velocities)
            raise InputError(
                f"'{name}' cannot be an independent coordinate (valid: {valid})",
                element="independent",
            )


def refuse_contacts(
    mechanism: Mechanism, problem: str, source: str | None = None
) -> None:
    """Refuse a robot at whose contacts unmeasured forces act, by a sentence that says why and what is possible."""
    if mechanism.contacts:
        where = f"contact '{mechanism.contacts[0].name}'"
        raise InputError(problem, source=source, element=where)


def _check_contacts(mechanism: Mechanism) -> None:
    if mechanism.closures:
        refuse_contacts(
            mechanism,
            "a robot with loops cannot have contacts with unknown forces: state them as loops to the ground",
        )
    names = [contact.name for contact in mechanism.contacts]
    for contact in mechanism.contacts:
        where = f"contact '{contact.name}'"
        if names.count(contact.name) > 1:
            raise InputError(
                "two contacts have this name; give them names of their own (name: heel)",
                element=where,
            )
        if (contact.radius.number or 0) < 0:  # type: ignore[operator]
            raise InputError("its radius is negative", element=where)
        if not 0 <= contact.body < len(mechanism.bodies):
            raise InputError("it is at a body that does not exist", element=where)
        for component in contact.measured:
            valid = contact.kind.components
            if component not in valid:
                raise InputError(
                    f"'{component}' is no component of its force (valid: {', '.join(valid)})",
                    element=where,
                )


_OWN_STATE = {"q", "qd", "qdd", "i"}  # of the place where a term acts


def _check_effects(mechanism: Mechanism) -> None:
    taken = {
        parameter.name for parameter in mechanism.columns if parameter.body is not None
    }
    symbols = {
        name for body in mechanism.bodies for name in body.joint.symbols()
    } | set(mechanism.symbols)
    clash = next((name for name in sorted(symbols) if name in taken), None)
    if clash is not None:
        raise InputError(
            f"the symbol '{clash}' has the name of a standard parameter; rename it"
        )
    joints = [name for motion in mechanism.motions for name in motion.velocities]
    places = {
        Side.JOINT: joints,
        Side.ACTUATOR: [a.name for a in mechanism.transmission.actuators],
        Side.OUTPUT: [o.name for o in mechanism.stated_outputs],
    }
    named: dict[str, Effect] = {}
    for effect in mechanism.effects:
        where = f"effect '{effect.parameter}'"
        other = named.setdefault(effect.parameter, effect)
        if other is not effect:
            acts = ", ".join(
                f"{action.term} at {action.at}" for action in other.actions
            )
            problem = f"another parameter ({acts}) has this name; choose another label"
            raise InputError(problem, element=where)
        if effect.parameter in taken or effect.parameter in symbols:
            problem = "another parameter or symbol has this name; choose another label"
            raise InputError(problem, element=where)
        for action in effect.actions:
            try:
                term = read_term(action.term)
            except InputError as error:
                raise InputError(error.problem, element=where) from None
            if action.at not in places[action.side]:
                names = ", ".join(places[action.side]) or "none"
                raise InputError(
                    f"there is no {action.side} '{action.at}' (valid: {names})",
                    element=where,
                )
            own = sorted(_OWN_STATE & term.symbols)
            if effect.bristles is not None:
                own.append("i")
            if action.side is Side.OUTPUT and own:
                such = f", such as {own[0]}[{joints[0]}]" if joints else ""
                raise InputError(
                    f"the output '{action.at}' has no {own[0]} of its own: name a joint or an actuator{such}",
                    element=where,
                )


def _check_outputs(mechanism: Mechanism) -> None:
    names = [output.name for output in mechanism.outputs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError("two outputs have this name", element=f"output '{twice}'")
    drives = [actuator.name for actuator in mechanism.transmission.actuators]
    for output in mechanism.outputs:
        where = f"output '{output.name}'"
        if not all(
            GROUND <= cut.body < len(mechanism.bodies) for cut, _ in output.cuts
        ):
            raise InputError("it is at a body that does not exist", element=where)
        for force, _ in output.forces:
            valid = (
                mechanism.independent_velocities if force.side is Side.JOINT else drives
            )
            if force.at not in valid:
                problem = f"'{force.at}' is not measurable here (valid: {', '.join(valid) or 'none'})"
                raise InputError(problem, element=where)


def _check_experiments(mechanism: Mechanism) -> None:
    """Trees of experiments hang on bodies without mass of their names, and follow one another."""
    current = ""
    for body in mechanism.bodies if mechanism.experiments else ():
        starts = body.name in mechanism.experiments
        if starts and (
            body.parent != GROUND or body.carried or not body.joint.is_fixed
        ):
            raise InputError(
                "the base of an experiment is fixed to the ground and has no mass",
                element=f"body '{body.name}'",
            )
        current = body.name if starts else current
        if not starts and not body.name.startswith(f"{current}."):
            raise InputError(
                "it belongs to no experiment: names of bodies begin with that of theirs",
                element=f"body '{body.name}'",
            )
        if not starts and body.parent == GROUND:
            raise InputError(
                f"it does not hang on the base of experiment '{current}'",
                element=f"body '{body.name}'",
            )
    names = {body.name for body in mechanism.bodies}
    strange = [name for name in mechanism.experiments if name not in names]
    if strange:
        raise InputError(
            f"experiment '{strange[0]}' has no base", element="experiments"
        )


def _check_fitted(mechanism: Mechanism) -> None:
    """Refuse symbols that logs have to tell, where more than effects depends on them."""
    placed = [e for frame in setup_placements(mechanism) for e in frame.entries()]
    others = (*placed, *setup_ratios(mechanism), *(mechanism.gravity or ()))
    used = {name for value in others for name in value.symbols()}
    used.update(name for body in mechanism.bodies for name in body.joint.symbols())
    for name, symbol in mechanism.symbols.items():
        if symbol.fit is not None and name in used:
            raise InputError(
                "only constants of effects are fitted, and the geometry depends on it",
                element=f"symbol '{name}'",
            )


def _check_names(mechanism: Mechanism) -> None:
    """Refuse names because of which a row of a result could be read as another."""
    for body in mechanism.bodies:
        check_identifier(body.label, f"label of body '{body.name}'")
    for name in mechanism.symbols.keys() - {
        PI,
        PER_PI,
    }:  # which no file can call a symbol of its own
        check_identifier(name, f"symbol '{name}'", composed=True)
    for effect in mechanism.effects:
        check_identifier(
            effect.parameter, f"effect '{effect.parameter}'", composed=True
        )
        check_text(effect.unit, f"unit of effect '{effect.parameter}'")
    for output in mechanism.measured or ():
        check_text(output.unit, f"unit of output '{output.name}'")
    in_formulas = (*mechanism.parameters, *mechanism.symbols)
    check_distinct(in_formulas, "parameters and symbols")
    known = frozenset(in_formulas)
    for what, names in _titles(mechanism).items():
        for name in names:
            check_title(name, f"{what} '{name}'", known)
        check_distinct(names, f"{what} names")


def _titles(mechanism: Mechanism) -> dict[str, list[str]]:
    """Names that stand beside formulas, by what they name."""
    return {
        "body": [body.name for body in mechanism.bodies],
        "joint": [body.joint.name for body in mechanism.bodies],
        "coordinate": [motion.name for motion in mechanism.motions],
        "actuator": [actuator.name for actuator in mechanism.actuators],
        "output": [output.name for output in mechanism.measured or ()],
        "loop": [closure.name for closure in mechanism.closures],
        "contact": [contact.name for contact in mechanism.contacts],
    }
