"""A set-up written for a robot and its logs: everything that was found in them, and what could not be decided.

Names decide first, then values.  The text is read back and tried on the logs before it is shown, so that whatever would
go wrong with it stands in it.
"""

from __future__ import annotations

import os
import re
import textwrap
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from echelon.formats import RobotFile, fixed_frames, named_axes, open_robot
from echelon.identification.logs.columns.by_values import sample_rate
from echelon.identification.logs.columns.column_map import Channel, ColumnMap
from echelon.identification.logs.columns.magnitudes import is_period
from echelon.identification.logs.files.log_file import LogFile, Table
from echelon.identification.logs.files.open_log import log_paths
from echelon.identification.logs.finding import Severity, counted, listed
from echelon.identification.logs.read_log import first_table, opened, read_log
from echelon.identification.logs.units import factor
from echelon.identification.setup.logs import (
    Understood,
    joined,
    stated_gears,
    understood,
)
from echelon.identification.setup.setup import Setup, load_setup
from echelon.identification.signals.clock import JITTER, REPEATED, round_rate
from echelon.robot import Mechanism, mechanism_of
from echelon.shared import EchelonError, Floats, InputError, dump_flow

_EFFECTS = """\
effects:
  - usual                               # friction and an offset in every drive, zeros of force/torque sensors; rotors
                                        # that the robot file states
  # - rotor_inertia                     # geared motors, whose rotors weigh more than links
  # - {type: stribeck, at: all, velocity: 0.05}
"""
_SERVOS = """\
effects:                                # no torques are logged: servos follow commands, and their motion is simulated
  - {type: servo, at: all}
  - {type: viscous, at: all}
  - {type: coulomb, at: all}
  - {type: rotor_inertia, at: all}
"""
GUESS = 333.0
"""Rate, Hz, at which hardly any robot is logged: a place-holder until the outputs tell one."""

_UNUSED = "columns that are not used"


@dataclass(frozen=True)
class Skeleton:
    """The text of a set-up, and what is to be said about it."""

    text: str
    undecided: tuple[str, ...]  # questions that only the user can answer
    report: tuple[str, ...]  # what the trial showed, line by line
    is_complete: bool  # whether it says all that is needed to read the logs


def skeleton(
    robot: str | os.PathLike[str],
    logs: Sequence[str | os.PathLike[str]],
    folder: Path,
    rate_of: Callable[[Setup, Sequence[Path]], float | None] | None = None,
) -> Skeleton:
    """A set-up for a robot file and its logs, to be put into a folder.

    ``rate_of`` finds the rate of a log without a clock from a set-up that states :data:`GUESS`.
    """
    file = open_robot(robot)
    if file.is_description and "log" in file.document.data:
        raise InputError("this set-up has a section log already; edit it, or start from a robot file",
                         source=file.source)  # fmt: skip
    setup = load_setup(file)
    if setup.experiments:  # whose logs have one robot's columns
        alone = mechanism_of(setup.experiments[0].robot)
        setup = replace(setup, mechanism=alone, experiments=())
    paths = joined(log_paths(logs), setup.mechanism)
    log = opened(paths[0])
    found = understood(log, setup, only=len(paths) == 1, by_values=True)
    if found.commanded:
        found = _commanded(
            understood(log, setup, only=len(paths) == 1, by_values=True, outputs=False)
        )
    found = _with_rate(found, log)
    problems, proposed = found.problems, None
    if _lacks_clock(found, log):
        if not problems and rate_of is not None:
            proposed = _explained_rate(
                found, file, log, folder, lambda setup: rate_of(setup, paths)
            )
        explained = (
            f"; a physical robot explains the outputs if the rate is {proposed:g} Hz"
            if proposed
            else ""
        )
        problems += (
            f"no column is the time: state the rate of the samples{explained}",
        )
    if not problems and not (found.columns.outputs or found.columns.inputs):
        problems = (
            "no output is measured: name the columns of torques, forces or currents under log",
        )
    body = _body(file, found, log, folder, proposed)
    questions = (*problems, *_questions(found.columns, setup))
    trial, is_read = ((), False) if problems else _trial(body, folder, paths)
    first = "Check it" if is_read else "Answer the open questions"
    head = [
        f"# Set-up of {setup.mechanism.name} for {log.source}, written by  echelon setup.  {first}, then"
    ]
    head += [
        f"#   echelon identify THIS_FILE {' '.join(map(str, logs))} -o result/",
        "#",
    ]
    head += (
        _comments("found", (*found.notes, *found.unmeasured))
        + _comments("open", questions)
        + _comments("tried", trial)
    )
    return Skeleton(
        "\n".join(head) + "\n" + body,
        questions,
        (*found.notes, *found.unmeasured, *trial),
        is_read,
    )


