"""A set-up with its logs: what columns mean is decided once, before anything is read in earnest.

Every kind of log, which is every list of column names, is guessed from its first file, so that all logs of a kind mean
the same.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from echelon.formats import RobotFile, stated_limits
from echelon.identification.logs.columns.by_values import is_still
from echelon.identification.logs.columns.column_guess import guess
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.columns.column_names import (
    aliases,
    is_output,
    meaning,
)
from echelon.identification.logs.columns.conversion import needed_columns, unpushed
from echelon.identification.logs.columns.magnitudes import with_units
from echelon.identification.logs.faults.locked_joints import STILL
from echelon.identification.logs.files.log_file import LogFile, Table
from echelon.identification.logs.files.numpy_file import MemoryLog
from echelon.identification.logs.files.open_log import log_paths
from echelon.identification.logs.finding import listed
from echelon.identification.logs.long_log import LongLog, rows_of_one_time
from echelon.identification.logs.read_log import (
    first_table,
    map_of,
    measured,
    opened,
)
from echelon.identification.logs.units import factor
from echelon.identification.setup.experiments import (
    by_experiment,
    told_apart,
    with_phases,
)
from echelon.identification.setup.setup import Setup, setup_of, with_usual
from echelon.robot import Mechanism, lockable, mechanism_of
from echelon.shared import MOST_NAMED, InputError, nearest_word

_VECTOR = re.compile(
    r"(?<![A-Za-z])(ctrl|actuator_force)[\W_]*(\d+)\W*$", re.IGNORECASE
)


def with_logs(
    setup: Any, logs: Any, others: Any = (), *, usual: bool = True
) -> tuple[Setup, tuple[Path, ...], tuple[Path, ...]]:
    """A set-up that knows its columns, or what one is made from; and the paths of two lists of logs.

    Without ``usual`` it keeps the effects that it states, and joints at rest move elsewhere.
    """
    setup = with_usual(setup_of(setup)) if usual else setup_of(setup)
    if setup.mechanism.experiments:
        return _of_experiments(setup, logs, others)
    fitted, unseen = (
        joined(log_paths(some), setup.mechanism, setup.columns)
        for some in (logs, others)
    )
    if setup.columns:
        setup = _resting_on(_as_logged(setup, (*fitted, *unseen)))
        columns = (
            _beside(some, setup.mechanism.locked, setup.free, (*fitted, *unseen))
            for some in setup.columns
        )
        setup = replace(setup, columns=tuple(columns))
        return with_phases(setup, fitted), fitted, unseen
    kinds: dict[tuple[str, ...], LogFile] = {}
    for path in (*fitted, *unseen):
        file = opened(path)
        kinds.setdefault(tuple(file.names), file)
    for file in kinds.values():
        found = understood(file, setup, only=usual and len(fitted) + len(unseen) == 1)
        if found.problems:
            advice = (
                "echelon setup ROBOT LOG -o setup.yaml  writes a set-up to begin with"
            )
            raise InputError("; ".join([*found.problems, advice]), source=file.source)
        notes = tuple(text for text in found.notes if text not in setup.assumed)
        setup = replace(
            found.setup,
            columns=(*setup.columns, found.columns),
            assumed=(*setup.assumed, *notes),
            unmeasured=(*setup.unmeasured, *found.unmeasured),
        )
    return setup, fitted, unseen


def _beside(
    columns: ColumnMap,
    held: Mapping[str, float],
    whole: Mechanism | None,
    paths: Sequence[Path],
) -> ColumnMap:
    """Stated columns with those of joints that are locked, where only the names of the logs' columns tell them."""
    lacking = {name: at for name, at in held.items() if name not in columns.locked}
    if not lacking or whole is None:
        return columns
    files = [path for path in paths if columns.is_for(str(path))]
    names = dict.fromkeys(name for path in files for name in opened(path).names)
    told = columns
    for kind in ("velocity", "position"):
        stated = columns.channels[kind] or columns.positions
        units = {channel.unit for channel in columns.channels[kind].values()}
        unit = units.pop() if len(units) == 1 else ""
        found = {
            name: Channel(column, unit)
            for name, column in _by_numbers(names, kind, whole, stated).items()
            if name in lacking
        }
        group = {**columns.channels[kind], **found}
        told = (
            replace(told, positions=group)
            if kind == "position"
            else replace(told, velocities=group)
        )
    told = told.with_locked(lacking)
    locked = {
        name: some if name in columns.locked else replace(some, stated=False)
        for name, some in told.locked.items()
    }
    return replace(told, locked=locked)


