"""The one mistake in a set-up that explains why its data contradict physics, or predict badly.

A column with the wrong sign, two columns exchanged, a wrong unit, rate or side of a gear: each is one change of what
was read.  All of them are tried on some samples of the logs, whose rows pass the filter of both sides: of unfiltered
ones the steps of dry friction would be all that is left.  For each change base parameters are fitted by weighted least
squares from the normal matrices of the outputs, then moved to those of the nearest physical robot; how well these
predict is the mark of the change.  Least squares alone would not do: an output whose parameters are its own is fitted
as well with the wrong sign, by a negative inertia.  The mark without physics is never worse, so changes are taken in
its order until it exceeds the best one found, and few programmes are solved.

A change is named only if it is far better than what was read, and than every other change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from math import degrees, exp, inf, log, pi, radians

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.errors import EchelonError
from echelon.identification.culprit_marks import Marks, Normal, States
from echelon.identification.rows.plan import begun
from echelon.logs.columns.column_map import Channel, ColumnMap, motion_of, signal_names
from echelon.logs.recording import Samples
from echelon.mechanism.joint import MotionKind
from echelon.mechanism.motor_side import transmission_matrix
from echelon.observe.observation import Observation

SAMPLES = 4000
"""Samples that changes are tried on, of which filters leave a third: some twenty per parameter of an arm, of every
output."""
BETTER = 0.75  # residual that a change leaves, relative to what was read, from which on it is named
_MUCH_BETTER = 0.5  # the same for the prediction of a log that was not fitted, which may be of another day
APART = 0.93  # the same relative to every other change
_FOREIGN = 50.0
"""Ratio of an output to what the prior predicts that no robot explains: below that of units, above errors of priors."""
_ALTERNATIVES = 2  # changes that are named together, because nothing tells them apart
_PROGRAMMES = 16  # physical programmes that are solved at most
_RATES = (*np.geomspace(0.1, 10, 31), 1e-3, 1e3)  # that are tried first, with ms for s and s for ms
_FINER_RATES = ((1.17, 9), (1.03, 9))  # then, how far from the best one, and how many
_SAME_RATE = 0.05  # relative difference from which on a rate is another one
_ALIKE = 0.5  # cosine from which on outputs and what the prior predicts have something to do with one another


@dataclass(frozen=True)
class Culprit:
    """A change of the set-up that mends it."""

    text: str  # what is wrong and how it is said right, in a sentence
    # residual of a physical robot without and with the change, as a share of the outputs' spread (geometric
    # mean); of a common unit, the outputs as multiples of what the prior predicts
    before: float
    after: float
    rate: float = 1.0  # times the rate that was taken

    @property
    def reduction(self) -> float:
        """Logarithm by which it reduces residuals, the mean of all outputs."""
        return log(self.before / self.after)


@dataclass(frozen=True)
class _Change:
    """A linear change of what the columns of positions and of outputs say."""

    text: str
    positions: Floats | None = None  # shape (n, n): of position columns, without their offsets
    velocities: Floats | None = None  # shape (n, n): of measured velocities alone
    shift: Floats | None = None  # shape (n,): added to them
    outputs: Floats | None = None  # shape (m, m)
    rate: float = 1.0  # times the rate that was taken


def states_of(samples: Iterable[Samples], band: float) -> States:
    """Prepared samples on a clock that is no faster than the band needs."""
    pieces = tuple(piece for piece in begun(samples, band, SAMPLES) if piece.y is not None)
    q, qd, qdd, y = (np.concatenate([getattr(p, name) for p in pieces]) for name in ("q", "qd", "qdd", "y"))
    inputs = {name: np.concatenate([piece.inputs[name] for piece in pieces]) for name in pieces[0].inputs}
    return States(q, qd, qdd, y, inputs, pieces)


def culprit(
    base: BaseModel,
    samples: Iterable[Samples],
    columns: Sequence[ColumnMap] = (),
    *,
    band: float = inf,
    velocities: bool = False,
    values: Floats | None = None,
    prior: Floats | None = None,
    only_rate: bool = False,
) -> Culprit | None:
    """The one change that restores physics and prediction, if there is one, or two that do alike.

    ``band`` is that of both sides, Hz; ``velocities`` says whether the samples' velocities were measured, not
    differentiated from positions.  With the ``values`` of base parameters from other logs a change is to restore their
    prediction.  Of changes that do alike the ``prior`` decides.  ``only_rate`` tries nothing but the clock.
    """
    search = _Search(base, states_of(samples, band), columns[0] if columns else ColumnMap(), velocities, values, prior)
    if not any(some.spread > 0 for some in search.marks.normals(search.read)):
        return None  # no row moves, or no output varies: all changes do alike
    return search.found(list(search.of_rate() if only_rate else search.changes()))


def common_unit(base: BaseModel, observation: Observation, prior: Floats) -> Culprit | None:
    """A wrong unit that all outputs share, or one of them: it scales parameters, so that only a prior can tell."""
    ratios, layout = {}, observation.layout
    for name, R, columns in zip(layout.outputs, observation.factors, layout.columns, strict=True):
        measured, guess = R[:, -1], R[:, :-1] @ prior[list(columns)]
        sizes = float(np.linalg.norm(measured)), float(np.linalg.norm(guess))
        if min(sizes) > 0 and measured @ guess > _ALIKE * sizes[0] * sizes[1]:
            ratios[name] = sizes[0] / sizes[1]
    units = {output.name: output.unit for output in base.mechanism.outputs}
    for factor, prefix in ((1e3, "m"), (1e-3, "k")):
        off = [name for name, ratio in ratios.items() if abs(log(ratio / factor)) < log(4.0)]
        usual = [name for name, ratio in ratios.items() if abs(log(ratio)) < log(20.0)]
        if off and (2 * len(off) > len(ratios) or len(off) == 1 == len(layout.outputs) - len(usual)):
            ratio = float(np.median([ratios[name] for name in off]))
            which = "all outputs are" if 2 * len(off) > len(ratios) else f"the output of '{off[0]}' is"
            said = " or ".join(f"{prefix}{unit}" for unit in dict.fromkeys(units[name] for name in off))
            text = f"{which} in {said} (unit: {said.split(' or ')[0]}), {ratio:.3g} times what the prior model predicts"
            return Culprit(text, exp(abs(log(ratio))), exp(abs(log(ratio / factor))))
    foreign = [ratio for ratio in ratios.values() if abs(log(ratio)) > log(_FOREIGN)]
    if 2 * len(foreign) > len(ratios):
        ratio = float(np.median(foreign))
        text = f"the outputs are in another unit: they are {ratio:.3g} times what the prior model predicts"
        return Culprit(text, exp(abs(log(ratio))), 1.0)
    return None


class _Search:
    def __init__(
        self,
        base: BaseModel,
        rows: States,
        columns: ColumnMap,
        velocities: bool,
        values: Floats | None,
        prior: Floats | None,
    ) -> None:
        self.base, self.rows, self.columns, self.velocities = base, rows, columns, velocities
        self.values, self.prior = values, prior
        self.outputs = [output.name for output in base.mechanism.outputs]
        self.marks = Marks(base, rows.y.shape[1])
        self.read = self.marks.products(rows)

    def found(self, changes: Sequence[_Change]) -> Culprit | None:
        """The best change, if it is far better than none and than all others."""
        if not changes:
            return None
        before = best = self._mark(self.marks.normals(self.read), physical=True)
        # of changes that physics alone tells apart, those that happen more often come first
        free = sorted(((round(self._free(change), 2), change) for change in changes), key=lambda entry: entry[0])
        marks: list[tuple[float, _Change]] = []
        for mark, change in free[:_PROGRAMMES]:
            if mark > best - log(APART):
                break
            marks.append((self._mark(self._normals(change), physical=True, failed=inf), change))
            best = min(best, marks[-1][0])
        if best > before + log(BETTER if self.values is None else _MUCH_BETTER):
            return None
        alike = self._likely([change for mark, change in marks if mark <= best - log(APART)])
        if len(alike) > _ALTERNATIVES:
            return None
        return Culprit(", or ".join(change.text for change in alike), exp(before), exp(best), alike[0].rate)

    def _likely(self, changes: list[_Change]) -> list[_Change]:
        """Those of several changes with which the prior predicts best: a mirrored robot can exist as well."""
        if self.prior is None or len(changes) < 2:
            return changes
        marks = [self.marks.mark(self._normals(change), self.prior) for change in changes]
        return [change for mark, change in zip(marks, changes, strict=True) if mark <= min(marks) - log(APART)]

    def _free(self, change: _Change) -> float:
        try:
            return self._mark(self._normals(change), physical=False)
        except EchelonError:  # loops that cannot be closed
            return inf

    def _mark(self, normals: list[Normal], *, physical: bool, failed: float | None = None) -> float:
        if self.values is not None:
            return self.marks.mark(normals, self.values)
        return self.marks.physical(normals, failed) if physical else self.marks.free(normals)

    def _normals(self, change: _Change) -> list[Normal]:
        same = change.positions is None and change.velocities is None and change.shift is None and change.rate == 1.0
        products = self.read if same else self.marks.products(self._changed(change))
        return self.marks.normals(products, change.outputs)

    # -- changes -------------------------------------------------------------------------------------------------

    def changes(self) -> Iterator[_Change]:
        """Everything that is tried."""
        yield from self._of_outputs()
        yield from self._of_positions()
        if self.velocities:
            yield from self._of_velocities()
        yield from self.of_rate()

    def _of_outputs(self) -> Iterator[_Change]:
        m, label = len(self.outputs), self._named("output", self.outputs, self.columns.outputs)
        yield from _flips("outputs", label, lambda text, matrix: _Change(text, outputs=matrix))
        for i in range(m):
            for factor, prefix in ((1e-3, "m"), (1e3, "k")):
                if not abs(log(self._sizes[i] * factor)) > log(_FOREIGN):  # also where it is nan
                    text = f"{label[i]} is in {prefix}{self.base.mechanism.outputs[i].unit}"
                    yield _Change(text, outputs=_scaled(m, i, factor))

    def _of_positions(self) -> Iterator[_Change]:
        label, n = self._position_labels, len(self._position_labels)
        yield from _flips("positions", label, _Change)
        for i, name in enumerate(self.names if n == len(self.names) else ()):
            if name in self.outputs:
                text = f"'{name}' turns the other way: position and output have the wrong sign, or its axis has"
                forces = _scaled(len(self.outputs), self.outputs.index(name), -1.0)
                yield _Change(text, _scaled(n, i, -1.0), outputs=forces)
        for i in range(n):
            if self._slides[i]:
                yield _Change(f"{label[i]} is in mm (unit: mm)", _scaled(n, i, 1e-3))
                yield _Change(f"{label[i]} is in m, not in mm (unit: m)", _scaled(n, i, 1e3))
                continue
            yield _Change(f"{label[i]} is in degrees (unit: deg)", _scaled(n, i, radians(1)))
            yield _Change(f"{label[i]} is in rad, not in degrees (unit: rad)", _scaled(n, i, degrees(1)))
            for shift, words in ((pi / 2, "pi/2"), (-pi / 2, "-pi/2"), (pi, "pi")):
                yield _Change(f"zero of {label[i]} is not the robot's (offset: {words})", shift=shift * np.eye(n)[i])
        for factor, words in ((radians(1), "degrees (unit: deg)"), (degrees(1), "rad, not in degrees (unit: rad)")):
            if not all(self._slides):
                yield _Change(f"all positions are in {words}", np.diag(np.where(self._slides, 1.0, factor)))
        yield from self._of_gears()

    def _of_velocities(self) -> Iterator[_Change]:
        label, n = self._named("velocity", self._keys, self.columns.velocities), len(self._keys)
        yield from _flips("velocities", label, lambda text, matrix: _Change(text, velocities=matrix))
        for i in range(n):
            yield _Change(f"{label[i]} is in degrees (unit: deg/s)", velocities=_scaled(n, i, radians(1)))

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
            yield from self._of_gear(i, self.names[j], abs(float(ratios[i, j])), (ahead, behind))
        for matrix, side in ((np.linalg.inv(ratios), ahead), (ratios, behind)):
            yield _Change(f"positions are on {side}", self._channels @ matrix @ P)
            if len(self.outputs) == len(ratios):
                forces = np.linalg.inv(matrix).T
                yield _Change(f"outputs are on {side}", outputs=forces)

    def _of_gear(self, drive: int, joint: str, ratio: float, sides: tuple[str, str]) -> Iterator[_Change]:
        """One column on the other side of one gear."""
        names = (self.base.mechanism.actuators[drive].name, joint)
        for name in names:
            for factor, side in ((1 / ratio, sides[0]), (ratio, sides[1])):
                if name in self.outputs:
                    text = f"the output of '{name}' is on {side}"
                    yield _Change(text, outputs=_scaled(len(self.outputs), self.outputs.index(name), 1 / factor))
                if name in self._keys:
                    text = f"the position of '{name}' is on {side}"
                    yield _Change(text, _scaled(len(self._keys), self._keys.index(name), factor))

    def of_rate(self) -> Iterator[_Change]:
        """The rate that explains most, if it is not the one that was taken."""
        rate = self._best_rate(_RATES)
        for width, count in _FINER_RATES:
            rate = self._best_rate(rate * width ** np.linspace(-1, 1, count))
        if abs(log(rate)) > _SAME_RATE:
            stated = self.columns.rate
            words = f", {stated * rate:.4g} Hz in place of {stated:g} Hz" if stated else ""
            yield _Change(f"the clock is wrong: the rate is about {rate:.3g} times that{words}", rate=rate)

    def _best_rate(self, rates: Iterable[float]) -> float:
        return min(map(float, rates), key=lambda rate: self._free(_Change("", rate=rate)))

    @cached_property
    def _sizes(self) -> list[float]:
        """Outputs relative to what the prior predicts, nan without one: then any unit may be right."""
        if self.prior is None:
            return [np.nan] * len(self.outputs)
        found = []
        for i, (columns, product) in enumerate(zip(self.marks.columns, self.read, strict=True)):
            values, place = self.prior[columns], len(columns) + i
            guess = float(values @ product[: len(columns), : len(columns)] @ values)
            found.append(float(np.sqrt(product[place, place] / guess)) if guess > 0 < product[place, place] else np.nan)
        return found

    # -- columns -------------------------------------------------------------------------------------------------

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Coordinates that columns may be of: those with a velocity of their own, which quaternions have not."""
        every, rates = self._coordinates
        return tuple(name for name in every if name in rates)

    @cached_property
    def _coordinates(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Names of the columns of positions and of velocities."""
        of = self.base.mechanism
        return signal_names(of, "q", self.rows.q.shape[1]), signal_names(of, "qd", self.rows.qd.shape[1])

    @cached_property
    def _position_labels(self) -> list[str]:
        return self._named("position", self._keys, self.columns.positions)

    @cached_property
    def _keys(self) -> tuple[str, ...]:
        """What the columns of positions are of: coordinates, or drives."""
        stated = self.columns.positions
        return tuple(stated) if len(stated) == len(self.names) else self.names

    @cached_property
    def _slides(self) -> list[bool]:
        """Whether columns of positions are lengths."""
        motions = [motion_of(self.base.mechanism, key) for key in self._keys]
        return [motion is not None and motion.kind is MotionKind.TRANSLATION for motion in motions]

    @cached_property
    def _channels(self) -> Floats:
        """Columns of positions as combinations of coordinates, shape (n, n)."""
        found = np.eye(len(self.names))
        if set(self._keys) == set(self.names):
            return found[[self.names.index(key) for key in self._keys]]
        driven, T = transmission_matrix(self.base.mechanism)
        drives = [actuator.name for actuator in self.base.mechanism.actuators]
        for row, key in zip(found, self._keys, strict=True):
            row[:] = 0.0
            if key in self.names:
                row[self.names.index(key)] = 1.0
            else:
                row[[self.names.index(name) for name in driven]] = T[drives.index(key)]
        return found

    def _named(self, kind: str, names: Sequence[str], stated: Mapping[str, Channel]) -> list[str]:
        return [
            f"the {kind} of '{name}'" + (f" (column '{stated[name].column}')" if name in stated else "")
            for name in names
        ]

    def _changed(self, change: _Change) -> States:
        rows = self.rows
        if change.rate != 1.0:  # velocities that were measured do not depend on the clock
            faster = 1.0 if self.velocities else change.rate
            rows = replace(rows, qd=rows.qd * faster, qdd=rows.qdd * faster * change.rate)
        if change.velocities is not None:
            return self._turned(rows, self._channels.T @ change.velocities.T @ np.linalg.inv(self._channels).T)
        if change.positions is None and change.shift is None:
            return rows
        P, stated = self._channels, self.columns.positions
        offset = np.array([stated[key].offset if key in stated else 0.0 for key in self._keys])
        matrix = np.eye(len(P)) if change.positions is None else change.positions
        shift = np.zeros(len(P)) if change.shift is None else change.shift
        back = np.linalg.inv(P).T
        places, q = [self._coordinates[0].index(name) for name in self.names], rows.q.copy()
        q[:, places] = ((q[:, places] @ P.T - offset) @ matrix.T + offset + shift) @ back
        rows = replace(rows, q=q)
        return rows if self.velocities else self._turned(rows, P.T @ matrix.T @ back)

    def _turned(self, rows: States, matrix: Floats) -> States:
        """Velocities and accelerations that belong to changed columns."""
        places = [self._coordinates[1].index(name) for name in self.names]
        qd, qdd = rows.qd.copy(), rows.qdd.copy()
        qd[:, places], qdd[:, places] = qd[:, places] @ matrix, qdd[:, places] @ matrix
        return replace(rows, qd=qd, qdd=qdd)


def _flips(kind: str, label: Sequence[str], change: Callable[[str, Floats], _Change]) -> Iterator[_Change]:
    """Wrong signs and exchanges of columns."""
    for i, name in enumerate(label):
        yield change(f"the sign of {name} is wrong (scale: -1)", _scaled(len(label), i, -1.0))
    if len(label) > 1:
        yield change(f"the signs of all {kind} are wrong (scale: -1)", -np.eye(len(label)))
    for i, j in combinations(range(len(label)), 2):
        yield change(f"{label[i]} and {label[j]} are exchanged", _exchanged(len(label), i, j))


def _scaled(size: int, place: int, factor: float) -> Floats:
    matrix = np.eye(size)
    matrix[place, place] = factor
    return matrix


def _exchanged(size: int, i: int, j: int) -> Floats:
    order = list(range(size))
    order[i], order[j] = j, i
    return np.eye(size)[order]
