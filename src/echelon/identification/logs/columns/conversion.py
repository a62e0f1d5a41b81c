"""A table in the terms of a robot: units, signs, offsets, clocks and sides of the gears are settled here, once.

Columns of messages bring clocks of their own, and are interpolated at the stamps of the positions.  Where a clock
pauses for longer than a gap its values are not numbers.

Positions behind the gears follow from θ = T q.  Every column is one equation, of a joint (q_i = …), of a motor (a row
of T) or of another sensor of motion, such as an inclinometer, so a log may mix them as long as there are as many
equations as unknowns; with more of them the user has to say which sensors to believe, since link- and motor-side
encoders differ by the elasticity between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from echelon.identification.logs.columns.column_map import (
    ORDERS,
    Channel,
    ColumnMap,
    actuators,
    coordinates,
    independent_coordinates,
    units,
)
from echelon.identification.logs.columns.column_names import kinds_said
from echelon.identification.logs.columns.motion_sensors import (
    NO_SENSORS,
    MotionSensor,
    Sensors,
)
from echelon.identification.logs.files.log_file import Table
from echelon.identification.logs.finding import listed
from echelon.identification.logs.recording import Recording
from echelon.identification.logs.units import factor
from echelon.identification.signals.clock import GAP, nominal_period
from echelon.identification.signals.filters import INVERSE, turned
from echelon.robot import (
    Force,
    Mechanism,
    MotionKind,
    Output,
    Side,
    symbol_values,
    transmission_matrix,
)
from echelon.shared import Flags, Floats, InputError, locating, nearest_of, nearest_word

_GAINED = ("A", "V")  # what drives report instead of forces
LARGEST = 1e100
"""Largest value of a sensor in SI units; its square, and that of its inverse, still have doubles."""

_STATES = {
    "position": "q",
    "velocity": "qd",
    "acceleration": "qdd",
    "reference": "reference",
}


def time_candidates(names: Sequence[str]) -> list[str]:
    """Columns that by their names could hold time stamps."""
    return [name for name in names if "time" in kinds_said(name)]


@dataclass(frozen=True)
class Alignment:
    """Columns of a table on the clock of the positions."""

    table: Table
    columns: ColumnMap
    used: tuple[
        str, ...
    ]  # the columns that will be asked for, those of positions first

    def column(self, name: str) -> Floats:
        """A column on the common clock, shape (N,)."""
        values = raw_column(self.table, name)
        clock = self.clock(name)
        if clock == self.clock(self.used[0]):
            return np.asarray(values if self._inside.all() else values[self._inside])
        return self._interpolated(name, self._stamps(clock), values)

    @cached_property
    def time(self) -> Floats:
        """The common time stamps, s, shape (N,)."""
        return np.asarray(self._stamps(self.clock(self.used[0]))[self._inside])

    @cached_property
    def _inside(self) -> npt.NDArray[np.bool_]:
        """Which stamps of the positions lie within the span of all clocks."""
        own = self.clock(self.used[0])
        base = self._stamps(own)
        inside = np.ones(len(base), dtype=bool)
        for clock in dict.fromkeys(map(self.clock, self.used)):
            if clock != own:
                stamps = self._stamps(clock)
                inside &= (
                    (base >= stamps[:1].sum())
                    & (base <= stamps[-1:].sum())
                    & bool(len(stamps))
                )
        if len(base) and not inside.any():
            clocks = listed(filter(None, map(self.clock, self.used)))
            raise InputError(
                f"the clocks {clocks} have no time in common", source=self.table.source
            )
        return inside

    def clock(self, name: str) -> str:
        """The column with the time stamps of a column; empty where a rate is given."""
        own = self.table.clocks.get(name)
        if self.columns.rate is not None:
            return ""
        time = self.columns.time
        if time is not None and (
            own is None or own in (time.column, self.table.clocks.get(time.column))
        ):
            return time.column
        if own is None:
            candidates = time_candidates(tuple(self.table.columns))
            hint = (
                f"; these columns could be time stamps: {listed(candidates)}"
                if candidates
                else ""
            )
            problem = "its samples have no time: name the column with time stamps as time, or write  rate: 1000  (Hz)  "
            problem += (
                f"under log, which  echelon setup ROBOT LOG -o setup.yaml  writes{hint}"
            )
            raise InputError(
                problem, source=self.table.source, element=f"column '{name}'"
            )
        return own

    def _stamps(self, clock: str) -> Floats:
        if not clock:
            if not (self.columns.rate and 0 < self.columns.rate < float("inf")):
                raise InputError(
                    f"rate must be positive, got {self.columns.rate}",
                    source=self.table.source,
                )
            count = len(raw_column(self.table, self.used[0]))
            return np.asarray((self.table.first + np.arange(count)) / self.columns.rate)
        values = raw_column(self.table, clock)
        channel = self.columns.time
        if channel is None or channel.column not in (
            clock,
            self.table.clocks.get(clock),
        ):
            return values
        try:
            return np.asarray(
                channel.scale * factor(channel.unit, "s") * values + channel.offset
            )
        except InputError as error:
            raise InputError(
                error.problem, source=self.table.source, element="unit of time"
            ) from None

    def _interpolated(self, name: str, stamps: Floats, values: Floats) -> Floats:
        back = np.flatnonzero(~(np.diff(stamps) >= 0))
        if len(back):
            problem = f"its time stamps go backwards at row {back[0] + 1}, so it cannot be brought onto another clock"
            raise InputError(
                problem, source=self.table.source, element=f"column '{name}'"
            )
        later = np.append(np.diff(stamps) > 0, True)  # of equal stamps the last counts
        stamps, values = stamps[later], values[later]
        wanted = self.time
        found = np.interp(wanted, stamps, values)
        if len(stamps) > 1:
            after = np.clip(np.searchsorted(stamps, wanted), 1, len(stamps) - 1)
            wide = stamps[after] - stamps[after - 1] > GAP * nominal_period(stamps)
            exact = (wanted == stamps[after]) | (wanted == stamps[after - 1])
            found[wide & ~exact] = np.nan
        return found


def raw_column(table: Table, name: str) -> Floats:
    """A column of a table; an error suggests the nearest name."""
    if name not in table.columns:
        raise InputError(
            f"there is no column '{name}'{nearest_of(name, table.columns)}",
            source=table.source,
        )
    return table.columns[name]


def check_lengths(table: Table, groups: Mapping[str, Sequence[str]]) -> None:
    """Refuse columns of one clock with different lengths; the clock itself may be empty."""
    for clock, names in groups.items():
        sizes = {
            name: len(raw_column(table, name))
            for name in ([clock] if clock else []) + list(names)
        }
        if len(set(sizes.values())) > 1:
            shown = ", ".join(
                f"'{name}' {size}" for name, size in list(sizes.items())[:8]
            )
            raise InputError(
                f"columns of one clock have different lengths: {shown}",
                source=table.source,
            )


def needed_columns(columns: ColumnMap, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Columns that a recording needs; without time or rate also those that could be time stamps, to name them."""
    time = [columns.time] if columns.time is not None else []
    channels = [
        *time,
        *(channel for group in columns.channels.values() for channel in group.values()),
    ]
    found = list(dict.fromkeys(channel.column for channel in channels))
    if names:
        of_locked = [name for some in columns.locked.values() for name in some.columns]
        strange = [name for name in found if name not in names]
        if len(strange) == 1:
            raise InputError(
                f"there is no column '{strange[0]}'{nearest_of(strange[0], names)}"
            )
        if strange:
            near = {name: nearest_word(name, names) for name in strange}
            guesses = (
                f"'{name}'" + (f" ('{near[name]}'?)" if near[name] else "")
                for name in strange
            )
            raise InputError(f"there are no columns {listed(guesses)}; in brackets are the nearest names; the log has "
                             f"{listed(names)}")  # fmt: skip
        if columns.time is None and columns.rate is None:
            found += [name for name in time_candidates(names) if name not in found]
        found += [name for name in of_locked if name in names and name not in found]
    return tuple(found)