def _by_numbers(
    names: Iterable[str], kind: str, whole: Mechanism, stated: Mapping[str, Channel]
) -> dict[str, str]:
    """Columns of a kind by the joint that their names tell: by its name, or by its number as in the stated columns."""
    places = {name: k for k, name in enumerate(whole.positions)}
    known = aliases(places)
    firsts = {
        said.index - places[name]
        for name, channel in stated.items()
        if name in places and (said := meaning(channel.column, known))
        if said.index is not None
    }
    first = firsts.pop() if len(firsts) == 1 else None
    joints = dict(enumerate(places, start=first or 0))
    found: dict[str, str] = {}
    for column in names:
        said = meaning(column, known)
        if said is None or said.kind != kind or said.motor:
            continue
        name = said.name
        if not name and first is not None and said.index is not None:
            name = joints.get(said.index, "")
        if name:
            found.setdefault(name, column)
    return found


def _as_logged(setup: Setup, paths: Sequence[Path]) -> Setup:
    """The set-up without outputs of which no log has the column.

    Where none has any, positions are missing too, or a name may be misspelt, reading a log says so.
    """
    columns = {name for path in paths for name in opened(path).names}
    stated = [pair for some in setup.columns for pair in some.outputs.items()]
    there = {name for name, channel in stated if channel.column in columns}
    lost = {name: some.column for name, some in stated if name not in there}
    groups = [group for some in setup.columns for group in some.channels.values()]
    used = {channel.column for group in groups for channel in group.values()}
    outputs = {output.reads or output.name for output in setup.mechanism.outputs}
    is_misspelt = any(nearest_word(column, columns - used) for column in lost.values())
    moves = any(
        {channel.column for channel in some.positions.values()} <= columns
        for some in setup.columns
    )
    is_clear = moves and there and lost.keys() <= outputs and not is_misspelt
    if not lost or not is_clear:
        return setup
    texts = [
        f"no log has the column '{column}': {_consequence(name)}"
        for name, column in lost.items()
    ]
    kept = [
        replace(some, outputs={n: c for n, c in some.outputs.items() if n in there})
        for some in setup.columns
    ]
    setup = replace(_without(setup, lost.keys()), columns=tuple(kept))
    return replace(setup, unmeasured=(*setup.unmeasured, *texts))


def _consequence(names: str) -> str:
    """The consequence of an output that is not measured, in a sentence."""
    return f"parameters that only the output of {names} shows are left out, and it is not predicted"


def _resting_on(setup: Setup) -> Setup:
    """The set-up with what is taken for granted of a robot in contact."""
    plate = next((c for c in setup.mechanism.contacts if c.measured), None)
    if plate is not None:
        raise InputError(
            "forces that a plate measures are not read from logs: leave out  measured,  and they count as unknown",
            source=setup.source,
            element=f"contact '{plate.name}'",
        )
    if not setup.mechanism.contacts:
        return setup
    text = "forces at contacts are taken off both sides of the equations of motion, and nobody asks what else may be wrong "
    text += "or lacking in these logs"
    if unpushed(setup.mechanism):
        text = f"nothing but its contacts pushes the floating base; {text}"
    return replace(setup, assumed=(*setup.assumed, text))


def _of_experiments(
    setup: Setup, logs: Any, others: Any
) -> tuple[Setup, tuple[Path, ...], tuple[Path, ...]]:
    """A set-up with the experiments that logs are of and their columns, and the paths of two lists of logs."""
    names = setup.mechanism.experiments
    if not setup.experiments:
        raise InputError(
            "its experiments are written out as trees: take the file that states them with the robot",
            source=setup.source,
            element="experiments",
        )
    fitted, unseen = (list(by_experiment(some, names)) for some in (logs, others))
    named = [ColumnMap(experiment=name) for name in names]
    columns: list[ColumnMap] = []
    for name, path in (*fitted, *unseen):
        if not setup.columns:
            own = name or map_of(opened(path), named).experiment
            columns.append(_guessed(setup, own, path))
        elif name:
            stated = [some for some in setup.columns if some.experiment == name]
            columns += [replace(some, files=(str(path),)) for some in stated]
    setup = _resting_on(replace(setup, columns=(*columns, *setup.columns)))
    first, second = (tuple(path for _, path in some) for some in (fitted, unseen))
    setup = replace(
        setup,
        columns=tuple(
            _beside_of_experiment(setup, some, (*first, *second))
            for some in setup.columns
        ),
    )
    return told_apart(setup, first, second), first, second


