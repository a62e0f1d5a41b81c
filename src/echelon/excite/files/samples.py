"""Samples of a trajectory: tables of them, and messages ``trajectory_msgs/JointTrajectory`` of ROS 2, without ROS.

Tables have a column for the time and three for each coordinate.  A message starts at once (its stamp is 0) and a point
holds positions, velocities and accelerations.  As YAML it is what ``ros2 topic pub`` takes.

Samples give a spline of degree 5 through them, so that accelerations and jerks are continuous.  Its knots are sample
times but for the two next to each end, which would leave it undetermined.  Velocities and accelerations that come with
the samples are not needed; they show that the samples are dense and precise enough for the spline to be what was meant.
"""

from __future__ import annotations

import csv
import io
import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np

from echelon.excite.problem.state_limits import NUMBERS_AT_ONCE
from echelon.excite.problem.trajectory import (
    DEGREE,
    LARGEST,
    SHORTEST_STEP,
    Splines,
    Trajectory,
)
from echelon.identification import decoding, open_log, read_table
from echelon.shared import (
    BeforeValidator,
    Floats,
    InputError,
    PlainValidator,
    Record,
    UnfitError,
    Within,
    extra,
    in_quotes,
    kind_of,
    locating,
    one_line,
    parse_yaml,
    record_from,
)

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

FEWEST = DEGREE + 1
"""Samples that a spline goes through."""

PREFIXES = (
    "q",
    "qd",
    "qdd",
)  # prefixes of the names of columns, by the order of the derivative

MOST_SAMPLES = 5_000_000
"""Samples that are written: an hour at 1 kHz, in a file that programs still open."""
ON_GRID = 1e-6
"""Part of a step by which rounding may leave the end of a motion beside the grid of samples."""


@dataclass(frozen=True)
class MotionSamples:
    """A motion at some times."""

    coordinates: tuple[str, ...]
    t: Floats  # shape (N,); s
    # shape (N, n); positions (rad, m), velocities and accelerations; the last two NaN in columns that are not
    # known, or None
    states: tuple[Floats, Floats | None, Floats | None]
    resolution: float = (
        0.0  # steps of the time stamps, s; 0 if they are those of floats
    )
    names: tuple[
        str, ...
    ] = ()  # what the columns of positions are called in the file, if not ``q_<name>``

    def column(self, order: int, coordinate: int) -> str:
        """The name of a column, ``"qd_j3"``."""
        if order == 0 and self.names:
            return self.names[coordinate]
        return f"{PREFIXES[order]}_{self.coordinates[coordinate]}"

    def columns(self) -> Iterator[tuple[int, int, Floats]]:
        """All columns that are known: order of the derivative, place of the coordinate, and values."""
        for order, values in enumerate(self.states):
            if values is not None:
                for j in range(len(self.coordinates)):
                    if order == 0 or not np.all(np.isnan(values[:, j])):
                        yield order, j, values[:, j]


def places(names: Sequence[str], coordinates: Sequence[str], element: str) -> list[int]:
    """Place of each coordinate among the names of a file, which are the same in any order."""
    there = ", ".join(f"'{one_line(name)}'" for name in names)
    if len(set(names)) < len(names):
        raise InputError(f"a joint occurs twice: {there}", element=element)
    for name in coordinates:
        if name not in names:
            raise InputError(
                f"the coordinate '{name}' is missing; there are {there or 'none'}",
                element=element,
            )
    surplus = ", ".join(
        f"'{one_line(name)}'" for name in names if name not in coordinates
    )
    if surplus:
        problem = f"there is no coordinate for {surplus}; valid are {', '.join(map(repr, coordinates))}"
        raise InputError(problem, element=element)
    return [names.index(name) for name in coordinates]


def sampled(trajectory: Trajectory, rate: float, repeats: int = 1) -> MotionSamples:
    """A trajectory at equal steps from its beginning to its end, both included.

    Where the end is not a multiple of the step, the last step is shorter.
    """
    check_repeats(trajectory, repeats)
    if not (math.isfinite(rate) and rate > 0):
        raise InputError(
            f"{rate!r} Hz is not a sampling rate; it is a positive number",
            element="rate",
        )
    end = trajectory.duration * repeats
    steps = end * rate
    if steps > MOST_SAMPLES:
        raise InputError(
            f"{rate:g} Hz gives {steps:.3g} samples; at most {MOST_SAMPLES} are written",
            element="rate",
        )
    whole = round(steps) if abs(steps - round(steps)) < ON_GRID else math.floor(steps)
    t = np.arange(whole + 1) / rate
    t = np.append(t, end) if steps - whole >= ON_GRID else np.append(t[:-1], end)
    if len(t) < FEWEST:
        problem = f"{rate:g} Hz gives {len(t)} samples in {end:g} s; at least {FEWEST} make a trajectory"
        raise InputError(problem, element="rate")
    q, qd, qdd = (_evaluated(trajectory, t, order) for order in range(3))
    return MotionSamples(trajectory.coordinates, t, (q, qd, qdd))