def recording(table: Table, columns: ColumnMap, mechanism: Mechanism) -> Recording:
    """A log in SI units, on the joints' side, on the clock of the positions; values within pauses are NaN."""
    with locating(table.source):
        if not columns.positions:
            raise InputError("the column map names no positions", element="position")
        for kind, group in columns.channels.items():
            check_names(mechanism, kind, group, columns.sensors)
        aligned = _aligned(table, columns)
        given = {
            kind: _read(aligned, mechanism, kind, group)
            for kind, group in columns.channels.items()
            if group
        }
        signals = {
            signal: joint_coordinates(mechanism, kind, given[kind], columns.sensors)
            for kind, signal in _STATES.items()
            if kind in given
        }
        if "qd" in signals:
            signals["qd"] = in_own_axes(mechanism, signals, columns.twist)
        if "output" in given:
            signals["y"] = measured_outputs(mechanism, given["output"])
        outputs = (
            dict(zip((o.name for o in mechanism.outputs), signals["y"].T, strict=True))
            if "y" in signals
            else {}
        )
        loads = {name: outputs[name] for name in _loaded(mechanism) if name in outputs}
        inputs = {**loads, **given.get("input", {})}
        touches = given.get("contact", {}) if mechanism.contacts else {}
        for name, values in touches.items():
            inputs[contact_input(name)] = (values > 0).astype(float)
        return Recording(table.source, aligned.time, signals, inputs)


