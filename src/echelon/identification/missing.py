"""What a model lacks: functions of the motion that residuals follow, and the effects to add.

For every output [W C y] is factored, on fitted and on held-out rows, with the forces C of effects that the model may
lack.  An effect is tried in all places at once, such as the rotors of all drives, in the joint least squares of all
outputs: what one output could explain alone the bodies may contradict elsewhere.  The effect that predicts held-out
rows best stays, and the others are tried beside it.  What the model can say already is projected away, so that nothing
is named twice; and what only fits noise does not predict.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echelon.arrays import Floats, Integers
from echelon.base.model import BaseModel
from echelon.identification.rows.plan import spread_out as begun
from echelon.identification.rows.rows import ModelRows, rows_taken
from echelon.logs.finding import Finding, note, warning
from echelon.logs.recording import Samples
from echelon.mechanism.effect import Side
from echelon.mechanism.mechanism import Force, Mechanism
from echelon.mechanism.stated import known_values
from echelon.observe.triangle import column_norms, safe_norms, upper_triangle

_SAMPLES, _ROWS = 12_000, 6_000
"""Samples that are looked at, on a clock no faster than the band needs, and rows of each output that are kept."""
_HARMONICS = range(1, 13)
_NAMED = 4  # effects that are named at most
_CLEAR = ((0.05, 1e-3), (0.3, 1e-4))
"""Least shares of an output's squares that an effect removes, with the least R² that it then adds."""
WORTH = min(gained for _, gained in _CLEAR)  # share of an output's squares that an effect has to explain at least
_RARE = 0.7  # weight of the gain of effects that few robots have, so that the usual ones come first
_RARELY = 3  # how much larger a share they have to remove
_SERIOUS = 0.01  # R² that is worth a warning
_EXACT = 1e-9  # share of an output's squares that is left at least: rounding of exact data explains nothing
_SEEN = 1e-2  # least share of an effect's force that the model cannot say already


@dataclass(frozen=True)
class Missing:
    """An effect that the model lacks, at the places where it matters."""

    follows: str  # what residuals follow, in words
    usual: bool  # whether most robots have it
    places: tuple[str, ...]
    entries: tuple[str, ...]  # of the set-up, by place, with {at} for where
    before: tuple[float, ...]  # R² on held-out rows, by place
    after: tuple[float, ...]

    @property
    def is_rotor(self) -> bool:
        """Whether it is the inertia of rotors."""
        return "rotor_inertia" in self.entries[0]

    def finding(self, *, lists_effects: bool, taken: bool = False) -> Finding:
        """What is said of it, with what to write into a set-up that lists effects, or has only the usual ones.

        Of an effect that was ``taken`` in at once it is said how to state it.
        """
        together = {
            entry: [p for p, e in zip(self.places, self.entries, strict=True) if e == entry] for entry in self.entries
        }
        lines = [entry.replace("{at}", f"[{', '.join(places)}]") for entry, places in together.items()]
        line = (
            f"add {', '.join(lines)} to 'effects'" if lists_effects else f"write effects: [usual, {', '.join(lines)}]"
        )
        line = f"it was taken in; to state it, {line}" if taken else line
        rises = zip(self.places, self.before, self.after, strict=True)
        gains = ", ".join(f"{name} {before:.4f} to {after:.4f}" for name, before, after in rises)
        text = f"residuals follow {self.follows}; with an effect for it R² on held-out rows rises ({gains}): {line}"
        least = _CLEAR[0][1] if self.usual else _SERIOUS
        serious = any(b - a > least for a, b in zip(self.before, self.after, strict=True))
        return (warning if serious else note)("missing effect", "", text)


