"""Other readings of the logs: columns with wrong signs, units or zeros, exchanged, on another side of a gear; a clock.

Each is one linear change of what the columns say, or another direction of gravity.  Least squares alone do not tell
them: an output whose parameters are its own is fitted as well with the wrong sign, by a negative inertia.  So readings
are judged by the parameters of a robot that can exist.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import combinations, permutations
from math import degrees, pi, radians

import numpy as np

from echelon.base import BaseModel
from echelon.formats import FixedFrame, other_axes
from echelon.identification.judge.evidence import States
from echelon.identification.judge.hypothesis import OtherReading, Usual
from echelon.identification.logs.columns.column_map import (
    Channel,
    ColumnMap,
    signal_names,
    units,
)
from echelon.robot import transmission_matrix
from echelon.shared import Floats

_COUPLED = 4  # joints in a row among which a drive moves two: belts and shafts through arms lead no farther
_DECIMALS = (
    5  # of delays, s: no log of a robot tells them to less than ten microseconds
)
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Readings:
    """All other readings of some logs."""

    base: BaseModel
    rows: States
    columns: ColumnMap
    velocities: (
        bool  # whether velocities were measured, not differentiated from positions
    )
    delays: Mapping[str, float] = field(
        default_factory=dict
    )  # by output, s: those that were undone
    frames: Mapping[str, FixedFrame] = field(
        default_factory=dict
    )  # that axes of sensors may follow, by name

    @property
    def outputs(self) -> list[str]:
        """Names of the outputs."""
        return [output.name for output in self.base.mechanism.outputs]

    def all(self) -> Iterator[OtherReading]:
        """Readings that are tried, but for clocks."""
        for change in self._changes():
            yield OtherReading(
                change.text, partial(self._changed, change), change.usual
            )
        yield from self.of_robot()

    def of_robot(self) -> Iterator[OtherReading]:
        """Readings that are about the robot, not its columns: where gravity points, and which joints a drive turns.

        Parameters that no robot has cannot imitate these, so that free ones tell them.
        """
        yield from self._of_gravity()
        yield from self._of_couplings()

    def all_delays(self, further: Floats) -> dict[str, float]:
        """Delays by output, s: those that were undone already and further ones, shape (outputs,)."""
        pairs = zip(self.outputs, further, strict=True)
        found = {
            name: round(self.delays.get(name, 0.0) + float(delay), _DECIMALS)
            for name, delay in pairs
        }
        return {name: delay for name, delay in found.items() if delay}

    def clock(self, rate: float) -> OtherReading:
        """A clock that is faster by a factor than the one that was taken."""
        stated = self.columns.rate
        words = f", {stated * rate:.4g} Hz in place of {stated:g} Hz" if stated else ""
        text = f"the clock is wrong: the rate is about {rate:.3g} times that{words}"
        return OtherReading(
            text, partial(self._changed, _Change(text, rate=rate)), Usual.RARELY, rate
        )

    def _of_gravity(self) -> Iterator[OtherReading]:
        gravity = self.rows.gravity
        if gravity is None:
            return
        size = float(np.linalg.norm(gravity))
        for name, axis in _AXES.items():
            for sign, word in ((1.0, ""), (-1.0, "-")):
                found = sign * size * np.array(axis)
                if not np.allclose(found, gravity):
                    line = ", ".join(f"{g:g}" for g in found)
                    text = (
                        f"gravity is along {word}{name} of the base (gravity: [{line}])"
                    )
                    yield OtherReading(
                        text, partial(_with_gravity, found), gravity=found
                    )
        text = "the outputs contain no weight, like torques of a controller that compensates gravity (gravity: none)"
        yield OtherReading(
            text, partial(_with_gravity, np.zeros(3)), gravity=np.zeros(3)
        )

    def _of_couplings(self) -> Iterator[OtherReading]:
        """Columns of drives that move two joints."""
        names = self.names
        if (
            self.base.mechanism.actuators
            or self.columns.sensors
            or set(names) != set(self.outputs)
            or len(names) != len(self.outputs)
        ):
            return
        turns = [
            name for name, slides in zip(names, self._slides, strict=True) if not slides
        ]
        near = self._near()
        for one, other in (
            pair for pair in permutations(turns, 2) if frozenset(pair) in near
        ):
            for sign, word in ((1.0, "+"), (-1.0, "-")):
                matrix = np.eye(len(names))  # of drives by joints
                matrix[names.index(one), names.index(other)] = sign
                order = [names.index(name) for name in self.outputs]
                forces = matrix.T[np.ix_(order, order)]
                text = f"the drive of '{one}' turns by {one} {word} {other}: state its drives under 'actuators'"
                change = _Change(
                    text,
                    positions=np.asarray(np.linalg.inv(matrix)),
                    outputs=forces,
                    couples=True,
                )
                yield OtherReading(text, partial(self._changed, change), Usual.OFTEN)

    def _near(self) -> set[frozenset[str]]:
        """Pairs of coordinates of one branch that a transmission may couple."""
        chains: dict[int, tuple[str, ...]] = {}
        found: set[frozenset[str]] = set()
        for index, body in enumerate(self.base.mechanism.bodies):
            own = (name for motion in body.joint.motions for name in motion.velocities)
            chains[index] = (*chains.get(body.parent, ()), *own)[-_COUPLED:]
            found.update(map(frozenset, combinations(chains[index], 2)))
        return found

    def _changes(self) -> Iterator[_Change]:
        """Changes of columns."""
        yield from self._of_outputs()
        yield from self._of_positions()
        if self.velocities:
            yield from self._of_velocities()

    def _of_outputs(self) -> Iterator[_Change]:
        m = len(self.outputs)
        label = self._named("output", self.outputs, self.columns.outputs)
        outputs = self.base.mechanism.outputs
        kinds = [output.unit if output.cuts else "" for output in outputs]
        yield from _flips(
            "outputs",
            label,
            lambda text, matrix: _Change(text, outputs=matrix),
            kinds,
        )
        yield from self._of_sensors()
        for i in range(m):
            for factor, prefix in ((1e-3, "m"), (1e3, "k")):
                text = f"{label[i]} is in {prefix}{self.base.mechanism.outputs[i].unit}"
                yield _Change(text, outputs=_scaled(m, i, factor))

    def _of_sensors(self) -> Iterator[_Change]:
        """Force/torque sensors whose axes are those of another frame, read on either side of the sensor."""
        for sensor, places in self._components().items():
            forces = [places[k, False] for k in range(3) if (k, False) in places]
            torques = [places[k, True] for k in range(3) if (k, True) in places]
            if {len(forces), len(torques)} - {0, 3}:
                continue
            cut, _ = self.base.mechanism.outputs[[*forces, *torques][0]].cuts[0]
            for axes in other_axes(self.base.mechanism, cut, self.frames):
                turn, shift = axes.pose[:3, :3], axes.pose[:3, 3]
                matrix = np.eye(len(self.outputs))
                for some in filter(None, (forces, torques)):
                    matrix[np.ix_(some, some)] = turn
                if forces and torques:
                    matrix[np.ix_(torques, forces)] = np.cross(shift, turn, axisb=0).T
                text = f"the axes of the sensor '{sensor}' are {axes.words}"
                yield _Change(text, outputs=matrix)
                some = [*forces, *torques]
                matrix = matrix.copy()
                matrix[some] *= -1
                yield _Change(
                    f"{text}, and its signs are wrong (scale: -1)", outputs=matrix
                )

    def _components(self) -> dict[str, dict[tuple[int, bool], int]]:
        """Outputs that are one component of a wrench, by sensor, axis and whether they are moments."""
        found: dict[str, dict[tuple[int, bool], int]] = {}
        for k, output in enumerate(self.base.mechanism.outputs):
            if output.sensor != output.name and not output.reads:
                cut, _ = output.cuts[0]
                found.setdefault(output.sensor, {})[cut.axis, cut.angular] = k
        return found

    def _of_positions(self) -> Iterator[_Change]:
        label, n = self.position_labels, len(self.position_labels)
        yield from _flips("positions", label, _Change)
        for i, key in enumerate(self._keys):
            name = key if key in self.names else self.names[i]  # of a drive its joint
            if name in self.outputs and key not in self.columns.sensors:
                text = f"'{name}' turns the other way: position and output have the wrong sign, or its axis has"
                forces = _scaled(len(self.outputs), self.outputs.index(name), -1.0)
                yield _Change(text, _scaled(n, i, -1.0), outputs=forces)
        for i in range(n):
            if self._slides[i]:
                yield _Change(f"{label[i]} is in mm (unit: mm)", _scaled(n, i, 1e-3))
                yield _Change(
                    f"{label[i]} is in m, not in mm (unit: m)", _scaled(n, i, 1e3)
                )
                continue
            yield _Change(
                f"{label[i]} is in degrees (unit: deg)", _scaled(n, i, radians(1))
            )
            yield _Change(
                f"{label[i]} is in rad, not in degrees (unit: rad)",
                _scaled(n, i, degrees(1)),
            )
            for shift, words in ((pi / 2, "pi/2"), (-pi / 2, "-pi/2"), (pi, "pi")):
                yield _Change(
                    f"zero of {label[i]} is not the robot's (offset: {words})",
                    shift=shift * np.eye(n)[i],
                )
        for factor, words in (
            (radians(1), "degrees (unit: deg)"),
            (degrees(1), "rad, not in degrees (unit: rad)"),
        ):
            if not all(self._slides):
                yield _Change(
                    f"all positions are in {words}",
                    np.diag(np.where(self._slides, 1.0, factor)),
                )
        yield from self._of_gears()

    def _of_velocities(self) -> Iterator[_Change]:
        stated = self.columns.velocities
        keys = self._keys_of(stated)
        label, n = self._named("velocity", keys, stated), len(keys)
        yield from _flips(
            "velocities", label, lambda text, matrix: _Change(text, velocities=matrix)
        )
        for i in range(n):
            yield _Change(
                f"{label[i]} is in degrees (unit: deg/s)",
                velocities=_scaled(n, i, radians(1)),
            )

    def _of_gears(self) -> Iterator[_Change]:
        """Positions or outputs that are on the other side of the gears."""
        if not self.base.mechanism.actuators:
            return
        driven, T = transmission_matrix(self.base.mechanism)
        if set(driven) != set(self.names) or len(T) != len(self.names):
            return
        ratios = T[:, [driven.index(name) for name in self.names]]
        behind = "the joints' side of the gears, not on the motors'"
        ahead = "the motors' side of the gears, not on the joints'"
        P = np.linalg.inv(self._channels)
        for i, j in zip(*np.nonzero(ratios), strict=True):
            yield from self._of_gear(
                i, self.names[j], abs(float(ratios[i, j])), (ahead, behind)
            )
        for matrix, side in ((np.linalg.inv(ratios), ahead), (ratios, behind)):
            yield _Change(f"positions are on {side}", self._channels @ matrix @ P)
            if len(self.outputs) == len(ratios):
                forces = np.linalg.inv(matrix).T
                yield _Change(f"outputs are on {side}", outputs=forces)

    def _of_gear(
        self, drive: int, joint: str, ratio: float, sides: tuple[str, str]
    ) -> Iterator[_Change]:
        """One column on the other side of one gear."""
        names = (self.base.mechanism.actuators[drive].name, joint)
        for name in names:
            for factor, side in ((1 / ratio, sides[0]), (ratio, sides[1])):
                if name in self.outputs:
                    text = f"the output of '{name}' is on {side}"
                    yield _Change(
                        text,
                        outputs=_scaled(
                            len(self.outputs), self.outputs.index(name), 1 / factor
                        ),
                    )
                if name in self._keys:
                    text = f"the position of '{name}' is on {side}"
                    yield _Change(
                        text, _scaled(len(self._keys), self._keys.index(name), factor)
                    )

    # -- columns -------------------------------------------------------------------------------------------------

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Coordinates that columns may be of: those with a velocity of their own, which quaternions have not."""
        every, rates = self._coordinates
        return tuple(name for name in every if name in rates)

    @cached_property
    def _coordinates(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the columns of positions and of velocities."""
        mechanism, rows = self.base.mechanism, self.rows
        return signal_names(mechanism, "q", rows.q.shape[1]), signal_names(
            mechanism, "qd", rows.qd.shape[1]
        )

    @cached_property
    def position_labels(self) -> list[str]:
        """Names of the columns of positions, for sentences."""
        return self._named("position", self._keys, self.columns.positions)

    @cached_property
    def _keys(self) -> tuple[str, ...]:
        """Names of what the columns of positions measure; :meth:`_combinations` must know each kind of them."""
        return self._keys_of(self.columns.positions)

    def _keys_of(self, stated: Mapping[str, Channel]) -> tuple[str, ...]:
        return tuple(stated) if len(stated) == len(self.names) else self.names

    @property
    def position_units(self) -> list[str]:
        """SI units of the columns of positions."""
        return ["m" if slides else "rad" for slides in self._slides]

    @property
    def offsets(self) -> Floats:
        """Stated offsets of the columns of positions, SI units, shape (n,)."""
        stated = self.columns.positions
        return np.array(
            [stated[key].offset if key in stated else 0.0 for key in self._keys]
        )

    def with_zero(self, states: States, column: int, shift: float) -> States:
        """States with something added to one column of positions, rad or m."""
        return self._changed(
            _Change("", shift=shift * np.eye(len(self._keys))[column]), states
        )

    @cached_property
    def _slides(self) -> list[bool]:
        """Whether columns of positions are lengths."""
        mechanism, sensors = self.base.mechanism, self.columns.sensors
        return [
            units(mechanism, "position", key, sensors) == ("m",) for key in self._keys
        ]

    @cached_property
    def _channels(self) -> Floats:
        """Columns of positions as combinations of coordinates, shape (n, n)."""
        return self._combinations(self._keys)

    @cached_property
    def _zeros(self) -> Floats:
        """Readings of columns without their offsets where all coordinates are zero, SI units, shape (n,)."""
        sensors = self.columns.sensors
        shown = [sensors[key].zero if key in sensors else 0.0 for key in self._keys]
        return np.asarray(np.array(shown) - self.offsets)

    def _combinations(self, keys: Sequence[str]) -> Floats:
        """Combinations of coordinates that coordinates, drives and sensors measure, shape (n, n)."""
        driven, T = transmission_matrix(self.base.mechanism)
        drives = [actuator.name for actuator in self.base.mechanism.actuators]
        found = np.zeros((len(keys), len(self.names)))
        for row, key in zip(found, keys, strict=True):
            if key in self.columns.sensors:
                for name, weight in self.columns.sensors[key].weights.items():
                    row[self.names.index(name)] = weight
            elif key in self.names:
                row[self.names.index(key)] = 1.0
            else:
                row[[self.names.index(name) for name in driven]] = T[drives.index(key)]
        return found

    def _named(
        self, kind: str, names: Sequence[str], stated: Mapping[str, Channel]
    ) -> list[str]:
        return [
            f"the {kind} of '{name}'"
            + (f" (column '{stated[name].column}')" if name in stated else "")
            for name in names
        ]

    def _changed(self, change: _Change, rows: States) -> States:
        """States as a change reads them."""
        if change.couples:
            rows = replace(rows, drives=rows.motion, shared=change.outputs)
        if change.outputs is not None:
            rows = replace(rows, y=rows.y @ change.outputs.T)
        if (
            change.rate != 1.0
        ):  # velocities that were measured do not depend on the clock
            faster = 1.0 if self.velocities else change.rate
            rows = replace(
                rows, qd=rows.qd * faster, qdd=rows.qdd * faster * change.rate
            )
        if change.velocities is not None:
            V = self._combinations(self._keys_of(self.columns.velocities))
            return self._turned(rows, V.T @ change.velocities.T @ np.linalg.inv(V).T)
        if change.positions is None and change.shift is None:
            return rows
        P, zero = self._channels, self._zeros
        matrix = np.eye(len(P)) if change.positions is None else change.positions
        shift = np.zeros(len(P)) if change.shift is None else change.shift
        back = np.linalg.inv(P).T
        places = [self._coordinates[0].index(name) for name in self.names]
        q = rows.q.copy()
        q[:, places] = ((q[:, places] @ P.T + zero) @ matrix.T - zero + shift) @ back
        rows = replace(rows, q=q)
        if change.positions is None or self.velocities:
            return rows
        return self._turned(rows, P.T @ matrix.T @ back)

    def _turned(self, rows: States, matrix: Floats) -> States:
        """Velocities and accelerations that belong to changed columns."""
        places = [self._coordinates[1].index(name) for name in self.names]
        qd, qdd = rows.qd.copy(), rows.qdd.copy()
        qd[:, places], qdd[:, places] = qd[:, places] @ matrix, qdd[:, places] @ matrix
        return replace(rows, qd=qd, qdd=qdd)


@dataclass(frozen=True)
class _Change:
    """A linear change of what the columns of positions and of outputs say."""

    text: str
    positions: Floats | None = (
        None  # shape (n, n): of position columns, without their offsets
    )
    velocities: Floats | None = None  # shape (n, n): of measured velocities alone
    shift: Floats | None = None  # shape (n,): added to them
    outputs: Floats | None = None  # shape (m, m)
    rate: float = 1.0  # times the rate that was taken
    couples: bool = (
        False  # whether columns are of drives, at which effects such as friction act
    )
    usual: Usual = Usual.EVERYWHERE


def _with_gravity(gravity: Floats, states: States) -> States:
    return replace(states, gravity=gravity)


def _flips(
    kind: str,
    label: Sequence[str],
    change: Callable[[str, Floats], _Change],
    kinds: Sequence[str] = (),
) -> Iterator[_Change]:
    """Wrong signs, and exchanges of columns, those of one kind if kinds are given: forces are no torques."""
    for i, name in enumerate(label):
        yield change(
            f"the sign of {name} is wrong (scale: -1)", _scaled(len(label), i, -1.0)
        )
    if len(label) > 1:
        yield change(
            f"the signs of all {kind} are wrong (scale: -1)", -np.eye(len(label))
        )
    for i, j in combinations(range(len(label)), 2):
        if kinds and kinds[i] != kinds[j]:
            continue
        yield change(
            f"{label[i]} and {label[j]} are exchanged", _exchanged(len(label), i, j)
        )


def _scaled(size: int, place: int, factor: float) -> Floats:
    matrix = np.eye(size)
    matrix[place, place] = factor
    return matrix


def _exchanged(size: int, i: int, j: int) -> Floats:
    order = list(range(size))
    order[i], order[j] = j, i
    return np.eye(size)[order]