_CONTACT = "contact "  # begins names of inputs that no coordinate or drive has


def contact_input(contact: str) -> str:
    """Name of the input that is above zero where a contact touches."""
    return f"{_CONTACT}{contact}"


def contact_of(name: str) -> str:
    """The contact that an input is of."""
    return name.removeprefix(_CONTACT)


def is_contact_input(name: str) -> bool:
    """Whether an input says where a contact touches."""
    return name.startswith(_CONTACT)


def touching(inputs: Mapping[str, Floats], contacts: Sequence[str]) -> Flags:
    """Which contacts touch, by the inputs of a log, shape (N, contacts); those without a column always do."""
    given = [inputs.get(contact_input(name)) for name in contacts]
    count = next((len(values) for values in given if values is not None), 1)
    always = np.ones(count)
    return np.column_stack([always if v is None else v for v in given]) > 0


def in_own_axes(
    mechanism: Mechanism, signals: Mapping[str, Floats], twist: str
) -> Floats:
    """Velocities (N, velocities) with those of floating bases along the axes that the mechanism has.

    Its linear velocities are along the world's axes and its angular ones about the base's own; ``twist`` says whether
    the log has both along the ``world``'s or both along the base's (``body``).
    """
    found = signals["qd"].copy()
    if twist == "mixed":
        return found
    for joint in mechanism.floating_joints:
        *slides, ball = joint.motions
        if ball.kind is not MotionKind.BALL:
            continue  # held upright, so that its axes are the world's
        q = signals["q"][:, [mechanism.positions.index(n) for n in ball.positions]]
        q = q / np.linalg.norm(q, axis=1, keepdims=True)
        own = twist == "world"
        moved = ball.velocities if own else [s.velocities[0] for s in slides]
        if not moved:
            continue
        if len(moved) < 3:
            problem = "velocities along the base's own axes are turned together: lock none of its translations, or all"
            raise InputError(problem, element=f"velocity of '{joint.name}'")
        places = [mechanism.velocities.index(name) for name in moved]
        found[:, places] = turned(q * INVERSE if own else q, found[:, places])
    return found


def _loaded(mechanism: Mechanism) -> set[str]:
    """Places with friction that grows with the load, which is what is measured there unless another input is stated."""
    return {
        a.at
        for effect in mechanism.effects
        for a in effect.actions
        if a.kind == "load_friction"
    }


def _aligned(table: Table, columns: ColumnMap) -> Alignment:
    names = tuple(
        channel.column
        for group in columns.channels.values()
        for channel in group.values()
    )
    for name in names:
        raw_column(table, name)
    aligned = Alignment(table, columns, tuple(dict.fromkeys(names)))
    clocks: dict[str, list[str]] = {}
    for name in aligned.used:
        clocks.setdefault(aligned.clock(name), []).append(name)
    check_lengths(table, clocks)
    return aligned


def _units(
    mechanism: Mechanism, kind: str, name: str, channel: Channel, sensors: Sensors
) -> Sequence[str] | None:
    """SI units that a column may be in; currents and voltages become forces by a gain that is stated."""
    expected = units(mechanism, kind, name, sensors)
    gained = kind == "output" and channel.scale != 1 and expected is not None
    return (*expected, *_GAINED) if gained and expected is not None else expected


def _read(
    aligned: Alignment, mechanism: Mechanism, kind: str, group: Mapping[str, Channel]
) -> dict[str, Floats]:
    """Values by coordinate, output, actuator or sensor: scale · (column in SI units) + offset."""
    found = {}
    for name, channel in group.items():
        try:
            ratio = channel.scale * factor(
                channel.unit,
                _units(mechanism, kind, name, channel, aligned.columns.sensors),
            )
        except InputError as error:
            where = f"unit of column '{channel.column}' ({kind} of '{name}')"
            raise InputError(error.problem, element=where) from None
        if not np.isfinite(ratio) or ratio == 0 or not np.isfinite(channel.offset):
            problem = f"scale {channel.scale:g} and offset {channel.offset:g}: expected finite numbers, the scale not 0"
            raise InputError(
                problem, element=f"column '{channel.column}' ({kind} of '{name}')"
            )
        with np.errstate(over="ignore"):
            values = ratio * aligned.column(channel.column) + channel.offset
        largest = float(np.max(np.abs(values), initial=0.0, where=np.isfinite(values)))
        if largest > LARGEST or 0 < largest < 1 / LARGEST:
            valid = f"{1 / LARGEST:.0e} to {LARGEST:.0e}"
            problem = f"reaches {largest:.3g} in SI units, which no sensor measures (valid: {valid})"
            raise InputError(
                problem, element=f"column '{channel.column}' ({kind} of '{name}')"
            )
        found[name] = values
    return found