def missing_effects(
    base: BaseModel, values: Floats, noise: Floats, band: float, fitted: Iterable[Samples], held: Iterable[Samples]
) -> list[Missing]:
    """Effects with which held-out rows are predicted better, the most useful ones first."""
    places = list(_places(base.mechanism))
    weights = np.where(np.isfinite(noise) & (noise > 0), 1 / noise, 0.0)
    trial = _Trial(base, values, weights, band, tuple(places))
    first, last = (trial.rows(samples) for samples in (fitted, held))
    return [] if first is None or last is None else list(_selected(trial, first, last))


def explained(lacking: Sequence[Missing], outputs: int) -> float:
    """Logarithm by which effects that a model lacks reduce residuals of held-out rows, the mean of all outputs."""
    rises = [pair for missing in lacking for pair in zip(missing.before, missing.after, strict=True)]
    return sum(0.5 * float(np.log((1 - before) / max(1 - after, _EXACT))) for before, after in rises) / max(outputs, 1)


# -- what may be missing ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Place:
    """An output that is the force of one drive or joint, and the coordinate of that."""

    output: int
    name: str
    ratios: tuple[tuple[int, int, float], ...]  # columns of positions and of velocities, and ratio, of coordinates

    def state(self, samples: Samples) -> tuple[Floats, Floats, Floats]:
        """Position, velocity and acceleration of the coordinate, shape (N,)."""
        q = np.sum([r * samples.q[:, p] for p, _, r in self.ratios], axis=0)
        qd, qdd = (np.sum([r * x[:, v] for _, v, r in self.ratios], axis=0) for x in (samples.qd, samples.qdd))
        return q, qd, qdd


def _places(mechanism: Mechanism) -> Iterator[_Place]:
    positions, velocities = mechanism.independent_positions, mechanism.independent_velocities
    known, drives = known_values(mechanism), {a.name: a.terms for a in mechanism.transmission.actuators}
    for k, output in enumerate(mechanism.outputs):
        force = output.terms[0][0]
        if len(output.terms) > 1 or not isinstance(force, Force):
            continue
        ratios = {force.at: 1.0}
        if force.side is Side.ACTUATOR:
            ratios = {n: r.at(known) for n, r in drives[force.at] if known.keys() >= set(r.symbols())}
        if ratios and all(n in positions and n in velocities for n in ratios):
            yield _Place(k, force.at, tuple((positions.index(n), velocities.index(n), r) for n, r in ratios.items()))


@dataclass(frozen=True)
class _Usual:
    """How far and how fast a coordinate usually moves."""

    centre: float
    reach: float
    speed: float

    @staticmethod
    def of(place: _Place, samples: Samples) -> _Usual:
        q, qd, _ = place.state(samples)
        low, high = float(q.min()), float(q.max())
        return _Usual((low + high) / 2, (high - low) / 2, float(np.percentile(np.abs(qd), 90)))


@dataclass(frozen=True)
class _Effect:
    """An effect at one place."""

    follows: str
    entry: str
    forces: tuple[Floats, ...]  # per unit of its parameters, shape (N,)
    weight: float = _RARE


def _effects(
    place: _Place, others: Sequence[_Place], samples: Samples, load: Floats, usual: _Usual
) -> Iterator[_Effect]:
    """Effects that may be missing at a place; those of one wording at several places are tried together."""
    q, qd, qdd = place.state(samples)
    sign, one = np.sign(qd), np.ones(len(samples))
    yield _Effect("nothing but a constant", "{type: offset, at: {at}}", (one,), 1.0)
    yield _Effect("the velocity qd", "{type: viscous, at: {at}}", (qd,), 1.0)
    yield _Effect("the direction sign(qd)", "{type: coulomb, at: {at}}", (sign,), 1.0)
    yield _Effect("the acceleration qdd", "{type: rotor_inertia, at: {at}}", (qdd,), 1.0)
    yield _Effect("the speed |qd|", "{type: asymmetric_viscous, at: {at}}", (np.abs(qd),))
    yield _Effect("the load |tau|·sign(qd)", "{type: load_friction, at: {at}}", (sign * np.abs(load),))
    yield from _slow(qd, usual)
    yield from _along(q, usual)
    yield from _elsewhere(place, others, samples)
    if place.name in samples.inputs:
        warmth = samples.inputs[place.name]
        entry = "{type: temperature_friction, at: {at}}"
        yield _Effect("the measured input times velocity and direction", entry, (warmth * qd, warmth * sign))


