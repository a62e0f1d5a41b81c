"""One judge: all hypotheses are scored by how well held-out blocks are predicted, and the best ones are taken.

Round after round the hypothesis that predicts best joins the model, until none is worth it.  Of those within one
standard error of the best the most usual one is taken, of these the one with the fewest columns.  A continuous change
is then made in earnest, with the size that the fit finds, until the size stands.

Other readings of the logs are judged by parameters of robots that can exist.  These are never better than free ones,
so that readings are tried in the order of free fits until that exceeds the best one found, and few programmes are
solved.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import exp, inf, log

import numpy as np

from echelon.arrays import Floats
from echelon.base.model import BaseModel
from echelon.errors import EchelonError
from echelon.identification.judge.changes import payloads, warming
from echelon.identification.judge.effects import effects
from echelon.identification.judge.evidence import Evidence, Fit, Gain, HeldOut, Products, States, fitted
from echelon.identification.judge.gains import own_gains
from echelon.identification.judge.hypothesis import Kind, Knob, Reading, Term, Usual
from echelon.identification.judge.knobs import gain, load_of, slopes, turned
from echelon.identification.judge.readings import Readings
from echelon.identification.physics.feasibility import nearest_physical

ROUNDS = 8  # hypotheses that are taken at most
SHOWN = 4  # of each round, hypotheses that are told beside the one that was taken
SURE = 4.0  # standard errors of a gain from which on it is more than chance among some hundred hypotheses
WORTH = 1.6e-3
"""Share of an output's squares that a hypothesis removes at least, times the root of the R² that it adds: a twentieth
of the squares where that adds a thousandth to R², half of them where it adds a hundred-thousandth."""
READ = 0.3  # gain of another reading of the logs from which on it is taken: it leaves three quarters of residuals
READ_ELSEWHERE = 0.7  # the same of a log that was not fitted, which may be of another day
_RARER = 3.0  # times WORTH, for hypotheses that are rarely true
_NEW = 1e-4  # least share of a column that the model cannot say already
_SETTLED, _STEPS = 1e-3, 6  # change of a size, by its standard error or itself, and most Gauss–Newton steps
_PROGRAMMES = 16  # physical programmes that are solved at most
_LARGEST = 120  # base parameters beyond which physics is not asked: programmes of that size take seconds
_ALTERNATIVES = 2  # readings that are named together, because nothing tells them apart
_FLOOR = 1e-4  # of an output's spread: smaller residuals count as equal
_HALVINGS = 5  # of a Gauss–Newton step at most
_UNITS = (1e-3, 1e3)  # rates by that taken, where ms and s were confused
_RATES = (*np.geomspace(0.1, 10, 31), *_UNITS)  # that are tried first
_FINER_RATES = ((1.17, 9), (1.03, 9))  # then, how far from the best one, and how many
_SAME_RATE = 0.05  # relative difference from which on a rate is another one


@dataclass(frozen=True)
class Judged:
    """A hypothesis that was judged."""

    kind: Kind
    words: str
    write: str  # what a set-up says to state it, with {at} for places; empty where nothing states it
    usual: Usual
    gain: Gain
    places: tuple[str, ...] = ()
    entries: tuple[str, ...] = ()  # what states it, by place
    before: tuple[float, ...] = ()  # R² on held-out rows, by place
    after: tuple[float, ...] = ()
    size: float = 1.0  # of a continuous change: times a rate or gain
    gravity: tuple[float, ...] | None = None  # that it finds, m/s² in the base frame
    taken: bool = True

    @property
    def shrinkage(self) -> float:
        """Per cent by which it makes residuals of all outputs smaller, as a geometric mean."""
        return 100 * (1 - exp(-self.gain.mean))

    @property
    def is_rotor(self) -> bool:
        """Whether it is the inertia of rotors."""
        return any("rotor_inertia" in entry for entry in self.entries)


@dataclass(frozen=True)
class _Candidate:
    judged: Judged
    terms: tuple[Term, ...]
    left: Floats  # squares by block and output
    start: Floats | None = None  # sizes of a continuous change to start from
    columns: Mapping[int, list[int]] = field(default_factory=dict)  # of its terms, by their numbers


@dataclass
class Judge:
    """Takes hypotheses into a model of some states, one after another."""

    base: BaseModel
    states: States
    readings: Readings
    doubtful: bool = True  # whether other readings are tried, each of which may take a physical programme
    prior: Floats | None = None  # base parameters that decide between readings that do alike
    values: Floats | None = None  # base parameters that are known, as of a log that was not fitted
    told: list[Judged] = field(default_factory=list, init=False)  # those that were taken, and the next best
    terms: list[Term] = field(default_factory=list, init=False)  # columns that were taken

    def __post_init__(self) -> None:
        self.evidence = Evidence(self.base, self.states)

    @property
    def is_told(self) -> bool:
        """Whether some output varies in rows that move, so that there is anything to judge."""
        return bool((self.evidence.products(self.states).spread > 0).any())

    def run(self) -> list[Judged]:
        """Hypotheses that are taken, in their order; :attr:`told` has others beside them."""
        taken: list[Judged] = []
        while len(taken) < ROUNDS:
            small, others = self._small()
            large = self.other_reading() if self.doubtful and not taken else None
            if large is not None and (small is None or not self._does_as_well(small, large[0])):
                self.told += [large[0], *others]
                return [*taken, large[0]]  # what is left then is judged when the set-up is mended
            if small is None:
                break
            taken.append(self._taken(small))
            self.told += [taken[-1], *others]
        return taken

    def _does_as_well(self, small: _Candidate, large: Judged) -> bool:
        """Whether columns of the fit explain as much as another reading of the logs, or a robot that can exist does."""
        if small.judged.gain.mean >= large.gain.mean:
            return True
        before, after = self._physical(self.states), None
        if small.judged.kind is Kind.GAIN:  # whose slope says little of a gain that is far from one
            after = self._physical(self._settled(small)[1])
        return before is not None and after is not None and _between(before, after).mean > large.gain.mean - READ_ALIKE

    # -- columns -------------------------------------------------------------------------------------------------

    def _small(self) -> tuple[_Candidate | None, list[Judged]]:
        """The best hypothesis that is columns of the fit, and others that do well."""
        model, first = self._fit(self.states)
        values = first.values[: self.base.rank]
        tried = [
            *effects(self.base.mechanism, self.states, self.states.predicted(self.base, values)),
            *payloads(self.base, self.states),
            *warming(self.base, self.states),
            *turned(self.base, self.states, values),
        ]
        products = self.evidence.products(self.states, [t.signals for t in (*self.terms, *tried)])
        kept = products.size - sum(term.width for term in tried)
        trial = _Trial(products, HeldOut(products, np.arange(kept), first.noise), tried)
        found = [c for columns in _grouped(tried, kept) if (c := trial.candidate(columns)) is not None]
        found += self._foreign_gains(model, first)
        sure = [c for c in found if c.judged.gain.ratio > SURE]
        if not sure:
            return None, []
        best = max(sure, key=lambda c: c.judged.gain.mean)
        alike = [c for c in sure if c is best or Gain.of(c.left, best.left, trial.floor).is_none]
        chosen = min(alike, key=lambda c: (c.judged.usual, sum(t.width for t in c.terms), -c.judged.gain.mean))
        others = sorted((c for c in sure if c is not chosen), key=lambda c: -c.judged.gain.mean)[:SHOWN]
        chosen = _of_position(trial.pruned(chosen), alike)
        return chosen, [replace(c.judged, taken=False) for c in others]

    def _foreign_gains(self, model: Products, fit: Fit) -> list[_Candidate]:
        """Outputs in other units, such as currents, whose gains are too far from one for derivatives."""
        gains = own_gains(self.base, model)
        if not gains:
            return []
        kept, other = np.arange(model.size), model
        for output, factor in gains.items():
            other = other.scaled(output, factor)
        before = HeldOut(model, kept, fit.noise).squares()
        after = HeldOut(other, kept, fitted(other).noise).squares()
        names = tuple(self.readings.outputs[output] for output in gains)
        knob, load = gain(list(gains), names), np.zeros_like(self.states.y)
        signals = slopes(self.base, self.states, fit.values[: self.base.rank], knob, np.zeros(len(gains)), load)
        term = Term(Kind.GAIN, "the gains of outputs", ", ".join(names), "", Usual.OFTEN, signals, knob)
        found, spread = Gain.of(before, after, _FLOOR**2 * model.spread), np.maximum(model.spread, _TINY)
        old, new = (tuple(1 - squares.sum(axis=0)[k] / spread[k] for k in gains) for squares in (before, after))
        entries = ("",) * len(names)
        judged = Judged(Kind.GAIN, term.words, "", term.usual, found, names, entries, old, new)
        return [_Candidate(judged, (term,), after, np.log(list(gains.values())))]

    def _taken(self, chosen: _Candidate) -> Judged:
        judged = chosen.judged
        if chosen.terms[0].knob is None:
            self.terms += chosen.terms
        else:
            judged, self.states = self._settled(chosen)
        self.evidence = Evidence(self.base, self.states)
        return judged

    def _settled(self, chosen: _Candidate) -> tuple[Judged, States]:
        """A continuous change that is made in earnest, by Gauss–Newton steps until its size stands."""
        (term, *_), start, rank = chosen.terms, self.states, self.base.rank
        knob = term.knob
        assert knob is not None
        sizes = np.zeros(knob.count) if chosen.start is None else chosen.start
        errors, load = np.zeros(knob.count), load_of(self.base, start, self._fit(start)[1].values[:rank])
        states = knob.moved(start, sizes, load)
        for _ in range(_STEPS):
            values = self._fit(states)[1].values[:rank]
            load = load_of(self.base, start, values)
            signals = slopes(self.base, start, values, knob, sizes, load)
            fit = fitted(self.evidence.products(states, [*(t.signals for t in self.terms), signals]))
            change = fit.values[-knob.count :]
            errors = fit.errors[-knob.count :]
            change, states = self._stepped(start, knob, sizes, change, load)
            sizes = sizes + change
            if (np.abs(change) < _SETTLED * np.maximum(errors, np.abs(sizes))).all():
                break
        words, write = knob.says(sizes, errors)
        gravity = None if term.kind is not Kind.GRAVITY or states.gravity is None else tuple(states.gravity.tolist())
        size = float(np.exp(sizes[0])) if term.kind in (Kind.GAIN, Kind.RATE) else 1.0
        return replace(chosen.judged, words=words, write=write, size=size, gravity=gravity), states

    def _stepped(self, start: States, knob: Knob, sizes: Floats, change: Floats, load: Floats) -> tuple[Floats, States]:
        """A change of sizes that is halved until the fit is no worse, and the states after it."""
        now = self._left(knob.moved(start, sizes, load))
        for _ in range(_HALVINGS):
            states = knob.moved(start, sizes + change, load)
            if self._left(states) <= now:
                return change, states
            change = change / 2
        return np.zeros_like(change), knob.moved(start, sizes, load)

    def _left(self, states: States) -> float:
        products, fit = self._fit(states)
        return float(_marks(products, fit.values).mean())

    def _fit(self, states: States) -> tuple[Products, Fit]:
        products = self.evidence.products(states, [term.signals for term in self.terms])
        return products, fitted(products)

    # -- readings ------------------------------------------------------------------------------------------------

    def other_reading(self, *, only_clock: bool = False) -> tuple[Judged, Reading] | None:
        """The reading of the logs with which a robot that can exist explains far more, if there is one."""
        before = self._physical(self.states)
        tried = self._clocks() if only_clock else (*self.readings.all(), *self._clocks())
        found = self._programmes(tried, inf if before is None else float(before.mean()))
        if before is None or not found:
            return None
        best = min((marks for marks, _ in found), key=lambda marks: float(marks.mean()))
        gain = _between(before, best)
        if gain.mean < (READ if self.values is None else READ_ELSEWHERE) or gain.ratio < SURE:
            return None
        alike = [reading for marks, reading in found if marks is best or _between(marks, best).is_none]
        most = min(reading.usual for reading in alike)
        alike = self._likely([reading for reading in alike if reading.usual == most])
        if len(alike) > _ALTERNATIVES:
            return None
        words, shares = ", or ".join(reading.words for reading in alike), (exp(before.mean()), exp(best.mean()))
        judged = Judged(Kind.READING, words, "", most, gain, before=shares[:1], after=shares[1:], size=alike[0].rate)
        gravity = None if alike[0].gravity is None else tuple(alike[0].gravity.tolist())
        return replace(judged, gravity=gravity), alike[0]

    def _programmes(self, tried: Iterable[Reading], before: float) -> list[tuple[Floats, Reading]]:
        """Readings with the marks of physical parameters, those that could be the best."""
        free = [(marks.mean(), reading) for reading in tried if (marks := self._free(reading)) is not None]
        free.sort(key=lambda entry: round(float(entry[0]), 2))  # of equal ones those that happen more often come first
        best, found = before - READ, []
        for mark, reading in free[:_PROGRAMMES]:
            if mark > best + READ_ALIKE:
                break
            marks = self._physical(reading.read(self.states))
            if marks is not None:
                found.append((marks, reading))
                best = min(best, float(marks.mean()))
        return found

    def _likely(self, alike: list[Reading]) -> list[Reading]:
        """Those of several readings with which the prior predicts best: a mirrored robot can exist as well."""
        if self.prior is None or len(alike) < 2:
            return alike
        products = [self.evidence.products(reading.read(self.states)) for reading in alike]
        marks = [float(_marks(some, self.prior).mean()) for some in products]
        return [reading for mark, reading in zip(marks, alike, strict=True) if mark <= min(marks) + READ_ALIKE]

    def _clocks(self) -> Iterator[Reading]:
        """The rate that explains most, if it is not the one that was taken."""

        def mark(rate: float) -> float:
            found = self._free(self.readings.clock(rate))
            return inf if found is None else float(found.mean())

        rate = min(map(float, _RATES), key=mark)
        for width, count in _FINER_RATES if rate not in _UNITS else ():
            rate = min((float(some) for some in rate * width ** np.linspace(-1, 1, count)), key=mark)
        if abs(log(rate)) > _SAME_RATE:
            yield self.readings.clock(rate)

    def _free(self, reading: Reading) -> Floats | None:
        """Marks of any parameters; None where nothing can be told, as with loops that do not close."""
        try:
            products, fit = self._fit(reading.read(self.states))
        except EchelonError:
            return None
        return _marks(products, self._known(fit.values))

    def _physical(self, states: States) -> Floats | None:
        """Marks of parameters of the nearest robot that can exist; None where none is found."""
        try:
            products, fit = self._fit(states)
            values, rank = fit.values.copy(), self.base.rank
            if self.values is None and rank <= _LARGEST:
                covariance = fit.covariance[:rank, :rank]
                standard, _ = nearest_physical(self.base, values[:rank], covariance)
                values[:rank] = self.base.B_float(states.symbols) @ standard
        except (EchelonError, np.linalg.LinAlgError):
            return None
        return _marks(products, self._known(values))

    def _known(self, values: Floats) -> Floats:
        return values if self.values is None else np.append(self.values, values[self.base.rank :])


READ_ALIKE = 0.07  # differences of marks of readings up to which they do alike: 7 % of what is left


@dataclass(frozen=True)
class _Trial:
    """Columns of all hypotheses beside a model."""

    products: Products
    held: HeldOut
    tried: Sequence[Term]

    @property
    def floor(self) -> Floats:
        """Squares that count as none, shape (outputs,)."""
        return _FLOOR**2 * self.products.spread

    def candidate(self, columns: dict[int, list[int]]) -> _Candidate | None:
        """A hypothesis at the places where it matters, given by columns of its terms; None if there are none."""
        columns = {term: [c for c in some if self.held.new([c])[0] > _NEW] for term, some in columns.items()}
        columns = {term: some for term, some in columns.items() if some and self._can_be(self.tried[term], some)}
        before = after = self.held.squares()
        while columns:
            after = self.held.squares([c for some in columns.values() for c in some])
            worth = {term: some for term, some in columns.items() if self._is_worth(self.tried[term], before, after)}
            if len(worth) == len(columns):
                break
            columns = worth
        if not columns:
            return None
        terms, spread = tuple(self.tried[term] for term in columns), np.maximum(self.products.spread, _TINY)
        outputs = [max(_shown(t, before), key=lambda k: float((before - after)[:, k].sum() / spread[k])) for t in terms]
        old, new = (tuple(float(1 - e[:, k].sum() / spread[k]) for k in outputs) for e in (before, after))
        entries, names = tuple(t.write for t in terms), tuple(t.place for t in terms)
        gain = Gain.of(before, after, self.floor)
        judged = Judged(terms[0].kind, terms[0].words, entries[0], terms[0].usual, gain, names, entries, old, new)
        return _Candidate(judged, terms, after, columns=columns)

    def pruned(self, chosen: _Candidate) -> _Candidate:
        """A hypothesis at those of its places that matter beside the others."""
        columns = dict(chosen.columns)
        for term in chosen.columns if len(columns) > 1 else ():
            others = [c for other, some in columns.items() if other != term for c in some]
            if others and not self._is_worth(self.tried[term], self.held.squares(others), chosen.left):
                del columns[term]
        kept = self.candidate(columns) if len(columns) < len(chosen.columns) else None
        return kept or chosen

    def _can_be(self, term: Term, columns: list[int]) -> bool:
        return not term.positive or bool((self.held.sizes(columns) > 0).all())

    def _is_worth(self, term: Term, before: Floats, after: Floats) -> bool:
        least = WORTH * (_RARER if term.usual is Usual.RARELY else 1.0)
        for output in _shown(term, before):
            old, new, spread = before[:, output].sum(), after[:, output].sum(), self.products.spread[output]
            if new < old and new < spread and (old - new) / old * np.sqrt((old - new) / spread) > least:
                return True
        return False


_TINY = np.finfo(float).tiny


def _shown(term: Term, squares: Floats) -> Iterable[int]:
    """Outputs in which a term may show: what is read otherwise moves parameters that all outputs share."""
    if term.kind is Kind.GAIN:
        return range(squares.shape[1])
    return term.signals


def _of_position(chosen: _Candidate, alike: Sequence[_Candidate]) -> _Candidate:
    """Functions of a joint's position that nothing tells apart are some function of it."""
    places = set(chosen.judged.places)
    same = [c for c in alike if c.terms[0].of_position and places <= set(c.judged.places)]
    if chosen.judged.usual is not Usual.RARELY or not chosen.terms[0].of_position or len(same) < _ALTERNATIVES:
        return chosen
    words = f"something that depends on the position, such as {chosen.judged.words}"
    return replace(chosen, judged=replace(chosen.judged, words=words))


def _marks(products: Products, values: Floats) -> Floats:
    """Logarithms of residuals over spread, by block, means of the outputs; shape (blocks,)."""
    told = products.spread > 0
    shares = products.squares(values)[:, told] * len(products.counts) / products.spread[told]
    return np.asarray(0.5 * np.log(np.maximum(shares, _FLOOR**2)).mean(axis=1))


def _between(before: Floats, after: Floats) -> Gain:
    differences = before - after
    return Gain(float(differences.mean()), float(differences.std(ddof=1) / np.sqrt(len(differences))))


def _grouped(tried: Sequence[Term], first: int) -> list[dict[int, list[int]]]:
    """Columns of terms, those of the same words together."""
    found: dict[str, dict[int, list[int]]] = {}
    for number, term in enumerate(tried):
        found.setdefault(term.words, {})[number] = list(range(first, first + term.width))
        first += term.width
    return list(found.values())