def _commanded(found: Understood) -> Understood:
    """The reading of a log that has position commands and no torques."""
    columns = replace(found.columns, references={}, inputs=found.columns.references)
    note = "the log has position commands and no outputs, so servos are fitted"
    return replace(found, columns=columns, notes=(*found.notes, note))


def _with_rate(found: Understood, log: LogFile) -> Understood:
    """With a rate where stamps are coarser than samples, or where there are none, by what velocities say."""
    columns, table = found.columns, first_table(log)
    time = (
        None
        if columns.time is None
        else table.columns[columns.time.column] * factor(columns.time.unit, "s")
    )
    if (
        columns.time is not None
        and time is not None
        and np.sum(np.diff(time) == 0) > REPEATED * (len(time) - 1)
    ):
        period = float(time[-1] - time[0]) / (len(time) - 1)
        if not is_period(period):
            return found
        rate = round_rate(period)
        text = f"time stamps in '{columns.time.column}' are coarser than the samples, and many repeat; the first and "
        text += f"the last one give {1000 * period:.4g} ms per sample: the rate is {rate:.4g} Hz"
    elif (
        time is None
        and not table.clocks
        and columns.positions.keys() & columns.velocities.keys()
    ):
        rate, error = _rate_by_velocities(columns, table)
        text = f"positions and velocities agree at {rate:.5g} ± {2 * error:.2g} samples per second"
        if not is_period(1 / rate):
            return found
        if error > JITTER * rate:
            return replace(
                found,
                notes=(
                    *found.notes,
                    f"{text}, which is too uncertain for a rate: state it",
                ),
            )
        rate = _roundest(rate, 2 * error)
        text += f": the rate is {rate:.6g} Hz"
    else:
        return found
    return replace(
        found,
        columns=replace(columns, time=None, rate=rate),
        notes=(*found.notes, text),
    )


def _roundest(value: float, error: float) -> float:
    """The number with the fewest digits that is within an error."""
    rounded = (float(f"{value:.{digits}e}") for digits in range(15))
    return next((number for number in rounded if abs(number - value) <= error), value)


def _rate_by_velocities(columns: ColumnMap, table: Table) -> tuple[float, float]:
    """Samples per second at which positions change as the velocities say, and their standard error; or nan."""
    names = [name for name in columns.positions if name in columns.velocities]

    def values(some: Mapping[str, Channel]) -> Floats:
        of_names = [some[name] for name in names]
        parts = [table.columns[c.column] * factor(c.unit, None) for c in of_names]
        return np.stack(parts, axis=1)

    return sample_rate(values(columns.positions), values(columns.velocities))


def _lacks_clock(found: Understood, log: LogFile) -> bool:
    columns = found.columns
    return bool(columns.positions) and not (
        columns.time or columns.rate or first_table(log).clocks
    )


def _explained_rate(
    found: Understood,
    file: RobotFile,
    log: LogFile,
    folder: Path,
    rate_of: Callable[[Setup], float | None],
) -> float | None:
    """The rate that explains the outputs, where masses and gravity tell one."""
    trial = _body(
        file, replace(found, columns=replace(found.columns, rate=GUESS)), log, folder
    )
    try:
        return rate_of(
            load_setup(RobotFile(trial.encode(), "setup.yaml", True, folder))
        )
    except EchelonError:  # what is wrong with the log is said when it is tried
        return None