def _slow(qd: Floats, usual: _Usual) -> Iterator[_Effect]:
    for share, words in ((0.05, "very slow"), (0.15, "slow"), (0.4, "rather slow")):
        velocity = f"{max(share * usual.speed, 1e-9):.1g}"
        entry = f"{{type: stribeck, at: {{at}}, velocity: {velocity}}}"
        force: Floats = np.sign(qd) * np.exp(-((qd / float(velocity)) ** 2))
        yield _Effect(f"{words} motion, as in Stribeck friction", entry, (force,))


def _along(q: Floats, usual: _Usual) -> Iterator[_Effect]:
    yield _Effect("the position q", "{type: spring, at: {at}}", (q, np.ones(len(q))))
    yield _Effect("q, q² and q³", "{type: cable, at: {at}}", (q, q**2, q**3))
    for share in (0.7, 0.75, 0.8, 0.85, 0.9, 0.95):
        lower, upper = (usual.centre + side * share * usual.reach for side in (-1, 1))
        entry = f"{{type: stop, at: {{at}}, lower: {lower:.3g}, upper: {upper:.3g}}}"
        force = np.maximum(q - upper, 0) + np.minimum(q - lower, 0)
        yield _Effect(f"the last {1 - share:.0%} of the range", entry, (force,))
    for k in _HARMONICS:
        angle = "q" if k == 1 else f"{k}q"
        entry = f"{{type: ripple, at: {{at}}, harmonic: {k}}}"
        words = f"sin({angle}) and cos({angle})" + ", as of springs or another direction of gravity" * (k == 1)
        yield _Effect(words, entry, (np.sin(k * q), np.cos(k * q)))


def _elsewhere(place: _Place, others: Sequence[_Place], samples: Samples) -> Iterator[_Effect]:
    for other in others:
        _, qd, qdd = other.state(samples)
        for term, force in (("qd[{}]", qd), ("sign(qd[{}])", np.sign(qd)), ("qdd[{}]", qdd)):
            written = term.format(other.name)
            acts = f'[{{at: {place.name}, term: "{written}"}}]'
            entry = f'{{parameter: "{place.name} by {other.name}", acts: {acts}}}'
            yield _Effect(f"another joint, {written}", entry, (force,))


# -- rows ------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Rows:
    """Rows of all outputs, one under another, in units of their noise."""

    model: Floats  # W, shape (rows, n)
    effects: Floats  # forces of the effects, shape (rows, m)
    y: Floats
    outputs: Integers  # of the rows
    spread: Floats  # squares of y about its mean, shape (outputs,)

    def squares(self, residual: Floats) -> Floats:
        """Squares by output."""
        return np.bincount(self.outputs, residual**2, len(self.spread)).astype(float)


