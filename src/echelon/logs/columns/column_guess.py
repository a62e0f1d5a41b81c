"""Columns by their names, for a set-up that says nothing about its logs: all that is clear, and nothing that is not.

A name such as ``q_rad_1``, ``/joint_states/position/elbow``, ``torques[0]`` or ``time [ms]`` is understood word by
word, and only if every word is: ``tau_fric1`` is some torque, but not the measured one.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from echelon.errors import InputError, locating
from echelon.logs.columns.column_map import Channel, ColumnMap
from echelon.logs.columns.quantities import actuators, coordinates, units
from echelon.logs.columns.units import factor
from echelon.logs.finding import listed
from echelon.mechanism.mechanism import Mechanism

_WORDS = {
    "position": "q pos position positions angle angles",
    "velocity": "v qd dq qdot vel velocity velocities speed speeds",
    "acceleration": "a qdd ddq qddot acc accel acceleration accelerations",
    "output": "tau torque torques trq effort efforts force forces",
    "time": "t ts time times timestamp timestamps stamp",
}
_KINDS = {word: kind for kind, words in _WORDS.items() for word in words.split()}
_OTHERS = {
    "reference": "ref reference target targets des desired cmd command commanded setpoint sp",
    "motor": "motor motors actuator actuators",
    "neutral": "meas measured act actual read joint joints j state states",
}
_ROLES = {word: role for role, words in _OTHERS.items() for word in words.split()}
_UNITS = {
    "rad": "rad",
    "deg": "deg",
    "rads": "rad/s",
    "degs": "deg/s",
    "rads2": "rad/s²",
    "rpm": "rpm",
    "m": "m",
    "mm": "mm",
    "nm": "N·m",
    "mnm": "mN·m",
    "n": "N",
    "s": "s",
    "sec": "s",
    "ms": "ms",
    "us": "us",
    "ns": "ns",
}
_BRACKETS = re.compile(r"\s*[\[(]\s*([^\[\]()]*[A-Za-z°][^\[\]()]*?)\s*[\])]")
_HUMP = re.compile(r"(?<=[a-z])(?=[A-Z][a-z])")


@dataclass(frozen=True)
class Meaning:
    """What a column's name says."""

    kind: str  # ``position``, ``velocity``, ``acceleration``, ``output``, ``reference`` or ``time``
    name: str = ""  # coordinate, output or actuator that it names; empty if it has none
    index: int | None = None  # its number
    motor: bool = False  # whether it says that it was measured at a motor
    unit: str = ""


def meaning(column: str, names: Iterable[str]) -> Meaning | None:
    """What a column's name says; None if there is a word that is not understood."""
    rest, unit, name = column, "", ""
    bracket = _BRACKETS.search(rest)
    if bracket:
        unit, rest = bracket.group(1), rest[: bracket.start()] + "_" + rest[bracket.end() :]
    for known in sorted(set(names), key=lambda n: (-len(n), n)):
        # a name that could also be a quantity's, such as q1, is left to its number
        parted = re.split(rf"(?<![A-Za-z0-9]){re.escape(known)}(?![A-Za-z0-9])", rest)
        if len(parted) == 2 and re.search("[A-Za-z]", "".join(parted)):
            rest, name = "_".join(parted), known
            break
    return _by_words(_HUMP.sub("_", rest), name, unit)


def _by_words(text: str, name: str, unit: str) -> Meaning | None:
    kind, index = "", None
    roles: set[str] = set()
    for word in re.findall(r"[a-z0-9°]+", text.lower()):
        letters, digits = (word, "") if word in _UNITS else re.fullmatch(r"(.*?)(\d*)", word).groups()  # type: ignore[union-attr]
        if digits:
            if index is not None:
                return None
            index = int(digits)
        if letters in _KINDS and not kind:
            kind = _KINDS[letters]
        elif not letters or letters in _ROLES:
            roles.add(_ROLES.get(letters, ""))
        elif letters in _UNITS and not unit:
            unit = _UNITS[letters]
        else:
            return None
    reference = "reference" in roles
    if not kind or (reference and kind != "position") or (name and index is not None):
        return None
    return Meaning("reference" if reference else kind, name, index, "motor" in roles, unit)


Meanings = Mapping[str, Meaning]


