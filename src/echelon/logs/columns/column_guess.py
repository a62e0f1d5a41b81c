"""Columns by their names, and by their values where names say nothing, for a set-up that says nothing about its logs.

What is clear is taken, and what is not is asked about, all of it in one message.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

from echelon.arrays import Floats
from echelon.errors import InputError
from echelon.logs.columns.by_values import (
    Family,
    are_numbers,
    blocks,
    classified,
    clock,
    clock_unit,
    families,
    in_order,
    in_pairs,
    is_mixed,
    is_still,
)
from echelon.logs.columns.column_map import (
    ORDERS,
    Channel,
    ColumnMap,
    actuators,
    independent_coordinates,
    units,
)
from echelon.logs.columns.column_names import (
    KNOWN,
    SHARES,
    Meaning,
    aliases,
    may_be_output,
    meaning,
    spoken,
    stated_unit,
    unlogged_joints,
    without_prefix,
    words,
)
from echelon.logs.files.log_file import Table
from echelon.logs.finding import counted, listed
from echelon.logs.units import factor, fits
from echelon.mechanism.lock_joints import lock_joints, lockable
from echelon.mechanism.mechanism import Mechanism

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
_MANY = 8
_SERVOS = (
    "; if none is an output, there are commands of positions, to which servos can be fitted: name these under input, "
    "with the effect {type: servo, at: all}"
)
_FEWEST = 4  # rows that say how columns change
_DIGITS = re.compile(r"\d+")
_FIRST = re.compile(r"/?[^\W_]+[\W_]+")
_ANGLES = re.compile(
    "theta|phi|psi|alpha|beta|angle|winkel|rad|deg|rot|θ|φ", re.IGNORECASE
)
_TORQUES = re.compile("tau|torque|trq|moment|nm|couple|τ", re.IGNORECASE)
_NOT_MEASURED = {
    *("ext", "external", "con", "fric", "friction", "grav", "gravity", "dist", "filt"),
    *("ref", "desired", "des", "cmd", "commanded", "target", "limit", "max", "min"),
}


@dataclass(frozen=True)
class Guess:
    """What the columns of a log were taken for, and what could not be decided."""

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
    meanings, known = _meanings(names, mechanism, said)
    whole = _of_all(
        names, meanings, mechanism, look, outputs=outputs, by_values=by_values
    )
    if not whole.problems or not lockable(mechanism):
        return whole
    paired = (
        _in_pairs(names, meanings, mechanism, look, outputs=outputs)
        if by_values and look is not None
        else None
    )
    if paired is not None:
        return paired
    several = _of_several(names, mechanism, look, said, outputs=outputs)
    if len(several) > 1:
        first, *others = several
        text = f"the log has several sets of columns, {listed([f'{word}…' for word in several])}"
        if by_values:
            text += f": taken are those of {first}…; for another, write {' or '.join(others)} for {first} under log"
            return replace(several[first], notes=(*several[first].notes, text))
        return replace(
            whole,
            problems=(f"{text}: say under log which are those of {mechanism.name}",),
        )
    parts = []
    for locked in unlogged_joints(names, meanings, known, mechanism):
        rest = lock_joints(mechanism, dict.fromkeys(locked, 0.0))
        part = _of_all(
            names,
            _meanings(names, rest, said)[0],
            rest,
            look,
            outputs=outputs,
            by_values=by_values,
        )
        parts += [replace(part, unlogged=locked)]
    nothing = not (whole.columns.positions or whole.columns.outputs)
    parts = [part for part in parts if not part.problems] or (parts if nothing else [])
    if len(parts) > 1:
        which = " or ".join(
            f"those of {listed(part.columns.positions)}" for part in parts
        )
        problem = f"the log has columns for some of the joints, {which}: say which others rest, under locked"
        choices = tuple(part.unlogged for part in parts)
        return replace(
            whole, columns=parts[0].columns, problems=(problem,), choices=choices
        )
    return parts[0] if parts else whole


def _of_several(
    names: Sequence[str],
    mechanism: Mechanism,
    look: Look | None,
    said: Mapping[str, str],
    *,
    outputs: bool,
) -> dict[str, Guess]:
    """Guesses by the first words of columns that without this word are all that the robot needs."""
    first = {
        name: start.group()
        for name in names
        if (start := _FIRST.match(name)) is not None
    }
    found: dict[str, Guess] = {}
    for word in dict.fromkeys(first.values()):
        own = [name for name in names if first.get(name, word) == word]
        short = {name: said.get(name, name).removeprefix(word) for name in own}
        if re.sub(r"[\W_]", "", word).lower() in KNOWN or len(own) == len(names):
            continue
        of = _of_all(
            own,
            _meanings(own, mechanism, short)[0],
            mechanism,
            look,
            outputs=outputs,
            by_values=False,
        )
        found |= {} if of.problems else {word: of}
    return found


def _meanings(
    names: Sequence[str], mechanism: Mechanism, said: Mapping[str, str]
) -> tuple[dict[str, Meaning], dict[str, str]]:
    """What the names of columns say, with their units, and coordinates by what columns may call them."""
    drives = [a.name for a in mechanism.transmission.actuators]
    known = aliases(
        [
            *mechanism.positions,
            *mechanism.velocities,
            *(o.name for o in mechanism.outputs),
            *drives,
        ]
    )
    texts = without_prefix(names, known)
    texts |= {name: said[name] for name in names if name in said}
    found = {name: meaning(text, known) for name, text in texts.items()}
    # of encoder1_1, encoder1_2, … none is understood, as two numbers differ in some of them
    strange = {_DIGITS.sub("#", name) for name, said in found.items() if said is None}
    return {
        n: said
        for n, said in found.items()
        if said is not None and _DIGITS.sub("#", n) not in strange
    }, known


def _of_all(
    names: Sequence[str],
    meanings: Meanings,
    mechanism: Mechanism,
    look: Look | None,
    *,
    outputs: bool,
    by_values: bool,
) -> Guess:
    """The guess if the log has all joints."""
    groups, problems = _by_names(meanings, mechanism, outputs, look)
    notes: list[str] = []
    headerless = are_numbers(names) and not meanings
    needed = _NEEDED[: 1 + outputs]
    time, trouble = _time(meanings, _may_be_time(names, meanings, groups), look)
    absent = [kind for kind in needed if not groups[kind]]
    if absent and look is not None and (by_values or (headerless and not problems)):
        partial = (
            0 < len(groups["output"]) < len(_valid(mechanism, "output"))
            and "position" in absent
        )
        if (
            len(absent) == len(needed) or partial
        ):  # A1 beside M1 is no acceleration, and wrist1 is not every joint
            groups = {kind: {} for kind in groups}
        known = [kind for kind, some in groups.items() if some]
        taken = {
            channel.column for some in groups.values() for channel in some.values()
        }
        clear = [
            n
            for n, said in meanings.items()
            if (said.kind in ("time", *known) or n in taken) and not headerless
        ]
        notes += _filled(
            groups,
            _by_values(names, clear, mechanism, look().columns, groups, time),
            mechanism,
        )
        absent = [kind for kind in needed if not groups[kind]]
        problems = problems if absent else []
        motors = [
            c.column
            for c in groups["position"].values()
            if c.column in meanings and meanings[c.column].motor
        ]
        if motors and not actuators(mechanism):
            text = "are those of motors by their names, taken for angles of joints: state actuators if there are gears"
            notes.append(f"{listed(motors)} {text}")
    commanded = absent == ["output"] and bool(groups["reference"])
    if absent and not problems:
        problems.append(
            _question(absent, names, meanings, mechanism, look, time)
            + _SERVOS * commanded
        )
    if commanded:
        unclear = [
            name
            for name in names
            if name not in meanings or meanings[name].kind in _PARTLY
        ]
        commanded = not _alive([name for name in unclear if may_be_output(name)], look)
    says_time = (
        time is not None
        and time.column in meanings
        and meanings[time.column].kind == "time"
    )
    if time is not None and not says_time and not headerless:
        notes.append(
            f"'{time.column}' taken for the time, because it grows as a clock does"
        )
    outputs_from = {channel.column for channel in groups["output"].values()}
    said_of = [said for column, said in meanings.items() if column in outputs_from]
    if any(said.kind == "current" for said in said_of):
        notes.append(
            "the outputs are currents by their names, taken for torques: give the torque per ampere as scale"
        )
    for sign, share in (("%", "hundredth"), ("‰", "thousandth")):
        if any(said.unit == sign for said in said_of):
            notes.append(
                f"the outputs are in {sign}, taken for torques: give a {share} of the rated torque as scale"
            )
    kinds = (
        groups[kind]
        for kind in ("position", "velocity", "acceleration", "output", "reference")
    )
    unmeasured = [
        name for name in _valid(mechanism, "output") if name not in groups["output"]
    ]
    unmeasured = (
        unmeasured
        if 0 < len(outputs_from) == len(mechanism.outputs) - len(unmeasured)
        else []
    )
    columns = ColumnMap(time, None, *kinds)
    rest = tuple(unmeasured)
    return Guess(
        columns,
        (*problems, *trouble),
        tuple(notes),
        unmeasured=rest,
        commanded=commanded,
    )


def _unchanging(look: Look | None) -> set[str]:
    """Columns that never change, and so say nothing; none before a log is looked at."""
    columns = {} if look is None else look().columns
    return {name for name, values in columns.items() if is_still(values)}


def _filled(
    groups: dict[str, dict[str, Channel]],
    seen: Mapping[str, Family],
    mechanism: Mechanism,
) -> list[str]:
    """Put families of columns where names say nothing; says which."""
    notes = []
    for kind, family in seen.items():
        if not groups.get(kind):
            groups[kind] = {
                n: _channel(c, stated_unit(c), mechanism, kind, n) or Channel(c)
                for n, c in zip(_valid(mechanism, kind), family.columns, strict=True)
            }
            those = (
                ", ".join(family.columns)
                if len(family.columns) < _MANY
                else family.label
            )
            notes.append(
                f"{those} taken for the {_several(kind)} of {listed(groups[kind])} by their values"
            )
    return notes


def _several(kind: str) -> str:
    return "velocities" if kind == "velocity" else f"{kind}s"


def _by_names(
    meanings: Meanings, mechanism: Mechanism, outputs: bool, look: Look | None
) -> tuple[dict[str, dict[str, Channel]], list[str]]:
    """Channels by kind and by coordinate, output or actuator, and what is wrong with the names."""
    groups: dict[str, dict[str, Channel]] = {}
    problems: list[str] = []
    for kind in (*_NEEDED, *_OPTIONAL):
        try:
            groups[kind] = _channels(meanings, mechanism, kind, look)
            other = _ALTERNATIVES.get(kind, "")
            several = any(said.kind == other for said in meanings.values())
            if several and not _alive(
                [channel.column for channel in groups[kind].values()], look
            ):
                groups[kind] = (
                    _channels(meanings, mechanism, other, look) or groups[kind]
                )
        except InputError as error:
            groups[kind] = {}
            if (
                kind in _NEEDED[: 1 + outputs]
            ):  # nobody needs the others: what is not clear is left out
                problems.append(error.problem)
    return groups, problems


def _valid(mechanism: Mechanism, kind: str) -> list[str]:
    if kind in ("output", "current"):
        return [output.name for output in mechanism.outputs]
    return list(
        independent_coordinates(mechanism, "position" if kind == "joint" else kind)
    )


# -- names ------------------------------------------------------------------------------------------------------------


def _time(
    meanings: Meanings, unnamed: Sequence[str], look: Look | None
) -> tuple[Channel | None, list[str]]:
    """The column of time, of several that by their names could be it the one that grows as a clock does."""
    found = [name for name, said in meanings.items() if said.kind == "time"]
    # columns of messages have stamps of their own, which the file assigns to them
    if look is None or look().clocks:
        found = [name for name in found if not name.startswith("/")]
    found = [name for name in found if fits(meanings[name].unit, "s")]
    if look is not None and (len(found) > 1 or (unnamed and not found)):
        table = look()
        chosen = (
            ""
            if table.clocks and not found
            else clock(table.columns, found or unnamed, named=bool(found))
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


def _may_be_time(
    names: Sequence[str],
    meanings: Meanings,
    groups: Mapping[str, Mapping[str, Channel]],
) -> list[str]:
    """Columns that may be the time though their names do not say so: a letter alone says little of a joint."""
    taken = {channel.column for some in groups.values() for channel in some.values()}
    others = [
        name
        for name, said in meanings.items()
        if not said.name and said.index is None and name not in taken
    ]
    return [*(name for name in names if name not in meanings), *others]


def _alive(names: Iterable[str], look: Look | None) -> list[str]:
    """The columns that change."""
    still = _unchanging(look) if names else set()
    return [name for name in names if name not in still]


def _channels(
    meanings: Meanings, mechanism: Mechanism, kind: str, look: Look | None
) -> dict[str, Channel]:
    """The columns of a kind, by coordinate, output or actuator; of several for one those that change."""
    own = {column: said for column, said in meanings.items() if said.kind == kind}
    if not own:
        return {}
    valid = _valid(mechanism, kind)
    motors = [actuator.name for actuator in actuators(mechanism)]
    if any(said.motor for said in own.values()) and (motors or kind == "position"):
        behind = [said for said in own.values() if not said.motor]
        changing = [
            own[column].motor for column in (_alive(own, look) if behind else ())
        ]
        # where both sides have sensors, the joints' where the robot states no gears
        at_joints = bool(behind) and changing.count(False) + (
            not motors
        ) > changing.count(True)
        own = {column: said for column, said in own.items() if said.motor != at_joints}
        if not motors and not at_joints:
            raise InputError(
                f"{listed(own)} are measured at motors by their names, but {mechanism.name} states no actuators: state "
                "actuators: {m1: 100*joint1}, or say under log that they are positions of joints"
            )
        valid = valid if at_joints else motors
    keys = {column: said.name for column, said in own.items() if said.name}
    positions = _numbers(
        said
        for said in meanings.values()
        if said.kind in ("position", "joint") and not said.motor
    )
    keys = keys or _numbered(
        own, positions if kind in _PARTLY else set(), valid, mechanism, kind
    )
    found: dict[str, Channel] = {}
    strange: list[str] = []
    if len(keys) > len({*keys.values()}):
        alive = _alive(keys, look)
        kept = {keys[column] for column in alive}
        keys = {
            column: name
            for column, name in keys.items()
            if column in alive or name not in kept
        }
    for column, name in keys.items():
        channel = _channel(column, own[column].unit, mechanism, kind, name)
        if (name not in valid and name not in motors) or channel is None:
            strange += [f"'{column}' is in {own[column].unit}"] if name in valid else []
            continue
        if name in found:
            both = f"'{found[name].column}' and '{column}'"
            raise InputError(
                f"{both} could both be the {kind} of '{name}'; say under log which it is"
            )
        found[name] = channel
    missing = [name for name in valid if name not in found]
    if (
        missing
        and not (found and kind in _PARTLY)
        and not any(name in found for name in motors)
    ):
        taken = "; ".join(
            [f"found: {listed(channel.column for channel in found.values())}", *strange]
        )
        raise InputError(
            f"no column is the {kind} of {listed(missing)} ({taken}); say under log which they are"
        )
    return {name: found[name] for name in [*valid, *motors] if name in found}


def _channel(
    column: str, unit: str, mechanism: Mechanism, kind: str, name: str
) -> Channel | None:
    """A column with its unit; None where the unit is not one of the quantity."""
    if kind == "current":  # as if it were a torque: one unit of force per ampere
        return Channel(column, scale=factor(unit, "A")) if fits(unit, "A") else None
    kind = "position" if kind == "joint" else kind
    expected = units(mechanism, kind, name)
    if kind == "output" and unit in SHARES:
        return Channel(column)
    # dq_deg is in deg/s, and the m of tau_m says that it was measured
    texts = (
        [unit + "/s" * order for order in range(ORDERS.get(kind, 0) + 1)]
        if unit
        else [""]
    )
    texts += [""] if len(unit) == 1 and stated_unit(column) != unit else []
    return next((Channel(column, text) for text in texts if fits(text, expected)), None)


def _numbers(meanings: Iterable[Meaning]) -> set[int]:
    return {said.index for said in meanings if said.index is not None}


def _numbered(
    own: Meanings,
    others: set[int],
    valid: Sequence[str],
    mechanism: Mechanism,
    kind: str,
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
            has = f"{counted(len(found), kind, _several(kind))} (numbers {', '.join(map(str, sorted(found)))})"
        raise InputError(
            f"the log has {has}, {listed(numbers)}, but {mechanism.name} has {len(valid)}: {listed(valid)}; is it a "
            "log of another robot?  If not, say under log which they are"
        )
    return {
        column: valid[number - first]
        for column, number in numbers.items()
        if number is not None
    }


# -- values -----------------------------------------------------------------------------------------------------------


def _by_values(
    names: Sequence[str],
    understood: Sequence[str],
    mechanism: Mechanism,
    columns: Mapping[str, Floats],
    groups: Mapping[str, Mapping[str, Channel]],
    time: Channel | None,
) -> dict[str, Family]:
    """Families of columns by kind; positions that are known by their names are among them."""
    valid = _valid(mechanism, "position")
    names = [name for name in names if name in columns]  # the others hold words
    lengths = {len(columns[name]) for name in names}
    if (
        len(_valid(mechanism, "output")) != len(valid)
        or len(lengths) != 1
        or min(lengths) < _FEWEST
    ):
        return {}
    times = (
        None if time is None or time.column not in names else _seconds(time, columns)
    )
    rest = [
        name
        for name in names
        if name not in understood and (time is None or name != time.column)
    ]
    if understood or not are_numbers(names):
        new = families(rest, len(valid), _places(valid))
    else:
        new = blocks(
            rest[1:] if len(rest) % len(valid) == 1 and len(valid) > 1 else rest,
            len(valid),
        )
    known = {
        kind: Family(tuple(channel.column for channel in some.values()))
        for kind, some in groups.items()
    }
    fixed = {
        kind: family
        for kind, family in known.items()
        if len(family.columns) == len(valid)
    }
    said = {family: _said(family) for family in new}
    strange = [
        family
        for family, kind in said.items()
        if (kind and kind not in groups)
        or all(is_still(columns[name]) for name in family.columns)
    ]
    rest = [
        name for name in rest if not any(name in family.columns for family in strange)
    ]
    new = tuple(
        family
        for family in new
        if family not in strange and not is_mixed(family, columns, times)
    )
    said = {family: said[family] for family in new}
    once = {
        kind for kind in said.values() if [*said.values()].count(kind) == 1
    } & groups.keys() - fixed.keys()
    named = {kind: family for family, kind in said.items() if kind in once}
    left = [family for family in new if family not in named.values()]
    found = named | classified(left, columns, times, fixed | named)
    complete = {"position", "output"} <= {*found, *fixed}
    return (
        found
        if complete
        else in_order(rest, len(valid), columns, times, fixed) or found
    )


def _places(valid: Sequence[str]) -> dict[str, int]:
    """Places of coordinates in their order, by what columns may call them."""
    return {alias: valid.index(name) for alias, name in aliases(valid).items()}


def _seconds(time: Channel, columns: Mapping[str, Floats]) -> Floats:
    stamps = columns[time.column]
    return stamps * factor(time.unit or clock_unit(stamps), "s")


def _in_pairs(
    names: Sequence[str],
    meanings: Meanings,
    mechanism: Mechanism,
    look: Look,
    *,
    outputs: bool,
) -> Guess | None:
    """The guess where every joint has names of its own, and rates tell what its position is, as on a cart with a pole.

    Only one of the joints may be driven.
    """
    columns, valid = look().columns, _valid(mechanism, "position")
    time, _ = _time(meanings, [name for name in names if name not in meanings], look)
    if time is None or len({len(values) for values in columns.values()}) != 1:
        return None
    others = [name for name in columns if name != time.column]
    found, left = in_pairs(others, len(valid), columns, _seconds(time, columns))
    if not found:
        return None
    order = _as_they_move(found["position"].columns, valid, mechanism)
    found = {
        kind: Family(tuple(family.columns[k] for k in order))
        for kind, family in found.items()
    }
    forces = [
        name for name in left if name in meanings and meanings[name].kind == "output"
    ] or left
    groups: dict[str, dict[str, Channel]] = {}
    notes, driven = (
        _filled(groups, found, mechanism),
        _driven(forces, mechanism) if outputs else {},
    )
    notes += [
        f"'{column}' taken for the output of {name}" for name, column in driven.items()
    ]
    groups["output"] = {
        name: _channel(column, stated_unit(column), mechanism, "output", name)
        or Channel(column)
        for name, column in driven.items()
    }
    problem = f"no column can be told to be the output of one of {listed(valid)}; say under log which it is"
    problems = (problem,) if outputs and not driven else ()
    kinds = (
        groups.get(kind, {})
        for kind in ("position", "velocity", "acceleration", "output")
    )
    unmeasured = tuple(
        name for name in _valid(mechanism, "output") if driven and name not in driven
    )
    return Guess(
        ColumnMap(time, None, *kinds), problems, tuple(notes), unmeasured=unmeasured
    )


def _as_they_move(
    columns: Sequence[str], valid: Sequence[str], mechanism: Mechanism
) -> list[int]:
    """Places of the columns of joints: angles of those that turn, if names tell as many, else in the given order."""
    turn = [units(mechanism, "position", name) != ("m",) for name in valid]
    angles = [k for k, column in enumerate(columns) if _ANGLES.search(column)]
    if len(angles) != sum(turn):
        return list(range(len(columns)))
    lengths = [k for k in range(len(columns)) if k not in angles]
    return [(angles if turns else lengths).pop(0) for turns in turn]


def _driven(forces: Sequence[str], mechanism: Mechanism) -> dict[str, str]:
    """Columns of outputs in their order; a single one is a torque if its name says so, else the force of the slide."""
    valid = _valid(mechanism, "output")
    if len(forces) == 1 < len(valid):
        unit = "N·m" if _TORQUES.search(forces[0]) else "N"
        valid = [output.name for output in mechanism.outputs if output.unit == unit]
    return dict(zip(valid, forces, strict=True)) if len(valid) == len(forces) else {}


def _said(family: Family) -> str:
    """The kind that all names say beside words that nobody knows; empty if they say none, or a part of a force."""
    parts = [spoken(column) for column in family.columns]
    kinds = {words().get(part, "") for some in parts for part in some} - {""}
    every = all(any(part in words() for part in some) for some in parts)
    mixed = len(kinds) > 1 or any(
        part in _NOT_MEASURED for some in parts for part in some
    )
    return kinds.pop() if every and kinds and not mixed else ""


def _question(
    absent: Sequence[str],
    names: Sequence[str],
    meanings: Meanings,
    mechanism: Mechanism,
    look: Look | None,
    time: Channel | None,
) -> str:
    """What is missing, and for every column that was not understood what it is nearest to."""
    valid = _valid(mechanism, "position")
    unknown = [name for name in names if name not in meanings]
    groups, _ = _by_names(meanings, mechanism, False, None)
    seen: dict[str, Family] = {}
    if look is not None and len(unknown) < 200:
        seen = _by_values(
            names, list(meanings), mechanism, look().columns, groups, time
        )
    asked, left = [], list(unknown)
    for family in families(unknown, len(valid), _places(valid)):
        kinds = [kind for kind, some in seen.items() if some == family]
        by = (
            f"{_several(kinds[0])} by their values"
            if kinds
            else _nearest(family.columns[0])
        )
        asked.append(f"{family.label}{by and f' ({by})'}")
        left = [name for name in left if name not in family.columns]
    asked += [f"{name}{(by := _nearest(name)) and f' ({by})'}" for name in left]
    what = f"no columns for {' and '.join(f'{kind}s' for kind in absent)} of {mechanism.name} can be told from their names"
    return (
        f"{what}; not understood: {listed(asked)}; say under log which they are"
        if asked
        else what
    )


def _nearest(column: str) -> str:
    """The word that a part of a column's name is nearest to."""
    known = words()
    for part in column.replace(".", "_").replace("/", "_").lower().split("_"):
        close = get_close_matches(
            part.strip("0123456789[]"),
            [word for word in known if len(word) > 2],
            n=1,
            cutoff=0.7,
        )
        if close:
            return f"{known[close[0]]}?"
    return ""
