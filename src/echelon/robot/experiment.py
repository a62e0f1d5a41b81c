"""Experiments: set-ups of a robot, and several of them as one mechanism whose trees share parameters.

The base parameters of several experiments are those of the stacked rows of all (Theorem 1, with W as it is in the
paper).  A mechanism with one tree for each experiment, in which bodies with one label share their parameters, has just
these rows: its trees move independently, so its row space is the sum of theirs.  So every question that can be asked
about a mechanism can be asked about experiments.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from os import PathLike
from typing import Any, TypeVar

import numpy as np

from echelon.robot.closure import Closure
from echelon.robot.contact import Contact
from echelon.robot.coupling import Coupling
from echelon.robot.effect import Action, Effect
from echelon.robot.joint import (
    ALL,
    GROUND,
    Body,
    Joint,
    Motion,
    Placement,
    Vector,
    merge,
)
from echelon.robot.locking import lock_joints
from echelon.robot.mechanism import Actuator, Cut, Mechanism, Output, Reading
from echelon.robot.rational_turns import rational_rotation
from echelon.robot.sources import Readable, mechanism_of
from echelon.robot.term import read_term
from echelon.shared import (
    InputError,
    check_distinct,
    check_identifier,
    nearest_of,
    public,
)

T = TypeVar("T")

TILT_TOLERANCE = 1e-9
"""Relative error of rational numbers for a direction of gravity, far below what bases are levelled to."""


@public
@dataclass(frozen=True)
class Experiment:
    """One set-up in which a robot is measured.

    Attributes
    ----------
    robot : Mechanism or path-like
        A robot, or the file of one.  Bodies of several experiments that have one label are one body.
    name : str
        Name of the experiment; ``e1``, ``e2`` … in the order of a list if omitted.
    locked : mapping of str to float
        Coordinates, or joints, that do not move, and where they stand, rad or m.
    sensors : sequence of str, optional
        Outputs and sensors of the robot that are measured, ``base`` for the wrench under it; all outputs if omitted.
    gravity : 3 numbers, optional
        Gravity in the base frame, as the robot's own but turned: its direction counts, of any length.
    payloads : mapping of str to str
        Loads with unknown inertias: a name, and the body that carries it.  One name is one load, in all experiments.
    contacts : sequence of str, optional
        Contacts of the robot that touch, by name; all of them if omitted.
    open_loops : bool
        Whether the robot's loops are open in this experiment.
    motion : mapping of str to array, or path-like, optional
        The motion that was driven, for :func:`echelon.sampled_rank`; base parameters are those of all motions.

    Raises
    ------
    InputError
        When it is used, if it names what the robot does not have, or gravity cannot be turned.

    Examples
    --------
    >>> import echelon as ec
    >>> table = ec.Experiment("examples/panda.yaml", "table")
    >>> wall = ec.Experiment("examples/panda.yaml", "wall", gravity=(9.81, 0, 0))
    >>> ec.base_parameters(table).rank, ec.base_parameters([table, wall]).rank
    (43, 45)
    """

    robot: Mechanism | Readable
    name: str = ""
    locked: Mapping[str, float] = field(default_factory=dict)
    sensors: Sequence[str] | None = None
    gravity: Sequence[float] | None = None
    payloads: Mapping[str, str] = field(default_factory=dict)
    contacts: Sequence[str] | None = None
    open_loops: bool = False
    motion: Mapping[str, Any] | str | PathLike[str] | None = None

    @cached_property
    def mechanism(self) -> Mechanism:
        """The robot as this experiment has it, mounted on its own base frame."""
        robot = mechanism_of(self.robot)
        if robot.experiments:
            raise InputError("it consists of experiments itself", element=self._where)
        if self.open_loops:
            robot = replace(robot, closures=(), independent=(), assembly={})
        if self.contacts is not None:
            robot = replace(
                robot, contacts=_touching(robot, self.contacts, self._where)
            )
        if self.sensors is not None:
            robot = robot.measuring(_chosen(robot, self.sensors, self._where))
        for load, body in self.payloads.items():
            robot = _loaded(robot, load, body, self._where)
        held = lock_joints(robot, self.locked)
        measured = {output.name for output in held.outputs}
        asked = [output.name for output in robot.outputs] if self.sensors else []
        gone = next((name for name in asked if name not in measured), None)
        if gone is not None:
            raise InputError(
                f"'{gone}' is locked, so its force is not measured: leave it out of the sensors",
                element=self._where,
            )
        if not measured:
            raise InputError(
                "it measures nothing, since all joints are locked", element=self._where
            )
        return held

    @cached_property
    def mounting(self) -> Placement:
        """Where the base stands against that of the robot's file: turned, so that gravity has the stated direction."""
        if self.gravity is None:
            return Placement()
        own = mechanism_of(self.robot).gravity
        return _turned_to(own, self.gravity, self._where)

    @property
    def _where(self) -> str:
        return f"experiment '{self.name}'" if self.name else "experiment"