# -- sides of the gears ------------------------------------------------------------------------------------------------


Given = Mapping[str, Floats]


def joint_coordinates(
    mechanism: Mechanism, kind: str, given: Given, sensors: Sensors = NO_SENSORS
) -> Floats:
    """Positions, velocities or accelerations (N, coordinates) from columns by coordinate, actuator or sensor, SI units.

    With loops, of the independent coordinates only where only these are given.
    """
    names = coordinates(mechanism, kind)
    check_names(mechanism, kind, given, sensors)
    found = {name: values for name, values in given.items() if name in names}
    rows = _rows(
        mechanism, kind, [name for name in given if name not in names], sensors
    )
    told = {*found, *(name for row in rows.values() for name in row.weights)}
    independent = independent_coordinates(mechanism, kind)
    if told <= set(independent):
        names = independent
    unknown = [name for name in names if name not in found]
    if unknown and not rows:
        raise InputError(_say_missing(mechanism, kind, unknown), element=kind)
    if len(rows) < len(unknown):
        problem = _say_missing(mechanism, kind, unknown)
        raise InputError(f"{problem}; {listed(rows)} alone do not determine them")
    found |= _solved(kind, rows, unknown, {**given, **found})
    return _columns([found[name] for name in names])


def check_names(
    mechanism: Mechanism,
    kind: str,
    given: Iterable[str],
    sensors: Sensors = NO_SENSORS,
) -> None:
    """Refuse keys that are no coordinates, outputs, actuators or sensors; suggests what was probably meant."""
    motors = [actuator.name for actuator in actuators(mechanism)]
    if kind == "output":
        valid = [
            *(output.name for output in mechanism.outputs),
            *(a.name for a in mechanism.transmission.actuators),
        ]
    elif kind == "input":
        valid = [
            *mechanism.velocities,
            *(a.name for a in mechanism.transmission.actuators),
        ]
    elif kind == "contact":
        return
    else:
        valid = [*coordinates(mechanism, kind), *motors, *sensors]
    for name in given:
        if name in mechanism.dependent and kind != "output":
            raise InputError(
                "it follows from others through a coupling; leave it out",
                element=f"{kind} of '{name}'",
            )
        if name not in valid:
            what = (
                "output or actuator" if kind == "output" else "coordinate or actuator"
            )
            problem = (
                f"{mechanism.name} has no {what} of this name{nearest_of(name, valid)}"
            )
            raise InputError(problem, element=f"{kind} of '{name}'")


def _say_missing(mechanism: Mechanism, kind: str, missing: Sequence[str]) -> str:
    text = f"columns are missing for {listed(missing)}"
    motors = [
        a.name
        for a in actuators(mechanism)
        if any(joint in missing for joint, _ in a.terms)
    ]
    text += f", or for the actuators {listed(motors)}" if motors else ""
    rests = f"; for a joint at rest, state its position:  locked: {{{missing[0]}: 0}}"
    return text + (rests if kind == "position" else "; give all or none")


def _rows(
    mechanism: Mechanism, kind: str, names: Sequence[str], sensors: Sensors
) -> dict[str, MotionSensor]:
    """Combinations of coordinates that actuators and sensors measure, by name."""
    driven, matrix = transmission_matrix(mechanism)
    every = [actuator.name for actuator in mechanism.actuators]
    found: dict[str, MotionSensor] = {}
    for name in names:
        if name in sensors:
            zero = 0.0 if ORDERS[kind] else sensors[name].zero
            found[name] = replace(sensors[name], zero=zero)
        else:
            ratios = dict(zip(driven, matrix[every.index(name)], strict=True))
            moved = {joint: float(ratio) for joint, ratio in ratios.items() if ratio}
            found[name] = MotionSensor(moved)
    return found


