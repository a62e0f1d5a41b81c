"""Set-ups: a robot description with what its logs mean, how they are prepared, and what is fitted or designed.

The sections of a file are declared once, as data models (:mod:`echelon.formats.schema`), and used as they are.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echelon.algebra import (
    DEFAULT_SEED,
    PI,
    Polynomial,
    is_trigonometric,
    parse,
    symbol_of,
)
from echelon.formats import (
    Document,
    ExcitationEntry,
    IdentificationEntry,
    MeasureEntry,
    PreparationEntry,
    ReadingOptions,
    RobotFile,
    open_robot,
    with_usual_effects,
)
from echelon.identification.logs.columns.column_map import (
    ORDERS,
    Channel,
    ColumnMap,
    coordinates,
)
from echelon.identification.logs.columns.motion_sensors import (
    MotionSensor,
    inclinometer,
)
from echelon.identification.logs.finding import listed
from echelon.robot import (
    Experiment,
    Mechanism,
    Side,
    joined,
    known_values,
    lock_joints,
    mechanism_of,
)
from echelon.shared import (
    InputError,
    in_quotes,
    locating,
    nearest,
    nearest_of,
    public,
)

if TYPE_CHECKING:
    from echelon.formats import Column, ColumnEntry, Columns, Combination, LogEntry


@public
@dataclass(frozen=True)
class Setup:
    """A robot, what its logs mean, and what is to be done with them.

    Attributes
    ----------
    source : str
        The file that states it.
    mechanism : Mechanism
    columns : tuple of ColumnMap
        What columns mean, for one or several kinds of logs; none where the file does not say, then the columns' names
        must speak for themselves.
    preparation : PreparationEntry
        How logs become samples; what is None is chosen from the data.
    settings : IdentificationEntry
        Settings of the fit: the section ``identification``.
    prior : Mechanism, optional
        Another description of the robot, with inertial values, for a prior.
    robot_file : RobotFile, optional
        The URDF, SDF or MJCF file that holds the robot, if one does.
    states_effects : bool
        Whether the file states effects; otherwise the usual ones are identified.
    usual : bool
        Whether the usual effects are among them, so that rotors are tried where data ask for them.
    assumed : tuple of str
        What was taken for granted where the file is silent, in sentences.
    unmeasured : tuple of str
        Outputs that no log has, and what follows, in sentences.
    excitation : ExcitationEntry
        What a trajectory has to keep that excites the parameters; see :func:`echelon.exciting_trajectory`.
    measure : tuple of MeasureEntry
        What a calibration of the geometry measures; none for the pose of the last body.
    seed : int
    document : Document, optional
        The description as it was read, which knows lines.
    experiments : tuple of Experiment
        The experiments that the mechanism stands for; none of a robot in one set-up.
    loads : tuple of str
        Bodies that a single experiment adds to its robot.
    free : Mechanism, optional
        The robot with all its joints, where some are locked.
    """

    source: str
    mechanism: Mechanism
    columns: tuple[ColumnMap, ...] = ()
    preparation: PreparationEntry = field(
        default_factory=PreparationEntry.model_construct
    )
    settings: IdentificationEntry = field(
        default_factory=IdentificationEntry.model_construct
    )
    prior: Mechanism | None = None
    robot_file: RobotFile | None = None
    states_effects: bool = True
    usual: bool = False
    assumed: tuple[str, ...] = ()
    unmeasured: tuple[str, ...] = ()
    excitation: ExcitationEntry = field(default_factory=ExcitationEntry.model_construct)
    measure: tuple[MeasureEntry, ...] = ()
    seed: int = DEFAULT_SEED
    document: Document | None = field(default=None, repr=False)
    experiments: tuple[Experiment, ...] = ()
    loads: tuple[str, ...] = ()
    free: Mechanism | None = None

    def error(self, path: str, problem: str) -> InputError:
        """An error about an element of the file, with its line where that is known.

        Parameters
        ----------
        path : str
            Path of the element, such as ``excitation.collisions.obstacles[0]``.
        problem : str

        Returns
        -------
        InputError
        """
        if self.document is None:
            return InputError(problem, source=self.source, element=path)
        return self.document.error(path, problem)

    def with_robot(self, change: Callable[[Mechanism], Mechanism]) -> Setup:
        """The set-up with a change of its robot, in all experiments.

        Parameters
        ----------
        change : callable

        Returns
        -------
        Setup
        """
        if not self.experiments:
            return replace(self, mechanism=change(self.mechanism))
        changed = [
            replace(e, robot=change(mechanism_of(e.robot))) for e in self.experiments
        ]
        return self.of_experiments(changed)

    def of_experiments(self, experiments: Sequence[Experiment]) -> Setup:
        """The set-up with other experiments.

        Parameters
        ----------
        experiments : sequence of Experiment

        Returns
        -------
        Setup
        """
        return replace(
            self, mechanism=joined(experiments), experiments=tuple(experiments)
        )

    def with_locked(self, positions: Mapping[str, float]) -> Setup:
        """The set-up with some joints of its robot locked.

        Parameters
        ----------
        positions : mapping of str to float
            Where joints stand, rad or m.

        Returns
        -------
        Setup
        """
        if not positions:
            return self
        held = lock_joints(self.mechanism, positions)
        reading = self.mechanism.reading
        if reading is not None:
            options = reading.options and replace(
                reading.options, locked={**reading.options.locked, **positions}
            )
            held = held.as_read(replace(reading, options=options))
        return replace(self, mechanism=held, free=self.free or self.mechanism)

    def of_single(self) -> Setup:
        """The set-up of the only experiment that there is, which keeps the names of its robot.

        Returns
        -------
        Setup
        """
        (own,) = self.experiments
        columns = [c for c in self.columns if c.experiment in ("", own.name)]
        free = self.free or mechanism_of(own.robot)
        return replace(
            self,
            columns=tuple(replace(c, experiment="") for c in columns),
            experiments=(),
            prior=self.prior_in_experiments,
            loads=tuple(own.payloads),
            free=free if own.mechanism.locked else None,
        )

    @property
    def prior_in_experiments(self) -> Mechanism | None:
        """The prior in all experiments, without their loads."""
        if self.prior is None or not self.experiments:
            return self.prior
        return joined(
            [
                replace(e, robot=self.prior, sensors=None, payloads={}, contacts=None)
                for e in self.experiments
            ]
        )

    def with_settings(self, **changes: Any) -> Setup:
        """The set-up with other settings of the section ``identification``.

        Parameters
        ----------
        **changes
            New values by name, such as ``estimator="huber"``.

        Examples
        --------
        >>> import echelon as ec
        >>> ec.load_setup("examples/logs/emps.yaml").with_settings(estimator="huber").settings.estimator
        'huber'
        """
        return replace(self, settings=self.settings.model_copy(update=changes))


def setup_of(source: Any) -> Setup:
    """A set-up as given, or what :func:`load_setup` makes of a robot or its file; experiments state their effects."""
    if isinstance(source, Setup):
        return source
    several = isinstance(source, Sequence) and not isinstance(source, str)
    if not several and not isinstance(source, Experiment):
        return load_setup(source)
    given = list(source) if several else [source]
    named = [replace(e, name=e.name or f"e{k}") for k, e in enumerate(given, start=1)]
    return Setup("experiments", joined(named), experiments=tuple(named))


@public
def load_setup(
    robot: Any, *, prior: Any = None, model: str = "", **reading: Any
) -> Setup:
    """Read a robot with its measurement set-up.

    Parameters
    ----------
    robot : path-like, str or model
        An Echelon description, whose sections ``log``, ``preparation`` and ``identification`` are read as well; or
        anything else that :func:`echelon.load` takes, for which everything is left to choose.  Without a list of
        effects every measured drive gets viscous and Coulomb friction and an offset, and a rotor and a spring where
        the robot file states one.
    prior : the same, optional
        Another description of the robot with inertial values, instead of the one that the file names.
    model : str
        Name of the model to read from an SDF file in which several have joints.
    **reading
        Keyword arguments of :func:`echelon.load`.

    Returns
    -------
    Setup

    Raises
    ------
    InputError
        If a file cannot be read, or a section refers to something that does not exist; names file and element.

    Examples
    --------
    >>> import echelon as ec
    >>> setup = ec.load_setup("examples/logs/emps.yaml")
    >>> setup.columns[0].positions["slide"].column, setup.preparation.band
    ('q_meas_m', None)
    """
    file, options = open_robot(robot, model), ReadingOptions(**reading)
    setup = _described(file, options) if file.is_description else _bare(file, options)
    return (
        setup
        if prior is None
        else replace(setup, prior=open_robot(prior).mechanism(options))
    )


def check_single(setup: Setup) -> Setup:
    """Refuse experiments and contacts, in a set-up for what knows of one robot that nothing touches."""
    mechanism = setup.mechanism
    if mechanism.experiments:
        raise InputError(
            f"it states the experiments {in_quotes(mechanism.experiments)}, and this is about one of them: name it, as "
            "experiment= or --experiment, or leave the others out",
            source=setup.source,
            element="experiments",
        )
    if mechanism.contacts:
        raise InputError(
            "unmeasured forces act there, and motions in which no contact slips cannot be planned yet: leave contacts out "
            "if there are none; ec.sampled_rank judges motions with contacts",
            source=setup.source,
            element=f"contact '{mechanism.contacts[0].name}'",
        )
    return setup


def _bare(file: RobotFile, options: ReadingOptions) -> Setup:
    free = file.mechanism(replace(options, usual_effects=True), free=True)
    found = Setup(file.source, free, robot_file=file, states_effects=False, usual=True)
    with locating(file.source):
        found = found.with_locked(options.locked)
    return replace(found, assumed=_assumed(found.mechanism))


def with_file_effects(setup: Setup) -> Setup:
    """The set-up with the usual effects, where a robot file that states none stands beside it."""
    check_single(setup)
    return with_usual(setup) if setup.robot_file is not None else setup


def with_usual(setup: Setup) -> Setup:
    """The set-up with the usual effects, where its file is silent about effects."""
    springs = setup.mechanism.springs
    own = [a for e in setup.mechanism.effects for a in e.actions if a.at not in springs]
    if setup.states_effects or own:
        return setup
    drives = {} if setup.robot_file is None else setup.robot_file.tree().drives
    found = setup.with_robot(partial(with_usual_effects, stated=drives))
    assumed = (*_assumed(found.mechanism), *setup.assumed)
    return replace(found, usual=True, assumed=assumed)


def _assumed(mechanism: Mechanism) -> tuple[str, ...]:
    """A note on effects that nobody stated."""
    places: dict[str, list[str]] = {"viscous": [], "rotor_inertia": [], "spring": []}
    actions = [effect.actions[0] for effect in mechanism.effects]
    for action in actions:
        if action.kind in places and action.at not in mechanism.springs:
            places[action.kind].append(action.at)
    got = []
    if places.pop("viscous"):
        got.append(
            "every measured drive got viscous and Coulomb friction and an offset"
        )
    if any(action.side is Side.OUTPUT for action in actions):
        got.append("every component of a force/torque sensor got an unknown zero")
    if not got:
        return ()
    text = f"no effects are stated, so {' and '.join(got)}"
    for kind, names in places.items():
        text += (
            f", and {kind.replace('_', ' ')} where the robot file shows one ({in_quotes(names)})"
            if names
            else ""
        )
    return (f"{text}; 'effects: none' in a set-up leaves them out",)


def _described(file: RobotFile, options: ReadingOptions) -> Setup:
    robot, document, entry = (
        file.description,
        file.document,
        file.description.identification,
    )
    free = file.mechanism(options, alone=True, free=True)
    found = Setup(
        file.source,
        free,
        preparation=robot.preparation,
        settings=entry,
        robot_file=file.robot,
        states_effects=robot.effects is not None,
        usual="usual" in (robot.effects or ()),
        excitation=robot.excitation,
        measure=robot.measure,
        document=document,
    )
    with locating(file.source):
        found = found.with_locked(file.locked(options))
        experiments = file.experiments(found.mechanism, options.experiment)
        whole = joined(experiments) if experiments else found.mechanism
    many = isinstance(robot.log, tuple)
    logs = robot.log if isinstance(robot.log, tuple) else (robot.log,)
    folder, prior = file.directory or Path(), entry.prior.file
    stated = None if prior is None else open_robot(folder / prior).mechanism(options)
    columns: list[ColumnMap] = []
    for k, log in enumerate(logs):
        path = f"log[{k}]" if many else "log"
        section = _LogSection(free, document, path, found.mechanism.locked)
        columns += section.read(log, found.mechanism, experiments)
    found = replace(
        found,
        mechanism=whole,
        columns=tuple(columns),
        prior=stated,
        experiments=experiments,
    )
    return found.of_single() if len(experiments) == 1 else found


_FIELD = re.compile(r"\{(?:(\d+) *\* *)?(n|i|name)(?: *([+-]) *(\d+))?\}")

EVERY, DRIVES = (
    "all",
    "actuators",
)  # keys that stand for every coordinate (or output), and for every drive


class _LogSection:
    """A ``log`` section of a description, read as a column map of the robot with all its joints."""

    def __init__(
        self,
        mechanism: Mechanism,
        document: Document,
        path: str,
        locked: Mapping[str, float],
    ) -> None:
        self.mechanism, self.document, self.path = mechanism, document, path
        self.drives = tuple(
            a.name
            for a in mechanism.transmission.actuators
            if a.name not in mechanism.springs
        )
        # values of symbols, and of joints that are locked
        self.known = {**locked, **known_values(mechanism), PI: math.pi}
        self.sensors: dict[str, MotionSensor] = {}
        # a floating base is named where contacts hold the robot: patterns are for joints
        self.bases = {
            name
            for joint in mechanism.floating_joints
            if mechanism.contacts
            for motion in joint.motions
            for name in (*motion.positions, *motion.velocities)
        }
        # coordinates whose velocities are their derivatives, which those of balls are not
        moving = [n for n in mechanism.velocities if n not in locked]
        self.single = [n for n in moving if n in mechanism.positions]

    def read(
        self, log: LogEntry, mechanism: Mechanism, experiments: Sequence[Experiment]
    ) -> list[ColumnMap]:
        """The map, or one for every experiment that logs of this section may belong to."""
        names = [e.name for e in experiments]
        if log.experiment is not None and log.experiment not in names:
            problem = f"there is no such experiment{nearest_of(log.experiment, names)}"
            raise self.document.error(f"{self.path}.experiment", problem)
        by_contacts = bool(log.contact) and log.experiment is None
        if not experiments or by_contacts:
            return [self._map(log, mechanism)]
        return [
            replace(self._map(log, e.mechanism), experiment=e.name)
            for e in experiments
            if log.experiment in (None, e.name)
        ]

    def _map(self, log: LogEntry, mechanism: Mechanism) -> ColumnMap:
        """The map for a mechanism, whose joints are numbered as those of the robot."""
        for name, sensor in log.sensors.items():
            self.sensors[name] = self._sensor(name, sensor, mechanism)
        positions, velocities = (
            self.mechanism.independent_positions,
            self.mechanism.independent_velocities,
        )
        outputs = tuple(
            dict.fromkeys(
                output.name
                for some in (self.mechanism, mechanism)
                for output in some.sensed
            )
        )
        touching = tuple(contact.name for contact in self.mechanism.contacts)
        found = ColumnMap(
            None
            if log.time is None
            else self._channel(log.time, f"{self.path}.time", {}),
            log.rate,
            self._channels(log.position, "position", positions),
            self._channels(log.velocity, "velocity", velocities),
            self._channels(log.acceleration, "acceleration", velocities),
            self._channels(log.output, "output", outputs),
            self._channels(log.reference, "reference", positions),
            self._channels(log.input, "input", velocities),
            sensors=self.sensors,
            contacts=self._channels(log.contact, "contact", touching),
            twist=log.twist,
            files=log.files,
        )
        found = found.with_locked(mechanism.locked)
        return found if mechanism is self.mechanism else found.within(mechanism)

    def _sensor(
        self, name: str, entry: Combination, mechanism: Mechanism
    ) -> MotionSensor:
        """A sensor of motion, by the combination of coordinates or the body that is stated."""
        path, moving = f"{self.path}.sensors.{name}", self.single
        if name in (*moving, *self.mechanism.positions, *self.drives, EVERY, DRIVES):
            problem = "means a coordinate, a drive or all of them: choose another name"
            raise self.document.error(path, problem)
        if isinstance(entry, str):
            return self._combination(entry, path)
        if entry.terms is not None:
            weights = {}
            for joint, ratio in entry.terms.items():
                place = f"{path}.terms.{joint}"
                if joint not in moving:
                    problem = f"there is no such coordinate{nearest_of(joint, moving)}"
                    raise self.document.error(place, problem)
                weights[joint] = self._value(ratio, place)
            return MotionSensor(weights)
        bodies = [body.name for body in self.mechanism.bodies]
        if entry.body not in bodies:
            problem = f"there is no such body{nearest_of(str(entry.body), bodies)}"
            raise self.document.error(f"{path}.body", problem)
        try:
            return inclinometer(mechanism, entry.body, entry.axis)
        except InputError as error:
            raise self.document.error(path, error.problem) from None

    def _combination(self, text: str, path: str) -> MotionSensor:
        """A linear expression in coordinates."""
        moving, zero = self.single, 0.0
        weights: dict[str, float] = {}
        for monomial, number in self._parsed(text, path, moving).terms.items():
            joints = [(g, power) for g, power in monomial if symbol_of(g) in moving]
            rest = Polynomial({tuple(f for f in monomial if f not in joints): number})
            value = rest.at(self.known)
            if not joints:
                zero += value
                continue
            joint, power = joints[0]
            if len(joints) > 1 or power != 1 or is_trigonometric(joint):
                problem = f"'{text}' is not linear in the coordinates"
                raise self.document.error(path, problem)
            weights[joint] = weights.get(joint, 0.0) + value
        if not weights:
            problem = f"'{text}' has no coordinate of the robot ({listed(moving)})"
            raise self.document.error(path, problem)
        return MotionSensor(weights, zero)

    def _channels(
        self, columns: Columns | None, key: str, names: Sequence[str]
    ) -> dict[str, Channel]:
        """The channels of one quantity by coordinate, output or drive; what is stated by name comes before all."""
        if columns is None:
            return {}
        if isinstance(columns, str):
            return dict(self._filled(columns, f"{self.path}.{key}", names))
        found: dict[str, Channel] = {}
        for name, entry in columns.items():
            path = f"{self.path}.{key}.{name}"
            if name in (EVERY, DRIVES):
                found |= dict(
                    self._filled(entry, path, names if name == EVERY else self.drives)
                )
        for name, entry in columns.items():
            path = f"{self.path}.{key}.{name}"
            if name not in (EVERY, DRIVES):
                valid = [*names, *self.drives]
                if key in ORDERS:  # in loops also those that follow from others
                    every = coordinates(self.mechanism, key)
                    valid = [*dict.fromkeys([*valid, *every]), *self.sensors]
                if name not in valid:
                    others = [*valid, EVERY, DRIVES]
                    problem = f"there is no such coordinate, output or drive{nearest_of(name, others)}"
                    raise self.document.error(path, problem)
                found[name] = self._channel(entry, path, {"name": name})
        return found

    def _filled(
        self, entry: Column, path: str, names: Iterable[str]
    ) -> Iterator[tuple[str, Channel]]:
        for i, name in enumerate(n for n in names if n not in self.bases):
            yield name, self._channel(entry, path, {"n": i + 1, "i": i, "name": name})

    def _channel(
        self, entry: Column, path: str, fields: Mapping[str, object]
    ) -> Channel:
        if isinstance(entry, str):
            return Channel(self._column(entry, path, fields))
        column = self._column(entry.column, f"{path}.column", fields)
        return Channel(
            column,
            entry.unit,
            *(self._number(entry, part, path) for part in ("scale", "offset")),
        )

    def _column(self, template: str, path: str, fields: Mapping[str, object]) -> str:
        """A column's name; braces that name no field belong to the name, and numbers may be shifted: ``{n+12}``."""

        def filled(found: re.Match[str]) -> str:
            times, field, sign, more = found.groups()
            if field not in fields:
                return found.group()
            value = fields[field]
            if isinstance(value, int):
                return str(int(times or 1) * value + int(f"{sign or ''}{more or 0}"))
            return found.group() if times or sign else str(value)

        name = _FIELD.sub(filled, template)
        if "n" in fields and name == template and fields["n"] != 1:
            problem = f"'{template}' is one column for several channels: use {{n}}, {{i}} or {{name}}"
            raise self.document.error(path, problem)
        return name

    def _number(self, entry: ColumnEntry, part: str, path: str) -> float:
        text, place = str(getattr(entry, part)), f"{path}.{part}"
        number = self._value(text, place)
        if part == "scale" and number == 0:
            problem = f"'{text}' is {number}; a scale must be finite and not zero"
            raise self.document.error(place, problem)
        return number

    def _value(self, text: str, place: str) -> float:
        """A number or an expression in symbols with values."""
        number = self._parsed(text, place).at(self.known)
        if not math.isfinite(number):
            problem = f"'{text}' is {number}; it must be finite"
            raise self.document.error(place, problem)
        return number

    def _parsed(
        self, text: str, place: str, coordinates: Sequence[str] = ()
    ) -> Polynomial:
        """An expression in symbols with values, and in coordinates."""
        try:
            value = parse(text)
        except ValueError as error:
            raise self.document.error(place, str(error)) from None
        for symbol in map(symbol_of, value.generators()):
            if symbol not in self.known and symbol not in coordinates:
                valid = [*self.known, *coordinates]
                problem = f"'{symbol}' in '{text}' has no value{nearest(symbol, valid)}"
                raise self.document.error(place, problem)
        return value