def _beside_of_experiment(
    setup: Setup, columns: ColumnMap, paths: Sequence[Path]
) -> ColumnMap:
    """Columns of an experiment with those of joints that it locks, where names tell them."""
    for experiment in setup.experiments:
        held = experiment.mechanism.locked
        if held and experiment.name == columns.experiment:
            whole = setup.free or mechanism_of(experiment.robot)
            return _beside(columns, held, whole, paths)
    return columns


def _guessed(setup: Setup, experiment: str, path: Path) -> ColumnMap:
    """The columns of a log of an experiment, by their names."""
    own = next(e for e in setup.experiments if e.name == experiment)
    free = (setup.free or mechanism_of(own.robot)) if own.mechanism.locked else None
    alone = replace(setup, mechanism=own.mechanism, free=free)
    found = understood(opened(path), alone, only=False)
    if found.problems:
        advice = "state what the columns are, under log"
        raise InputError("; ".join([*found.problems, advice]), source=str(path))
    return replace(found.columns, experiment=experiment, files=(str(path),))


@dataclass(frozen=True)
class Understood:
    """A log as it is understood for a robot."""

    setup: Setup  # without joints that rest and outputs that are not measured
    columns: ColumnMap
    problems: tuple[str, ...]
    notes: tuple[str, ...]  # what was taken for granted
    locked: dict[str, float]  # where joints rest, rad or m
    choices: tuple[
        dict[str, float], ...
    ] = ()  # the same, where only the user can tell which joints rest
    commanded: bool = False  # whether there are commands of positions, and nothing that could be an output
    unmeasured: tuple[str, ...] = ()  # outputs that no column is of, in sentences


def understood(
    file: LogFile,
    setup: Setup,
    *,
    only: bool,
    by_values: bool = False,
    outputs: bool = True,
) -> Understood:
    """The columns of a log, told by their names, and by their values where that is asked for.

    Joints that are not in the log rest, and so do those that never move there; if it is not the ``only`` log, those of
    which moreover no output is measured.
    """
    drives = _drives(setup.robot_file)
    vectors = _of_vectors(file.names, drives)
    said = {
        name: f"{name} [{unit}]"
        for name, unit in getattr(file, "units", {}).items()
        if unit
    }
    said |= {name: f"{drive.joint} torque" for name, (drive, _) in vectors.items()}
    look = cache(lambda: first_table(file))
    guessed = partial(
        guess, file.names, look=look, said=said, by_values=by_values, outputs=outputs
    )
    held = setup.mechanism.locked
    whole = setup.mechanism if setup.free is None else setup.free
    found = guessed(whole)
    if found.problems or not held.keys() >= set(found.unlogged):
        whole = setup.mechanism  # the log lacks joints that are locked
        found = guessed(whole)
    unread = getattr(file, "left_out", {})
    lacks_outputs = (
        outputs and not found.columns.outputs and any(map(is_output, unread))
    )
    reasons = "; ".join(
        [f"'{name}' {why}" for name, why in unread.items()][:MOST_NAMED]
    )
    problems = found.problems + (
        (f"not read: {reasons}",)
        if unread and (found.problems or lacks_outputs)
        else ()
    )
    repeated = rows_of_one_time(look()) if problems else ""
    problems += (repeated,) if repeated else ()
    columns, geared = _with_gears(found.columns, drives, vectors)
    side_by_side = file.notes if isinstance(file, LongLog) else ()
    notes = [*side_by_side, *found.notes, *geared]
    silent = {o.name for o in setup.mechanism.sensed} & set(found.unmeasured)
    locked = _assumed(setup, [name for name in found.unlogged if name not in held])
    if locked:
        notes.append(
            f"the log has no columns for {listed(locked)}, which count as resting, {_line(locked)}"
        )
    if columns.positions:
        tables = file.tables(needed_columns(columns, file.names))
        table, more = measured(next(tables, Table(file.source, {}))), next(tables, None)
        columns, findings = with_units(columns, table, whole)
        columns = columns.with_locked(held).within(setup.mechanism)
        columns, empty = _without_empty(columns, table)
        notes += [*(finding.text for finding in findings), *empty]
        still: dict[str, float] = {}
        if more is None and lockable(
            setup.mechanism
        ):  # of a long log nobody knows what moves later
            silent |= {
                name
                for name, some in columns.outputs.items()
                if not np.any(table.columns[some.column])
            }
            still = _still(columns, table)
        resting = {name: at for name, at in still.items() if only or name in silent}
        if len(silent | resting.keys()) < len(columns.outputs) + len(found.unmeasured):
            locked |= resting
            notes += (
                [f"at rest all the time: {listed(resting)}, {_line(resting)}"]
                if resting
                else []
            )
            mute = [
                name
                for name in resting
                if is_still(table.columns[columns.positions[name].column])
            ]
            notes += (
                [
                    f"all samples of {listed(mute)} are equal: does the joint rest, or does it lack a sensor?"
                ]
                if mute
                else []
            )
        else:  # nothing would be left: what is wrong with it is said when it is read
            silent = set(found.unmeasured)
    silent -= locked.keys()
    lacking = []
    if silent:
        gone = listed(silent)
        lacking.append(
            f"no measured output for {gone}: no column, or only zeros; {_consequence(gone)}"
        )
    setup = setup.with_locked(locked)
    return Understood(
        _without(setup, silent),
        _columns_without(columns.with_locked(setup.mechanism.locked), silent),
        problems,
        tuple(notes),
        locked,
        tuple(_assumed(setup, some) for some in found.choices),
        found.commanded and not lacks_outputs,
        tuple(lacking),
    )