def _chosen(robot: Mechanism, names: Sequence[str], where: str) -> tuple[Output, ...]:
    """Outputs by their names or those of their sensors."""
    base = [
        Cut(GROUND, Placement(), False, axis, angular).of_sensor("base")
        for axis in range(3)
        for angular in (False, True)
    ]
    known = {output.name: [output] for output in robot.outputs}
    for output in (*robot.outputs, *base):
        of_sensor = known.setdefault(output.sensor, [])
        if output not in of_sensor:
            of_sensor.append(output)
    found: dict[str, Output] = {}
    for name in names:
        if name not in known:
            raise InputError(
                f"there is no sensor '{name}'{nearest_of(name, list(known))}",
                element=where,
            )
        found |= {output.name: output for output in known[name]}
    if not found:
        raise InputError(
            "it measures nothing; name a sensor, or leave sensors out for all",
            element=where,
        )
    return tuple(found.values())


def _touching(
    robot: Mechanism, names: Sequence[str], where: str
) -> tuple[Contact, ...]:
    """Contacts by their names."""
    known = {contact.name: contact for contact in robot.contacts}
    strange = next((name for name in names if name not in known), None)
    if strange is not None:
        raise InputError(
            f"there is no contact '{strange}'{nearest_of(strange, list(known))}",
            element=where,
        )
    return tuple(known[name] for name in dict.fromkeys(names))


def _loaded(robot: Mechanism, name: str, carrier: str, where: str) -> Mechanism:
    """The robot with a body more, which is rigidly on another and has parameters of its own."""
    check_identifier(name, f"payload '{name}'")
    bodies = [body.name for body in robot.bodies]
    if name in bodies:
        raise InputError(
            f"payload '{name}' has the name of a body; choose another", element=where
        )
    if carrier not in bodies:
        raise InputError(
            f"payload '{name}': there is no body '{carrier}'{nearest_of(carrier, bodies)}",
            element=where,
        )
    joint = Joint(f"{name}_on_{carrier}", "fixed", ())
    load = Body(name, f"_{name}", bodies.index(carrier), joint, ALL)
    return replace(robot, bodies=(*robot.bodies, load))


def _turned_to(own: Vector | None, wanted: Sequence[float], where: str) -> Placement:
    """The rotation of a base in which the robot's own gravity has a wanted direction."""
    numbers = None if own is None else [g.number for g in own]
    if numbers is None or None in numbers:
        problem = "is absent" if own is None else "has symbols"
        raise InputError(
            f"the robot's own gravity {problem}, so it cannot be turned: state gravity with numbers in its file",
            element=where,
        )
    stated = np.array(wanted, dtype=float)
    if stated.shape != (3,) or not np.isfinite(stated).all() or not stated.any():
        raise InputError(
            f"gravity is {list(wanted)}; expected three numbers, not all zero",
            element=where,
        )
    world = np.array(numbers, dtype=float)
    world, stated = world / np.linalg.norm(world), stated / np.linalg.norm(stated)
    cosine, axis = float(stated @ world), np.cross(stated, world)
    if cosine < -1 + TILT_TOLERANCE:  # upside down: half a turn about any level axis
        cosine, axis = -1.0, np.cross(world, np.eye(3)[np.abs(world).argmin()])
    return rational_rotation((1 + cosine, *axis), TILT_TOLERANCE)