def _evaluated(trajectory: Trajectory, t: Floats, order: int) -> Floats:
    """Derivatives at times, evaluated in pieces, because all functions of a basis are evaluated at once."""
    rows = max(1, NUMBERS_AT_ONCE // trajectory.basis.size)
    return np.concatenate(
        [trajectory(t[k : k + rows], order) for k in range(0, len(t), rows)]
    )


def check_repeats(trajectory: Trajectory, repeats: int) -> None:
    """Only what ends as it began can follow itself."""
    if repeats < 1:
        raise InputError(
            f"{repeats} is not a number of runs; it is 1 or more", element="repeats"
        )
    if repeats > 1 and not trajectory.basis.periodic:
        problem = f"a motion that is not periodic cannot be run {repeats} times without a jump; valid is 1"
        raise InputError(problem, element="repeats")


TIME = "t"  # name of the column of times, s

_PER = ("", "/s", "/s²")
_UNIT = b"unit"


def csv_text(samples: MotionSamples) -> str:
    """A header and a line per sample, in the fewest digits from which every number reads back exactly."""
    columns = _columns(samples)
    stream = io.StringIO()
    table = csv.writer(stream, lineterminator="\n")
    table.writerow(columns)
    table.writerows(np.column_stack(list(columns.values())).tolist())
    return stream.getvalue()


def parquet_bytes(samples: MotionSamples, units: Sequence[str]) -> bytes:
    """A Parquet file with the same columns, each with its unit in its metadata."""
    with extra("excite"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    stated = _units(samples.coordinates, units)
    columns = _columns(samples)
    fields = [
        pa.field(name, pa.float64(), metadata={_UNIT: stated[name].encode()})
        for name in columns
    ]
    sink = io.BytesIO()
    pq.write_table(pa.table(list(columns.values()), schema=pa.schema(fields)), sink)
    return sink.getvalue()


def read_samples(
    path: str | os.PathLike[str], coordinates: Sequence[str], units: Sequence[str]
) -> MotionSamples:
    """Samples from a table with the columns ``t`` and, for each coordinate, ``q_<name>`` or its name alone.

    Columns ``qd_<name>`` and ``qdd_<name>`` need not be there.
    """
    log = open_log(path)
    positions = position_columns(log.names, coordinates, log.source)
    wanted = dict(zip(coordinates, positions, strict=True))
    _check_surplus(log.names, wanted, log.source)
    _check_units(
        path,
        log.source,
        _units(coordinates, units) | dict(zip(positions, units, strict=True)),
    )
    read = read_table(path, [name for name in log.names if name in _known(wanted)])
    if read.left_out:  # a log may lose rows, a motion that is to be executed may not
        raise InputError(read.left_out[0], source=log.source)
    table = read.columns
    unknown = np.full(len(table[TIME]), np.nan)

    def stacked(order: int) -> Floats:
        return np.column_stack(
            [table.get(f"{PREFIXES[order]}_{name}", unknown) for name in coordinates]
        )

    states = (
        np.column_stack([table[column] for column in positions]),
        stacked(1),
        stacked(2),
    )
    return MotionSamples(
        tuple(coordinates), table[TIME], states, names=tuple(positions)
    )


def _columns(samples: MotionSamples) -> dict[str, Floats]:
    found = {TIME: samples.t}
    return found | {
        samples.column(order, j): values for order, j, values in samples.columns()
    }


def _units(coordinates: Sequence[str], units: Sequence[str]) -> dict[str, str]:
    found = {TIME: "s"}
    for prefix, per in zip(PREFIXES, _PER, strict=True):
        found |= {
            f"{prefix}_{name}": unit + per
            for name, unit in zip(coordinates, units, strict=True)
        }
    return found


def position_columns(
    names: Sequence[str], coordinates: Sequence[str], source: str
) -> list[str]:
    """Columns with positions: all with a prefix, or all without."""
    if TIME not in names:
        problem = f"the column of times is missing; there are {in_quotes(map(one_line, names))}"
        raise InputError(problem, source=source, element=f"column '{TIME}'")
    prefixed = [f"{PREFIXES[0]}_{name}" for name in coordinates]
    if all(column in names for column in prefixed):
        return prefixed
    if all(name in names and name != TIME for name in coordinates):
        return list(coordinates)
    style = prefixed if any(column in names for column in prefixed) else coordinates
    lacking = next(
        k for k, column in enumerate(style) if column not in names or column == TIME
    )
    there = in_quotes(map(one_line, names))
    problem = f"no column '{prefixed[lacking]}' or '{coordinates[lacking]}'; there are {there}"
    raise InputError(
        one_line(problem), source=source, element=f"coordinate '{coordinates[lacking]}'"
    )


def _known(wanted: dict[str, str]) -> set[str]:
    """Columns that mean something."""
    derivatives = {f"{prefix}_{name}" for prefix in PREFIXES[1:] for name in wanted}
    return {TIME, *wanted.values(), *derivatives}


def _check_surplus(names: Sequence[str], wanted: dict[str, str], source: str) -> None:
    surplus = [name for name in names if name not in _known(wanted)]
    if surplus:
        problem = (
            f"there is no coordinate for {in_quotes(map(one_line, surplus))}; valid are '{TIME}', and "
            f"q_<name>, qd_<name> and qdd_<name> of {in_quotes(wanted)}"
        )
        raise InputError(problem, source=source, element="columns")


def _check_units(
    path: str | os.PathLike[str], source: str, valid: dict[str, str]
) -> None:
    """Units in the metadata of a Parquet file, where they are stated."""
    with open(path, "rb") as stream:
        if stream.read(4) != b"PAR1":
            return
    with extra("excite"):
        import pyarrow.parquet as pq

    with decoding(source, "a Parquet file"):
        schema = pq.read_schema(path)
    for field in schema:
        stated = (field.metadata or {}).get(_UNIT)
        if (
            stated is not None
            and field.name in valid
            and stated.decode(errors="replace") != valid[field.name]
        ):
            problem = f"is in {one_line(stated.decode(errors='replace'))}; needs {valid[field.name]}"
            raise InputError(problem, source=source, element=f"column '{field.name}'")


_NANO = 10**9  # nanoseconds in a second
_STATES = ("positions", "velocities", "accelerations")


def yaml_text(samples: MotionSamples) -> str:
    """The message as YAML."""
    import yaml

    names = yaml.safe_dump(
        list(samples.coordinates),
        default_flow_style=True,
        width=float("inf"),
        allow_unicode=True,
    )
    lines = [
        "header:",
        "  stamp: {sec: 0, nanosec: 0}",
        "  frame_id: ''",
        f"joint_names: {names.strip()}",
        "points:",
    ]
    states = [values for values in samples.states if values is not None]
    for time, *state in zip(samples.t.tolist(), *states, strict=True):
        sec, nanosec = divmod(round(time * _NANO), _NANO)
        lines += [
            f"{mark} {field}: [{', '.join(map(_number, values.tolist()))}]"
            for mark, field, values in zip("-  ", _STATES, state, strict=True)
        ]
        lines += [
            "  effort: []",
            f"  time_from_start: {{sec: {sec}, nanosec: {nanosec}}}",
        ]
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    """All digits; YAML 1.1 takes 1e-05 for a text, unlike 1.0e-05."""
    text = repr(value)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


_INT32 = np.iinfo(np.int32)  # the message's type of seconds
_SHAPE = "a JointTrajectory with joint_names and points"


_OTHER_NAMES = {"secs": "sec", "nsec": "nanosec", "nsecs": "nanosec"}  # of ROS 1


def _named(value: object) -> object:
    """A stamp with the names of ROS 2."""
    if not isinstance(value, dict):
        return value
    return {_OTHER_NAMES.get(name, name): part for name, part in value.items()}


def _read(kind: type, words: str, value: Any) -> Any:
    """The number of a YAML text."""
    try:
        return kind(value)
    except (TypeError, ValueError):
        raise UnfitError(f"needs {words}, found {kind_of(value)}") from None


_Real = Annotated[float, PlainValidator(partial(_read, float, "a number"))]
_Whole = Annotated[int, PlainValidator(partial(_read, int, "a whole number"))]


class _Stamp(Record):
    sec: Annotated[_Whole, Within(ge=_INT32.min, le=_INT32.max)]
    nanosec: Annotated[_Whole, Within(ge=0, lt=_NANO)]


class _Point(Record):
    other_keys = True

    positions: list[_Real] = []  # noqa: RUF012
    velocities: list[_Real] = []  # noqa: RUF012
    accelerations: list[_Real] = []  # noqa: RUF012
    time_from_start: Annotated[_Stamp, BeforeValidator(_named)]


class _Message(Record):
    other_keys = True

    joint_names: list[str]
    points: list[_Point]


def from_yaml(content: bytes, source: str, coordinates: Sequence[str]) -> MotionSamples:
    """Samples from a message as YAML."""
    documents = [
        found.data for found in parse_yaml(content, source) if found.data is not None
    ]
    if len(documents) != 1:
        raise InputError(
            f"holds {len(documents)} messages; needs one: {_SHAPE}", source=source
        )
    message = record_from(_Message, documents[0], source, _SHAPE)
    with locating(source):
        order = places(message.joint_names, coordinates, "joint_names")
        values = [_values(message.points, name, len(order)) for name in _STATES]
    q, qd, qdd = (None if block is None else block[:, order] for block in values)
    if q is None:
        raise InputError(
            "holds no points with positions", source=source, element="points"
        )
    stamps = [point.time_from_start for point in message.points]
    t = np.array([stamp.sec * _NANO + stamp.nanosec for stamp in stamps]) / _NANO
    return MotionSamples(tuple(coordinates), t, (q, qd, qdd), 1 / _NANO)


def _values(points: Sequence[_Point], name: str, width: int) -> Floats | None:
    """A field of all points, shape (N, width); None if none has it."""
    given = [getattr(point, name) for point in points]
    if not any(given):
        return None
    for k, values in enumerate(given):
        if len(values) != width:
            problem = f"holds {len(values)} numbers; needs {width}, one for each joint"
            raise InputError(problem, element=f"points[{k}].{name}")
    return np.array(given)


# -- a spline through samples ----------------------------------------------------------------------------------------

GROSS = 0.2
"""Root mean square of a difference, relative to that of what differs, that cannot come from interpolating."""


def interpolated(
    samples: MotionSamples, units: Sequence[str], source: str, row: str = "row"
) -> Trajectory:
    """The quintic spline through samples, from time 0 on."""
    with extra("excite"):
        from scipy.interpolate import BSpline, make_interp_spline

    _check_numbers(samples, source, row)
    t = samples.t - samples.t[0]
    _check_times(t, samples.t, source, row)
    spline = make_interp_spline(t, samples.states[0], k=DEGREE)
    # the spline's knots: inside, each once; at the ends, so often that the spline ends there
    breaks = spline.t[DEGREE : len(spline.t) - DEGREE]
    points: Floats = np.ascontiguousarray(spline.c, dtype=float)
    _check_derivatives(samples, BSpline(spline.t, points, DEGREE), t, source)
    return Trajectory(
        samples.coordinates, tuple(units), Splines(tuple(breaks.tolist())), points
    )


def _check_numbers(samples: MotionSamples, source: str, row: str) -> None:
    count = len(samples.t)
    if count < FEWEST:
        raise InputError(
            f"holds {count} samples; a trajectory needs at least {FEWEST}",
            source=source,
        )
    columns = [
        ("t", samples.t),
        *((samples.column(order, j), values) for order, j, values in samples.columns()),
    ]
    for name, values in columns:
        sound = np.abs(values) <= LARGEST
        if not np.all(sound):
            k = int(np.argmin(sound))
            problem = f"is not a finite number up to {LARGEST:.0e}, in SI units"
            raise InputError(
                f"{values[k]} {problem}",
                source=source,
                element=f"column '{name}', {row} {k}",
            )


def _check_times(t: Floats, stated: Floats, source: str, row: str) -> None:
    """Times rise, also after the first one is taken from them."""
    rising = np.diff(t) >= SHORTEST_STEP
    if not np.all(rising):
        k = int(np.argmin(rising))
        problem = f"{stated[k + 1]!s} s follows {stated[k]!s} s; times must rise"
        raise InputError(problem, source=source, element=f"column 't', {row} {k + 1}")


def _check_derivatives(
    samples: MotionSamples, spline: BSpline, t: Floats, source: str
) -> None:
    """Velocities and accelerations that the file states; differences that rounding explains do not count."""
    speeds, step = spline(t, nu=1), float(np.min(np.diff(t)))
    stamps = samples.resolution + float(np.spacing(np.abs(samples.t).max()))
    for order, j, stated in samples.columns():
        if order == 0:
            continue
        found: Floats = spline(t, nu=order)[:, j]
        rounding = 4 * float(
            np.spacing(np.abs(samples.states[0][:, j]).max())
        ) + stamps * _rms(speeds[:, j])
        difference, scale = _rms(stated - found), max(_rms(stated), _rms(found))
        # of what the steps can show, the fastest oscillation makes the most of an error
        if difference > GROSS * scale + rounding * (np.pi / step) ** order:
            share = f"{100 * difference / scale:.0f} %"
            problem = (
                f"its {_STATES[order]} differ from the derivatives of its positions by {share} (rms): steps are "
                "too long, positions have too few digits, or units differ"
            )
            raise InputError(
                problem, source=source, element=f"column '{samples.column(order, j)}'"
            )


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(values))))