@dataclass(frozen=True)
class _Drive:
    """An actuator of a robot file that drives one joint."""

    name: str
    joint: str
    gear: float
    gain: float = 1.0  # force per unit of control; nan where it depends on the state


def stated_gears(file: RobotFile) -> dict[str, tuple[str, str]]:
    """Joints and ratios of the actuators that a URDF or MJCF file states with gears."""
    found: dict[str, tuple[str, str]] = {}
    for transmission in (
        file.root.iter("transmission") if file.root.tag == "robot" else ()
    ):
        joints, actuators = (
            transmission.findall("joint"),
            transmission.findall("actuator"),
        )
        if len(joints) == len(actuators) == 1:
            ratio = transmission.findtext(".//mechanicalReduction") or "1"
            found[str(actuators[0].get("name"))] = (
                str(joints[0].get("name")),
                ratio.strip(),
            )
    for drive in _drives(file):
        if drive is not None:
            found[drive.name] = (drive.joint, f"{drive.gear:.12g}")
    return {
        name: (joint, ratio)
        for name, (joint, ratio) in found.items()
        if ratio not in ("1", "1.0")
    }


def _drives(file: RobotFile | None) -> list[_Drive | None]:
    """The actuators of an MJCF file in its order, with what its defaults say; None for those of no joint."""
    if file is None or file.is_description or file.root.tag != "mujoco":
        return []
    from echelon.formats import drives_joint, is_motor, parse_spec

    return [
        _Drive(
            str(a.name),
            str(a.target),
            float(a.gear[0]),
            float(a.gainprm[0]) if is_motor(a) else np.nan,
        )
        if drives_joint(a)
        else None
        for a in parse_spec(file.mjcf).actuators
    ]


def _of_vectors(
    names: Sequence[str], drives: Sequence[_Drive | None]
) -> dict[str, tuple[_Drive, float]]:
    """Columns of MuJoCo's vectors ``ctrl`` and ``actuator_force``, and joint torque per unit in them."""
    numbers = {
        name: found for name in names if (found := _VECTOR.search(name)) and drives
    }
    first = min((int(found.group(2)) for found in numbers.values()), default=0)
    said = {}
    for name, found in numbers.items():
        place = int(found.group(2)) - min(first, 1)
        drive = drives[place] if place < len(drives) else None
        factor = (
            0.0
            if drive is None
            else drive.gear * (drive.gain if found.group(1).lower() == "ctrl" else 1.0)
        )
        if drive is not None and factor and np.isfinite(factor):
            said[name] = (drive, factor)
    both = {drive.joint for name, (drive, _) in said.items() if "force" in name.lower()}
    return {
        name: some
        for name, some in said.items()
        if "force" in name.lower() or some[0].joint not in both
    }


def _with_gears(
    columns: ColumnMap,
    drives: Sequence[_Drive | None],
    vectors: Mapping[str, tuple[_Drive, float]],
) -> tuple[ColumnMap, list[str]]:
    """Forces that are those of MuJoCo's actuators by their names, times their gears, as the joint feels them."""
    outputs, notes = dict(columns.outputs), []
    for drive in drives:
        channel = None if drive is None else outputs.get(drive.joint)
        if drive is None or channel is None:
            continue
        word = rf"(?<![A-Za-z0-9]){re.escape(drive.name)}(?![A-Za-z0-9])"
        named = (
            drive.name and drive.name != drive.joint and re.search(word, channel.column)
        )
        _, ratio = vectors.get(channel.column, (drive, drive.gear if named else 1.0))
        if ratio != 1.0:
            outputs[drive.joint] = replace(channel, scale=ratio * channel.scale)
            notes.append(
                f"'{channel.column}' has the name of actuator '{drive.name}' and is multiplied by its gear, {ratio:g}"
            )
    return replace(columns, outputs=outputs), notes