# -- one mechanism of several experiments ------------------------------------------------------------------------------


@public
def joined(experiments: Sequence[Experiment]) -> Mechanism:
    """One mechanism with a tree for each experiment; bodies with one label share their parameters.

    Parameters
    ----------
    experiments : sequence of Experiment
        With different names, or without.

    Returns
    -------
    Mechanism
        Coordinates, outputs and bodies are named ``experiment.name``; of a single experiment they keep their names.

    Raises
    ------
    InputError
        If there are none, names occur twice, or the robots disagree about a body or a symbol.
    """
    if not experiments:
        raise InputError("there are no experiments; give at least one")
    named = [
        replace(e, name=e.name or f"e{k}") for k, e in enumerate(experiments, start=1)
    ]
    for e in named:
        check_identifier(e.name, f"experiment '{e.name}'")
    names = [e.name for e in named]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"two experiments have the name '{twice}'")
    check_distinct(names, "experiments")
    whole = _stacked(named)
    readings = [m.reading for m in (mechanism_of(e.robot) for e in named)]
    known = [reading for reading in readings if reading is not None]
    files = _Files(tuple(named))
    if not known and not files.motions:
        return whole
    return whole.as_read(
        Reading(
            tuple(dict.fromkeys(snap for r in known for snap in r.snaps)),
            tuple(dict.fromkeys(note for r in known for note in r.notes)),
            files,
            None,
        )
    )


@dataclass(frozen=True)
class _Files:
    """The files of the robots of some experiments."""

    experiments: tuple[Experiment, ...]

    @property
    def motions(self) -> dict[str, Any]:
        """Motions that were driven, by experiment."""
        return {e.name: e.motion for e in self.experiments if e.motion is not None}

    def mechanism(
        self,
        options: Any = None,  # noqa: ARG002  those of each file
        literal: Collection[str] = (),
    ) -> Mechanism:
        """The experiments with the numbers of some elements of their files taken literally."""
        robots = [mechanism_of(e.robot) for e in self.experiments]
        taken = [r if r.reading is None else r.reading.literal(literal) for r in robots]
        pairs = zip(self.experiments, taken, strict=True)
        return _stacked([replace(e, robot=robot) for e, robot in pairs])


def _stacked(experiments: Sequence[Experiment]) -> Mechanism:
    """The mechanism of experiments with names."""
    alone = len(experiments) == 1
    if alone and experiments[0].mounting.is_identity:
        return experiments[0].mechanism
    bodies, trees = list[Body](), list[_Branch]()
    for e in experiments:
        mounted = Joint(f"{e.name}.base", "fixed", (e.mounting,))
        base = Body(e.name, f"{e.name}_base", GROUND, mounted, carried=())
        new_name = str if alone else partial(_prefixed, e.name)
        tree = _Branch(e.mechanism, len(bodies) + 1, new_name)
        bodies += [base, *tree.bodies(range(len(e.mechanism.bodies)), len(bodies))]
        trees.append(tree)
    mechanisms = [e.mechanism for e in experiments]
    return Mechanism(
        " + ".join(e.name for e in experiments),
        tuple(bodies),
        _common_gravity(experiments),
        couplings=tuple(c for tree in trees for c in tree.couplings()),
        symbols=_agreed("symbol", [m.symbols for m in mechanisms]),
        actuators=tuple(a for tree in trees for a in tree.actuators()),
        effects=_merged([effect for tree in trees for effect in tree.effects()]),
        measured=None
        if all(m.measures_every_force for m in mechanisms)
        else tuple(o for tree in trees for o in tree.outputs()),
        closures=tuple(c for tree in trees for c in tree.closures()),
        independent=tuple(n for tree in trees for n in tree.independent())
        if any(m.closures for m in mechanisms)
        else (),
        assembly={
            n: at for tree in trees for n, at in tree.positions("assembly").items()
        },
        rounding=max(m.rounding for m in mechanisms),
        contacts=tuple(c for tree in trees for c in tree.contacts()),
        experiments=() if alone else tuple(e.name for e in experiments),
        locked={n: at for tree in trees for n, at in tree.positions("locked").items()},
    )