def _questions(columns: ColumnMap, setup: Setup) -> list[str]:
    """Questions that no file answers, where it matters."""
    asked, mechanism = [], setup.mechanism
    if columns.rate and columns.time is None:
        asked.append(
            f"check the rate of {columns.rate:g} samples per second, as found above"
        )
    unclear = not any(channel.unit for channel in columns.outputs.values())
    if columns.outputs and unclear and _has_wrenches(columns.outputs, mechanism):
        asked.append("check that wrenches are in N and N·m, and act on the body that the sensor carries (else scale: -1)")  # fmt: skip
    asked += _questions_of_axes(columns, setup)
    if columns.outputs and unclear and _has_drives(columns.outputs, mechanism):
        asked.append("check that outputs are in N·m (N), on the joints' side of the gears; for motors before gears, state actuators: {m1: 100*joint1} and name these under output")  # fmt: skip
    if columns.positions and not any(
        channel.unit for channel in columns.positions.values()
    ):
        asked.append(
            "check joint zeros and signs against the robot file (offset, scale: -1)"
        )
    for name, channel in columns.positions.items():
        if _INCLINED.search(channel.column) and not _INCLINED.search(name):
            asked.append(
                f"check that '{channel.column}' is the angle of the joint '{name}'; an inclinometer is a sensor, "
                f"sensors: {{tilt: {{body: …}}}}, with a position of its own, position: {{tilt: {channel.column}}}"
            )
    return asked


def _questions_of_axes(columns: ColumnMap, setup: Setup) -> list[str]:
    """Which frame the axes of force/torque sensors follow: files have several on a link."""
    mechanism, asked = setup.mechanism, {}
    wrenches = [
        o for o in mechanism.stated_outputs if o.cuts and o.name in columns.outputs
    ]
    frames = fixed_frames(mechanism, setup.robot_file) if wrenches else {}
    for output in wrenches:
        others = named_axes(mechanism, output, frames)
        if output.sensor != output.name:
            some = f" of {' or '.join(others)}, or" if others else ""
            asked[output.sensor] = (
                f"check the axes of the sensor '{output.sensor}', which are read as those under outputs: they may be "
                f"those{some} of a sensor that is turned, such as frame: {{rpy: [0, 0, pi/2]}}"
            )
    return list(asked.values())


_INCLINED = re.compile("incl|tilt|pitch|slope", re.IGNORECASE)
"""Words for angles of bodies to the vertical, in names of columns."""


# -- text -------------------------------------------------------------------------------------------------------------


def _body(
    file: RobotFile,
    found: Understood,
    log: LogFile,
    folder: Path,
    proposed: float | None = None,
) -> str:
    """The set-up after its head; with a ``proposed`` rate, Hz, for a log without a clock."""
    mechanism = found.setup.mechanism
    parts = [f"{line}  # they rest: there?" for line in _locked_lines(found)]
    if mechanism.measured is not None and not file.is_description:
        parts.append(
            dump_flow(
                {"outputs": [{"actuator": output.name} for output in mechanism.sensed]}
            )
        )
    section = _log_section(found, log, proposed, stated=not file.is_description)
    if file.is_description:
        return "\n".join([_moved(file, folder).rstrip(), *parts, section])
    source = Path(file.source)
    path = _seen_from(folder, source) if source.is_file() else str(source)
    head = [
        dump_flow({key: value})
        for key, value in (("echelon", 1), ("name", mechanism.name), ("robot", path))
    ]
    return (
        "\n".join(
            [
                *head,
                *_gears(file),
                *parts,
                _SERVOS if found.columns.inputs else _EFFECTS,
            ]
        )
        + section
    )


def _seen_from(folder: Path, file: Path) -> str:
    """The path of a file for whoever stands in a folder."""
    return os.path.relpath(file.absolute(), folder.absolute())


def _moved(file: RobotFile, folder: Path) -> str:
    """The text of a description, with the paths of files that it names as seen from another folder."""
    text, home = file.data.decode(), Path(file.source).parent
    # a longer path may end in a shorter one
    for path in sorted(_named_files(file.document.data, home), key=len, reverse=True):
        there = _seen_from(folder, home / path)
        whole = rf"(?<![\w./\\-]){re.escape(path)}(?![\w./\\-])"
        if there != os.path.normpath(path):
            text = re.sub(whole, there.replace("\\", "/"), text)
    return text


