"""Columns by their names, and by their values where names say nothing, for a set-up that says nothing about its logs.

What is clear is taken, and what is not is asked about, all of it in one message.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property

from echelon.identification.logs.columns.by_values import (
    Family,
    are_numbers,
    blocks,
    classified,
    clock,
    families,
    in_order,
    in_pairs,
    is_mixed,
    is_still,
)
from echelon.identification.logs.columns.column_map import (
    ORDERS,
    Channel,
    ColumnMap,
    actuators,
    independent_coordinates,
    units,
)
from echelon.identification.logs.columns.column_names import (
    KNOWN,
    SHARES,
    Meaning,
    aliases,
    kinds_said,
    may_be_output,
    meaning,
    spoken,
    stated_unit,
    unlogged_joints,
    without_prefix,
    words,
)
from echelon.identification.logs.columns.magnitudes import clock_unit
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.finding import counted, listed
from echelon.identification.logs.recording import FEWEST
from echelon.identification.logs.units import factor, fits
from echelon.robot import Mechanism, lock_joints, lockable
from echelon.shared import ENTRIES, MOST_NAMED, Floats, InputError

Meanings = Mapping[str, Meaning]
Look = Callable[[], Table]  # reads the first piece of a log, with all columns

_NEEDED = ("position", "output")
_PARTLY = (
    "output",
    "current",
)  # what may be there for some joints only: the others are not measured
_ALTERNATIVES = {
    "position": "joint",
    "output": "current",
}  # joint_0 beside torque_0, currents for want of torques
_OPTIONAL = ("velocity", "acceleration", "reference")
_AS_NAMED: Mapping[str, str] = {}
_SERVOS = (
    "; if the log has position commands and no outputs, servos can be fitted: name the commands under input, with "
    "the effect {type: servo, at: all}"
)
_DIGITS = re.compile(r"\d+")
_FIRST = re.compile(r"/?[^\W_]+[\W_]+")
_ANGLES = re.compile(
    "theta|phi|psi|alpha|beta|angle|winkel|rad|deg|rot|θ|φ", re.IGNORECASE
)
_TORQUES = re.compile("tau|torque|trq|moment|nm|couple|τ", re.IGNORECASE)
_NOT_MEASURED = re.compile(
    "ext|external|con|fric|friction|grav|gravity|dist|filt|ref|desired|des|cmd|commanded|target|limit|max|min"
)
"""Words of forces that are computed, commanded, or a part of the whole."""


CURRENTS = (
    "the outputs have names of currents and are read as torques, so parameters may be in units of currents, not of "
    "inertia: give the torque per ampere at the joint, which is the torque constant times the gear ratio, as  scale  "
    "(or  unit: N·m  for outputs that are torques)"
)
"""Doubt about outputs whose columns say current."""

UNKNOWN_GAINS = (
    "if nobody knows the torque per ampere, name the currents under  input  instead of  output,  add the effect  "
    "{type: drive_gain, at: all},  and give  ec.gains_from_logs  in Python what is known: one gain, a mass, or runs with a "
    "weighed payload"
)
"""What to do with such columns where their scale is unknown."""


def are_currents(columns: Iterable[ColumnMap]) -> bool:
    """Whether an output has the name of a current, and neither its unit nor its scale makes it a torque."""
    outputs = [output for some in columns for output in some.outputs.values()]
    plain = [one.column for one in outputs if not one.unit and abs(one.scale) == 1]
    said = [kinds_said(column) for column in plain]
    return any("current" in kinds and "output" not in kinds for kinds in said)


@dataclass(frozen=True)
class Guess:
    """The columns of a log as they were taken, and questions that could not be decided."""

    columns: ColumnMap
    problems: tuple[
        str, ...
    ] = ()  # in sentences; without any, nothing that is needed is missing
    notes: tuple[str, ...] = ()  # what was taken for granted
    unlogged: tuple[
        str, ...
    ] = ()  # motions that no column is of, so that they have to be locked
    choices: tuple[tuple[str, ...], ...] = ()  # the same where only the user can tell
    commanded: bool = False  # whether there are commands of positions, and nothing that could be an output
    unmeasured: tuple[
        str, ...
    ] = ()  # outputs that no column is of, though one is of each position


def guess(
    names: Sequence[str],
    mechanism: Mechanism,
    look: Look | None = None,
    *,
    said: Mapping[str, str] = _AS_NAMED,
    outputs: bool = True,
    by_values: bool = False,
) -> Guess:
    """Take columns for what their names say, and with ``by_values`` or without names for what their values say.

    ``said`` is what to read in place of some names, such as names with units that the file states beside them.  Where
    this fails for the whole robot, it is tried for what is left of it without joints that the log may lack.
    """
    columns = _Columns(names, mechanism, look, said, outputs, by_values)
    whole = columns.guess()
    if not whole.problems or not lockable(mechanism):
        return whole
    paired = columns.in_pairs() if by_values else None
    if paired is not None:
        return paired
    several = columns.sets()
    if len(several) > 1:
        first, *others = several
        text = f"the log has several sets of columns, {listed([f'{word}…' for word in several])}"
        if by_values:
            text += f": those of {first}… are used; for another set, replace {first} by {' or '.join(others)} under log"
            return replace(several[first], notes=(*several[first].notes, text))
        return replace(
            whole,
            problems=(f"{text}: name the columns of {mechanism.name} under log",),
        )
    parts = []
    for locked in unlogged_joints(names, columns.meanings, columns.known, mechanism):
        rest = replace(
            columns, mechanism=lock_joints(mechanism, dict.fromkeys(locked, 0.0))
        )
        parts.append(replace(rest.guess(), unlogged=locked))
    nothing = not (whole.columns.positions or whole.columns.outputs)
    parts = [part for part in parts if not part.problems] or (parts if nothing else [])
    if len(parts) > 1:
        which = " or ".join(
            f"those of {listed(part.columns.positions)}" for part in parts
        )
        problem = f"the log has columns for some joints only, {which}: list the joints that rest under locked"
        choices = tuple(part.unlogged for part in parts)
        return replace(
            whole, columns=parts[0].columns, problems=(problem,), choices=choices
        )
    return parts[0] if parts else whole


Groups = dict[str, dict[str, Channel]]


@dataclass(frozen=True)
class _Columns:
    """The columns of a log, to be understood for a robot."""

    names: Sequence[str]
    mechanism: Mechanism
    look: Look | None
    said: Mapping[str, str]
    outputs: bool
    by_values: bool

    @cached_property
    def known(self) -> dict[str, str]:
        """Coordinates, outputs and drives by what columns may call them."""
        drives = [actuator.name for actuator in self.mechanism.transmission.actuators]
        coordinates = (*self.mechanism.positions, *self.mechanism.velocities)
        return aliases(
            [*coordinates, *(output.name for output in self.mechanism.sensed), *drives]
        )

    @cached_property
    def meanings(self) -> dict[str, Meaning]:
        """The meanings of names that are understood, with their units."""
        texts = without_prefix(self.names, self.known)
        texts |= {name: self.said[name] for name in self.names if name in self.said}
        found = {name: meaning(text, self.known) for name, text in texts.items()}
        # of encoder1_1, encoder1_2, … none is understood, as two numbers differ in some of them
        strange = {
            _DIGITS.sub("#", name) for name, said in found.items() if said is None
        }
        return {
            n: said
            for n, said in found.items()
            if said is not None and _DIGITS.sub("#", n) not in strange
        }

    @cached_property
    def values(self) -> Mapping[str, Floats]:
        """Columns of numbers; none before a log is looked at."""
        return {} if self.look is None else self.look().columns

    @cached_property
    def joints(self) -> list[str]:
        """Coordinates of positions that a log needs."""
        return self.valid("position")

    def valid(self, kind: str) -> list[str]:
        """Coordinates or outputs that columns of a kind may be of."""
        if kind in _PARTLY:
            return [output.name for output in self.mechanism.sensed]
        return list(
            independent_coordinates(
                self.mechanism, "position" if kind == "joint" else kind
            )
        )

    def alive(self, names: Iterable[str]) -> list[str]:
        """The columns that change."""
        return [
            name
            for name in names
            if name not in self.values or not is_still(self.values[name])
        ]

    def guess(self) -> Guess:
        """The guess if the log has all joints."""
        groups, problems = self._by_names(self.outputs)
        notes: list[str] = []
        headerless = are_numbers(self.names) and not self.meanings
        needed = _NEEDED[: 1 + self.outputs]
        time, trouble = self._time(self._may_be_time(groups))
        absent = [kind for kind in needed if not groups[kind]]
        if (
            absent
            and self.look is not None
            and (self.by_values or (headerless and not problems))
        ):
            partial = (
                0 < len(groups["output"]) < len(self.mechanism.sensed)
                and "position" in absent
            )
            if (
                len(absent) == len(needed) or partial
            ):  # A1 beside M1 is no acceleration, and wrist1 is not every joint
                groups = {kind: {} for kind in groups}
            kinds = ("time", *(kind for kind, some in groups.items() if some))
            taken = _taken(groups)
            clear = [
                n
                for n, said in self.meanings.items()
                if (said.kind in kinds or n in taken) and not headerless
            ]
            notes += self._fill(groups, self._told_by_values(clear, groups, time))
            absent = [kind for kind in needed if not groups[kind]]
            problems = problems if absent else []
            positions = [channel.column for channel in groups["position"].values()]
            motors = [
                name
                for name in positions
                if name in self.meanings and self.meanings[name].motor
            ]
            if motors and not actuators(self.mechanism):
                text = "have names of motors and are read as joint angles"
                notes.append(
                    f"{listed(motors)} {text}: state actuators if there are gears"
                )
        commanded = absent == ["output"] and bool(groups["reference"])
        if absent and not problems:
            problems.append(self._question(absent, time) + _SERVOS * commanded)
        if commanded:
            meanings = self.meanings
            unclear = [
                name
                for name in self.names
                if name not in meanings or meanings[name].kind in _PARTLY
            ]
            commanded = not self.alive(name for name in unclear if may_be_output(name))
        notes += self._notes(groups, time if not headerless else None)
        kinds_of_map = ("position", "velocity", "acceleration", "output", "reference")
        columns = ColumnMap(time, None, *(groups[kind] for kind in kinds_of_map))
        unmeasured = [
            output.name
            for output in self.mechanism.sensed
            if output.name not in groups["output"]
        ]
        measured = len(self.mechanism.sensed) - len(unmeasured)
        is_partly = (
            0
            < len({channel.column for channel in groups["output"].values()})
            == measured
        )
        rest = tuple(unmeasured if is_partly else ())
        return Guess(
            columns,
            (*problems, *trouble),
            tuple(notes),
            unmeasured=rest,
            commanded=commanded,
        )

    def _notes(self, groups: Groups, time: Channel | None) -> Iterator[str]:
        """Notes on a clock and on units of outputs that were taken for granted."""
        if time is not None and (
            time.column not in self.meanings
            or self.meanings[time.column].kind != "time"
        ):
            yield f"'{time.column}' is read as the time, because it grows like a clock"
        outputs = {channel.column for channel in groups["output"].values()}
        said = [said for column, said in self.meanings.items() if column in outputs]
        if any(one.kind == "current" for one in said):
            yield CURRENTS
            yield UNKNOWN_GAINS
        for sign, share in zip(SHARES, ("hundredth", "thousandth"), strict=True):
            if any(one.unit == sign for one in said):
                yield f"the outputs are in {sign} and are read as torques: give a {share} of the rated torque as scale"

    def sets(self) -> dict[str, Guess]:
        """Guesses by the first words of columns that without this word are all that the robot needs."""
        first = {
            name: start.group()
            for name in self.names
            if (start := _FIRST.match(name)) is not None
        }
        found: dict[str, Guess] = {}
        for word in dict.fromkeys(first.values()):
            own = [name for name in self.names if first.get(name, word) == word]
            if re.sub(r"[\W_]", "", word).lower() in KNOWN or len(own) == len(
                self.names
            ):
                continue
            short = {name: self.said.get(name, name).removeprefix(word) for name in own}
            part = replace(self, names=own, said=short, by_values=False).guess()
            if not part.problems:
                found[word] = part
        return found

    def _fill(self, groups: Groups, seen: Mapping[str, Family]) -> list[str]:
        """Put families of columns where names say nothing, and note which."""
        notes = []
        for kind, family in seen.items():
            if not groups.get(kind):
                pairs = zip(self.valid(kind), family.columns, strict=True)
                groups[kind] = {
                    name: self._plain_channel(column, kind, name)
                    for name, column in pairs
                }
                columns = (
                    ", ".join(family.columns)
                    if len(family.columns) < MOST_NAMED
                    else family.label
                )
                notes.append(
                    f"{columns} are read as the {_several(kind)} of {listed(groups[kind])}, judging by their values"
                )
        return notes

    def _plain_channel(self, column: str, kind: str, name: str) -> Channel:
        """A column with the unit that its name states, if it is one of the quantity."""
        return self._channel(column, stated_unit(column), kind, name) or Channel(column)

    def _by_names(self, outputs: bool) -> tuple[Groups, list[str]]:
        """Channels by kind and by coordinate, output or actuator, and what is wrong with the names."""
        groups: Groups = {}
        problems: list[str] = []
        for kind in (*_NEEDED, *_OPTIONAL):
            try:
                groups[kind] = self._channels(kind)
                other = _ALTERNATIVES.get(kind, "")
                several = any(said.kind == other for said in self.meanings.values())
                if several and not self.alive(
                    channel.column for channel in groups[kind].values()
                ):
                    groups[kind] = self._channels(other) or groups[kind]
            except InputError as error:
                groups[kind] = {}
                if (
                    kind in _NEEDED[: 1 + outputs]
                ):  # nobody needs the others: what is not clear is left out
                    problems.append(error.problem)
        return groups, problems

    # -- names ---------------------------------------------------------------------------------------------------------

    def _time(self, unnamed: Sequence[str]) -> tuple[Channel | None, list[str]]:
        """The column of time, of several that by their names could be it the one that grows as a clock does."""
        look, meanings = self.look, self.meanings
        found = [
            name
            for name, said in meanings.items()
            if said.kind == "time" and fits(said.unit, "s")
        ]
        # columns of messages have stamps of their own, which the file assigns to them
        if look is None or look().clocks:
            found = [name for name in found if not name.startswith("/")]
        if look is not None and (len(found) > 1 or (unnamed and not found)):
            clocks = look().clocks
            # of clocks that have one themselves, that is the file's column of times
            known = [clocks[own] for own in clocks.values() if own in clocks]
            chosen = (
                next(iter(known), "")
                if clocks and not found
                else clock(self.values, found or unnamed, named=bool(found))
            )
            found = [chosen] if chosen else found
        if len(found) > 1:
            return None, [
                f"{listed(found)} could all be the time; name one as time under log"
            ]
        if not found:
            return None, []
        said = meanings.get(found[0])
        return Channel(
            found[0], said.unit if said is not None and said.kind == "time" else ""
        ), []

    def _may_be_time(self, groups: Groups) -> list[str]:
        """Columns that may be the time though their names do not say so: a letter alone says little of a joint."""
        taken = _taken(groups)
        weak = [
            name
            for name, said in self.meanings.items()
            if not said.name and said.index is None
        ]
        return [*self._unknown(), *(name for name in weak if name not in taken)]

    def _unknown(self) -> list[str]:
        """Names that are not understood."""
        return [name for name in self.names if name not in self.meanings]

    def _channels(self, kind: str) -> dict[str, Channel]:
        """The columns of a kind, by coordinate, output or actuator; of several for one those that change."""
        own = {
            column: said for column, said in self.meanings.items() if said.kind == kind
        }
        if not own:
            return {}
        valid = self.valid(kind)
        motors = [actuator.name for actuator in actuators(self.mechanism)]
        if any(said.motor for said in own.values()) and (motors or kind == "position"):
            beside = not all(said.motor for said in own.values())
            changing = [
                own[column].motor for column in (self.alive(own) if beside else ())
            ]
            # where both sides have sensors, the joints' where the robot states no gears
            at_joints = beside and changing.count(False) + (
                not motors
            ) > changing.count(True)
            own = {
                column: said for column, said in own.items() if said.motor != at_joints
            }
            if not motors and not at_joints:
                raise InputError(
                    f"{listed(own)} have names of motors, but {self.mechanism.name} states no actuators: state "
                    f"actuators: {{m1: 100*joint1}}, or list them as positions of joints under log"
                )
            valid = valid if at_joints else motors
        keys = {column: said.name for column, said in own.items() if said.name}
        if not keys:
            joints = [
                said
                for said in self.meanings.values()
                if said.kind in ("position", "joint") and not said.motor
            ]
            keys = self._numbered(
                own, _numbers(joints) if kind in _PARTLY else set(), valid, kind
            )
        if len(keys) > len({*keys.values()}):
            alive = self.alive(keys)
            kept = {keys[column] for column in alive}
            keys = {
                column: name
                for column, name in keys.items()
                if column in alive or name not in kept
            }
        found: dict[str, Channel] = {}
        strange: list[str] = []
        for column, name in keys.items():
            channel = self._channel(column, own[column].unit, kind, name)
            if name not in (*valid, *motors) or channel is None:
                if name in valid:
                    strange.append(f"'{column}' is in {own[column].unit}")
                continue
            if name in found:
                both = f"'{found[name].column}' and '{column}'"
                raise InputError(
                    f"{both} could both be the {kind} of '{name}'; name the right one under log"
                )
            found[name] = channel
        missing = [name for name in valid if name not in found]
        if (
            missing
            and not (found and kind in _PARTLY)
            and not any(name in found for name in motors)
        ):
            taken = "; ".join(
                [
                    f"found: {listed(channel.column for channel in found.values())}",
                    *strange,
                ]
            )
            raise InputError(
                f"no column is the {kind} of {listed(missing)} ({taken}); name them under log"
            )
        return {name: found[name] for name in [*valid, *motors] if name in found}

    def _channel(self, column: str, unit: str, kind: str, name: str) -> Channel | None:
        """A column with its unit; None where the unit is not one of the quantity."""
        if kind == "current":  # as if it were a torque: one unit of force per ampere
            return Channel(column, scale=factor(unit, "A")) if fits(unit, "A") else None
        if kind == "output" and unit in SHARES:
            return Channel(column)
        kind = "position" if kind == "joint" else kind
        expected = units(self.mechanism, kind, name)
        # dq_deg is in deg/s, and the m of tau_m says that it was measured
        texts = (
            [unit + "/s" * order for order in range(ORDERS.get(kind, 0) + 1)]
            if unit
            else [""]
        )
        if len(unit) == 1 and stated_unit(column) != unit:
            texts.append("")
        return next(
            (Channel(column, text) for text in texts if fits(text, expected)), None
        )

    def _numbered(
        self, own: Meanings, others: set[int], valid: Sequence[str], kind: str
    ) -> dict[str, str]:
        """Coordinates by number, counted from 0 or from 1 like the ``others``; a single one needs none."""
        numbers = {column: said.index for column, said in own.items()}
        if set(numbers.values()) == {None} and len(valid) == 1:
            return dict.fromkeys(numbers, valid[0])
        found = _numbers(own.values())
        every = others if found and found <= others else found
        first = min(every, default=0)
        if first > 1 or every != set(range(first, first + len(valid))):
            has = f"one {kind}"
            if found:
                words = "numbers" if len(found) > 1 else "joint number"
                has = f"{counted(len(found), kind, _several(kind))} ({words} {', '.join(map(str, sorted(found)))})"
            raise InputError(
                f"the log has {has}, {listed(numbers)}, but {self.mechanism.name} has {len(valid)}: {listed(valid)}; "
                "is it a log of another robot?  If not, name the columns under log"
            )
        return {
            column: valid[number - first]
            for column, number in numbers.items()
            if number is not None
        }

    # -- values --------------------------------------------------------------------------------------------------------

    def _families(self, names: Sequence[str]) -> tuple[Family, ...]:
        """Columns of one pattern, one for every joint."""
        places = {
            alias: self.joints.index(name)
            for alias, name in aliases(self.joints).items()
        }
        return families(names, len(self.joints), places)

    def _told_by_values(
        self, understood: Sequence[str], groups: Groups, time: Channel | None
    ) -> dict[str, Family]:
        """Families of columns by kind; positions that are known by their names are among them."""
        count, columns = len(self.joints), self.values
        names = [
            name for name in self.names if name in columns
        ]  # the others hold words
        lengths = {len(columns[name]) for name in names}
        if (
            len(self.mechanism.sensed) != count
            or len(lengths) != 1
            or min(lengths) < FEWEST
        ):
            return {}
        times = (
            None if time is None or time.column not in names else self._seconds(time)
        )
        rest = [
            name
            for name in names
            if name not in understood and (time is None or name != time.column)
        ]
        if understood or not are_numbers(names):
            new = self._families(rest)
        else:
            new = blocks(
                rest[1:] if len(rest) % count == 1 and count > 1 else rest, count
            )
        known = {
            kind: Family(tuple(channel.column for channel in some.values()))
            for kind, some in groups.items()
        }
        fixed = {
            kind: family
            for kind, family in known.items()
            if len(family.columns) == count
        }
        strange = [
            f for f in new if _said(f) not in ("", *groups) or not self.alive(f.columns)
        ]
        rest = [
            name
            for name in rest
            if not any(name in family.columns for family in strange)
        ]
        new = tuple(
            family
            for family in new
            if family not in strange and not is_mixed(family, columns, times)
        )
        said = {family: _said(family) for family in new}
        once = {
            kind for kind in said.values() if [*said.values()].count(kind) == 1
        } & groups.keys() - fixed.keys()
        named = {kind: family for family, kind in said.items() if kind in once}
        left = [family for family in new if family not in named.values()]
        found = named | classified(left, columns, times, fixed | named)
        complete = {"position", "output"} <= {*found, *fixed}
        return (
            found if complete else in_order(rest, count, columns, times, fixed) or found
        )

    def _seconds(self, time: Channel) -> Floats:
        stamps = self.values[time.column]
        return stamps * factor(time.unit or clock_unit(stamps), "s")

    def in_pairs(self) -> Guess | None:
        """The guess where every joint has names of its own, and rates tell its position, as on a cart with a pole.

        Only one of the joints may be driven.
        """
        columns = self.values
        time, _ = self._time(self._unknown())
        if time is None or len({len(values) for values in columns.values()}) != 1:
            return None
        others = [name for name in columns if name != time.column]
        found, left = in_pairs(others, len(self.joints), columns, self._seconds(time))
        if not found:
            return None
        order = self._as_they_move(found["position"].columns)
        found = {
            kind: Family(tuple(family.columns[k] for k in order))
            for kind, family in found.items()
        }
        forces = [
            name
            for name in left
            if name in self.meanings and self.meanings[name].kind == "output"
        ] or left
        groups: Groups = {}
        notes, driven = (
            self._fill(groups, found),
            self._driven(forces) if self.outputs else {},
        )
        notes += [
            f"'{column}' is read as the output of {name}"
            for name, column in driven.items()
        ]
        groups["output"] = {
            name: self._plain_channel(column, "output", name)
            for name, column in driven.items()
        }
        problem = f"no column recognised as the output of one of {listed(self.joints)}; name it under log"
        problems = (problem,) if self.outputs and not driven else ()
        kinds = (
            groups.get(kind, {})
            for kind in ("position", "velocity", "acceleration", "output")
        )
        unmeasured = tuple(
            name for name in self.valid("output") if driven and name not in driven
        )
        return Guess(
            ColumnMap(time, None, *kinds), problems, tuple(notes), unmeasured=unmeasured
        )

    def _as_they_move(self, columns: Sequence[str]) -> list[int]:
        """Places of the columns of joints: angles of those that turn, if names tell as many, else in order."""
        turn = [
            units(self.mechanism, "position", name) != ("m",) for name in self.joints
        ]
        angles = [k for k, column in enumerate(columns) if _ANGLES.search(column)]
        if len(angles) != sum(turn):
            return list(range(len(columns)))
        lengths = [k for k in range(len(columns)) if k not in angles]
        return [(angles if turns else lengths).pop(0) for turns in turn]

    def _driven(self, forces: Sequence[str]) -> dict[str, str]:
        """Columns of outputs in their order; a single one is a torque by its name, or else the force of the slide."""
        valid = self.valid("output")
        if len(forces) == 1 < len(valid):
            unit = "N·m" if _TORQUES.search(forces[0]) else "N"
            valid = [
                output.name for output in self.mechanism.sensed if output.unit == unit
            ]
        return (
            dict(zip(valid, forces, strict=True)) if len(valid) == len(forces) else {}
        )

    def _question(self, absent: Sequence[str], time: Channel | None) -> str:
        """The question for kinds that are absent, with the nearest word to every column that was not understood."""
        unknown = self._unknown()
        seen: dict[str, Family] = {}
        if self.look is not None and len(unknown) < ENTRIES.most:
            groups, _ = replace(self, look=None)._by_names(outputs=False)
            seen = self._told_by_values(list(self.meanings), groups, time)
        asked, left = [], list(unknown)
        for family in self._families(unknown):
            kinds = [kind for kind, some in seen.items() if some == family]
            by = (
                f"{_several(kinds[0])}, judging by their values"
                if kinds
                else _nearest(family.columns[0])
            )
            asked.append(f"{family.label}{by and f' ({by})'}")
            left = [name for name in left if name not in family.columns]
        asked += [f"{name}{(by := _nearest(name)) and f' ({by})'}" for name in left]
        lacking = " and ".join(absent)
        text = f"no {lacking} columns of {self.mechanism.name} recognised"
        return (
            f"{text}; unclear: {listed(asked)}; name them under log" if asked else text
        )


def _taken(groups: Groups) -> set[str]:
    """Columns that are taken for something."""
    return {channel.column for some in groups.values() for channel in some.values()}


def _several(kind: str) -> str:
    return "velocities" if kind == "velocity" else f"{kind}s"


def _numbers(meanings: Iterable[Meaning]) -> set[int]:
    return {said.index for said in meanings if said.index is not None}


def _said(family: Family) -> str:
    """The kind that all names say beside words that nobody knows; empty if they say none, or a part of a force."""
    parts = [spoken(column) for column in family.columns]
    kinds = {words().get(part, "") for some in parts for part in some} - {""}
    every = all(any(part in words() for part in some) for some in parts)
    mixed = len(kinds) > 1 or any(
        _NOT_MEASURED.fullmatch(part) for some in parts for part in some
    )
    return kinds.pop() if every and kinds and not mixed else ""


def _nearest(column: str) -> str:
    """The word that a part of a column's name is nearest to."""
    known = words()
    long = [word for word in known if len(word) > 2]
    for part in column.replace(".", "_").replace("/", "_").lower().split("_"):
        close = get_close_matches(part.strip("0123456789[]"), long, n=1, cutoff=0.7)
        if close:
            return f"{known[close[0]]}?"
    return ""