@dataclass
class _Trial:
    base: BaseModel
    values: Floats
    weights: Floats  # shape (outputs,)
    band: float  # of both sides, Hz
    places: tuple[_Place, ...]

    def __post_init__(self) -> None:
        self.usual: dict[str, _Usual] = {}
        self.columns: list[tuple[_Place, _Effect]] = []  # of the effects, without their forces

    def rows(self, samples: Iterable[Samples]) -> _Rows | None:
        """What is known of some samples, as R-factors of [W C y]."""
        pieces = [self._piece(some) for some in begun(samples, self.band, _SAMPLES, 10, self._left)]
        layout = ModelRows.of(self.base, ()).layout
        parts, outputs, spread = [], [], np.zeros(len(layout.outputs))
        names = [column[0].output for column in self.columns]
        for k, columns in enumerate(layout.columns):
            mine = [c for c, output in enumerate(names) if output == k]
            table = np.concatenate([piece[k] for piece in pieces]) if pieces else np.zeros((0, 1))
            if not len(table) or not mine or not self.weights[k]:
                continue
            triangle = self.weights[k] * upper_triangle(table[:: -(-len(table) // _ROWS)])
            whole = np.zeros((len(triangle), len(layout.parameters) + len(names) + 1))
            whole[:, [*columns, *(len(layout.parameters) + c for c in mine), -1]] = triangle
            parts.append(whole)
            outputs += [k] * len(triangle)
            y, one = triangle[:, -1], triangle[:, len(columns)]
            spread[k] = y @ y - (one @ y) ** 2 / (one @ one)
        if not parts:
            return None
        stacked, n = np.concatenate(parts), len(layout.parameters)
        return _Rows(stacked[:, :n], stacked[:, n:-1], stacked[:, -1], np.array(outputs), spread)

    def _left(self, samples: Samples) -> Samples:
        """Samples whose outputs are what the model leaves of them: on a slow clock directions change too late."""
        assert samples.y is not None
        return replace(samples, y=samples.y - ModelRows.of(self.base, ()).predict(samples, self.values))

    def _piece(self, samples: Samples) -> list[Floats]:
        """[W C y] of every output, from what the model leaves of it."""
        load = self.base.predict(samples.q, samples.qd, samples.qdd, self.values, None, dict(samples.inputs))
        blocks = list(ModelRows.of(self.base, [samples]).blocks())
        found = [np.concatenate([b.matrices[k] for b in blocks]) for k in range(load.shape[1])]
        columns = ModelRows.of(self.base, ()).layout.columns
        left = [np.concatenate([b.y[k] for b in blocks]) for k in range(load.shape[1])]
        y = [r + w @ self.values[[*some]] for r, w, some in zip(left, found, columns, strict=True)]
        tried: list[tuple[_Place, _Effect]] = []
        for place in self.places:
            others = [other for other in self.places if other is not place]
            usual = self.usual.setdefault(place.name, _Usual.of(place, samples))
            effects = list(_effects(place, others, samples, load[:, place.output], usual))
            _, forces, moving = rows_taken(samples, np.stack([f for e in effects for f in e.forces], axis=1))
            used = slice(None) if moving is None else moving[:, place.output]
            found[place.output] = np.column_stack([found[place.output], forces[used]])
            tried += [(place, replace(effect, forces=())) for effect in effects for _ in effect.forces]
        self.columns = self.columns or tried
        return [np.column_stack([table, values]) for table, values in zip(found, y, strict=True)]


# -- the least squares -----------------------------------------------------------------------------------------------


def _selected(trial: _Trial, first: _Rows, last: _Rows) -> Iterator[Missing]:
    """The best effect, then the best beside it, and so on."""
    groups: dict[str, list[int]] = {}
    for column, (_, effect) in enumerate(trial.columns):
        groups.setdefault(effect.follows, []).append(column)
    for _ in range(_NAMED):
        fit = _Fit.of(first, last)
        tested = (_Test(trial, fit, fit.seen(columns)) for columns in groups.values())
        best = max((test for test in tested if test.named), key=lambda test: test.score, default=None)
        if best is None:
            return
        alone = _Test(trial, fit, [c for c in best.columns if trial.columns[c][0].output in best.named])
        if not alone.named:
            return
        yield alone.missing()
        kind = alone.kind
        groups = {words: columns for words, columns in groups.items() if not kind or kind not in words}
        first, last = (
            replace(rows, model=np.hstack([rows.model, rows.effects[:, alone.columns]])) for rows in (first, last)
        )


@dataclass(frozen=True)
class _Fit:
    """Least squares on the fitted rows: what it leaves of outputs and effects, there and on held-out rows."""

    first: _Rows
    last: _Rows
    effects: tuple[Floats, Floats]  # without what the model can say
    residuals: tuple[Floats, Floats]

    @staticmethod
    def of(first: _Rows, last: _Rows) -> _Fit:
        scales = safe_norms(first.model)
        inverse = np.linalg.pinv(first.model / scales, rcond=1e-9) / scales[:, None]
        effects, values = inverse @ first.effects, inverse @ first.y
        return _Fit(
            first,
            last,
            (first.effects - first.model @ effects, last.effects - last.model @ effects),
            (first.y - first.model @ values, last.y - last.model @ values),
        )

    def seen(self, columns: Sequence[int]) -> list[int]:
        """Those of some columns that the model cannot say already."""
        whole, left = (column_norms(some[:, columns]) for some in (self.first.effects, self.effects[0]))
        return [c for c, a, b in zip(columns, whole, left, strict=True) if b > _SEEN * a]


@dataclass(frozen=True)
class _Test:
    """Some effects beside the model."""

    trial: _Trial
    fit: _Fit
    columns: Sequence[int]

    @cached_property
    def _values(self) -> Floats:
        some = self.fit.effects[0][:, self.columns]
        sizes = column_norms(some)
        return np.linalg.lstsq(some / sizes, self.fit.residuals[0], rcond=1e-3)[0] / sizes

    @cached_property
    def _squares(self) -> tuple[tuple[Floats, Floats], ...]:
        """Squares by output before and after, of fitted and of held-out rows."""
        parts = zip((self.fit.first, self.fit.last), self.fit.residuals, self.fit.effects, strict=True)
        return tuple((rows.squares(r), rows.squares(r - c[:, self.columns] @ self._values)) for rows, r, c in parts)

    @cached_property
    def named(self) -> dict[int, list[int]]:
        """Columns of the effects that matter, by output."""
        by_output: dict[int, list[int]] = {}
        for column in self.columns:
            by_output.setdefault(self.trial.columns[column][0].output, []).append(column)
        return {output: columns for output, columns in by_output.items() if self._matters(output, columns)}

    def _matters(self, output: int, columns: list[int]) -> bool:
        """Whether an effect removes enough of an output's squares: by itself, of the fitted and of held-out rows."""
        (before, after), (old, new) = ((first[output], second[output]) for first, second in self._squares)
        spread = self.fit.last.spread[output]
        if not (before and old and new < spread):
            return False
        values = self._values[[list(self.columns).index(column) for column in columns]]
        own = self.fit.first.squares(self.fit.effects[0][:, columns] @ values)[output]
        share = min(own / before, 2 * (1 - after / before), 1 - new / old)
        least = 1 if self._weight == 1 else _RARELY
        return any(share > least * removed and old - new > gained * spread for removed, gained in _CLEAR)

    @property
    def kind(self) -> str:
        """Part of the words of effects of which one is enough."""
        words = self.trial.columns[self.columns[0]][1].follows
        return next((kind for kind in ("Stribeck", "of the range") if kind in words), "")

    @property
    def _weight(self) -> float:
        return self.trial.columns[self.columns[0]][1].weight

    @property
    def score(self) -> float:
        """How much better held-out rows are predicted, over all outputs."""
        old, new = self._squares[1]
        some = (old > 0) & (new > 0)
        return self._weight * float(np.log(old[some] / new[some]).sum())

    def missing(self) -> Missing:
        """The effects that matter, by place."""
        (old, new), spread = self._squares[1], self.fit.last.spread
        chosen = {k: self.trial.columns[columns[0]] for k, columns in self.named.items()}
        return Missing(
            next(effect.follows for _, effect in chosen.values()),
            self._weight == 1,
            tuple(place.name for place, _ in chosen.values()),
            tuple(effect.entry for _, effect in chosen.values()),
            tuple(float(1 - old[k] / spread[k]) for k in chosen),
            tuple(float(1 - new[k] / spread[k]) for k in chosen),
        )