def _named_files(data: object, home: Path) -> set[str]:
    """Relative paths in a document at which there is a file."""
    if isinstance(data, Mapping):
        data = list(data.values())
    if isinstance(data, list | tuple):
        return set[str]().union(*(_named_files(entry, home) for entry in data))
    if not isinstance(data, str) or not Path(data).suffix or os.path.isabs(data):
        return set()
    return {data} if os.path.isfile(home / data) else set()


def _locked_lines(found: Understood) -> list[str]:
    """Lines that say which joints rest; as comments where only the user can tell."""
    lines = [dump_flow({"locked": found.locked})] if found.locked else []
    return lines + [f"# {dump_flow({'locked': choice})}" for choice in found.choices]


def _gears(file: RobotFile) -> list[str]:
    """The gears that a robot file states, as a comment: they matter where columns were measured at motors."""
    ratios = {
        actuator: f"{ratio}*{joint}"
        for actuator, (joint, ratio) in stated_gears(file).items()
    }
    if not ratios:
        return []
    return [
        "# gears of the robot file, for columns that were measured at the motors:",
        f"# {dump_flow({'actuators': ratios})}",
    ]


def _log_section(
    found: Understood, log: LogFile, proposed: float | None, *, stated: bool
) -> str:
    """The section ``log``; ``stated`` says whether the set-up states which outputs are measured."""
    mechanism, columns = found.setup.mechanism, _with_all_joints(found)
    whole = found.setup.free or mechanism
    stated = stated and mechanism.measured is not None
    numbered = {
        "output": [o.name for o in (mechanism if stated else whole).sensed],
        "position": whole.independent_positions,
    }
    lines = ["log:"]
    if columns.time is not None:
        lines.append(f"  {dump_flow({'time': _entry(columns.time)})}")
    elif columns.rate:
        lines.append(f"  rate: {columns.rate:<32g}# Hz, as found above")
    elif not first_table(log).clocks:
        lines.append(
            f"  #  rate: {proposed or 1000:<28g} # Hz; no column holds the time"
        )
    for key, group in columns.channels.items():
        if group:
            lines += _group(key, group, numbered.get(key, whole.independent_velocities))
            if key == "output" and _has_drives(group, mechanism):
                lines += _in_amperes(group, numbered[key])
        elif key == "position" or (key == "output" and not columns.inputs):
            lines.append(
                f'  # {key}: "…_{{n}}"                       # one column for each of {listed(_names(mechanism, key))}'
            )
    used = {
        channel.column
        for group in columns.channels.values()
        for channel in group.values()
    }
    used |= {columns.time.column} if columns.time is not None else set()
    left = [name for name in log.names if name not in used]
    return (
        "\n".join([*lines, *(f"  {line}" for line in _comments(_UNUSED, left))]) + "\n"
    )


def _with_all_joints(found: Understood) -> ColumnMap:
    """The columns with those of joints that are locked, in the order of the robot's joints."""
    columns = found.columns
    locked = {
        name: some.position
        for name, some in columns.locked.items()
        if some.position is not None
    }
    every = {**columns.positions, **locked}
    whole = found.setup.free or found.setup.mechanism
    order = {name: k for k, name in enumerate(whole.positions)}
    names = sorted(every, key=lambda name: order.get(name, len(order)))
    return replace(columns, positions={name: every[name] for name in names})


def _names(mechanism: Mechanism, key: str) -> list[str]:
    return (
        [output.name for output in mechanism.outputs]
        if key == "output"
        else list(mechanism.positions)
    )


def _group(
    key: str, group: Mapping[str, Channel], numbered: Sequence[str]
) -> list[str]:
    """Lines that state the channels of a quantity: by a pattern where they have one, else one by one."""
    pattern = _pattern(group, numbered)
    if pattern is not None:
        entry = _entry(pattern)
        return [
            f"  {dump_flow({key: entry if isinstance(entry, str) else {'all': entry}})}"
        ]
    return [
        f"  {key}:",
        *(
            f"    {dump_flow({name: _entry(channel)})}"
            for name, channel in group.items()
        ),
    ]


def _has_drives(names: Collection[str], mechanism: Mechanism) -> bool:
    """Whether outputs of some names are forces of joints or drives."""
    wrenches = {output.name for output in mechanism.sensed if not output.forces}
    return not wrenches.issuperset(names)