def guess_columns(names: Sequence[str], mechanism: Mechanism, source: str = "", *, outputs: bool = True) -> ColumnMap:
    """Take columns for what their names say: positions, outputs, and what else there is for all coordinates."""
    drives = [a.name for a in mechanism.transmission.actuators]
    known = {*mechanism.positions, *mechanism.velocities, *(o.name for o in mechanism.outputs), *drives}
    meanings = {name: found for name in names if (found := meaning(name, known)) is not None}
    with locating(source):
        groups = {kind: _channels(meanings, mechanism, kind) for kind in ("position", "output")}
        _require(groups, names, mechanism, outputs)
    for kind in ("velocity", "acceleration", "reference"):
        try:
            groups[kind] = _channels(meanings, mechanism, kind)
        except InputError:  # nobody needs them: what is not clear is left out
            groups[kind] = {}
    with locating(source):
        time = _time(meanings)
    return ColumnMap(
        time,
        None,
        groups["position"],
        groups["velocity"],
        groups["acceleration"],
        groups["output"],
        groups["reference"],
    )


def _require(
    groups: Mapping[str, Mapping[str, Channel]], names: Sequence[str], mechanism: Mechanism, outputs: bool
) -> None:
    absent = [kind + "s" for kind in ("position", "output")[: 1 + outputs] if not groups[kind]]
    if absent:
        raise InputError(
            f"no columns for {' and '.join(absent)} of {mechanism.name} can be told from their names; say under log "
            f"which they are (columns: {listed(names)})"
        )


def _time(meanings: Meanings) -> Channel | None:
    # columns of messages have stamps of their own, which the file assigns to them
    found = [name for name, said in meanings.items() if said.kind == "time" and not name.startswith("/")]
    found = [name for name in found if _fits(meanings[name].unit, "s")]
    if len(found) > 1:
        raise InputError(f"{listed(found)} could all be the time; name one as time under log")
    return Channel(found[0], meanings[found[0]].unit) if found else None


def _fits(unit: str, quantity: str | Sequence[str] | None) -> bool:
    try:
        factor(unit, quantity)
    except InputError:
        return False
    return True


def _channels(meanings: Meanings, mechanism: Mechanism, kind: str) -> dict[str, Channel]:
    """The columns of a kind, by coordinate, output or actuator."""
    own = {column: said for column, said in meanings.items() if said.kind == kind}
    if not own:
        return {}
    valid = [o.name for o in mechanism.outputs] if kind == "output" else list(coordinates(mechanism, kind))
    motors = [actuator.name for actuator in actuators(mechanism)]
    if any(said.motor for said in own.values()):
        own = {column: said for column, said in own.items() if said.motor}
        if not motors:
            raise InputError(
                f"{listed(own)} are measured at motors by their names, but {mechanism.name} states no actuators"
            )
        valid = motors
    by_number = [column for column, said in own.items() if not said.name]
    keys = {column: said.name for column, said in own.items() if said.name}
    keys |= _numbered(own, by_number, valid, mechanism, kind) if not keys else {}
    found: dict[str, Channel] = {}
    for column, name in keys.items():
        unit = own[column].unit
        if (name not in valid and name not in motors) or not _fits(unit, units(mechanism, kind, name)):
            continue
        if name in found:
            both = f"'{found[name].column}' and '{column}'"
            raise InputError(f"{both} could both be the {kind} of '{name}'; say under log which it is")
        found[name] = Channel(column, unit)
    missing = [name for name in valid if name not in found]
    if missing and not any(name in found for name in motors):
        taken = listed(channel.column for channel in found.values())
        raise InputError(f"no column is the {kind} of {listed(missing)} (found: {taken}); say under log which they are")
    return {name: found[name] for name in [*valid, *motors] if name in found}


def _numbered(
    own: Meanings, columns: Sequence[str], valid: Sequence[str], mechanism: Mechanism, kind: str
) -> dict[str, str]:
    """Coordinates by number, counted from 0 or from 1; a single one needs none."""
    numbers = {column: own[column].index for column in columns}
    if set(numbers.values()) == {None} and len(valid) == 1:
        return dict.fromkeys(columns, valid[0])
    counted = {number for number in numbers.values() if number is not None}
    first = min(counted, default=0)
    if first > 1 or counted != set(range(first, first + len(valid))):
        has = (
            f"a {kind} for {len(counted)} (numbers {', '.join(map(str, sorted(counted)))})"
            if counted
            else f"one {kind}"
        )
        raise InputError(
            f"the log has {has}, {listed(columns)}, but {mechanism.name} has {len(valid)}: {listed(valid)}; is it a "
            "log of another robot?  If not, say under log which they are"
        )
    return {column: valid[number - first] for column, number in numbers.items() if number is not None}