def experiment_of(mechanism: Mechanism, name: str) -> Mechanism:
    """The mechanism of one of several experiments, with the names that its own robot has and with all parameters.

    Bodies that only other experiments have are on the ground, where no output sees them, and effects act nowhere.

    Parameters
    ----------
    mechanism : Mechanism
        From :func:`joined`, perhaps with other expressions or values since.
    name : str

    Raises
    ------
    InputError
        If there is no such experiment.
    """
    names = mechanism.experiments
    if name not in names:
        raise InputError(
            f"there is no experiment '{name}'{nearest_of(name, list(names))}"
        )
    bases = [k for k, body in enumerate(mechanism.bodies) if body.name in names]
    ends = dict(pairwise([*bases, len(mechanism.bodies)]))
    first = next(k for k in bases if mechanism.bodies[k].name == name)
    tree = _Branch(mechanism, -first, partial(_without_prefix, name))
    bodies = list(tree.bodies(range(first, ends[first]), GROUND))
    labels = {body.label for body in bodies}
    absent = [mechanism.bodies[k] for k in mechanism.carriers]
    for body in (body for body in absent if body.label not in labels):
        at_rest = Joint(body.joint.name, "fixed", ())
        bodies.append(replace(body, parent=GROUND, joint=at_rest))
    return tree.whole(name, bodies)


def renamed(mechanism: Mechanism, new_name: Callable[[str], str]) -> Mechanism:
    """A mechanism whose bodies, joints, coordinates, outputs and loops have other names."""
    tree = _Branch(mechanism, 0, new_name)
    bodies = tree.bodies(range(len(mechanism.bodies)), GROUND)
    return tree.whole(mechanism.name, bodies)


# -- names and places --------------------------------------------------------------------------------------------------


def _prefixed(experiment: str, name: str) -> str:
    return f"{experiment}.{name}"


def _without_prefix(experiment: str, name: str) -> str | None:
    """A name as the robot of an experiment has it; None for what belongs to others."""
    prefix = f"{experiment}."
    if name == experiment:
        return name
    return name.removeprefix(prefix) if name.startswith(prefix) else None