def _has_wrenches(names: Collection[str], mechanism: Mechanism) -> bool:
    """Whether outputs of some names are components of wrenches."""
    return any(output.cuts and output.name in names for output in mechanism.sensed)


def _in_amperes(group: Mapping[str, Channel], numbered: Sequence[str]) -> list[str]:
    """A comment that shows how to state outputs that are currents, where nothing says that they are not."""
    pattern = _pattern(group, numbered)
    name, channel = next(iter(group.items())) if pattern is None else ("all", pattern)
    if channel.unit or channel.scale != 1:
        return []
    entry = {name: {"column": channel.column, "scale": 1}}
    return [
        "  # currents, in A, need a scale: torque per ampere at the joint, N·m/A (torque constant times gear ratio; N/A of slides):",
        f"  # {dump_flow({'output': entry})}",
    ]


def _entry(channel: Channel) -> str | dict[str, str | float]:
    """A channel as a description states it."""
    found: dict[str, str | float] = {"column": channel.column}
    found |= {"unit": channel.unit} if channel.unit else {}
    found |= {"scale": channel.scale} if channel.scale != 1 else {}
    return found if len(found) > 1 else channel.column


def _pattern(group: Mapping[str, Channel], numbered: Sequence[str]) -> Channel | None:
    """One channel whose name, with {n} or {name} in it, stands for all of them; names have numbers by their order."""
    names, channels = list(group), list(group.values())
    first = channels[0]
    if len(channels) < 2 or any(
        (c.unit, c.scale, c.offset) != (first.unit, first.scale, first.offset)
        for c in channels
    ):
        return None
    if all(c.column.replace(name, "{name}") == first.column.replace(names[0], "{name}") != first.column
           for name, c in group.items()):  # fmt: skip
        return replace(first, column=first.column.replace(names[0], "{name}"))
    if not set(names) <= set(numbered):
        return None
    places = [numbered.index(name) for name in names]
    for number in reversed([*re.finditer(r"\d+", first.column)]):
        shift = int(number.group()) - 1 - places[0]
        before, after = first.column[: number.start()], first.column[number.end() :]
        if all(
            channel.column == f"{before}{k + 1 + shift}{after}"
            for k, channel in zip(places, channels, strict=True)
        ):
            field = "{n}" if shift == 0 else "{i}" if shift == -1 else f"{{n+{shift}}}"
            return replace(first, column=f"{before}{field}{after}")
    return None


def _comments(title: str, texts: Sequence[str]) -> list[str]:
    """Texts as comments: a list of sentences, or names in a row."""
    wrapped = partial(textwrap.wrap, width=112)
    if not texts:
        return []
    if title == _UNUSED:
        return wrapped(f"# {title}: {', '.join(texts)}", subsequent_indent="#   ")
    lines = [f"# {title}:"]
    for text in texts:
        lines += wrapped(
            " ".join(text.split()), initial_indent="#   - ", subsequent_indent="#     "
        )
    return lines


# -- trial ------------------------------------------------------------------------------------------------------------


def _trial(
    body: str, folder: Path, paths: Sequence[Path]
) -> tuple[tuple[str, ...], bool]:
    """Findings of reading the logs with the set-up, and whether they can be read."""
    try:
        setup = load_setup(RobotFile(body.encode(), "setup.yaml", True, folder))
        lines = []
        for path in paths:
            piece = next(
                read_log(
                    path,
                    setup.mechanism,
                    setup.columns,
                    outputs=any(some.outputs for some in setup.columns),
                ),
                None,
            )
            segments = () if piece is None else piece.segments
            seconds = sum(len(segment) / segment.rate for segment in segments)
            rate = f" at {segments[0].rate:.5g} Hz" if segments else ""
            lines.append(
                f"{path.name}: {seconds:.4g} s{rate} in {counted(len(segments), 'stretch', 'stretches')}"
            )
            lines += [
                str(f)
                for f in (piece.findings if piece else ())
                if f.severity is Severity.WARNING
            ]
    except InputError as error:
        return (f"reading it failed: {error}",), False
    return tuple(lines), True