def _solved(
    kind: str, rows: Mapping[str, MotionSensor], unknown: Sequence[str], given: Given
) -> dict[str, Floats]:
    """Coordinates that no column is of, by actuators and sensors that move with them."""
    if len(rows) > len(unknown):
        moved = dict.fromkeys(name for row in rows.values() for name in row.weights)
        stated = [name for name in moved if name not in unknown]
        problem = f"{listed([*stated, *rows])} measure {listed(moved)} more than once, on both sides of a gear or by several "
        problem += "sensors; keep one column for each coordinate"
        raise InputError(problem, element=kind)
    if not rows:
        return {}
    weights = [
        [row.weights.get(name, 0.0) for name in unknown] for row in rows.values()
    ]
    if np.linalg.matrix_rank(weights) < len(unknown):
        problem = f"{listed(rows)} do not determine {listed(unknown)}"
        raise InputError(problem, element=kind)
    right = []
    for name, row in rows.items():
        known = [
            given[joint] * weight
            for joint, weight in row.weights.items()
            if joint not in unknown
        ]
        right.append(given[name] - row.zero - sum(known))
    solution = np.linalg.solve(weights, np.stack(right)) + 0.0  # no negative zeros
    return dict(zip(unknown, solution, strict=True))


# -- outputs ----------------------------------------------------------------------------------------------------------


def unpushed(mechanism: Mechanism) -> list[str]:
    """Outputs of the floating base of a robot in contact, which no drive pushes."""
    free = mechanism.floating_velocities if mechanism.contacts else ()
    return [
        output.name
        for output in mechanism.outputs
        if output.forces and all(force.at in free for force, _ in output.forces)
    ]


def measured_outputs(mechanism: Mechanism, given: Given) -> Floats:
    """Outputs (N, outputs) from columns by output or actuator, SI units; joint forces also as τ_q = Tᵀ τ_θ.

    Nothing but its contacts pushes the floating base of a robot that has some.
    """
    check_names(mechanism, "output", given)
    rest = np.zeros(len(next(iter(given.values()))))
    given = {**dict.fromkeys(unpushed(mechanism), rest), **given}
    names = {output.name for output in mechanism.outputs}
    motors = {name: values for name, values in given.items() if name not in names}
    missing = [output for output in mechanism.sensed if output.name not in given]
    if not motors:
        if missing:
            text = f"columns are missing for {listed(o.name for o in missing)}"
            raise InputError(
                f"{text}; or state in the description that they are not measured",
                element="output",
            )
        return _columns([given[o.reads or o.name] for o in mechanism.outputs])
    found = {name: values for name, values in given.items() if name in names}
    used: set[str] = set()
    for output in missing:
        found[output.name] = _from_motors(mechanism, output, motors, used)
    idle = next((name for name in motors if name not in used), None)
    if idle is not None:
        problem = f"no output needs it (outputs: {listed(names)}); leave it out"
        raise InputError(problem, element=f"output of '{idle}'")
    return _columns([found[o.reads or o.name] for o in mechanism.outputs])


def _columns(channels: Sequence[Floats]) -> Floats:
    """Channels as columns, each of which lies together in memory, because they are looked at one by one."""
    return np.stack(channels).T


def _from_motors(
    mechanism: Mechanism, output: Output, motors: Given, used: set[str]
) -> Floats:
    total = np.zeros(len(next(iter(motors.values()))))
    where = f"output '{output.name}'"
    if output.cuts:
        raise InputError(_ONLY_JOINTS, element=where)
    for force, weight in output.forces:
        known = symbol_values(mechanism, weight.symbols())
        scale = weight.at(known)
        for name, ratio in _shares(mechanism, where, force).items():
            if name not in motors:
                problem = f"a column is missing for it, or for the actuator '{name}'"
                raise InputError(problem, element=where)
            used.add(name)
            total = total + scale * ratio * motors[name]
    return total


_ONLY_JOINTS = (
    "a column is missing for it; only forces of joints follow from those of actuators"
)


def _shares(mechanism: Mechanism, where: str, force: Force) -> dict[str, float]:
    """Actuators whose forces make a joint's force, with their ratios."""
    if force.side is not Side.JOINT:
        raise InputError(_ONLY_JOINTS, element=where)
    driven, matrix = transmission_matrix(mechanism)
    found = {force.at: 1.0}
    if force.at in driven:
        column = matrix[:, driven.index(force.at)]
        found = {
            a.name: float(r)
            for a, r in zip(mechanism.actuators, column, strict=True)
            if r
        }
    for effect in mechanism.effects:
        lossy = next(
            (a.at for a in effect.actions if a.side is Side.ACTUATOR and a.at in found),
            None,
        )
        if lossy is not None:
            raise InputError(
                f"the force of actuator '{lossy}' differs from that at the joint by the effect '{effect.parameter}' in "
                "the drive: state the actuators' forces as outputs, or the effect at the joint",
                element=where,
            )
    return found