@dataclass(frozen=True)
class _Branch:
    """A mechanism's parts with other names, and bodies by other indices; parts without a new name are left out."""

    mechanism: Mechanism
    shift: int  # what is added to indices of bodies
    renamed: Callable[[str], str | None]

    def whole(self, name: str, bodies: Iterable[Body]) -> Mechanism:
        """A mechanism of these parts and some bodies."""
        return Mechanism(
            name,
            tuple(bodies),
            self.mechanism.gravity,
            tuple(self.couplings()),
            self.mechanism.symbols,
            tuple(self.actuators()),
            tuple(self.effects()),
            None if self.mechanism.measured is None else tuple(self.outputs()),
            tuple(self.closures()),
            tuple(self.independent()) if self.mechanism.independent else (),
            self.positions("assembly"),
            self.mechanism.rounding,
            tuple(self.contacts()),
            locked=self.positions("locked"),
        )

    def bodies(self, chosen: Iterable[int], ground: int) -> Iterator[Body]:
        """Some bodies; those on the ground hang on a body of an index."""
        for k in chosen:
            body = self.mechanism.bodies[k]
            parent = ground if body.parent == GROUND else body.parent + self.shift
            steps = tuple(
                replace(step, name=self._name(step.name))
                if isinstance(step, Motion)
                else step
                for step in body.joint.steps
            )
            joint = Joint(self._name(body.joint.name), body.joint.kind, merge(steps))
            yield replace(body, name=self._name(body.name), parent=parent, joint=joint)

    def couplings(self) -> Iterator[Coupling]:
        """Couplings of coordinates that have a name."""
        for coupling in self.mechanism.couplings:
            coordinate = self.renamed(coupling.coordinate)
            if coordinate is not None:
                yield Coupling(coordinate, self._terms(coupling.terms))

    def actuators(self) -> Iterator[Actuator]:
        """Actuators that have a name."""
        for actuator in self.mechanism.actuators:
            name = self.renamed(actuator.name)
            if name is not None:
                yield Actuator(name, self._terms(actuator.terms))

    def effects(self) -> Iterator[Effect]:
        """All effects, with what they do at places that have a name."""
        for effect in self.mechanism.effects:
            actions = [
                Action(name, action.side, self._term(action.term))
                for action in effect.actions
                if (name := self.renamed(action.at)) is not None
            ]
            yield replace(effect, actions=tuple(actions))

    def outputs(self) -> Iterator[Output]:
        """Outputs that have a name."""
        for output in self.mechanism.outputs:
            name = self.renamed(output.name)
            if name is not None:
                forces = [
                    (replace(force, at=self._name(force.at)), weight)
                    for force, weight in output.forces
                ]
                cuts = [
                    (replace(cut, body=cut.body + self.shift), weight)
                    for cut, weight in output.cuts
                ]
                yield replace(
                    output,
                    name=name,
                    forces=tuple(forces),
                    cuts=tuple(cuts),
                    reads=self._name(output.reads) if output.reads else "",
                )

    def closures(self) -> Iterator[Closure]:
        """Closures that have a name."""
        for closure in self.mechanism.closures:
            name = self.renamed(closure.name)
            if name is not None:
                first, second = closure.first + self.shift, closure.second + self.shift
                yield replace(closure, name=name, first=first, second=second)

    def contacts(self) -> Iterator[Contact]:
        """Contacts that have a name."""
        for contact in self.mechanism.contacts:
            name = self.renamed(contact.name)
            if name is not None:
                yield replace(contact, name=name, body=contact.body + self.shift)

    def independent(self) -> Iterator[str]:
        """Independent velocity coordinates that have a name."""
        for coordinate in self.mechanism.independent_velocities:
            name = self.renamed(coordinate)
            if name is not None:
                yield name

    def positions(self, stated: str) -> dict[str, float]:
        """Positions that the mechanism states as ``assembly`` or ``locked``, of coordinates that have a name."""
        given: Mapping[str, float] = getattr(self.mechanism, stated)
        found = {self.renamed(name): at for name, at in given.items()}
        return {name: at for name, at in found.items() if name is not None}

    def _name(self, name: str) -> str:
        return self.renamed(name) or name

    def _terms(self, terms: Iterable[tuple[str, T]]) -> tuple[tuple[str, T], ...]:
        return tuple((self._name(name), value) for name, value in terms)

    def _term(self, text: str) -> str:
        """A term of an effect, in which other places are named."""
        term = read_term(text)
        places = {q.node: q for q in term.quantities if q.at is not None}
        return term.replaced(
            {node: f"{q.name}[{self._name(q.at or '')}]" for node, q in places.items()}
        )


# -- what experiments have in common -----------------------------------------------------------------------------------


def _common_gravity(experiments: Sequence[Experiment]) -> Vector | None:
    """Gravity in the world, in which bases are mounted."""
    first, *others = experiments
    gravity = first.mechanism.gravity
    for e in others:
        if e.mechanism.gravity != gravity:
            raise InputError(
                f"experiments '{first.name}' and '{e.name}' have robots with different gravity: read them with one "
                "gravity, and turn a base by gravity of its experiment",
            )
    return gravity


def _agreed(what: str, tables: Iterable[Mapping[str, T]]) -> dict[str, T]:
    """Several tables as one; what they have in common must be equal."""
    found: dict[str, T] = {}
    for name, value in (item for table in tables for item in table.items()):
        if found.setdefault(name, value) != value:
            raise InputError(
                f"the robots of two experiments disagree about {what} '{name}'; give one of them another name"
            )
    return found


def _merged(effects: Iterable[Effect]) -> tuple[Effect, ...]:
    """Effects of one parameter as one."""
    found: dict[str, Effect] = {}
    for effect in effects:
        known = found.setdefault(effect.parameter, replace(effect, actions=()))
        if (known.unit, known.value) != (effect.unit, effect.value):
            raise InputError(
                f"the robots of two experiments disagree about effect '{effect.parameter}'; give one of them another label"
            )
        actions = (*known.actions, *effect.actions)
        found[effect.parameter] = replace(known, actions=actions)
    return tuple(found.values())