def _line(locked: Mapping[str, float]) -> str:
    """The line that says where joints rest."""
    if len(locked) > MOST_NAMED:
        return "where  locked  states" if any(locked.values()) else "at zero"
    return f"as by  locked: {{{', '.join(f'{name}: {position:.6g}' for name, position in locked.items())}}}"


def _assumed(setup: Setup, names: Sequence[str]) -> dict[str, float]:
    """Where joints that nobody logged are taken to stand: at zero, or at the nearest end of their range."""
    file, found = setup.robot_file, {}
    limits = stated_limits(file, setup.mechanism) if names and file is not None else {}
    for name in names:
        low, high = (limits[name].position if name in limits else None) or (0.0, 0.0)
        found[name] = min(max(low, 0.0), high)
    return found


def _still(columns: ColumnMap, table: Table) -> dict[str, float]:
    """Joints whose positions never change by more than an encoder's noise, and where they stand, rad or m."""
    found = {}
    for name, channel in columns.positions.items():
        values = (
            channel.scale * factor(channel.unit, None) * table.columns[channel.column]
            + channel.offset
        )
        values = values[np.isfinite(values)]
        if len(values) and np.ptp(values) < STILL:
            found[name] = float(np.median(values))
    return found


def _without_empty(columns: ColumnMap, table: Table) -> tuple[ColumnMap, list[str]]:
    """Without velocities, accelerations and references, which nobody needs, where one of them holds no number."""
    notes: list[str] = []
    kept: dict[str, Mapping[str, Channel]] = {}
    for kind in ("velocity", "acceleration", "reference"):
        group = columns.channels[kind]
        empty = [
            some.column
            for some in group.values()
            if not np.isfinite(table.columns[some.column]).any()
        ]
        notes += (
            [f"no {kind} is used, because {listed(empty)} hold no numbers"]
            if empty
            else []
        )
        kept[kind] = {} if empty else group
    v, a, r = kept.values()
    return replace(columns, velocities=v, accelerations=a, references=r), notes


def _columns_without(columns: ColumnMap, silent: Collection[str]) -> ColumnMap:
    return columns.kept(lambda kind, name: kind != "output" or name not in silent)


def _without(setup: Setup, silent: Collection[str]) -> Setup:
    """The set-up without outputs that are not measured, and effects in their drives."""
    if not silent:
        return setup
    mechanism = setup.mechanism
    measured = tuple(
        output
        for output in mechanism.outputs
        if (output.reads or output.name) not in silent
    )
    mechanism = mechanism.measuring(measured)
    effects = tuple(
        e
        for e in mechanism.effects
        if any(action.at not in silent for action in e.actions)
    )
    return replace(setup, mechanism=replace(mechanism, effects=effects))


def joined(
    paths: Sequence[Path], mechanism: Mechanism, columns: Sequence[ColumnMap] = ()
) -> tuple[Path, ...]:
    """The logs, with files joined of which no one is a log: all of them, or one of each kind, such as positions1.csv.

    The name of a file may say of which quantity or joint it is.
    """

    def is_log(path: Path) -> bool:
        names = opened(path).names
        return (
            any(set(needed_columns(some)) <= set(names) for some in columns)
            or not guess(names, mechanism).problems
        )

    if len(paths) < 2 or any(
        isinstance(path, MemoryLog) or is_log(path) for path in paths
    ):
        return tuple(paths)
    kinds: dict[tuple[str, ...], list[Path]] = {}
    for path in paths:
        kinds.setdefault(_holds(path, mechanism), []).append(path)
    sets = list(zip(*kinds.values(), strict=False))
    if len(sets) * len(kinds) < len(paths) or len(kinds) < 2:
        sets = [tuple(paths)]
    found = [Path("+".join(map(str, some))) for some in sets]
    with suppress(InputError):  # two files have one name
        return tuple(found) if is_log(found[0]) else tuple(paths)
    return tuple(paths)


def _holds(path: Path, mechanism: Mechanism) -> tuple[str, ...]:
    """The kinds of quantities that the columns of a file are by their names, with that of the file or without."""
    names = opened(path).names
    for tried in ([f"{path.stem}/{name}" for name in names], names):
        channels = guess(tried, mechanism).columns.channels
        if found := tuple(kind for kind, some in channels.items() if some):
            return found
    return ()
